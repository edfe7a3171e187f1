"""Motions that begin and end at a speed: closed forms on one axis, the certificate, the pulses,
what is refused.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PPoly
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError
from planner import (
    Arc,
    Dwell,
    Infeasible,
    Line,
    Program,
    Spline,
    Turn,
    classical,
    plan,
    time_optimal,
)
from planner.certificate import certify
from planner.path.actuation import actuate
from planner.pulses import check

V, A = 1.0, 2.0
RIM = RigidTransform.from_components([0.015, 0, 0.025], Rotation.identity())


def straight(length):
    return PPoly(np.array([[[1.0]], [[0.0]]]), [0.0, length])


def test_speeds_that_cannot_be_are_refused():
    """From V₀ to rest takes V₀²/2A: over 0.1 it is √(2 · A · 0.1)."""
    with pytest.raises(Infeasible, match="start speed") as refusal:
        time_optimal(straight(0.1), max_speed=V, max_acceleration=A, start_speed=1.0)
    assert refusal.value.limit == pytest.approx(np.sqrt(2 * A * 0.1), rel=1e-6)
    with pytest.raises(Infeasible, match="end speed"):
        time_optimal(straight(1.5), max_speed=V, max_acceleration=A, end_speed=1.01)
    for wrong in (-0.1, np.inf, np.nan, "1", True):
        with pytest.raises(MotionError, match="end_speed"):
            time_optimal(straight(1.5), max_speed=V, max_acceleration=A, end_speed=wrong)


@pytest.fixture(scope="module")
def moving(hexapod):
    """Onto a circle and off it again at speeds, a rest between."""
    segments = (Line([0, 0, 0.025]), Dwell(0.1), Line([0.01, 0.01, 0.03], speed=0.02))
    return plan(Program(segments, start=RIM, start_speed=0.01, end_speed=0.02), hexapod, order=2)


def test_a_program_begins_and_ends_at_its_tool_speeds(moving):
    trajectory = moving.trajectory
    assert moving.certificate.holds
    ends = trajectory.at(np.array([0.0, trajectory.duration]))
    assert np.linalg.norm(ends.tool_velocity, axis=1) == pytest.approx([0.01, 0.02], rel=1e-9)
    assert ends.tool_velocity[0] == pytest.approx([-0.01, 0, 0], abs=1e-12)
    # a speed less to gain: faster than from rest to rest
    rest = plan(replace(moving.program, start_speed=0.0, end_speed=0.0), moving.machine, order=2)
    assert trajectory.duration < rest.trajectory.duration
    assert classical(moving).duration == pytest.approx(classical(rest).duration, rel=1e-12)


def test_pulses_of_a_motion_that_is_under_way(moving):
    verdict = check(moving.pulses, moving.trajectory, moving.machine.axes, moving.machine.home_q)
    assert verdict.holds
    q = moving.trajectory.at(0.0).q[0] - moving.machine.home_q
    assert np.abs(moving.pulses.counts(0.0)[0] * 0.75e-6 - q).max() <= 0.75e-6 / 2 * (1 + 1e-6)


@pytest.mark.parametrize(
    ("start", "end", "moment"), [(0.0101, 0.02, 0), (0.0, 0.02, 0), (0.01, 0.0199, -1)]
)
def test_the_certificate_takes_no_other_speed(moving, start, end, moment):
    """The same motion along a path that states another speed: a jump of speed, at that end."""
    stated = actuate(replace(moving.program, start_speed=start, end_speed=end), moving.machine)
    certificate = certify(replace(moving.trajectory, path=stated), moving.limits)
    assert not certificate.holds
    assert certificate.where["speed jump"].t == moving.trajectory.knots[moment]


@pytest.mark.parametrize(
    ("segments", "speeds", "phrase"),
    [
        ((Turn(RIM.rotation, line_number=4),), (0.01, 0), r"segment 1, turn \(line 4\).*start_speed"),
        ((Line([0, 0, 0.01]), Dwell(1.0, line_number=9)), (0, 0.01), r"segment 2, dwell \(line 9\).*end_speed"),
        ((Line([0, 0, 0.01], speed=0.005, line_number=3),), (0.006, 0), r"line 3\).* 6 mm/s is above its speed 5 mm/s"),
    ],
)  # fmt: skip
def test_segments_that_cannot_bear_a_speed_are_named(hexapod, segments, speeds, phrase):
    program = Program(segments, start=RIM, start_speed=speeds[0], end_speed=speeds[1])
    with pytest.raises(MotionError, match=phrase):
        actuate(program, hexapod)


@pytest.mark.parametrize("speed", [-1.0, np.nan, np.inf])
def test_speeds_that_are_none_are_refused(speed):
    with pytest.raises(MotionError, match="end_speed"):
        Program((Arc([0, 0, 0], [0, 0, 1], 1),), end_speed=speed)


@pytest.mark.parametrize("order", [2, 3])
def test_end_speeds_are_the_tool_s_on_splines_too(hexapod, order):
    """A spline's parameter is its chords' length; what is stated is how fast the tool goes."""
    through = [[0.01, 0.02, 0.03], [0.03, 0.0, 0.03], [0.05, 0.02, 0.03]]
    start = RigidTransform.from_translation([0, 0, 0.03])
    program = Program([Spline(through)], start=start, start_speed=0.004, end_speed=0.006)
    made = plan(program, hexapod, order=order)
    state = made.trajectory.at(np.array([0.0, made.trajectory.duration]))
    assert np.linalg.norm(state.tool_velocity, axis=1) == pytest.approx([0.004, 0.006], rel=1e-9)
    assert made.certificate.holds


@pytest.mark.parametrize(("seed", "asked"), [(99, (0.1, 0.1)), (1, (0.0, 0.2))])
def test_the_largest_end_speed_that_is_told_is_the_largest(seed, asked):
    """It does, 1.01 of it does not; and what is told does not depend on what was asked for."""
    path = CubicSpline(np.linspace(0, 1, 12), np.random.default_rng(seed).uniform(-1, 1, (12, 3)))
    limits = {"max_speed": 1.0, "max_acceleration": 5.0, "max_jerk": 50.0}

    def refused(start, end):
        with pytest.raises(Infeasible) as refusal:
            time_optimal(path, start_speed=start, end_speed=end, **limits)
        assert ("both are too high" in str(refusal.value)) == (min(start, end) > 0)
        return refusal.value

    no = refused(*asked)
    at = ("start speed", "end speed").index(no.kind)
    speeds = np.zeros(2)  # beside a rest at the other end
    speeds[at] = 0.999 * no.limit
    assert time_optimal(
        path, start_speed=speeds[0], end_speed=speeds[1], **limits
    ).certificate.holds
    speeds[at] = 1.01 * no.limit
    assert refused(*speeds.tolist()).limit == pytest.approx(no.limit, rel=1e-3)
    slope = path(path.x[-1 if at else 0], 1)
    assert no.limit <= limits["max_speed"] / np.abs(slope).max()


def test_few_motions_are_solved_for_the_largest_end_speed(monkeypatch):
    """The solver maximises the speed; motions are solved near its answer alone: a bisection would
    take fifteen.
    """
    from planner.timing import attempts

    solve, count = attempts.solve_once, 0

    def solve_once(task):
        nonlocal count
        count += 1
        return solve(task)

    monkeypatch.setattr(attempts, "solve_once", solve_once)
    path = CubicSpline(np.linspace(0, 1, 12), np.random.default_rng(99).uniform(-1, 1, (12, 3)))
    with pytest.raises(Infeasible, match="end speed"):
        time_optimal(path, max_speed=1.0, max_acceleration=5.0, max_jerk=50.0, end_speed=0.1)
    assert 0 < count < 10
