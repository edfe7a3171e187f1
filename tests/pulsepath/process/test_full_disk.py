"""Standard output and files that take no more: exit 2, and one line that names what is full."""

import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

resource = pytest.importorskip("resource", reason="limits of POSIX")

FULL = Path("/dev/full")
LINE = 'schema = 1\nlength = "mm"\n[[segment]]\nline = { to = [0, 0, 0.1] }\n'

PRINTING = {
    "version": (["--version"], ""),
    "help of a group": (["positions", "--help"], ""),
    "JSON": (["rules", "--json"], ""),
    "tables": (["rules"], ""),
    "JSON of a usage error": (["rules", "--nope", "--json"], "No such option '--nope'"),
    "JSON of an error": (["check", "none.toml", "--json"], "none.toml"),
    "JSON of what is infeasible": (["pose", "hexapod", "500,0,0", "--json"], ""),
}


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason=f"{FULL} of Linux")
@pytest.mark.parametrize(("arguments", "before"), PRINTING.values(), ids=PRINTING)
@pytest.mark.parametrize("unbuffered", [False, True])
def test_a_full_standard_output_is_bad_input_and_one_line(tmp_path, arguments, before, unbuffered):
    command = [sys.executable, *(["-u"] if unbuffered else []), "-m", "pulsepath", *arguments]
    with FULL.open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2, done.stderr
    *lines, last = done.stderr.splitlines()
    assert last == "error: standard output: No space left on device"
    assert "Traceback" not in done.stderr
    assert bool(lines) == bool(before)
    assert before in done.stderr


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason=f"{FULL} of Linux")
def test_a_console_whose_replies_cannot_be_written_says_so(tmp_path):
    command = [sys.executable, "-m", "pulsepath", "console", "--machine", "traverser", "--fast"]
    with FULL.open("w") as full:
        done = subprocess.run(
            [*command, "--state", str(tmp_path / "registers.json")],
            input="WHERE\n",
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == "error: standard output: No space left on device"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason=f"{FULL} of Linux")
@pytest.mark.parametrize(
    "arguments", [["--version"], ["check", "none.toml", "--json"], ["rules", "--nope"]]
)
def test_where_both_streams_are_full_the_code_is_right(arguments):
    with FULL.open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "pulsepath", *arguments], stdout=full, stderr=full, check=False
        )
    assert done.returncode == 2


@pytest.mark.parametrize(
    "arguments", [["--version"], ["rules"], ["rules", "--json"], ["rules", "--nope", "--json"]]
)
def test_a_reader_that_has_left_is_no_error(arguments):
    """The pipe's reading end is closed before anything is written."""
    with subprocess.Popen(
        [sys.executable, "-m", "pulsepath", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as run:
        run.stdout.close()
        said = run.stderr.read()
    assert run.returncode == (2 if "--nope" in arguments else 0)
    assert "Traceback" not in said
    assert "Errno" not in said


@contextmanager
def small_files(most):
    """Within, no file grows beyond so many bytes: the system refuses to write, as on a full
    disk.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


PLAN = (
    "plan",
    "line.toml",
    "--machine",
    "hexapod",
    "--order",
    "2",
    "--no-figures",
    "--no-baselines",
    "--out",
    "out",
)
WRITING = {
    "plan": (PLAN, "out/motion.bin", 4096),
    "plan, the program": (PLAN, "out/program.toml", 10),
    "plan, the table": (PLAN, "out/trajectory.csv", 10_000),
    "plan, the report": (PLAN, "out/report.html", 20_000),
    "plan in parts": ((*PLAN, "--stream"), "out/motion.bin", 4096),
    "plan in parts, the report": ((*PLAN, "--stream"), "out/report.html", 10_000),
    "calibrate": (("calibrate", "hexapod", "cmm", "--out", "out"), "out/nominal.toml", 100),
    "stills, pdf": (("view", "plan", "--stills", "out.pdf"), "out.pdf", 4096),
    "stills, png": (("view", "plan", "--stills", "out.png"), "out.png", 4096),
    "stills, svg": (("view", "plan", "--stills", "out.svg"), "out.svg", 4096),
    "view": (("view", "plan", "--frames", "2", "--html", "out.html"), "out.html", 4096),
    "export, npz": (("export", "plan", "--format", "npz", "--out", "out.npz"), "out.npz", 4096),
    "export, binary": (
        ("export", "plan", "--format", "binary", "--out", "out.bin"),
        "out.bin",
        500,
    ),
    "export, pulses": (
        ("export", "plan", "--format", "pulses", "--out", "out.csv"),
        "out.csv",
        4096,
    ),
    "export, steps": (("export", "plan", "--format", "steps", "--out", "out.txt"), "out.txt", 100),
    "hold": (
        ("hold", "plan", "--at", "40 %", "--format", "npz", "--out", "out.npz"),
        "out.npz",
        100,
    ),
    "stops": (("hold", "plan", "--stops", "1", "--out", "out.csv"), "out.csv", 10),
    "import": (("import", "part.nc", "--out", "out.toml"), "out.toml", 10),
    "import, the figure": (
        ("import", "part.nc", "--out", "out.toml", "--figure", "out.png"),
        "out.png",
        4096,
    ),
    "init": (("init", "out"), "out/machine.toml", 10),
    "positions": (("positions", "poses.csv", "save", "out.csv"), "out.csv", 10),
}


@pytest.mark.parametrize(("arguments", "place", "most"), WRITING.values(), ids=WRITING)
def test_a_file_that_cannot_be_written_is_named(
    tmp_path, call, corner, monkeypatch, arguments, place, most
):
    shutil.copytree(corner, tmp_path / "plan")
    (tmp_path / "line.toml").write_text(LINE)
    (tmp_path / "part.nc").write_text("G21 G90\nG1 X5 F600\nX0\n")
    (tmp_path / "poses.csv").write_text("x [mm],y [mm],z [mm]\n0,0,25\n0,0,26\n")
    monkeypatch.chdir(tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    with small_files(most):
        done = call(*arguments)
    assert done.exit_code == 2, done.stderr
    assert done.stderr.splitlines()[-1] == f"error: {place}: File too large"
    assert sorted(path.name for path in tmp_path.iterdir()) == before
