"""Ctrl-C, or a request to end, at any moment: nothing is left that is not whole, and that is
told.
"""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pulsepath.process.ending import GRACE_PERIOD, REPEAT_TIME

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="a process there cannot be sent these signals"
)

PLAN = ("plan", "bare-circle", "--order", "2", "--bound", "none", "--out", "there/out")
UNDRAWN = (*PLAN, "--no-figures", "--no-baselines")
"""With little to do before its report."""
MOMENTS = {
    "plan, at the start": (PLAN, None, "out"),
    "plan, planning": (PLAN, "planning bare-circle", "out"),
    "plan, the report": (UNDRAWN, "writing the report", "out"),
    "import": (("import", "part.nc", "--out", "there/out.toml"), "reading", "out.toml"),
    "calibrate": (("calibrate", "hexapod", "cmm", "--out", "there/out"), "identifying", "out"),
    "export": (
        ("export", "plan", "--format", "vcd", "--out", "there/out.vcd"),
        "reading pulses",
        "out.vcd",
    ),
    "track": (("track", "there", "--law", "3"), "tracking", "track.json"),
    "compare": (
        ("compare", "--law", "6", "--task", "line", "--out", "there"),
        "running",
        "compare.json",
    ),
}


def launch(folder, *arguments, stdout=subprocess.PIPE):
    """Start Python in a folder, with this project."""
    return subprocess.Popen(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.getcwd()},  # noqa: PTH109
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        # a shell's background job ignores it
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def interrupted(folder, arguments, moment, number=signal.SIGINT, again=False):
    """Exit code and stderr of a command to which a signal is sent once it says that it begins
    something.

    moment  None: as soon as the command line has loaded
    """
    options = ("-X", "importtime") if moment is None else ()
    process = launch(folder, *options, "-m", "pulsepath", *arguments)
    begun = (
        "numpy" if moment is None else moment
    )  # the first that a command loads, after the command line itself
    seen = ""
    for line in process.stderr:
        seen += line
        if begun in line:
            break
    process.send_signal(number)
    if again:
        time.sleep(0.02)
        process.send_signal(number)
    _, rest = process.communicate(timeout=60)
    return process.returncode, seen + rest


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize(("arguments", "moment", "target"), MOMENTS.values(), ids=MOMENTS)
def test_nothing_is_written_and_that_is_said(tmp_path, directory, arguments, moment, target):
    there = tmp_path / "there"
    if arguments[0] == "track":
        shutil.copytree(directory, there)
    else:
        there.mkdir()
    if arguments[0] == "export":
        (tmp_path / "plan").symlink_to(directory)
    (tmp_path / "part.nc").write_text(
        "G21 G90\n" + "".join(f"G1 X{n % 7} Y{n % 11} F600\n" for n in range(30_000))
    )
    before = names(there)
    again = moment is None or "report" in moment or "identifying" in moment
    code, told = interrupted(tmp_path, arguments, moment, again=again)
    assert code == 130
    assert "Traceback" not in told
    said = [
        line for line in told.splitlines() if not line.startswith("import time:")
    ]  # processes beside it say too
    assert f"interrupted: nothing was written to there/{target}" in said[-1]
    after = names(there)
    if arguments[0] == "compare":  # what was run is kept, and is said to be
        assert "are kept in there" in told
        assert not {"compare.json", "report.html", "runs.csv"} & set(after)
        after = [name for name in after if name.startswith(".")]
    assert after == before


def test_while_kernels_are_compiled(tmp_path, monkeypatch):
    """The compiler runs beside what the signal ends, and the process ends without it."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cold"))
    (tmp_path / "there").mkdir()
    code, told = interrupted(tmp_path, PLAN, "compiling numerical kernels")
    assert code == 130
    assert told.splitlines()[-1] == "interrupted: nothing was written to there/out"
    assert names(tmp_path / "there") == []


def test_what_was_there_before_stays_and_that_is_said(tmp_path, directory):
    there = tmp_path / "there"
    there.mkdir()
    shutil.copytree(directory, there / "out")
    before = {path.name: path.stat().st_mtime_ns for path in (there / "out").iterdir()}
    code, told = interrupted(tmp_path, (*UNDRAWN, "--force"), "writing the report", signal.SIGTERM)
    assert code == 143
    assert (
        told.splitlines()[-1] == "interrupted: nothing was written to there/out, which is unchanged"
    )
    assert names(there) == ["out"]
    assert {path.name: path.stat().st_mtime_ns for path in (there / "out").iterdir()} == before


@pytest.mark.usefixtures("planned")
def test_after_it_is_written_that_is_said(call, tmp_path, monkeypatch):
    def come(_):
        raise KeyboardInterrupt

    monkeypatch.setattr("pulsepath.output.tables.sum_up", come)
    monkeypatch.setattr(
        "benchmarks.reports.plan_report.write_report", lambda report, page: page.write_text("")
    )
    done = call("plan", "bare-circle", "--out", tmp_path / "o")
    assert done.exit_code == 130
    assert done.stderr.splitlines()[-1] == f"interrupted, after {tmp_path / 'o'} had been written"
    assert (tmp_path / "o" / "plan.json").exists()


SCRIPT = """
import signal, sys, time
from contextlib import suppress
from pathlib import Path
from pulsepath.__main__ import main
from pulsepath.cli import main as commands
from pulsepath.process.intent import writes
@commands.command()
def compute():
    writes(Path("a/b/out"))
    {before}
    print("computing", file=sys.stderr, flush=True)
    {work}
