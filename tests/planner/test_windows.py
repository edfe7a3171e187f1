"""A path planned window by window: as fast as planned whole, continuous where windows meet, at rest at every end."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from kinematics import MotionError, load_machine
from planner import load_program
from planner.limits import limits_of
from planner.path.actuation import MachinePath, actuate
from planner.path.join_and_blend import PathStep
from planner.program.model import Line, Program
from planner.program.modifiers import Blend, Stop
from planner.timing.certified_solve import certified_solve
from planner.windows import WindowPlanner

LINE, BLEND, SPEED = 4e-4, 2e-5, 0.01


def draw_polyline(count, join=None, seed=0):
    """Short lines of a seeded walk in a plane, as from CAM."""
    rng, angle, here, segments = np.random.default_rng(seed), 0.0, np.zeros(2), []
    for _ in range(count):
        angle += rng.uniform(-0.6, 0.6)
        here = here + LINE * np.array([np.cos(angle), np.sin(angle)])
        segments.append(Line(np.array([*here, 0.025]), speed=SPEED, join=Blend(BLEND) if join is None else join))
    return Program(start=RigidTransform.from_translation([0.0, 0.0, 0.025]), segments=tuple(segments))


def steps_of(path: MachinePath):
    return [PathStep(*each) for each in zip(path.pieces, path.joins[1:], path.dwells[1:], strict=True)]


def plan_both(program, machine, order, pieces):
    path = actuate(program, machine)
    planner = WindowPlanner(machine, lambda part: limits_of(part, machine.axes, order), order, pieces=pieces)
    return certified_solve(path, limits_of(path, machine.axes, order), order), list(planner(steps_of(path)))


@pytest.fixture(scope="module", params=[2, 3])
def both(request, hexapod):
    return plan_both(draw_polyline(40), hexapod, request.param, 30)


def test_windows_take_as_long_as_the_whole(both):
    whole, windows = both
    assert len(windows) > 2
    assert sum(window.duration for window in windows) == pytest.approx(whole.trajectory.duration, rel=1e-3)


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
        assert one.start.begin + one.duration == other.start.begin == one.next.begin
        assert before.v[one.kept] == after.v[0]
        if order == 3:
            assert before.a[one.kept] == after.a[0]
        np.testing.assert_allclose(before.at(one.duration).q, after.at(0.0).q, atol=1e-12)


def test_it_can_be_gone_on_with_from_every_window(hexapod):
    path = actuate(draw_polyline(40), hexapod)
    planner = WindowPlanner(hexapod, lambda part: limits_of(part, hexapod.axes, 3), 3, pieces=30)
    windows = list(planner(steps_of(path)))
    for n, window in enumerate(windows[:-1]):
        onward = next(planner(steps_of(path)[window.next.steps :], window.next)).solution.trajectory
        for name in ("knots", "s", "v", "a", "j", "piece"):
            np.testing.assert_array_equal(
                getattr(onward, name), getattr(windows[n + 1].solution.trajectory, name), strict=True
            )


def test_stops_end_windows(hexapod):
    whole, windows = plan_both(draw_polyline(8, Stop()), hexapod, 2, 3)
    assert len(windows) == 3
    assert all(window.kept == len(window.solution.trajectory.s) for window in windows)
    assert sum(window.duration for window in windows) == pytest.approx(whole.trajectory.duration, rel=1e-12)


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


def test_a_window_that_cannot_be_is_refused_after_those_that_can(hexapod):
    program = draw_polyline(20)
    far = Line(np.array([5.0, 0.0, 0.025]), speed=SPEED, join=Blend(BLEND))
    path = actuate(Program(start=program.start, segments=(*program.segments, far)), hexapod)
    planner = WindowPlanner(hexapod, lambda part: limits_of(part, hexapod.axes, 2), 2, pieces=12)
    given = []
    with pytest.raises(MotionError, match="segment 21"):
        given.extend(planner(steps_of(path)))
    assert given
    assert all(window.solution.certificate.holds for window in given)


def test_coordinates_go_on_turn_after_turn():
    machine = load_machine("arm")
    program = load_program("arm-circle-back")
    whole, windows = plan_both(program, machine, 2, 1)
    ends = [one.solution.trajectory.at(one.duration).q for one in windows]
    np.testing.assert_allclose(ends[-1], whole.trajectory.at(whole.trajectory.duration).q, atol=1e-9)
    assert sum(window.duration for window in windows) == pytest.approx(whole.trajectory.duration, rel=1e-3)
