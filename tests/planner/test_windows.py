"""A path planned window by window: as fast as planned whole, continuous where windows meet, at rest
at every end.
"""

import pickle
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from kinematics import MotionError, load_machine
from planner import Blend, Line, Program, Stop, load_program
from planner.limits import limits_of
from planner.path.actuation import MachinePath, actuate
from planner.path.join_and_blend import PathStep
from planner.timing import certified_solve
from planner.windows import WindowPlanner

LINE, BLEND, SPEED = 4e-4, 2e-5, 0.01


def draw_polyline(count, join=None, seed=0):
    """Short lines of a seeded walk in a plane, as from CAM."""
    rng, angle, here, segments = np.random.default_rng(seed), 0.0, np.zeros(2), []
    for _ in range(count):
        angle += rng.uniform(-0.6, 0.6)
        here = here + LINE * np.array([np.cos(angle), np.sin(angle)])
        segments.append(
            Line(np.array([*here, 0.025]), speed=SPEED, join=Blend(BLEND) if join is None else join)
        )
    return Program(
        start=RigidTransform.from_translation([0.0, 0.0, 0.025]), segments=tuple(segments)
    )


def steps_of(path: MachinePath):
    return [
        PathStep(*each) for each in zip(path.pieces, path.joins[1:], path.dwells[1:], strict=True)
    ]


def plan_both(program, machine, order, pieces):
    path = actuate(program, machine)
    planner = WindowPlanner(
        machine, lambda part: limits_of(part, machine.axes, order), order, pieces=pieces
    )
    return certified_solve(path, limits_of(path, machine.axes, order), order), list(
        planner(steps_of(path))
    )


@pytest.fixture(scope="module", params=[2, 3])
def both(request, hexapod):
    return plan_both(draw_polyline(16), hexapod, request.param, 12)


def test_windows_take_as_long_as_the_whole(both):
    whole, windows = both
    assert len(windows) > 2
    assert sum(window.duration for window in windows) == pytest.approx(
        whole.trajectory.duration, rel=1e-3
    )


def test_every_window_is_proved_and_comes_to_rest(both):
    for window in both[1]:
        motion = window.solution.trajectory
        assert window.solution.certificate.holds
        end = motion.at(motion.duration)
        assert np.abs(end.qd).max() < 1e-9 * np.abs(motion.at(motion.duration / 2).qd).max()


def test_a_window_goes_on_just_where_the_one_before_was_left(both):
    whole, windows = both
    order = 3 if whole.trajectory.j.any() else 2
    for one, other in pairwise(windows):
        before, after = one.solution.trajectory, other.solution.trajectory
        assert one.start.elapsed + Fraction(one.duration) == other.start.elapsed == one.next.elapsed
        assert before.v[one.kept] == after.v[0]
        if order == 3:
            assert before.a[one.kept] == after.a[0]
        np.testing.assert_allclose(before.at(one.duration).q, after.at(0.0).q, atol=1e-12)


def test_stops_end_windows(hexapod):
    whole, windows = plan_both(draw_polyline(8, Stop()), hexapod, 2, 3)
    assert len(windows) == 3
    assert all(window.kept == len(window.solution.trajectory.s) for window in windows)
    assert sum(window.duration for window in windows) == pytest.approx(
        whole.trajectory.duration, rel=1e-12
    )


def test_steps_are_taken_as_they_are_needed(hexapod):
    path = actuate(draw_polyline(40), hexapod)
    taken = 0

    def come():
        nonlocal taken
        for step in steps_of(path):
            taken += 1
            yield step

    planner = WindowPlanner(hexapod, lambda part: limits_of(part, hexapod.axes, 2), 2, pieces=16)
    next(planner(come()))
    assert taken <= 2 * 16 + 2 < len(path.pieces)


def test_a_window_that_cannot_be_is_refused_after_those_that_can(hexapod, limit_search):
    limit_search(0.0)
    program = draw_polyline(10)
    far = Line(np.array([5.0, 0.0, 0.025]), speed=SPEED, join=Blend(BLEND))
    path = actuate(Program(start=program.start, segments=(*program.segments, far)), hexapod)
    planner = WindowPlanner(hexapod, lambda part: limits_of(part, hexapod.axes, 2), 2, pieces=6)
    given = []
    with pytest.raises(MotionError, match="segment 11"):
        given.extend(planner(steps_of(path)))
    assert given
    assert all(window.solution.certificate.holds for window in given)


def test_coordinates_go_on_turn_after_turn():
    machine = load_machine("arm")
    program = load_program("arm-circle-back")
    whole, windows = plan_both(program, machine, 2, 1)
    ends = [one.solution.trajectory.at(one.duration).q for one in windows]
    np.testing.assert_allclose(
        ends[-1], whole.trajectory.at(whole.trajectory.duration).q, atol=1e-9
    )
    assert sum(window.duration for window in windows) == pytest.approx(
        whole.trajectory.duration, rel=1e-3
    )