sys.argv = ["pulsepath", "compute"]
main()
"""
"""The command line with one more command, which loads next to nothing."""
STAGE = (
    "from kinematics.files.atomic_files import stage_directory; p = Path('a/b/out').absolute(); "
    "p.parent.mkdir(parents=True); s = stage_directory(p); s.__enter__()"
)
POOL = (
    "import pickle; from planner.parallel import open_pool; pool = open_pool(pickle.dumps(time.sleep), 1); "
    "p = pool.__enter__(); p.submit(0).future.result(); p.submit(100)"
)
SWALLOW = """
    while True:
        with suppress(BaseException):
            time.sleep(100)
"""
NOTHING_WRITTEN = "interrupted: nothing was written to a/b/out\n"


def start(folder, work, before="pass", **more):
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT.format(work=work, before=before)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.getcwd()},  # noqa: PTH109
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **more,
    )
    assert process.stderr.readline() == "computing\n"
    time.sleep(0.1)
    return process


def end(process, *numbers, pause=0.5):
    """Return stderr and the seconds from the first signal until no process holds the streams any
    more.
    """
    begin = time.monotonic()
    for number in numbers:
        process.send_signal(number)
        if number is not numbers[-1]:
            time.sleep(pause)
    said = process.communicate(timeout=60)[1]
    return said, time.monotonic() - begin


@pytest.mark.parametrize(
    ("numbers", "pause", "at_once"),
    [
        ((signal.SIGTERM, signal.SIGINT), REPEAT_TIME / 2, False),
        ((signal.SIGINT, signal.SIGTERM), REPEAT_TIME / 2, False),
        ((signal.SIGTERM, signal.SIGINT), 2 * REPEAT_TIME, True),
    ],
)
def test_a_second_signal_ends_it_at_once_unless_it_is_the_first_repeated(
    tmp_path, numbers, pause, at_once
):
    """Though what a signal raises is swallowed: the watching thread ends it, after the grace period
    or at once, and cleans up.
    """
    process = start(tmp_path, SWALLOW, STAGE)
    assert list((tmp_path / "a" / "b").iterdir())
    said, duration = end(process, *numbers, pause=pause)
    assert (process.returncode, said) == (128 + numbers[0], NOTHING_WRITTEN)
    assert duration < 2
    assert (duration < GRACE_PERIOD - 0.2) == at_once
    assert list(tmp_path.iterdir()) == []


def test_the_processes_of_its_pool_end_too(tmp_path):
    process = start(tmp_path, SWALLOW, POOL)
    said, duration = end(process, signal.SIGTERM)  # the streams are closed when all are gone
    assert (process.returncode, said) == (143, NOTHING_WRITTEN)
    assert duration < 2.5  # one of the pool ends when the first process has


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_terminal_sends_it_to_all_processes(tmp_path, number):
    process = start(tmp_path, "time.sleep(100)", POOL, start_new_session=True)
    os.killpg(process.pid, number)
    said, _ = end(process)
    assert (process.returncode, said) == (128 + number, NOTHING_WRITTEN)


def test_a_killed_process_leaves_no_process(tmp_path):
    process = start(tmp_path, "time.sleep(100)", POOL)
    _, duration = end(process, signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    assert duration < 5


def test_it_ends_while_code_runs_that_the_interpreter_waits_for(tmp_path):
    """The exit handlers take long."""
    process = start(tmp_path, "time.sleep(100)", "import atexit; atexit.register(time.sleep, 100)")
    said, duration = end(process, signal.SIGINT)
    assert (process.returncode, said) == (130, NOTHING_WRITTEN)
    assert duration < 2


CONVERTED = """
    import casadi
    class Late:
        @property
        def shape(self):
            signal.raise_signal(signal.SIGINT)
            raise AttributeError
    with suppress(Exception):
        casadi.sin(Late())
    time.sleep(100)
"""


def test_what_casadi_would_swallow_is_given_again(tmp_path):
    """It calls Python to convert what it is given, and clears whatever is raised there."""
    said, duration = end(process := start(tmp_path, CONVERTED))
    assert (process.returncode, said) == (130, NOTHING_WRITTEN)
    assert duration < GRACE_PERIOD  # else the watching thread ended it


CONVERTED_ERROR = """
    time.sleep(0.3)  # until the line before is read
    try:
        signal.raise_signal(signal.SIGTERM)
    except BaseException:
        raise RuntimeError("raised by a library")
