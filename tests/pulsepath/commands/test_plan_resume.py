"""`plan --resume`: a run that was broken off is gone on with, and gives the same bytes; nothing else is."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from functools import partial

import pytest

from benchmarks.evidence.workpieces import spiral
from benchmarks.reports import parts_report
from planner.plan_parts import plan_parts
from pulsepath import parts_job
from pulsepath.output import parts_directory
from pulsepath.output.directory import fill_directory

LINES = 120
"""Which are six windows of so few pieces."""
PIECES = 6
ASKED = ("--machine", "hexapod", "--stream", "--order", "2", "--no-figures")
SAME = ("motion.bin", "pulses.bin", "report.html", "triggers.csv", "certificate.json", "program.nc")


REACHED = r"segments 1 to (\d+) of \d+, ([\d.]+) s of motion, are "


SMALL_WINDOWS = f"""
from functools import partial
from planner.plan_parts import plan_parts
from pulsepath import parts_job
from pulsepath.cli import main
parts_job.plan_parts = partial(plan_parts, pieces={PIECES})
main()
"""


@pytest.fixture
def small_windows(monkeypatch):
    monkeypatch.setattr(parts_job, "plan_parts", partial(plan_parts, pieces=PIECES))


@pytest.fixture
def file(tmp_path):
    made = tmp_path / "spiral.nc"
    lines = [*spiral(LINES)]
    for k in range(len(lines) - 1, 4, -15):
        lines.insert(k, f"M3 S{k}")
    made.write_text("\n".join([*lines, ""]))
    return made


def break_off(monkeypatch, call, after, *arguments, by=KeyboardInterrupt):
    """Call, and break it off when so many parts are written."""
    with monkeypatch.context() as patch:
        told = []

        def write(*given, **named):
            told.append(None)
            found = parts_directory_write(*given, **named)
            if len(told) == after:
                raise by
            return found

        parts_directory_write = parts_directory.write_checkpoint
        patch.setattr(parts_directory, "write_checkpoint", write)
        return call(*arguments)


@pytest.mark.parametrize("after", [1, 3])
def test_the_same_bytes_come_of_it(drawn, call, file, tmp_path, monkeypatch, small_windows, after):
    whole = call("plan", file, *ASKED, "--out", tmp_path / "whole", "--json")
    assert whole.exit_code == 0, whole.stderr
    assert json.loads(whole.stdout)["windows"] > 4
    done = break_off(monkeypatch, call, after, "plan", file, *ASKED, "--out", tmp_path / "out")
    assert done.exit_code == 130
    kept = re.search(
        REACHED + r'kept in out.unfinished: "pulsepath (plan .*) --resume" goes on from there', done.stderr
    )
    assert 0 < int(kept[1]) < LINES
    assert float(kept[2]) > 0
    assert kept[3].split() == ["plan", str(file), *ASKED, "--out", str(tmp_path / "out")]
    assert not (tmp_path / "out").exists()
    checked = call("check", tmp_path / "out.unfinished")
    assert checked.exit_code == 2
    held = re.search(REACHED + r'planned; "pulsepath (plan .*) --resume" goes on from there', checked.stderr)
    assert held.groups() == kept.groups()
    assert "holds an interrupted run of pulsepath plan" in call("export", tmp_path / "out", "--format", "npz").stderr
    again = call("plan", file, *ASKED, "--out", tmp_path / "out", "--resume", "--json")
    assert again.exit_code == 0, again.stderr
    assert f"segments 1 to {kept[1]} of {LINES + 1}, {kept[2]} s of motion, are planned already" in again.stderr
    assert not (tmp_path / "out.unfinished").exists()
    for name in SAME:
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), name
    one, other = json.loads(again.stdout), json.loads(whole.stdout)
    assert one.pop("report") != other.pop("report")
    assert one == other


def test_before_the_first_part_nothing_is_kept_and_resume_begins_anew(call, file, tmp_path, monkeypatch, small_windows):
    def break_here(*_: object) -> None:
        unfinished.append(call("check", tmp_path / "out.unfinished").stderr)
        raise KeyboardInterrupt

    unfinished = []
    with monkeypatch.context() as patch:
        patch.setattr(parts_directory.PartsWriter, "add", break_here)
        done = call("plan", file, *ASKED, "--out", tmp_path / "out")
    assert done.exit_code == 130
    assert "the first part of the plan was not finished, so nothing is kept for --resume" in done.stderr
    assert "is being made: no part of it is planned yet; wait for its end" in unfinished[0]
    assert [path.name for path in tmp_path.iterdir()] == [file.name]
    again = call("plan", file, *ASKED, "--out", tmp_path / "out", "--resume")
    assert again.exit_code == 0, again.stderr
    assert "there is nothing to resume in out.unfinished: planning begins at the first segment" in again.stderr


def test_it_goes_on_with_nothing_else(call, file, tmp_path, monkeypatch, small_windows):
    out = tmp_path / "out"
    break_off(monkeypatch, call, 2, "plan", file, *ASKED, "--out", out)
    done = call("plan", file, *ASKED, "--out", out)
    assert done.exit_code == 2
    assert "give --resume, or --force to begin anew" in done.stderr
    for change, told in (
        (("--order", "3"), "begun with order 2, not 3"),
        (("--rule", "floor"), "begun with rule nearest, not floor"),
        (("--clock-hz", "1000000"), "begun with clock_hz 10000000, not 1000000"),
    ):
        done = call("plan", file, *ASKED, *change, "--out", out, "--resume")
        assert done.exit_code == 2
        assert told in done.stderr
    file.write_text(file.read_text() + "G1 X1\n")
    done = call("plan", file, *ASKED, "--out", out, "--resume")
    assert "begun with other inputs" in done.stderr
    (tmp_path / "out.unfinished" / "checkpoint.json").write_text("{")
    assert "no checkpoint can be read" in call("plan", file, *ASKED, "--out", out, "--resume").stderr
    assert call("plan", file, *ASKED, "--out", out, "--force").exit_code == 0


def test_what_was_planned_to_its_end_is_only_finished(call, file, tmp_path, monkeypatch, small_windows):
    def break_here(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(parts_report, "write_report", break_here)
        assert call("plan", file, *ASKED, "--out", tmp_path / "out").exit_code == 130
    done = call("plan", file, *ASKED, "--out", tmp_path / "out", "--resume")
    assert done.exit_code == 0, done.stderr
    assert call("check", tmp_path / "out").exit_code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", file.name]
    assert not {"begun", "checkpoint.json"} & {path.name for path in (tmp_path / "out").iterdir()}


@pytest.mark.parametrize("name", ["motion.bin", "pulses.bin", "triggers.csv"])
def test_files_shorter_than_the_checkpoint_says_are_refused(call, file, tmp_path, monkeypatch, small_windows, name):
    break_off(monkeypatch, call, 3, "plan", file, *ASKED, "--out", tmp_path / "out")
    damaged = tmp_path / "out.unfinished" / name
    damaged.write_bytes(damaged.read_bytes()[:-20])
    done = call("plan", file, *ASKED, "--out", tmp_path / "out", "--resume")
    assert done.exit_code == 2
    assert re.search(rf"{name} has \d+ bytes, and its checkpoint counts on \d+", done.stderr)
    assert damaged.exists()


def test_what_the_system_did_can_be_mended(call, file, tmp_path, monkeypatch, small_windows):
    done = break_off(monkeypatch, call, 2, "plan", file, *ASKED, "--out", tmp_path / "out", by=OSError(28, "disk full"))
    assert done.exit_code not in (0, 1)
    assert call("plan", file, *ASKED, "--out", tmp_path / "out", "--resume").exit_code == 0


def test_an_error_of_the_plan_leaves_nothing(call, file, tmp_path, small_windows):
    file.write_text(file.read_text() + "G1 X500\n")
    assert call("plan", file, *ASKED, "--out", tmp_path / "out").exit_code == 1
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


def test_one_run_fills_a_directory(call, file, tmp_path):
    with fill_directory(tmp_path / "out", False, False, "checkpoint.json"):
        done = call("plan", file, *ASKED, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert "is being filled by another run" in done.stderr


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_run_that_was_killed_is_gone_on_with(call, file, tmp_path, small_windows):
    file.write_text("\n".join([*spiral(3 * LINES), ""]))
    out, checkpoint = tmp_path / "out", tmp_path / "out.unfinished" / "checkpoint.json"
    command = [sys.executable, "-c", SMALL_WINDOWS, "plan", str(file), *ASKED, "--out", str(out)]
    run = subprocess.Popen(command, stderr=subprocess.DEVNULL, start_new_session=True)
    end = time.monotonic() + 120
    while not checkpoint.exists() and run.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    assert checkpoint.exists()
    done = call("plan", file, *ASKED, "--out", out, "--resume", "--json")
    assert done.exit_code == 0, done.stderr
    checked = call("check", out, "--json")
    assert checked.exit_code == 0, checked.stdout
    assert json.loads(checked.stdout)["pulses"] == json.loads(done.stdout)["pulses"]["total"]
