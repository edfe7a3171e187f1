"""Runs that start or end at a speed: against closed forms on one axis, at both orders, and what
cannot be.
"""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from kinematics import Axis, MotionError
from planner import Infeasible, Trajectory
from planner.certificate import prove
from planner.limits import limits_of
from planner.path.polynomial import PolynomialPath
from planner.timing import (
    Run,
    Task,
    at_speeds,
    certified_solve,
    make_grid,
    pose_problem,
    second_order,
    solve_run,
)

SPEED, ACCELERATION, JERK = 1.0, 2.0, 20.0


def line(length):
    return PolynomialPath([0.0, length], np.array([[[1.0]], [[0.0]]]), ["x"])


def limits_on(path, order):
    axes = [
        Axis(name, max_speed=SPEED, max_acceleration=ACCELERATION, max_jerk=JERK)
        for name in path.names
    ]
    return limits_of(path, axes, order)


@pytest.fixture(params=["straight", "general"])
def way(request):
    """By the closed form, and by the general solvers: these where a second axis bends, by which no
    limit binds.
    """
    return request.param


def draw(way, length):
    """x = s, and y = s²/1000 for the general solvers: x alone decides how long it takes."""
    if way == "straight":
        return line(length)
    return PolynomialPath(
        [0.0, length], np.array([[[0.0, 1e-3]], [[1.0, 0.0]], [[0.0, 0.0]]]), ["x", "y"]
    )


def solved(path, start, end, order, last=0):
    return solve_run(
        Task(path, limits_on(path, order), Run(0, last, at_speeds(start, end)), order)
    ).require_profile()


def ramp(change, order):
    """Time to change speed by so much: s̈ at its limit, under jerk limits from 0 to 0 (A²/J is
    passed).
    """
    return change / ACCELERATION + (ACCELERATION / JERK if order == 3 and change > 0 else 0.0)


def least_time(length, start, end, order):
    """Up to V, along, down: every ramp is symmetric, so it covers its mean speed times its time."""
    up, down = ramp(SPEED - start, order), ramp(SPEED - end, order)
    rest = length - up * (SPEED + start) / 2 - down * (SPEED + end) / 2
    assert rest >= 0
    return up + down + rest / SPEED


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize(
    ("start", "end"), [(1.0, 1.0), (0.0, 1.0), (1.0, 0.0), (0.5, 0.2), (0.0, 0.3)]
)
def test_one_axis(start, end, order, way):
    """A corner within an interval costs a part of it, as from rest to rest (1e-5 at order 2, 1e-3
    at order 3).
    """
    profile = solved(draw(way, 1.5), start, end, order)
    time = least_time(1.5, start, end, order)
    slack = 1e-9 if way == "straight" else 2e-5 if order == 2 else 1e-3
    assert time * (1 - min(slack, 1e-6)) <= profile.duration <= time * (1 + slack)
    v, a, j, h = (x[-1] for x in (profile.v, profile.a, profile.j, profile.h))
    assert profile.v[0] == start
    assert v + h * (a + h * j / 2) == pytest.approx(end, abs=1e-9)
    if order == 3:
        assert profile.a[0] == 0.0
        assert a + h * j == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("order", [2, 3])
def test_both_ends_below_and_between(order, way):
    """Too short to reach V: from v₀ to v₁ as fast as can be, when that takes the whole length."""
    start, end = 0.2, 0.7
    length = ramp(end - start, order) * (start + end) / 2
    profile = solved(draw(way, length * (1 + 1e-3)), start, end, order)
    assert profile.duration == pytest.approx(ramp(end - start, order), rel=5e-3)