"""


def test_an_error_that_the_signal_causes_is_an_interruption(tmp_path):
    """Some libraries raise an exception of their own in the place of any that comes."""
    said, duration = end(process := start(tmp_path, CONVERTED_ERROR))
    assert (process.returncode, said) == (143, NOTHING_WRITTEN)
    assert duration < GRACE_PERIOD


AFTER_THE_COMMAND = "import atexit; atexit.register(time.sleep, {seconds}); atexit.register(os.write, 2, b'ending\\n')"


@pytest.mark.parametrize(("seconds", "code"), [(0.5, 0), (100, 143)])
def test_a_complete_command_ends_as_it_would_unless_that_takes_long(tmp_path, seconds, code):
    """Its result is whole; only an interpreter that does not end is ended."""
    process = start(tmp_path, "pass", "import os; " + AFTER_THE_COMMAND.format(seconds=seconds))
    assert process.stderr.readline() == "ending\n"
    said, duration = end(process, signal.SIGTERM)
    assert (process.returncode, said) == (code, NOTHING_WRITTEN if code else "")
    assert duration < 2


def test_a_module_that_is_being_loaded_is_loaded_first(tmp_path):
    """A compiled one would make an ImportError of it, or abort."""
    (tmp_path / "slowly_loaded.py").write_text(
        "import signal, time\nsignal.raise_signal(signal.SIGTERM)\ntime.sleep(0.01)\nprint('loaded', flush=True)\n"
    )
    process = start(tmp_path, "import slowly_loaded; time.sleep(100)", "sys.path.append('.')")
    out, said = process.communicate(timeout=60)
    assert (process.returncode, out, said) == (143, "loaded\n", NOTHING_WRITTEN)


def test_what_ignores_hang_ups_goes_on(tmp_path):
    def ignore():
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    process = start(tmp_path, "time.sleep(0.5); raise SystemExit(7)", preexec_fn=ignore)
    end(process, signal.SIGHUP)
    assert process.returncode == 7


FORKED = """
    import os
    child = os.fork()
    if not child:
        time.sleep(100)
    time.sleep(0.1)
    os.kill(child, signal.SIGTERM)
    time.sleep({rest})
    raise SystemExit(7)
"""


def test_a_signal_to_a_child_does_not_end_its_parent(tmp_path):
    process = start(tmp_path, FORKED.format(rest=GRACE_PERIOD + 0.2))
    end(process)
    assert process.returncode == 7


def test_a_program_that_calls_it_keeps_its_signals():
    done = subprocess.run(
        [sys.executable, "-c", "import signal\nfrom click.testing import CliRunner\n"
         "from pulsepath.cli import main\n"
         "before = signal.getsignal(signal.SIGTERM)\nassert CliRunner().invoke(main, ['laws']).exit_code == 0\n"
         "assert signal.getsignal(signal.SIGTERM) is before\nassert signal.set_wakeup_fd(-1) == -1\n"],
        check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


LINES = "G21 G90 F2000\n" + "".join(f"G1 X{n % 7} Y{n % 11}\n" for n in range(3000))
CIRCLE = Path("planner/presets/bare-circle.toml").read_text()
PARTS = ("plan", "long.nc", "--machine", "corexy", "--stream", "--out", "there/a/out")
STUDIO = ("studio", "there", "--program", "circle.toml", "--no-browser", "--port", "0")
# What runs, s until a signal, and the signal.
RUNS = {
    "plan in parts": (PARTS, 1.97, signal.SIGHUP),
    "plan in parts, later": (PARTS, 3.1, signal.SIGINT),
    "studio, soon": (STUDIO, 0.9, signal.SIGINT),
    "studio": (STUDIO, 2.15, signal.SIGTERM),
}


@pytest.mark.parametrize(("arguments", "instant", "number"), RUNS.values(), ids=RUNS)
def test_a_signal_at_any_instant(tmp_path, arguments, instant, number):
    """The command ends within 2 s, and leaves no process, no traceback and nothing unfinished."""
    (tmp_path / "long.nc").write_text(LINES)
    (tmp_path / "circle.toml").write_text(CIRCLE)
    there = tmp_path / "there"
    there.mkdir()
    process = launch(tmp_path, "-m", "pulsepath", *arguments, stdout=subprocess.DEVNULL)
    time.sleep(instant)
    done = process.poll() == 0
    process.send_signal(number)
    begin = time.monotonic()
    code = process.wait(timeout=60)
    assert time.monotonic() - begin < 2
    said = process.communicate(timeout=60)[1]  # when no process holds it any more
    assert "Traceback" not in said
    # before the commands have loaded, the system itself ends the process; a complete command ends
    # as it would
    complete = code == 0 and (
        arguments[0] != "plan" or (there / "a" / "out" / "plan.json").exists()
    )
    assert code in (128 + number, -number) or done or complete
    assert not list(there.rglob("*.staged"))
    if arguments[0] == "plan" and code:
        assert not list(there.iterdir()) or "had been written" in said
