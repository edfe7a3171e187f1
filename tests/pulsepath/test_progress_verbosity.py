"""How much is said, and in what dress: -q and -v before or after the command, NO_COLOR,
terminals.
"""

import os
import subprocess
import sys

import click
import pytest

from pulsepath.cli import main
from pulsepath.progress import VERBOSE, level, step


@pytest.mark.usefixtures("planned")
def test_quiet_says_the_result_alone(call, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "benchmarks.reports.plan_report.write_report", lambda report, page: page.write_text("")
    )
    arguments = [
        "plan",
        "bare-circle",
        "--out",
        tmp_path / "o",
        "--no-figures",
        "--json",
        "--force",
    ]
    usual = call(*arguments)
    assert usual.exit_code == 0
    assert "writing the report …" in usual.stderr
    for quiet in (call("-q", *arguments), call(*arguments, "--quiet")):
        assert (quiet.exit_code, quiet.stdout, quiet.stderr) == (0, usual.stdout, "")


def test_quiet_still_tells_errors(call):
    done = call("-q", "check", "circel")
    assert (done.exit_code, done.stdout) == (2, "")
    assert 'nearest is "circle"' in done.stderr


def test_verbose_says_how(call, tmp_path):
    program = tmp_path / "line.nc"
    program.write_text("G21 G90\nG1 X5 Y2 F1200\n", encoding="utf-8")
    few = ("--no-figures", "--no-baselines", "--no-worth", "--json", "--force")
    arguments = ["plan", program, "--machine", "corexy", "--whole", "--out", tmp_path / "o", *few]
    for done in (call("--verbose", *arguments), call(*arguments, "-v")):
        assert done.exit_code == 0
        assert "order 3, solve rounds: " in done.stderr
        assert "runs between stops: 1 by " in done.stderr
    assert "iterations" not in call(*arguments).stderr


def test_both_at_once_are_refused(call):
    for arguments in (["-q", "machines", "-v"], ["machines", "-q", "-v"]):
        done = call(*arguments)
        assert done.exit_code == 2
        assert "exclude each other" in done.stderr


def test_every_command_takes_them_and_they_end_with_it(call):
    def commands(group):
        for command in group.commands.values():
            yield command
            if isinstance(command, click.Group):
                yield from commands(command)

    flags = [
        {flag for option in command.params for flag in option.opts} for command in commands(main)
    ]
    assert len(flags) > 15
    assert all({"-q", "--quiet", "-v", "--verbose"} <= each for each in flags)
    with click.Context(main) as context:
        context.meta["pulsepath.progress"] = VERBOSE
        assert level() == VERBOSE
    assert level() != VERBOSE


def on_a_terminal(arguments, **environment):
    """What a command shows on a terminal of its own."""
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    clean = {
        name: value
        for name, value in os.environ.items()
        if name not in ("NO_COLOR", "TERM", "FORCE_COLOR")
    }
    process = subprocess.Popen(
        [sys.executable, *arguments],
        stdout=theirs,
        stderr=theirs,
        stdin=theirs,
        env=clean | environment,
    )
    os.close(theirs)
    shown = b""
    try:
        while part := os.read(ours, 4096):
            shown += part
    except OSError:  # so Linux says that the other end is closed
        pass
    process.wait()
    os.close(ours)
    return shown


STEP = "from pulsepath.progress import step\nwith step('work') as tell: tell(1, 2); time.sleep(.2)"
TABLES = "from pulsepath.cli import main\nmain(['rigs'], standalone_mode=False)"
ALL = f"""
import time
{STEP}
{TABLES}
for arguments in (["--help"], ["compare", "servorig", "--out", "nowhere"]):
    try:
        main(arguments, prog_name="pulsepath")
    except SystemExit:
        pass
"""
"""Progress, a table, help and an error."""


@pytest.mark.parametrize(
    "environment", [{"NO_COLOR": "1", "TERM": "xterm"}, {"TERM": "dumb"}], ids=["NO_COLOR", "dumb"]
)
def test_no_escape_codes_where_none_are_wanted(environment):
    shown = on_a_terminal(["-c", ALL], **environment)
    for part in (b"work", b"servo-rig", b"Usage", b"no rig is called"):
        assert part in shown
    assert b"\x1b" not in shown


@pytest.mark.parametrize("what", [TABLES, f"import time\n{STEP}"], ids=["table", "progress"])
def test_a_terminal_that_has_them_gets_them(what):
    assert b"\x1b[" in on_a_terminal(["-c", what], TERM="xterm-256color")


def test_none_but_on_a_terminal():
    environment = {**os.environ, "FORCE_COLOR": "1", "TERM": "xterm-256color"}
    done = subprocess.run([sys.executable, "-c", ALL], capture_output=True, env=environment)
    assert b"servo-rig" in done.stdout
    assert b"no rig is called" in done.stderr
    assert b"\x1b" not in done.stdout + done.stderr


def test_a_step_outside_of_the_command_line_is_told_as_usual(capsys):
    with step("counting"):
        pass
    assert capsys.readouterr().err == "counting …\n"
