"""What a directory holds is believed only where it is what was proved."""

import json
import re
import shutil
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest

import pulsepath as pp
from kinematics import MotionError, load_machine
from planner import load_program
from planner.export.formats import binary
from planner.orientation.orient import apply_choice, find_choice
from planner.path.shape import DEGREE
from planner.request import PlanRequest
from pulsepath.inputs import Inputs, read_inputs
from pulsepath.job import run
from pulsepath.requests import ReportRequest
from pulsepath.store import read as store
from pulsepath.store import verify as verification
from pulsepath.store.files import DERIVED
from pulsepath.store.write import write_whole
from tests import motion_pieces


def faster(folder, factor=10):
    """Ten times faster: a hundred times the acceleration."""
    motion = motion_pieces.load(folder / "motion.bin")
    motion["knots"] /= factor
    for power, name in enumerate(("v", "a", "j"), 1):
        motion[name] *= factor**power
    motion_pieces.store(folder / "motion.bin", motion)


def forge(folder, **changed):
    """Digests that fit again, as anyone can compute them."""
    path = folder / "plan.json"
    record = json.loads(path.read_text()) | changed
    for key in ("files", "record"):
        del record["provenance"][key]
    path.unlink()
    path.write_text(json.dumps(verification.seal_record(record, folder)))


