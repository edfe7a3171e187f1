"""Equal runs are planned and proved once: the motion and its proof are those of planning each of
them.
"""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from kinematics import MotionError, load_machine
from planner import plan, plan_parts
from planner.bounds import bound_duration
from planner.certificate import certify
from planner.limits import limits_of
from planner.limits.limit import Limit, Rows, Term
from planner.limits.registry import MACHINE_LIMITS
from planner.path.chain import walk_path
from planner.path.shape import Piece
from planner.program.model import Arc, Dwell, Line, Program
from planner.program.modifiers import Blend
from planner.windows import WindowPlanner

REPEAT = 3
START = np.array([0.0, 0.0, 0.025])
# A copy begins at another path length, which is rounded: to 1e-16 of the path, a few times. At
# order 3 a run that is solved anew there ends a little elsewhere, within the solver's tolerance of
# 1e-6.
ROUNDING = {2: 1e-12, 3: 1e-9}
# A proved bound is refined until it is within 5e-7 of what is attained.
TIGHT = 1e-6


class FarAway(Limit):
    """A limit of a caller's own that no motion comes near: where there is one, nothing is
    copied.
    """

    name, channels, units = "far away", ("tool",), (("mm/s", 1e3),)
    terms = frozenset({Term.SD})
    bounds = np.array([1e6])

    def value(self, motion):
        return motion.qd[:, :1]

    def use(self, low, high, piece):
        return np.maximum(-low, high) / self.bounds

    def rows(self, points):
        return Rows(
            {Term.SD: points.derivatives[1][:, :1]},
            np.broadcast_to(self.bounds, (len(points.s), 1)),
        )


@pytest.fixture(scope="module")
def program():
    """Two corners, one of them rounded, half a circle and a dwell; back where it began, at rest."""
    points = START + 0.001 * np.array([[8, 0, 0], [8, 5, 0], [0, 5, 0]])
    half = Arc(centre=(0.0, 0.0025, 0.025), normal=(0.0, 0.0, 1.0), angle=np.pi)
    segments = (
        Line(points[0]),
        Line(points[1], join=Blend(5e-5)),
        Line(points[2], speed=0.02),
        Dwell(0.01),
        half,
    )
    return Program(
        start=RigidTransform.from_translation(START),
        segments=segments,
        repeat=REPEAT,
        name="repeated",
    )


@pytest.fixture(scope="module", params=[("hexapod", 3), ("cartesian", 2), ("cartesian", 3)])
def plans(request, program):
    """The plan with copies, the plan without, and the numbers of runs that each has solved."""
    name, order = request.param
    machine, counts = load_machine(name), []
    made = []
    for limits in ((), (FarAway(),)):
        solved = []
        made.append(
            plan(
                program,
                machine,
                order=order,
                limits=limits,
                progress=lambda n, of, s=solved: s.append(of),
            )
        )
        counts.append(solved[0])
    return (*made, counts)


def test_equal_runs_are_solved_once(plans):
    copied, single, (few, all_runs) = plans
    assert all_runs == copied.path.stops(copied.order).sum() - 1
    assert few <= all_runs - (REPEAT - 2) * all_runs / REPEAT
    assert len(copied.methods) == len(single.methods) == all_runs


def test_copies_take_as_long_and_use_as_much_of_the_limits(plans):
    copied, single, _ = plans
    assert copied.duration == pytest.approx(single.duration, rel=ROUNDING[copied.order])
    assert copied.certificate.holds
    for name, worst in copied.certificate.worst.items():
        assert worst == pytest.approx(single.certificate.worst[name], abs=TIGHT)


def test_the_proof_of_a_copy_is_that_of_the_whole_motion_proved_anew(plans):
    copied = plans[0]
    anew = certify(copied.trajectory, copied.limits)
    assert anew.holds
    for name, use in copied.certificate.use.items():
        assert (copied.certificate.attained[name] <= anew.use[name] + TIGHT).all()
        assert (anew.attained[name] <= use + TIGHT).all()


def test_copies_have_the_same_pulses(plans):
    copied, single, _ = plans
    assert copied.pulses.total > 1000
    for one, other in zip(copied.pulses.axes, single.pulses.axes, strict=True):
        assert (one.direction == other.direction).all()
        # a crossing may fall on the other side of half a tick
        assert (np.abs(one.ticks - other.ticks) <= 1).all()


def test_the_bound_of_equal_runs_is_that_of_each(plans):
    copied, single, _ = plans
    quick = [
        bound_duration(one.trajectory, one.limits, one.order, most_cells=300)
        for one in (copied, single)
    ]
    # path lengths differ by rounding, and the dual stops at 1e-5 of the time: bounds then differ by
    # 2e-9
    assert quick[0].value == pytest.approx(quick[1].value, rel=1e-8)
    np.testing.assert_allclose(quick[0].s, quick[1].s, atol=1e-9 * copied.path.breaks[-1])
    assert quick[0].loss.sum() == pytest.approx(copied.duration - quick[0].value, rel=1e-6)