class Pickled:
    """Helpers of this process, which see what others would; the last that was given is done
    first.
    """

    def __init__(self, places=3):
        self.places, self.given, self.most, self.alone = places, [], 0, []

    def room(self):
        return self.places

    def prepare(self, work):
        packed = pickle.dumps(work)

        def submit(stretch):
            self.given.append([packed, pickle.dumps(stretch), None])
            self.most = max(self.most, sum(each[2] is None for each in self.given))
            return Done(self, len(self.given) - 1)

        return submit

    def tell_alone(self, segment):
        self.alone.append(segment)


class Done:
    def __init__(self, helpers, n):
        self.helpers, self.n = helpers, n

    def result(self, here):
        for each in reversed(self.helpers.given):
            each[2] = each[2] or pickle.dumps(pickle.loads(each[0])(pickle.loads(each[1])))
        return pickle.loads(self.helpers.given[self.n][2])


def compare_windows(some, others):
    assert len(some) == len(others)
    for one, other in zip(some, others, strict=True):
        for name in ("knots", "s", "v", "a", "j", "piece"):
            here, there = (getattr(each.solution.trajectory, name) for each in (one, other))
            np.testing.assert_array_equal(here, there, strict=True)
        assert one.solution.certificate.worst == other.solution.certificate.worst
        assert one.solution.certificate.where == other.solution.certificate.where
        assert (one.steps, one.kept) == (other.steps, other.kept)
        for a, b in ((one.start, other.start), (one.next, other.next)):
            plain = [replace(each, near=None, continuation=None) for each in (a, b)]
            assert plain[0] == plain[1]
            assert (a.near is None) == (b.near is None)
            assert a.near is None or np.array_equal(a.near, b.near)
            assert (a.continuation is None) == (b.continuation is None)
        end = one.solution.trajectory.duration
        assert np.array_equal(
            one.solution.trajectory.at(end).q, other.solution.trajectory.at(end).q
        )


def draw_stops(pattern, far=False):
    """Short lines, stretches of so many between stops."""
    segments = list(draw_polyline(sum(pattern)).segments)
    for last in np.cumsum(pattern) - 1:
        segments[last] = replace(segments[last], join=Stop())
    if far:
        segments.append(Line(np.array([5.0, 0.0, 0.025]), speed=SPEED))
    return Program(
        start=RigidTransform.from_translation([0.0, 0.0, 0.025]), segments=tuple(segments)
    )


@pytest.fixture(scope="module")
def stopping(hexapod):
    """Stretches of many kinds, and how to plan them."""
    planner = WindowPlanner(hexapod, partial(limits_of, axes=hexapod.axes, order=2), 2, pieces=8)
    steps = steps_of(actuate(draw_stops([2, 1, 9, 1, 4, 4, 2]), hexapod))
    return planner, steps, list(planner(steps))


def test_who_helps_changes_nothing(stopping):
    planner, steps, alone = stopping
    helpers = Pickled()
    compare_windows(list(planner(steps, helpers)), alone)
    assert len(helpers.given) > 4
    assert helpers.most == 3
    assert not helpers.alone


def test_with_helpers_refusals_come_where_they_do_alone(stopping, hexapod, limit_search):
    limit_search(0.0)
    planner = stopping[0]
    steps = steps_of(actuate(draw_stops([3, 9], far=True), hexapod))

    def break_off():
        yield from steps[:12]
        raise MotionError("no line")

    for coming in (lambda: steps, break_off):
        told = []
        for helpers in (None, Pickled()):
            given = []
            with pytest.raises(MotionError) as no:
                given.extend(planner(coming(), helpers))
            told.append((given, str(no.value)))
        compare_windows(told[0][0], told[1][0])
        assert told[0][0]
        assert told[0][1] == told[1][1]


def test_the_same_shapes_in_another_process_are_the_same(hexapod):
    """What is built on them is not built again."""
    for step in steps_of(actuate(draw_polyline(2), hexapod)):
        again = pickle.loads(pickle.dumps(step.piece.shape))
        assert again == step.piece.shape
        assert hash(again) == hash(step.piece.shape)


def test_helpers_stay_on_the_turn_and_branch():
    machine, program = load_machine("arm"), load_program("arm-circle-back")
    steps = steps_of(actuate(program, machine))
    planner = WindowPlanner(machine, partial(limits_of, axes=machine.axes, order=2), 2, pieces=1)
    compare_windows(list(planner(steps, Pickled())), list(planner(steps)))
