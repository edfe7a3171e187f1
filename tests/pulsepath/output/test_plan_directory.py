"""What `plan` writes: each file holds the plan, and nothing of where or when it was made."""

import json
import sys
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import pulsepath as pp
from kinematics import MotionError
from planner import read_pulses
from planner.export.formats import binary
from planner.pulses import check, generate
from planner.pulses.schedule import holds_same_pulses
from tests import read_lines


def test_the_record(directory, job):
    record = json.loads((directory / "plan.json").read_text())
    assert record["duration_s"] == job.plan.trajectory.duration <= 1.2630
    classical = record["classical"]
    assert classical["duration_s"] - record["duration_s"] == classical["saved_s"] > 0
    assert (classical["kind"], classical["leaves_out"]) == (
        "s-curve",
        [],
    )  # the one that keeps jerk as well
    assert classical["kinds"]["trapezoid"]["leaves_out"] == ["jerk"]
    assert classical["kinds"]["trapezoid"]["differences"] == ["without jerk"]
    limits = record["certificate"]["limits"]
    assert set(limits) == {
        "speed",
        "acceleration",
        "jerk",
        "travel",
        "tilt",
        "clearance",
        "force",
        "holding force",
    }
    for limit in limits.values():
        assert limit["attained_ratio"] <= limit["worst_ratio"] <= 1 + 1e-6
        assert 0 <= limit["where"]["time_s"] <= record["duration_s"]
        assert limit["where"]["segment"] == 1
    pulses = record["pulses"]
    assert sum(axis["pulses"] for axis in pulses["axes"].values()) == pulses["total"]
    # the circle closes: every leg ends where it began
    assert {axis["net_count"] for axis in pulses["axes"].values()} == {0}
    # no leg steps faster than its speed limit, but for the tick to which each of two pulses is
    # rounded
    interval = 0.75e-6 / 20e-3
    assert pulses["check"]["highest_rate_hz"] <= 1 / (interval - 1 / pulses["clock_hz"])
    realised = record["realised"]
    assert set(realised["errors"]) == {"x", "y", "z", "rx", "ry", "rz", "position", "orientation"}
    for error in realised["errors"].values():
        assert 0 < error["rms"] < error["max"] <= error["bound"]
        assert error["where"]["segment"] == 1
    # half a pulse of 0.75 µm in every leg moves the platform by some microns
    assert 1e-6 < realised["errors"]["position"]["max"] < 5e-6


def test_nothing_written_tells_where_or_when_it_was_made(drawn, write_plan, job, tmp_path):
    one, other = (write_plan(job, tmp_path / name) for name in ("one", "other"))
    for path in one.glob("*.*"):
        text = path.read_text(errors="replace")
        assert str(tmp_path) not in text
        assert sys.prefix not in text
    for path in one.rglob("*"):
        if path.is_file():
            assert path.read_bytes() == (other / path.relative_to(one)).read_bytes(), path.name


def test_the_trajectory_table(directory, job):
    path = directory / "trajectory.csv"
    header = path.read_text().partition("\n")[0].split(",")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    assert header[:8] == [
        "t [s]",
        "s [m]",
        "x [m]",
        "y [m]",
        "z [m]",
        "rx [rad]",
        "ry [rad]",
        "rz [rad]",
    ]
    assert header[8:12] == ["leg1 q [m]", "leg1 qd [m/s]", "leg1 qdd [m/s^2]", "leg1 qddd [m/s^3]"]
    assert table.shape == (int(np.ceil(job.plan.trajectory.duration / 1e-3)) + 1, len(header))
    t = table[:, 0]
    np.testing.assert_allclose(np.diff(t)[:-1], 1e-3, rtol=1e-9)
    np.testing.assert_allclose(t[-1], job.plan.trajectory.duration, rtol=1e-11)
    # the circle of 15 mm, 25 mm above home, run once
    np.testing.assert_allclose(np.hypot(table[:, 2], table[:, 3]), 15e-3, atol=1e-12)
    np.testing.assert_allclose(table[[0, -1], 1], [0, 2 * np.pi * 15e-3], atol=1e-12)
    # lengths between joints, from the poses of the same rows; twelve digits of a length of
    # decimetres
    pose = RigidTransform.from_components(table[:, 2:5], Rotation.from_euler("XYZ", table[:, 5:8]))
    np.testing.assert_allclose(table[:, 8::4], job.plan.machine.inverse(pose), atol=2e-12)
    # each column is the slope of the one before: the trapezoidal rule misses by |third derivative|
    # h³/12 a step
    h = np.diff(t)[:, None]
    q, qd, qdd = table[:, 8::4], table[:, 9::4], table[:, 10::4]
    np.testing.assert_allclose(
        np.diff(q, axis=0), h * (qd[1:] + qd[:-1]) / 2, atol=4.0 * 1e-9 / 12 + 1e-11
    )
    np.testing.assert_allclose(np.diff(qd, axis=0), h * (qdd[1:] + qdd[:-1]) / 2, atol=4.0 * 1e-6)