def test_runs_that_differ_in_a_cap_alone_are_not_copied():
    machine = load_machine("cartesian")
    there, back = np.array([0.01, 0.0, 0.025]), START
    speeds = 0.02, 0.01, 0.02
    segments = [
        line for speed in speeds for line in (Line(there, speed=speed), Line(back, speed=speed))
    ]
    planned = plan(
        Program(start=RigidTransform.from_translation(START), segments=tuple(segments)), machine
    )
    moving = planned.trajectory.piece
    fastest = [planned.trajectory.v[moving == k].max() for k in range(len(segments))]
    np.testing.assert_allclose(fastest, np.repeat(speeds, 2), rtol=1e-6)


class SlowThird(FarAway):
    """A limit that only the third piece of the path keeps below 5 mm/s."""

    name = "slow third piece"

    def use(self, low, high, piece):
        return np.maximum(-low, high) / self.caps[piece][:, None]

    def rows(self, points):
        return Rows({Term.SD: points.derivatives[1][:, :1]}, self.caps[points.piece][:, None])

    def __init__(self, pieces):
        self.caps = np.where(np.arange(pieces) == 2, 0.005, 1e6)


def test_a_limit_that_depends_on_the_place_is_not_copied(monkeypatch):
    """Even if the table has it: a proof of one place would be taken for that of another."""
    monkeypatch.setitem(
        MACHINE_LIMITS, SlowThird, lambda machine, path: SlowThird(len(path.pieces))
    )
    there = Line(np.array([0.01, 0.0, 0.025]))
    program = Program(
        start=RigidTransform.from_translation(START),
        segments=(there, Line(START)),
        repeat=3,
    )
    planned = plan(program, load_machine("cartesian"))
    fastest = [planned.trajectory.v[planned.trajectory.piece == k].max() for k in range(6)]
    assert planned.certificate.holds
    assert fastest[2] <= 0.005
    assert min(fastest[0], fastest[4]) > 0.01


def test_parts_with_copies_are_those_without(program):
    machine = load_machine("hexapod")
    for order, pieces in ((3, 4), (2, 14)):
        (copied, single) = (
            list(plan_parts(program, machine, order=order, limits=limits, pieces=pieces))
            for limits in ((), (FarAway(),))
        )
        assert len(copied) == len(single)
        assert copied[-1].standing.duration == pytest.approx(
            single[-1].standing.duration, rel=ROUNDING[order]
        )
        assert [part.standing.segment for part in copied] == [
            part.standing.segment for part in single
        ]
        proof = copied[-1].standing.certificate
        assert proof.holds
        for name, worst in proof.worst.items():
            assert worst == pytest.approx(single[-1].standing.certificate.worst[name], abs=TIGHT)
        for one, other in zip(copied, single, strict=True):
            assert one.pulses.total == other.pulses.total


def test_a_stretch_longer_than_a_window_is_planned_once(program):
    """Its windows share the numbers of the first, and state their own place on the path."""
    machine = load_machine("hexapod")
    smooth = tuple(
        replace(segment, join=Blend(5e-5)) if isinstance(segment, Line) else segment
        for segment in program.segments
        if not isinstance(segment, Dwell)
    )
    program = replace(program, segments=smooth)
    planner = WindowPlanner(
        machine, lambda path: limits_of(path, machine.axes, 2), 2, pieces=3, copying=True
    )
    windows = list(planner(walk_path(program, machine)))
    each = len(windows) // REPEAT
    for one, other in zip(windows[each:-each], windows[2 * each :], strict=True):
        assert other.solution.trajectory.v is one.solution.trajectory.v
        assert other.solution.certificate.use is one.solution.certificate.use
    for window in windows:
        path, start = window.solution.trajectory.path, window.start
        for at in window.solution.certificate.where.values():
            near = np.searchsorted(path.breaks, at.s - start.length + np.array([-1e-9, 1e-9])) - 1
            numbers = {
                (path.pieces[k].segment, path.pieces[k].repetition)
                for k in np.clip(near, 0, len(path.pieces) - 1)
            }
            assert (at.segment, at.repetition) in numbers


@pytest.mark.parametrize("join", [Blend(5e-5), None])
def test_a_repetition_that_cannot_be_drawn_is_refused_in_parts(join):
    """The second repetition begins where its first line ends."""
    joins = {} if join is None else {"join": join}
    ends = [START + 0.004 * np.array(way) for way in ([1, 0, 0], [1, 1, 0], [1, 0, 0])]
    lines = tuple(Line(end, **joins) for end in ends)
    program = Program(start=RigidTransform.from_translation(START), segments=lines, repeat=2)
    with pytest.raises(MotionError, match="repetition 2"):
        list(plan_parts(program, load_machine("cartesian"), pieces=2))


OTHER_VALUES = {
    "length": 2.0,
    "tool_speed": 0.5,
    "start": 0.25,
    "turn": 0.125,
    "tool_acceleration": 3.0,
    "angular_speed": 0.75,
    "constant": True,
    "tool_jerk": 40.0,
}


@pytest.mark.parametrize("name", [field.name for field in fields(Piece)])
def test_every_field_of_a_piece_decides_whether_it_equals_another(name, program):
    """A piece that differs in anything but its numbers is not timed and proved by another's
    motion.
    """
    machine = load_machine("cartesian")
    first, *others = [step.piece for step in walk_path(program, machine)]
    other = next(piece for piece in others if piece.shape != first.shape)
    if name in ("segment", "repetition"):
        assert replace(first, **{name: 7}).content == first.content
        return
    value = OTHER_VALUES.get(name, getattr(other, name))
    assert replace(first, **{name: value}).content != first.content
