"""Ctrl-C, or a request to end, at any moment: nothing is left that is not whole, and that is told."""

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from importlib import import_module

import casadi
import pytest

from pulsepath.process.ending import EndSignal, raise_on_signal

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a process there cannot be sent these signals")

PLAN = ("plan", "bare-circle", "--order", "2", "--out", "there/out")
MOMENTS = {
    "plan, at the start": (PLAN, None, "out"),
    "plan, planning": (PLAN, "planning bare-circle", "out"),
    "plan, the report": (PLAN, "writing the report", "out"),
    "import": (("import", "part.nc", "--out", "there/out.toml"), "reading", "out.toml"),
    "calibrate": (("calibrate", "hexapod", "cmm", "--out", "there/out"), "identifying", "out"),
    "export": (("export", "plan", "--format", "vcd", "--out", "there/out.vcd"), "reading pulses", "out.vcd"),
    "track": (("track", "there", "--law", "3"), "tracking", "track.json"),
    "compare": (("compare", "--law", "6", "--task", "line", "--out", "there"), "running", "compare.json"),
}


def interrupted(folder, arguments, moment, number=signal.SIGINT, again=False):
    """Exit code and stderr of a command to which a signal is sent once it says that it begins something.

    moment  None: as soon as the command line has loaded
    """
    process = subprocess.Popen(
        [sys.executable, "-X", "importtime", "-m", "pulsepath", *arguments] if moment is None
        else [sys.executable, "-m", "pulsepath", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.getcwd()},  # noqa: PTH109
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background job ignores it
    )  # fmt: skip
    begun = "numpy" if moment is None else moment  # the first that a command loads, after the command line itself
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
    (tmp_path / "part.nc").write_text("G21 G90\n" + "".join(f"G1 X{n % 7} Y{n % 11} F600\n" for n in range(30_000)))
    before = names(there)
    again = moment is None or "report" in moment or "identifying" in moment
    code, told = interrupted(tmp_path, arguments, moment, again=again)
    assert code == 130
    assert "Traceback" not in told
    said = [line for line in told.splitlines() if not line.startswith("import time:")]  # processes beside it say too
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
    code, told = interrupted(tmp_path, (*PLAN, "--force"), "writing the report", signal.SIGTERM)
    assert code == 143
    assert told.splitlines()[-1] == "interrupted: nothing was written to there/out, which is unchanged"
    assert names(there) == ["out"]
    assert {path.name: path.stat().st_mtime_ns for path in (there / "out").iterdir()} == before


@pytest.mark.usefixtures("planned")
def test_after_it_is_written_that_is_said(call, tmp_path, monkeypatch):
    def come(_):
        raise KeyboardInterrupt

    monkeypatch.setattr("pulsepath.output.tables.sum_up", come)
    monkeypatch.setattr("benchmarks.reports.plan_report.write_report", lambda report, page: page.write_text(""))
    done = call("plan", "bare-circle", "--out", tmp_path / "o")
    assert done.exit_code == 130
    assert done.stderr.splitlines()[-1] == f"interrupted, after {tmp_path / 'o'} had been written"
    assert (tmp_path / "o" / "plan.json").exists()


def test_what_casadi_would_swallow_is_given_again():
    """It calls Python to convert what it is given, and clears whatever is raised there."""

    class Late:
        @property
        def shape(self):
            signal.raise_signal(signal.SIGINT)
            raise AttributeError

    def told_while_it_converts():
        with raise_on_signal():
            with suppress(Exception):
                casadi.sin(Late())
            time.sleep(5)  # which it ends

    with pytest.raises(EndSignal):
        told_while_it_converts()


def test_a_module_that_is_being_loaded_is_loaded_first(tmp_path, monkeypatch):
    """A compiled one would make an ImportError of it, or abort."""
    (tmp_path / "slowly_loaded.py").write_text(
        "import signal, time\nsignal.raise_signal(signal.SIGTERM)\ntime.sleep(0.01)\nloaded = True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)

    def load():
        with raise_on_signal():
            import_module("slowly_loaded")
            time.sleep(5)  # which it ends

    with pytest.raises(EndSignal):
        load()
    assert sys.modules.pop("slowly_loaded").loaded
