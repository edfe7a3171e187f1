"""Triggers: their times by independent root finding, their counts by the pulses; and repeated
programs.
"""

import csv

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.optimize import brentq
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError
from planner import Arc, Dwell, Line, Program, Spline, Trigger, Turn, load_program, plan, plan_parts
from planner.export import plan_files
from planner.path.actuation import actuate, make_points
from planner.program.program_writer import program_toml

TWIST = Rotation.from_euler("XYZ", [0.05, 0.0, 0.0])
SEGMENTS = (
    Line([0.01, 0, 0.03], trigger=Trigger("third", 1 / 3)),
    Dwell(0.1),
    Arc([0, 0, 0.03], [0, 0, 1], 2.0, trigger=Trigger("arc done")),
    Turn(TWIST, trigger=Trigger("half turned", 0.5)),
    Line([0, 0, 0.03], Rotation.identity(), trigger=Trigger("begins", 0)),
)


@pytest.fixture(scope="module")
def marked(hexapod):
    start = RigidTransform.from_components([0, 0, 0.03], Rotation.identity())
    return plan(Program(SEGMENTS, start=start, repeat=2), hexapod, order=2)


def test_every_trigger_of_every_repetition_in_order(marked):
    names = ["third", "arc done", "half turned", "begins"]
    assert [event.name for event in marked.triggers] == 2 * names
    assert [event.where.segment for event in marked.triggers] == 2 * [1, 3, 4, 5]
    assert [event.where.repetition for event in marked.triggers] == 4 * [1] + 4 * [2]
    assert str(marked.triggers[4].where).startswith("s = ")
    assert "segment 1 of repetition 2" in str(marked.triggers[4].where)
    assert (np.diff([event.time for event in marked.triggers]) >= 0).all()


def test_positions_are_those_of_the_program(marked, hexapod):
    half = Rotation.from_rotvec(TWIST.as_rotvec() / 2)
    rim = [0.01 * np.cos(2), 0.01 * np.sin(2), 0.03]
    expected = [
        ([0.01 / 3, 0, 0.03], Rotation.identity()),
        (rim, Rotation.identity()),
        (rim, half),
        (rim, TWIST),
    ]
    for event, (position, rotation) in zip(marked.triggers, 2 * expected, strict=True):
        found = hexapod.home.inv() * event.pose
        assert found.translation == pytest.approx(position, abs=1e-9)
        assert (found.rotation.inv() * rotation).magnitude() < 1e-8


@pytest.mark.parametrize("parts", [False, True])
def test_after_a_rest_it_is_when_the_motion_goes_on(hexapod, parts):
    """A lamp before a rest and one behind it: the length of the rest apart, at the same place; at
    no rest at once.
    """
    segments = (
        Line([0.01, 0, 0.03], trigger=Trigger("before")),
        Dwell(0.1),
        Dwell(0.05),
        Line([0.01, 0.01, 0.03], trigger=Trigger("behind", 0.0, after_rest=True)),
        Line([0, 0, 0.03], trigger=Trigger("corner", 0.0, after_rest=True)),
    )
    program = Program(segments, start=RigidTransform.from_translation([0, 0, 0.03]), repeat=2)
    if parts:
        made = [*plan_parts(program, hexapod, order=2, pieces=2)]
        found = [event for part in made for event in part.triggers]
    else:
        found = plan(program, hexapod, order=2).triggers
    assert [event.name for event in found] == 2 * ["before", "behind", "corner"]
    for before, behind in (found[0:2], found[3:5]):
        assert behind.time - before.time == pytest.approx(0.15, abs=1e-12)
        assert behind.counts.tolist() == before.counts.tolist()
        assert behind.where.s == before.where.s
    whole = plan(program, hexapod, order=2).trajectory
    assert whole.at(found[2].time).along[0] == pytest.approx(found[2].where.s, abs=1e-9)
    with pytest.raises(MotionError, match="at = 0"):
        Trigger("wrong", 0.5, after_rest=True)


@pytest.mark.parametrize("tool", [None, RigidTransform.from_translation([0.01, 0.005, 0.04])])
def test_on_a_spline_it_is_a_share_of_the_way(hexapod, tool):
    """The tool's way up to the trigger, by Simpson's rule on 4001 points of every piece: 1e-12 of
    it.
    """
    z = 0.03 if tool is None else 0.07
    start = RigidTransform.from_components([0.01, 0, z], Rotation.identity())
    rotate = Rotation.from_rotvec([[0.02, 0, 0.05], [0.04, 0.01, 0.02]])
    curve = Spline([[0.012, 0.006, z], [0.02, 0.001, z]], rotate, trigger=Trigger("here", 0.2))
    made = plan(Program((Line([0.01, 0.002, z]), curve), start=start, tool=tool), hexapod, order=2)
    path, s = made.path, made.triggers[0].where.s

    def length(low, high, piece):
        x = np.linspace(low, high, 4001)
        points = make_points(path, x, np.full(len(x), piece))
        return simpson(np.linalg.norm(points.tool_derivatives[1][:, :3], axis=1), x=x)

    pieces = range(1, len(path.pieces))
    whole = sum(length(path.breaks[k], path.breaks[k + 1], k) for k in pieces)
    way = sum(
        length(path.breaks[k], min(path.breaks[k + 1], s), k) for k in pieces if path.breaks[k] < s
    )
    assert path.breaks[1] < s < path.breaks[-1]
    assert way == pytest.approx(0.2 * whole, rel=1e-11)


