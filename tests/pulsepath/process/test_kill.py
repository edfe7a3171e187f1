"""Killed at any moment, a command leaves its whole result or none, and the next run clears what is
left beside it.
"""

import json
import random
import shutil
import subprocess
import sys
import time

import pytest

import pulsepath as pp
from kinematics import MotionError
from kinematics.files.atomic_files import Destination
from kinematics.files.leftovers import clear
from planner import read_pulses
from planner.export.formats import npz
from pulsepath.output.directory import KIND, replace_directory

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="nothing there tells the dead from the living"
)

REPLACING = f"""
import json, sys
from pathlib import Path
from pulsepath.output.directory import replace_directory
for number in range(100_000):
    with replace_directory(Path(sys.argv[1]), force=True) as folder:
        for part in range(5):
            (folder / f"part{{part}}").write_text(str(number))
        (folder / "plan.json").write_text(json.dumps({{"kind": "{KIND}", "number": number}}))
"""


def start(*arguments):
    return subprocess.Popen(
        [sys.executable, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )


def kill_when(process, there, pattern, then):
    """Kill a process a while after it made a file of this pattern in a folder: by then it may be
    done.
    """
    end = time.monotonic() + 60
    while process.poll() is None and not any(there.glob(pattern)) and time.monotonic() < end:
        time.sleep(0.001)
    assert process.poll() in (None, 0)
    time.sleep(then)
    process.kill()
    process.communicate()  # until all that it started is no more either, which hold the other end


def names(folder):
    return {path.name for path in folder.iterdir()}


def assert_plan(folder):
    """All its files are there, and agree with its record."""
    record = json.loads((folder / "plan.json").read_bytes())
    planned = pp.load_plan(folder)  # holds its sources against their digests
    assert planned.pulses.total == record["pulses"]["total"]
    assert read_pulses(folder / "pulses.bin").total == record["pulses"]["total"]
    assert (folder / "report.html").read_text("utf-8").rstrip().endswith("</html>")


def test_directories_replaced_without_pause(tmp_path):
    """Killed eight times at any moment: whole afterwards, or the one before comes back."""
    place, moments = tmp_path / "out", random.Random(5)
    with replace_directory(place, force=False) as folder:
        (folder / "plan.json").write_text(json.dumps({"kind": KIND, "number": -1}))
        for part in range(5):
            (folder / f"part{part}").write_text("-1")
    left = 0
    for _ in range(8):
        process = start("-c", REPLACING, place)
        kill_when(process, tmp_path, ".out-*.staged/new/part0", moments.uniform(0, 0.02))
        left += len(names(tmp_path) - {"out"})
        for cleared in (False, True):
            if cleared:
                clear(tmp_path)
            if cleared or place.exists():
                number = json.loads((place / "plan.json").read_text())["number"]
                assert {(place / f"part{part}").read_text() for part in range(5)} == {str(number)}
        assert names(tmp_path) == {"out"}
    assert left  # else no kill struck


def test_between_the_renames_the_one_before_comes_back(tmp_path):
    """And is not replaced then by a run that was not told to."""
    place, old = tmp_path / "out", tmp_path / ".out-abcd_123.staged" / "old"
    old.mkdir(parents=True)
    (old.parent / ".pulsepath").touch()
    (old / "plan.json").write_text(json.dumps({"kind": KIND}))
    with pytest.raises(MotionError, match="not empty"), replace_directory(place, force=False):
        pass
    assert names(tmp_path) == {"out"}
    assert names(place) == {"plan.json"}


def test_what_another_run_works_on_is_left_alone(tmp_path):
    place = tmp_path / "out"
    with replace_directory(place, force=False):
        working = names(tmp_path)
        clear(tmp_path)
        assert names(tmp_path) == working != set()


def test_what_is_not_ours_is_left_alone(tmp_path):
    for name in (".out-backup", ".out-12345678", "out-12345678.staged", ".outer-12345678.staged"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "thesis.txt").touch()
    before = names(tmp_path)
    clear(tmp_path)
    assert names(tmp_path) == before


def test_the_next_run_clears_what_is_left_of_another_target(tmp_path):
    for name in (".other-12345678.staged", ".part.ngc-abcdefgh.staged"):
        (tmp_path / name / "new").mkdir(parents=True)
        (tmp_path / name / ".pulsepath").touch()
    (tmp_path / ".empty-12345678.staged").mkdir()  # killed before it was marked
    old = tmp_path / ".older-12345678.staged" / "old"
    old.mkdir(parents=True)
    (old.parent / ".pulsepath").touch()
    (tmp_path / "plan").mkdir()
    Destination(tmp_path / "plan" / "file").write("x")  # as `export` does
    assert names(tmp_path) == {"plan", "older"}


@pytest.mark.parametrize(
    ("made", "earlier", "way"),
    [
        ("pulses.bin", False, "--whole"),
        ("report.html", True, "--whole"),
        ("motion.bin", True, "--stream"),
    ],
)
def test_plan_killed_in_the_midst(tmp_path, directory, made, earlier, way):
    program, out = tmp_path / "line.toml", tmp_path / "plans" / "out"
    program.write_text('schema = 1\nlength = "mm"\n[[segment]]\nline = { to = [0, 0, 0.1] }\n')
    out.parent.mkdir()
    if earlier:
        shutil.copytree(directory, out)
    asked = ("plan", program, "--machine", "hexapod", way, "--order", "2", "--no-figures")
    process = start("-m", "pulsepath", *asked, "--out", out, "--force")
    kill_when(
        process, out.parent, f".out-*.staged/new/{made}", random.Random(made).uniform(0, 0.05)
    )
    whole = out.exists()
    assert whole >= earlier
    if whole:
        assert_plan(out)
    assert len(names(out.parent) - {"out"}) <= 1  # hidden: no command reads it
    clear(out.parent)
    assert names(out.parent) == ({"out"} if whole else set())


@pytest.mark.parametrize("earlier", [False, True])
def test_export_killed_in_the_midst(tmp_path, directory, job, earlier):
    out = tmp_path / "held" / "pulses.npz"
    out.parent.mkdir()
    if earlier:
        npz.write(job.plan.pulses, out)
    process = start(
        "-m",
        "pulsepath",
        "export",
        directory,
        "--format",
        "npz",
        "--part",
        "3",
        "--out",
        out,
        "--force",
    )
    kill_when(
        process,
        out.parent,
        ".pulses.npz-*.staged/new/pulses.npz",
        random.Random(earlier).uniform(0, 0.2),
    )
    whole = out.exists()
    assert whole >= earlier
    if whole:
        assert npz.read(out).total == job.plan.pulses.total
    clear(out.parent)
    assert names(out.parent) == ({"pulses.npz"} if whole else set())
