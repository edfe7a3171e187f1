"""The command `track`: the errors of the plan that is in a directory, and no other."""

import json
from importlib.resources import files

import numpy as np
import pytest

from controllers import evaluate, find_law, load_rig, track
from tests import motion_pieces


def test_it_is_the_motion_that_was_planned(call, plan, job):
    done = call("track", plan, "--law", "3", "--json")
    assert done.exit_code == 0
    record = json.loads(done.stdout)
    assert record == json.loads((plan / "track.json").read_text())
    machine = job.plan.machine
    expected = evaluate(
        track(job.plan, machine, find_law("3"), rig=load_rig("hexapod-steppers")), job.plan, machine
    )
    assert record["rig"] == "hexapod-steppers"
    for series in expected.series:
        found = record["laws"][expected.law][series.name]
        assert (found["rms"], found["p95"], found["max"]) == (series.rms, series.p95, series.max)


def test_it_prints_a_table_per_law(call, plan):
    done = call("track", plan, "--law", "open-position", "--law", "6")
    assert done.exit_code == 0
    laws = json.loads((plan / "track.json").read_text())["laws"]
    assert len(laws) == 2
    for law, errors in laws.items():
        text = done.stdout[done.stdout.index(law) :]
        (row,) = [line.split() for line in text.splitlines() if line.startswith(" contour")][:1]
        assert [float(cell) for cell in row[1:4]] == pytest.approx(
            [1e6 * errors["contour"][name] for name in ("rms", "p95", "max")], abs=5e-4
        )


def test_a_law_that_closes_no_loop_is_said_to_close_none(call, plan):
    """The bundled steppers have no encoders."""
    closed = call("track", plan, "--law", "6", "--force")
    assert (
        "No encoder is read on hexapod-steppers: closed-position closes its loop over"
        in closed.stdout
    )
    assert "No encoder" not in call("track", plan, "--law", "3", "--force").stdout


def test_the_rig_that_fits_is_taken_and_named(call, plan):
    """Without --rig it is said which one it is; on it no law errs by as much as a servo would
    lag.
    """
    done = call("track", plan)
    assert done.exit_code == 0
    assert (
        "on rig hexapod-steppers: 6 steppers, card PCI-8132: the bundled rig that fits hexapod"
        in done.stderr
    )
    found = json.loads((plan / "track.json").read_text())
    assert (found["rig"], sorted(found["lost_steps"].values())) == ("hexapod-steppers", [0, 0])
    assert len(found["laws"]) == 2
    assert all(errors["contour"]["max"] < 10e-6 for errors in found["laws"].values())


def test_a_machine_of_other_pulses_is_tracked_on_its_own_rig_alone(call, tmp_path):
    """No bundled rig fits it: nothing is made up; a rig file that names it does."""
    preset = (files("kinematics") / "presets" / "hexapod.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(
        preset.replace('pulse = "0.75 um"', 'pulse = "3 um"'), encoding="utf-8"
    )
    steppers = (files("controllers") / "presets" / "hexapod-steppers.toml").read_text(
        encoding="utf-8"
    )
    rig = tmp_path / "rig.toml"
    rig.write_text(
        steppers.replace('machine = "hexapod"', 'machine = "mine.toml"'), encoding="utf-8"
    )
    out = tmp_path / "out"
    plan = (
        "plan",
        "bare-circle",
        "--machine",
        tmp_path / "mine.toml",
        "--out",
        out,
        "--no-figures",
        "--no-baselines",
        "--no-worth",
        "--order",
        "2",
    )
    refused = call(*plan, "--rig", "hexapod-steppers")
    assert refused.exit_code == 2
    assert (
        "a pulse of leg1 is 0.75 µm on it and 3 µm on the machine; no bundled rig fits"
        in refused.stderr
    )
    assert not out.exists()
    assert call(*plan).exit_code == 0
    assert json.loads((out / "plan.json").read_text())["tracking"] is None
    page = (out / "report.html").read_text()
    assert "The plan was not tracked." in page
    assert "no bundled rig fits its axes" in page
    for arguments in ([], ["--rig", "hexapod-steppers"]):
        refused = call("track", out, *arguments)
        assert refused.exit_code == 2
        assert "no bundled rig fits" in refused.stderr
        assert not (out / "track.json").exists()
    assert call("track", out, "--rig", rig, "--law", "3").exit_code == 0
    assert json.loads((out / "track.json").read_text())["rig"] == "rig"


def test_a_plan_is_tracked_where_it_is_asked_for(call, tmp_path):
    out = tmp_path / "out"
    done = call(
        "plan",
        "linkage-line",
        "--out",
        out,
        "--no-figures",
        "--order",
        "2",
        "--rig",
        "linkage-steppers",
    )
    assert done.exit_code == 0
    tracking = json.loads((out / "plan.json").read_text())["tracking"]
    assert tracking["rig"] == "linkage-steppers"
    assert len(tracking["laws"]) == 2
    assert "2 steppers, card PCI-8132" in (out / "report.html").read_text()
    call("track", out, "--rig", "linkage-steppers")
    later = json.loads((out / "track.json").read_text())
    assert later["laws"].keys() == tracking["laws"].keys()
    for law, errors in later["laws"].items():
        for name, error in errors.items():
            assert error["rms"] == pytest.approx(tracking["laws"][law][name]["rms"], rel=1e-9)


def test_gains_are_given_as_compare_tells_them(call, plan):
    done = call("track", plan, "--law", "closed-position:gain=0.5", "--json")
    assert done.exit_code == 0
    assert list(json.loads(done.stdout)["laws"]) == [find_law("6", gain=0.5).name]


def test_an_earlier_result_is_replaced_only_by_force(call, plan):
    (plan / "track.json").write_text("mine")
    done = call("track", plan, "--law", "3")
    assert done.exit_code == 2
    assert (plan / "track.json").read_text() == "mine"
    assert call("track", plan, "--law", "3", "--force").exit_code == 0
    assert "open-position" in json.loads((plan / "track.json").read_text())["laws"]


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("motion.bin", '{"knots": [0, 1]}', "motion.bin: is not a binary file of pulsepath"),
        ("motion.bin", {"j": [np.nan]}, "do not make a motion"),
        ("motion.bin", {"knots": [1.0, 0.0]}, "do not make a motion"),
        ("motion.bin", {"piece": [1]}, "belongs to another path"),
    ],
)
def test_a_damaged_plan_is_refused(call, plan, name, text, told):
    if isinstance(text, dict):
        right = {"knots": [0.0, 1.0], "s": [0.0], "v": [0.0], "a": [0.0], "j": [0.0], "piece": [0]}
        motion_pieces.store(plan / name, right | text)
    else:
        (plan / name).write_text(text)
    done = call("track", plan, "--law", "3", *(["--unverified"] if name == "motion.bin" else []))
    assert done.exit_code == 2
    assert told in done.stderr
    assert not (plan / "track.json").exists()