@pytest.mark.parametrize(
    "command",
    [("export", "--format", "g93"), ("view", "--html", "x.html"), ("track", "--law", "3")],
)
def test_a_changed_motion_is_refused(call, plan, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    faster(plan)
    before = sorted(tmp_path.rglob("*"))
    done = call(command[0], plan, *command[1:])
    assert done.exit_code == 2
    assert f"{plan / 'motion.bin'} was changed after it was written" in done.stderr
    assert "--unverified" in done.stderr
    assert sorted(tmp_path.rglob("*")) == before


def test_a_forged_motion_is_refused(call, plan):
    faster(plan)
    forge(plan)
    done = call("export", plan, "--format", "g93")
    assert done.exit_code == 2
    # ten times the speed, a hundred the acceleration, a thousand the jerk
    worst = re.search(r"the motion uses ([\d.]+) times its limit on jerk", done.stderr)
    assert worst is not None
    assert 999 < float(worst[1]) < 1001
    assert not (plan / "g93.ngc").exists()


@pytest.mark.parametrize("name", ["s", "v", "knots"])
def test_a_motion_that_jumps_is_refused(plan, name):
    """Though every piece of it keeps all limits."""
    path = plan / "motion.bin"
    motion = motion_pieces.load(path)
    middle = len(motion[name]) // 2
    motion[name][middle] += 1e-4 if name == "s" else 0.01 * motion[name][middle]
    if name == "knots":
        motion[name].sort()
    motion_pieces.store(path, motion)
    forge(plan)
    with pytest.raises(MotionError, match="times its limit on"):
        pp.load_plan(plan)


@pytest.mark.parametrize("key", ["duration_s", "order", "program"])
def test_a_changed_record_is_refused(plan, key):
    path = plan / "plan.json"
    record = json.loads(path.read_text())
    path.write_text(
        json.dumps(record | {key: {"duration_s": 0.1, "order": 2, "program": "another"}[key]})
    )
    with pytest.raises(MotionError, match=r"plan\.json was changed after it was written"):
        pp.load_plan(plan)
    if key == "duration_s":
        forge(plan)
        with pytest.raises(MotionError, match="to another motion"):
            pp.load_plan(plan)


@pytest.mark.parametrize("provenance", [None, [], {}, {"files": []}, {"files": {}}])
def test_a_record_without_digests_is_refused(plan, provenance):
    path = plan / "plan.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"provenance": provenance}))
    with pytest.raises(MotionError, match="--unverified"):
        pp.load_plan(plan)
    assert pp.load_plan(plan, unverified=True).doubts


def test_every_file_counts(directory, tmp_path):
    """Those that no command reads may be missing, but not changed."""
    for path in [path for path in directory.iterdir() if path.is_file()]:
        copy = tmp_path / path.name
        shutil.copytree(directory, copy)
        (copy / path.name).write_bytes((copy / path.name).read_bytes() + b" ")
        if path.name == "plan.json":  # a space is none of its values
            continue
        with pytest.raises(MotionError, match=f"{path.name} was changed"):
            pp.load_plan(copy)
        (copy / path.name).unlink()
        if path.name in DERIVED:
            pp.load_plan(copy)
        else:
            with pytest.raises(MotionError, match=f"{path.name} is missing"):
                pp.load_plan(copy)
        shutil.rmtree(copy)


def test_an_arms_own_file_counts(call, tmp_path):
    (tmp_path / "p.toml").write_text(
        'schema = 1\nlength = "mm"\n[[segment]]\nline = { to = [1, 0, 1] }\n'
    )
    assert (
        call(
            "plan", tmp_path / "p.toml", "--machine", "arm", "--no-figures", "--out", tmp_path / "o"
        ).exit_code
        == 0
    )
    urdf = tmp_path / "o" / "arm.urdf"
    urdf.write_text(urdf.read_text().replace("<mass value=", "<mass  value=", 1))
    done = call("export", tmp_path / "o", "--format", "ros")
    assert done.exit_code == 2
    assert "arm.urdf was changed" in done.stderr


def test_on_request_it_goes_on_and_says_so(call, plan, tmp_path):
    faster(plan, 1.2)
    done = call("export", plan, "--format", "g93", "--unverified")
    assert done.exit_code == 0, done.stderr
    assert "NOT VERIFIED: " in done.stdout
    assert "motion.bin was changed" in done.stdout
    assert "NOT VERIFIED" in next(plan.glob("*.g93.*")).read_text()
    done = call("export", plan, "--format", "vcd", "--unverified", "--json")
    said = json.loads(done.stdout)
    assert said["verified"] is False
    assert any("motion.bin was changed" in doubt for doubt in said["doubts"])
    page = tmp_path / "x.html"
    done = call("view", plan, "--html", page, "--frames", "2", "--unverified")
    assert "NOT VERIFIED: " in done.stdout
    assert "NOT VERIFIED" in page.read_text()


def test_what_is_verified_says_so(call, plan):
    said = json.loads(call("export", plan, "--format", "vcd", "--json").stdout)
    assert (said["verified"], said["doubts"]) == (True, [])


def test_pulses_that_differ_are_checked_again(plan, monkeypatch):
    """As those that another processor rounds another way."""
    path = plan / "plan.json"
    record = json.loads(path.read_text())
    record["pulses"]["sha256"] = "0" * 64
    forge(plan, pulses=record["pulses"])
    taken = pp.load_plan(plan)
    assert taken.pulses.total == record["pulses"]["total"]
    generate = store.generate

    def shifted(*args, **kwargs):
        made = generate(*args, **kwargs)
        axes = (replace(made.axes[0], ticks=made.axes[0].ticks + 5), *made.axes[1:])
        return replace(made, axes=axes)

    monkeypatch.setattr(store, "generate", shifted)
    again = pp.load_plan(plan)
    with pytest.raises(MotionError, match="pulses made again"):
        _ = again.pulses


def test_a_record_with_impossible_pulses_is_refused_by_its_name(plan):
    original = json.loads((plan / "plan.json").read_text())["pulses"]
    first, *_ = original["axes"]
    endless = {**original["axes"], first: original["axes"][first] | {"start_count": float("inf")}}
    for change, message in (
        ({"clock_hz": True}, "states no pulse clock"),
        ({"rule": "foo"}, "states an unknown firing rule .*foo"),
        ({"axes": endless}, "does not state its pulses"),
    ):
        forge(plan, pulses=original | change)
        for unverified in (False, True):
            with pytest.raises(MotionError, match=rf"plan\.json {message}"):
                pp.load_plan(plan, unverified)


def test_chosen_orientation_is_taken_up_again(tmp_path):
    text = 'schema = 1\nlength = "mm"\n[[segment]]\nline = { to = [0.2, 0, 0.1] }\nfree = "yaw"\n'
    (tmp_path / "p.toml").write_text(text)
    machine, controls = load_machine("hexapod"), np.zeros((3, DEGREE + 1))
    controls[2, 3:5] = 0.002
    program = apply_choice(load_program(tmp_path / "p.toml"), {0: controls})
    machine_toml = read_inputs("circle", "hexapod").machine_toml
    job = run(program, machine, PlanRequest(order=2), ReportRequest(figures=False))
    made = tmp_path / "o"
    made.mkdir()
    write_whole(made, job, Inputs(program, machine, text.encode(), machine_toml))
    taken = pp.load_plan(made)
    np.testing.assert_array_equal(find_choice(taken.program)[0], controls)
    t = np.linspace(0, taken.trajectory.duration, 50)
    np.testing.assert_array_equal(taken.trajectory.at(t).q, job.plan.trajectory.at(t).q)
    (made / "orientation.json").unlink()
    forge(made)
    with pytest.raises(MotionError, match="the orientation chosen for free segments is missing"):
        pp.load_plan(made)


@pytest.mark.parametrize("form", ["pulses.bin", "pulses.csv", None])
def test_a_plan_is_checked_with_its_file_of_pulses(call, directory, edges, job, form, capfd):
    folder = edges if form == "pulses.csv" else directory
    if form is None:
        assert pp.load_plan(str(folder)).pulses.total == job.plan.pulses.total
        assert capfd.readouterr() == ("", "")
        assert call("check", folder, "--machine", "hexapod").exit_code == 2
        return
    done = call("check", folder)
    assert done.exit_code == 0
    assert "its motion of 1.26" in done.stdout
    assert f"{form}: {job.plan.pulses.total} pulses, checked against the motion" in done.stdout
    told = json.loads(call("check", folder, "--json").stdout)
    assert told == {
        "holds": True,
        "duration_s": job.plan.trajectory.duration,
        "pulse_file": form,
        "pulses": job.plan.pulses.total,
    }


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"ticks": lambda axis: axis.ticks + (np.arange(len(axis)) == 900)}, "off its crossing"),
        ({"bound": lambda _: 9.5}, "bound: the file states 9.5, and the plan 0.5"),
    ],
)
def test_forged_pulses_are_found(call, plan, job, change, told):
    """Though all digests fit."""
    (name, make), axes = *change.items(), list(job.plan.pulses.axes)
    axes[2] = replace(axes[2], **{name: make(axes[2])})
    binary.write(replace(job.plan.pulses, axes=tuple(axes)), plan / "pulses.bin")
    forge(plan)
    done = call("check", plan)
    assert done.exit_code == 2
    assert told in done.stderr
    assert "leg3" in done.stderr
    # and what other commands read is what was proved
    assert pp.load_plan(plan).pulses.axes[2].bound == 0.5


def test_the_digest_of_pulses_is_of_each_axis_wherever_they_are_cut(job, tmp_path):
    pulses = job.plan.pulses
    each = [
        sha256(array.tobytes()).digest()
        for axis in pulses.axes
        for array in (axis.ticks, axis.direction)
    ]
    binary.write(pulses, tmp_path / "p.bin", part=777)
    assert verification.digest_pulses([pulses]) == sha256(b"".join(each)).hexdigest()
    assert verification.digest_pulses(
        pp.open_pulses(tmp_path / "p.bin").parts()
    ) == verification.digest_pulses([pulses])
    moved = replace(
        pulses, axes=(replace(pulses.axes[0], ticks=pulses.axes[0].ticks + 1), *pulses.axes[1:])
    )
    assert verification.digest_pulses([moved]) != verification.digest_pulses([pulses])