def test_the_edges_are_the_plans_pulses(edges, job):
    plan = job.plan
    start, machine = [axis.start for axis in plan.pulses.axes], plan.machine
    duration = plan.trajectory.duration
    read = read_lines.read(
        edges / "pulses.csv",
        10_000_000,
        machine.axes,
        machine.home_q,
        start=start,
        duration=duration,
    ).schedule
    assert check(read, plan.trajectory).holds
    assert read.total == plan.pulses.total


def test_the_certificate_is_of_the_file_of_edges(edges, job):
    """Its figures are those of a reader of the tests' own: edges in whole ticks, from the text."""
    certificate = json.loads((edges / "certificate.json").read_text())
    content = (edges / "pulses.csv").read_bytes()
    assert certificate["sha256"] == sha256(content).hexdigest()
    assert certificate["holds"] is True
    assert certificate["faults"] == []
    rows = [line.split(",") for line in content.decode().splitlines()[1:]]
    ticks = np.array([round(float(row[0]) * 1e7) for row in rows])
    for k, axis in enumerate(job.plan.pulses.axes):
        said = certificate["axes"][axis.name]
        step = np.array([int(row[1 + 2 * k]) for row in rows])
        turn = np.array([int(row[2 + 2 * k]) for row in rows])
        rise = ticks[1:][np.diff(step) == 1]
        fall = ticks[1:][np.diff(step) == -1]
        change = ticks[1:][np.diff(turn) != 0]
        assert said["pulses"] == len(rise) == len(axis)
        assert said["highest_rate_hz"] == pytest.approx(1e7 / np.diff(rise).min())
        assert said["lines_s"]["high"] == pytest.approx((fall - rise).min() / 1e7)
        assert said["lines_s"]["low"] == pytest.approx((rise[1:] - fall[:-1]).min() / 1e7)
        setups = [rise[rise >= at].min() - at for at in [0, *change.tolist()] if (rise >= at).any()]
        assert said["lines_s"]["setup"] == pytest.approx(min(setups) / 1e7)
        holds = [at - rise[rise < at].max() for at in change.tolist() if (rise < at).any()]
        assert said["lines_s"]["hold"] == (pytest.approx(min(holds) / 1e7) if holds else None)
        assert said["final_count"] - said["start_count"] == np.sum(axis.direction)
        assert 0 <= said["time_error_ticks"] <= 0.5