@pytest.mark.parametrize("order", [2, 3])
def test_runs_joined_at_a_speed_are_as_fast_as_one(order):
    """A spline cut at a knot: with the speed that the whole motion has there, order 2 loses
    nothing.

    Under jerk limits s̈ = 0 is asked at the cut, which costs speed and time; every limit is kept
    all the same.
    """
    points = np.array([[0.0, 0.0], [0.4, 0.1], [0.7, 0.5], [1.2, 0.4], [1.5, 0.0]])
    spline = CubicSpline(np.arange(5.0), points, bc_type="natural")
    path = PolynomialPath(spline.x, spline.c, ["x", "y"])
    if order == 3:  # its third derivative jumps at the knots, which jerk limits allow
        assert path.stops(3).tolist() == [True, False, False, False, True]
    whole = solved(path, 0.0, 0.0, order, last=3)
    speed = float(whole.v[np.searchsorted(whole.s, 2.0)]) * (1.0 if order == 2 else 0.9)
    limits = limits_on(path, order)
    parts = [
        solve_run(Task(path, limits, Run(0, 1, at_speeds(0.0, speed)), order)).profile,
        solve_run(Task(path, limits, Run(2, 3, at_speeds(speed, 0.0)), order)).profile,
    ]
    together = sum(part.duration for part in parts)
    # other grids on both sides of the cut: an interval's share of each switch, as on one axis
    assert (
        whole.duration * (1 - 5e-4) <= together <= whole.duration * (1.0005 if order == 2 else 1.1)
    )
    columns = [
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("s", "v", "a", "j", "h", "piece")
    ]
    trajectory = Trajectory(path, np.append(0.0, np.cumsum(columns[4])), *columns[:4], columns[5])
    use, _ = prove(trajectory, limits, order)
    # first attempts, not tightened: what lies between grid points
    assert max(values.max() for values in use.values()) < 1 + 2e-3


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize(("start", "end"), [(0.9, 0.0), (0.0, 0.9), (0.9, 0.1), (0.05, 0.9)])
def test_too_fast_for_the_way_to_the_other_end(start, end, order, way):
    """From v to w the way is (v + w)/2 times the ramp's time: the largest v is told (under jerk to
    1e-3), and works.
    """
    length, slow = 0.1, min(start, end)
    with pytest.raises(Infeasible) as refused:
        solved(draw(way, length), start, end, order)
    no = refused.value
    # (v + w)/2 ((v − w)/A + A/J) = L, the last term under jerk limits alone
    lead = ACCELERATION / JERK if order == 3 else 0.0
    roots = np.roots([1 / ACCELERATION, lead, lead * slow - slow**2 / ACCELERATION - 2 * length])
    largest = roots.max()
    assert (no.kind, no.axis) == ("start speed" if start > end else "end speed", "path")
    assert no.place.s == (0.0 if start > end else length)
    assert no.value == max(start, end)
    assert no.limit == pytest.approx(
        largest, rel=1e-9 if way == "straight" else 1e-6 if order == 2 else 2e-3
    )
    solved(
        draw(way, length),
        *(no.limit * 0.9999 if v == max(start, end) else v for v in (start, end)),
        order,
    )


@pytest.mark.parametrize("order", [2, 3])
def test_beyond_the_speed_limit(order, way):
    with pytest.raises(Infeasible, match=r"end speed 1\.2 /s is beyond") as refused:
        solved(draw(way, 1.5), 0.0, 1.2, order)
    assert refused.value.limit == pytest.approx(1.0, rel=2e-3)


def test_a_solver_returns_what_it_came_to_and_raises_nothing():
    """Too fast for its own limit of speed, and for the way; who needs a motion all the same is
    refused.
    """
    path = line(1.5)
    for speed in (1.2, 50.0):
        found = second_order(
            pose_problem(
                path, limits_on(path, 2), *make_grid(path, Run(0, 0), 300), at_speeds(0.0, speed)
            )
        )
        assert (found.status, found.solved, found.duration) == ("too fast", False, 0.0)
        assert found.refusal.largest < speed
        with pytest.raises(MotionError, match="is beyond"):
            found.require_profile()


@pytest.mark.parametrize(("start", "end"), [(0.3, 0.0), (0.0, 0.5), (0.5, 0.4)])
def test_toppra_agrees(start, end):
    spline = CubicSpline(
        np.arange(4.0), [[0.0, 0.0], [0.5, 0.3], [1.0, -0.2], [1.5, 0.1]], bc_type="natural"
    )
    path = PolynomialPath(spline.x, spline.c, ["x", "y"])
    problem = pose_problem(
        path, limits_on(path, 2), *make_grid(path, Run(0, 2), 300), at_speeds(start, end)
    )
    ours, toppra = second_order(problem), second_order(problem, solver="toppra")
    assert ours.duration == pytest.approx(toppra.duration, rel=1e-5)
    assert toppra.profile.v[0] == start


CLAMPED, CUBIC, CUBIC_BACK = (
    [6.0, -15.0, 10.0, 0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0, 0.0],
    [1.0, -3.0, 3.0, 0.0],
)


@pytest.mark.parametrize(
    ("q", "passed"), [(CLAMPED, (True, True)), (CUBIC, (True, False)), (CUBIC_BACK, (False, True))]
)
def test_from_rest_where_two_derivatives_are_nothing(q, passed):
    """10 s³ − 15 s⁴ + 6 s⁵, s³ and 1 − (1 − s)³ go from 0 to 1: one axis, in its least time.

    Where q′ = q″ = 0 it rests whatever ṡ is, and the motion begins or ends with ṡ > 0.
    """
    path = PolynomialPath([0.0, 1.0], np.array(q)[:, None, None], ["x"])
    found = certified_solve(path, limits_on(path, 3), 3)
    assert found.certificate.holds
    assert {method.split(",")[0] for method in found.methods} == {"riccati"}
    motion = found.trajectory
    assert motion.duration == pytest.approx(least_time(1.0, 0.0, 0.0, 3), rel=4e-3)
    state = motion.at([0.0, motion.duration])
    assert np.abs(state.qd).max() < 1e-12
    assert np.abs(state.qdd).max() < 1e-9
    end = motion.within(np.array([len(motion.s) - 1]), np.diff(motion.knots)[-1:])
    assert (bool(motion.v[0] > 1e-3), bool(end.sd[0] > 1e-3)) == passed