def test_times_by_another_root_finder(marked):
    """Brent on s(t) − s at 1e-15 s; where the motion rests, s(t) is flat: just before the arrival
    it is not there.
    """
    trajectory = marked.trajectory
    for event in marked.triggers:
        s, t = event.where.s, event.time
        if event.name in ("third", "half turned"):
            root = brentq(
                lambda x, s=s: trajectory.at(x).s[0] - s,
                0,
                trajectory.duration,
                xtol=1e-15,
                rtol=1e-14,
            )
            assert t == pytest.approx(root, abs=1e-12)
        else:
            assert trajectory.at(t).s[0] == pytest.approx(s, abs=1e-15)
            assert trajectory.at(t).sd[0] == pytest.approx(0, abs=1e-12)
            assert trajectory.at(t - 1e-4).s[0] < s


def test_a_rest_is_marked_at_its_arrival(hexapod):
    plain = plan(
        Program((Line([0, 0, 0.01], trigger=Trigger("there")), Dwell(0.5))), hexapod, order=2
    )
    assert plain.triggers[0].time == pytest.approx(plain.trajectory.duration - 0.5, abs=1e-12)


def test_counts_are_those_of_the_pulses(marked):
    for event in marked.triggers:
        for axis, count in zip(marked.pulses.axes, event.counts, strict=True):
            fired = axis.ticks <= np.floor(
                np.nextafter(event.time * marked.pulses.clock_hz, np.inf)
            )
            assert count == axis.start + axis.direction[fired].sum()
        # a count is within half a pulse, and a tick's travel, of the axis
        q = marked.machine.inverse(event.pose)
        pulse = np.array([axis.pulse for axis in marked.machine.axes])
        assert np.abs(event.counts - (q - marked.machine.home_q) / pulse).max() < 0.51


def test_the_table_reads_back(marked, tmp_path):
    plan_files.write_trigger_csv(marked.triggers, marked.machine.axes, tmp_path / "triggers.csv")
    with (tmp_path / "triggers.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == [event.name for event in marked.triggers]
    for row, event in zip(rows, marked.triggers, strict=True):
        assert float(row["t [s]"]) == event.time
        assert (int(row["segment"]), int(row["repetition"])) == (
            event.where.segment,
            event.where.repetition,
        )
        assert [int(row[f"leg{n} [counts]"]) for n in range(1, 7)] == event.counts.tolist()
        assert [float(row[f"{name} [m]"]) for name in "xyz"] == event.pose.translation.tolist()


def test_a_repeated_program_is_the_program_written_out(marked, hexapod):
    start = RigidTransform.from_components([0, 0, 0.03], Rotation.identity())
    written = plan(Program(SEGMENTS + SEGMENTS, start=start), hexapod, order=2)
    for name in ("knots", "s", "v", "a", "j", "piece"):
        np.testing.assert_array_equal(
            getattr(written.trajectory, name), getattr(marked.trajectory, name)
        )
    assert [event.time for event in written.triggers] == [event.time for event in marked.triggers]
    assert [event.where.segment for event in written.triggers] == [1, 3, 4, 5, 6, 8, 9, 10]


def test_a_segment_without_length_in_a_repetition_is_named(hexapod):
    segments = (Line([0.01, 0, 0], line_number=7), Arc([0, 0, 0], [0, 0, 1], 2 * np.pi))
    with pytest.raises(
        MotionError,
        match=r"segment 1, line \(line 7\): repetition 2: it ends where it starts.*start",
    ):
        actuate(Program(segments, repeat=2), hexapod)
    assert len(actuate(Program(segments), hexapod).breaks) == 3


@pytest.mark.parametrize("count", [0, -1, True, 1.0])
def test_counts_that_are_none_are_refused(count):
    with pytest.raises(MotionError, match="repeat"):
        Program(SEGMENTS, repeat=count)


@pytest.mark.parametrize(("name", "at"), [("", 1), ("a", -0.1), ("a", 1.1), ("a", float("nan"))])
def test_triggers_that_are_none_are_refused(name, at):
    with pytest.raises(MotionError, match="trigger"):
        Trigger(name, at)


def test_a_dwells_trigger_is_at_a_share_of_its_time(tmp_path):
    """Written and read again; of two dwells in a row, each has its own; after_rest is of what
    moves.
    """
    cue = Dwell(0.4, trigger=Trigger("cue", 0.25))
    program = Program(
        [Line([0.01, 0, 0]), cue, Dwell(0.2, trigger=Trigger("go")), Line([0, 0, 0])], repeat=2
    )
    (tmp_path / "p.toml").write_text(program_toml(program))
    made = plan(load_program(tmp_path / "p.toml"), "cartesian", order=2)
    move = (made.duration - 2 * 0.6) / 4
    due = [move + 0.1, move + 0.6, 3 * move + 0.7, 3 * move + 1.2]
    assert [event.name for event in made.triggers] == ["cue", "go"] * 2
    assert [event.time for event in made.triggers] == pytest.approx(due, abs=1e-7)
    assert [(event.where.segment, event.where.repetition) for event in made.triggers] == [
        (2, 1),
        (3, 1),
        (2, 2),
        (3, 2),
    ]
    with pytest.raises(MotionError, match="trigger go: after_rest is of what moves"):
        Dwell(0.1, trigger=Trigger("go", 0.0, after_rest=True))