def test_the_pulse_file_is_the_plans_schedule_and_the_certificate_is_of_it(directory, edges, job):
    path = directory / "pulses.bin"
    held = read_pulses(path)
    assert (held.rule, held.duration, held.clock_hz) == (
        "nearest",
        job.plan.trajectory.duration,
        10_000_000,
    )
    for got, axis in zip(held.axes, job.plan.pulses.axes, strict=True):
        np.testing.assert_array_equal(got.ticks, axis.ticks)
        np.testing.assert_array_equal(got.direction, axis.direction)
    certificate, other = (
        json.loads((folder / "certificate.json").read_text()) for folder in (directory, edges)
    )
    assert (certificate["file"], certificate["sha256"]) == (
        "pulses.bin",
        sha256(path.read_bytes()).hexdigest(),
    )
    for name, axis in certificate["axes"].items():
        # a file without lines: what follows from its pulses is what another reader finds on the
        # lines of the other
        assert axis == other["axes"][name]
        assert axis["lines_s"]["high"] == 2e-6
    # 9 bytes a pulse in memory, some 95 as edges
    assert path.stat().st_size < 0.3 * held.total < 0.01 * (edges / "pulses.csv").stat().st_size


def test_a_plan_without_a_file_of_pulses_is_proved_and_makes_them_again(
    write_plan, job, tmp_path, edges
):
    write_plan(replace(job, draw=None), tmp_path, "--pulses", "none")
    assert not list(tmp_path.glob("pulses.*"))
    certificate = json.loads((tmp_path / "certificate.json").read_text())
    assert (certificate["file"], certificate["sha256"], certificate["holds"]) == (None, None, True)
    assert pp.load_plan(tmp_path).source.open_pulses() is None
    assert holds_same_pulses(job.plan.pulses, [pp.load_plan(tmp_path).pulses])
    assert holds_same_pulses(job.plan.pulses, [pp.load_plan(edges).pulses])


def test_pulses_are_taken_from_their_file_and_where_it_is_gone_made_again(directory, job, tmp_path):
    for path in directory.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    again = pp.load_plan(tmp_path)
    assert holds_same_pulses(job.plan.pulses, [again.pulses])
    assert holds_same_pulses(job.plan.pulses, again.source.open_pulses().parts())
    (tmp_path / "pulses.bin").unlink()
    assert holds_same_pulses(job.plan.pulses, [pp.load_plan(tmp_path).pulses])
    earlier = replace(job.plan.pulses.axes[0], ticks=job.plan.pulses.axes[0].ticks - 1)
    binary.write(
        replace(job.plan.pulses, axes=(earlier, *job.plan.pulses.axes[1:])), tmp_path / "pulses.bin"
    )
    with pytest.raises(MotionError, match=r"pulses\.bin was changed"):
        pp.load_plan(tmp_path)
    # and never from another plan's, were it not told
    other = pp.load_plan(directory)
    other.source.pulse_file = tmp_path / "pulses.bin"
    assert other.source.open_pulses() is None
    assert holds_same_pulses(job.plan.pulses, [other.pulses])


def test_a_plan_taken_up_again_fires_by_its_rule(write_plan, job, tmp_path):
    plan, rule = job.plan, "sampled:period=1e-05 s"
    pulses = generate(plan.trajectory, plan.machine.axes, plan.machine.home_q, rule=rule)
    changed = replace(plan, source=replace(plan.source, schedule=pulses))
    write_plan(replace(job, results=replace(job.results, plan=changed)), tmp_path)
    record = json.loads((tmp_path / "plan.json").read_text())["pulses"]
    assert record["rule"] == rule
    assert record["check"] == {**record["check"], "holds": True, "time_error_ticks": 0.0}
    assert [axis["bound_pulses"] for axis in record["axes"].values()] == [
        axis.bound for axis in pulses.axes
    ]
    again = pp.load_plan(tmp_path).pulses
    assert again.rule == rule
    for got, axis in zip(again.axes, pulses.axes, strict=True):
        np.testing.assert_array_equal(got.ticks, axis.ticks)
        np.testing.assert_array_equal(got.direction, axis.direction)


def test_a_plan_taken_up_again_is_the_same_to_the_last_bit(directory, job):
    again = pp.load_plan(directory).trajectory
    for name in ("knots", "s", "v", "a", "j", "piece"):
        np.testing.assert_array_equal(getattr(again, name), getattr(job.plan.trajectory, name))
    t = np.linspace(0, again.duration, 101)
    np.testing.assert_array_equal(again.at(t).q, job.plan.trajectory.at(t).q)
