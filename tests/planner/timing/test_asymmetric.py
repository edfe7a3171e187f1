"""Limits that differ towards smaller and greater positions: one axis by hand, several by
symmetry.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, PPoly
from scipy.optimize import linprog

from kinematics import Axis, MotionError
from planner import Line, Program, classical, plan, time_optimal
from planner.limits import limits_of
from planner.path.polynomial import PolynomialPath
from planner.timing import Run, jerk_problem, make_grid, pose_problem, second_order, third_order


def straight(length):
    return PPoly(np.array([[[float(np.sign(length))]], [[0.0]]]), [0.0, abs(length)])


@pytest.mark.parametrize(("length", "gain", "brake"), [(1.0, 4.0, 1.0), (-1.0, 1.0, 4.0)])
def test_a_triangle_of_two_accelerations(length, gain, brake):
    """v²/2 (1/a + 1/b) = L and T = v (1/a + 1/b), so T = √(2 L (1/a + 1/b)), whichever way it
    goes.
    """
    moved = time_optimal(straight(length), max_speed=10.0, max_acceleration=[[1.0, 4.0]])
    assert moved.certificate.holds
    assert moved.trajectory.duration == pytest.approx(np.sqrt(2 * (1 / gain + 1 / brake)), rel=1e-6)
    peak = moved.trajectory.knots[np.argmax(moved.trajectory.v)]
    v = moved.trajectory.v.max()
    assert peak == pytest.approx(v / gain, rel=1e-3)  # the grid's step


@pytest.mark.parametrize(("length", "speed"), [(1.0, 0.5), (-1.0, 0.2)])
def test_the_way_it_goes_chooses_the_speed(length, speed):
    """T = L/v + v/a with v of that way."""
    moved = time_optimal(straight(length), max_speed=[[0.2, 0.5]], max_acceleration=3.0)
    # the ramps end inside an interval, of which there are 1000: a tenth of one's time at most
    assert moved.trajectory.duration == pytest.approx(1 / speed + speed / 3, rel=1e-4)
    assert moved.certificate.worst["speed"] == pytest.approx(1.0, abs=1e-6)


def test_two_jerks():
    """Jerks +8, −1, +8 over t, 16 t, t: the way is 2 · 204 t³ and T = 18 t."""
    moved = time_optimal(straight(1.0), max_speed=1e3, max_acceleration=1e3, max_jerk=[[1.0, 8.0]])
    assert moved.certificate.holds
    assert moved.methods == ("straight",)
    assert moved.trajectory.duration == pytest.approx(18 * np.cbrt(1 / 408), rel=1e-9)
    path = PolynomialPath(np.array([0.0, 1.0]), np.array([[[1.0]], [[0.0]]]), ["x"])
    limits = limits_of(
        path, [Axis("x", max_speed=1e3, max_acceleration=1e3, max_jerk=(1.0, 8.0))], 3
    )
    problem, start = jerk_problem(path, limits, Run(0, 0))
    # what the trace of jerk in the cost and the grid leave, as for equal jerks
    assert third_order(problem, start.on(problem.s)).duration == pytest.approx(
        18 * np.cbrt(1 / 408), rel=2e-4
    )


sides = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)).map(
    lambda x: tuple(10 ** np.array(x))
)


@settings(max_examples=30, deadline=None)
@given(sides, sides, st.floats(1, 3), st.floats(1, 3))
def test_all_phases(push, jerk, faster, further):
    """Of a ramp to V with s̈ = P, rise r = P/J and fall f = P/K, the time is t = V/P + (r + f)/2
    and the way V t/2 + V (f − r)/4 − P (f² − r²)/24; what is left of the length goes by at V.
    """
    (brake, gain), (back, forth) = push, jerk
    speed = faster * max(push) ** 2 * (1 / back + 1 / forth) / 2
    times, ways = [], []
    for most in (gain, brake):  # a ramp down is one up, backwards
        rise, fall = most / forth, most / back
        times.append(speed / most + (rise + fall) / 2)
        ways.append(
            speed * times[-1] / 2 + speed * (fall - rise) / 4 - most * (fall**2 - rise**2) / 24
        )
    length = further * sum(ways)
    moved = time_optimal(
        straight(length), max_speed=speed, max_acceleration=[push], max_jerk=[jerk]
    )
    assert moved.methods == ("straight",)
    assert moved.trajectory.duration == pytest.approx(
        sum(times) + (length - sum(ways)) / speed, rel=1e-9
    )


@settings(max_examples=12, deadline=None)
@given(st.floats(-1, 0.5).map(lambda x: 10**x), sides, sides, sides, st.sampled_from([1, -1]))
def test_no_motion_on_a_grid_goes_further_in_the_time(length, speed, push, jerk, way):
    """A linear programme: the furthest from rest to rest with constant jerk over each of 120 equal
    times.

    It goes no further than the fastest motion does, but for the speed between the times, of which a
    share of some 1/120² is not looked at; and less far by what switches between the times cost.
    """
    moved = time_optimal(
        straight(way * length), max_speed=[speed], max_acceleration=[push], max_jerk=[jerk]
    )
    assert moved.certificate.holds
    assert moved.methods == ("straight",)
    h = moved.trajectory.duration / 120
    after = np.arange(120)[:, None] - np.arange(120)  # of each time after a jerk has begun
    acts = after >= 0
    a, v, s = h * acts, h**2 * (after + 1 / 2) * acts, h**3 * (after**2 + after + 1 / 3) / 2 * acts
    (_, top), (brake, gain), (back, forth) = (each[::way] for each in (speed, push, jerk))
    found = linprog(
        -s[-1],
        A_ub=np.concatenate([v, a, -a]),
        b_ub=np.repeat([top, gain, brake], 120),
        A_eq=np.stack([v[-1], a[-1]]),
        b_eq=[0, 0],
        bounds=(-back, forth),
    )
    assert length * (1 - 2e-3) <= -found.fun <= length * (1 + 1e-4)


@settings(max_examples=4, deadline=None)
@given(st.integers(0, 2**31))
def test_a_mirrored_motion_takes_as_long(seed):
    """q → −q with the sides exchanged is the same motion; so is running backwards with
    accelerations exchanged.
    """
    random = np.random.default_rng(seed)
    points = np.cumsum(random.uniform(-1, 1, (6, 3)), 0)
    speed, push = random.uniform(0.2, 2.0, (2, 3, 2))
    spline = CubicSpline(np.arange(6.0), points)
    there = time_optimal(spline, max_speed=speed, max_acceleration=push)
    mirrored = time_optimal(
        CubicSpline(np.arange(6.0), -points),
        max_speed=speed[:, ::-1],
        max_acceleration=push[:, ::-1],
    )
    back = time_optimal(
        CubicSpline(np.arange(6.0), points[::-1]), max_speed=speed[:, ::-1], max_acceleration=push
    )
    assert there.certificate.holds
    assert mirrored.trajectory.duration == pytest.approx(there.trajectory.duration, rel=1e-9)
    # s̈ is constant on intervals, which reversed are the same; what is taken off between them is
    # not quite
    assert back.trajectory.duration == pytest.approx(there.trajectory.duration, rel=1e-4)
    state = there.trajectory.at(np.linspace(0, there.trajectory.duration, 5001))
    for values, bounds in ((state.qd, speed), (state.qdd, push)):
        assert (values <= bounds[:, 1] * (1 + 2e-6)).all()
        assert (values >= -bounds[:, 0] * (1 + 2e-6)).all()
    # equal sides: one number says the same
    alike = time_optimal(
        spline, max_speed=np.stack([speed[:, 0]] * 2, 1), max_acceleration=push[:, 0]
    )
    plain = time_optimal(spline, max_speed=speed[:, 0], max_acceleration=push[:, 0])
    assert alike.trajectory.duration == plain.trajectory.duration
    # and a wider side never slows
    assert there.trajectory.duration <= time_optimal(
        spline, max_speed=speed.min(1), max_acceleration=push.min(1)
    ).trajectory.duration * (1 + 1e-9)


def test_both_solvers_of_order_2_agree():
    pytest.importorskip("toppra")
    axes = [
        Axis(f"a{k}", max_speed=(0.5, 1.0 + k), max_acceleration=(3.0 + k, 0.8)) for k in range(2)
    ]
    spline = CubicSpline(np.arange(5.0), [[0, 0], [1, -1], [0.4, 0.3], [2, 1], [1, 1.5]])
    path = PolynomialPath(spline.x, spline.c, ["a0", "a1"])
    problem = pose_problem(path, limits_of(path, axes, 2), *make_grid(path, Run(0, 3), 500))
    ours, theirs = (
        second_order(problem, solver=solver).duration for solver in ("passes", "toppra")
    )
    assert ours == pytest.approx(theirs, rel=1e-6)


@pytest.mark.parametrize("order", [2, 3])
def test_a_hexapod_with_a_weak_side(hexapod, order):
    """Legs that may push half as hard as they brake: certified, sampled, and named on the side that
    binds.
    """
    axes = [
        replace(axis, max_speed=(0.018, 0.02), max_acceleration=(0.225, 0.1), max_jerk=(4.0, 2.0))
        for axis in hexapod.axes
    ]
    machine = type(hexapod)(hexapod.base, hexapod.platform, axes=axes, home=hexapod.home)
    made = plan(Program([Line([0, 0, 0.02]), Line([0.01, 0, 0.01])]), machine, order=order)
    assert made.certificate.holds
    state = made.trajectory.at(np.linspace(0, made.trajectory.duration, 20001))
    assert (state.qd.max(), -state.qd.min()) == pytest.approx((0.02, 0.018), rel=1e-3)
    assert state.qdd.max() <= 0.1 * (1 + 1e-6)
    assert state.qdd.max() == pytest.approx(0.1, rel=1e-2)
    assert state.qdd.min() >= -0.225 * (1 + 1e-6)
    assert state.qdd.min() < -0.15
    if order == 2:
        baseline = classical(made)
        assert baseline.certificate.holds
        assert baseline.duration >= made.trajectory.duration * (1 - 1e-6)


def test_what_is_no_magnitude_is_refused():
    with pytest.raises(MotionError, match=r"axis x: max_speed .* above 0, not \(1.0, 0.0\)"):
        Axis("x", max_speed=(1.0, 0.0))
    with pytest.raises(MotionError, match="two: towards smaller and towards greater"):
        Axis("x", max_jerk=(1.0, 2.0, 3.0))
    with pytest.raises(MotionError, match="max_speed"):
        time_optimal(straight(1.0), max_speed=[[1.0, -1.0]], max_acceleration=1.0)


def test_told_against_its_own_side():
    axis = Axis("x", max_speed=(0.018, 0.02))
    path = PolynomialPath([0.0, 1.0], np.array([[[1.0]], [[0.0]]]), ["x"])
    speed = limits_of(path, [axis], 2)[0]
    assert speed.report_value(0.021, 0, 0) == (0.021, 0.02)
    assert speed.report_value(-0.019, 0, 0) == (0.019, 0.018)
    low, high = np.array([[-0.009]]), np.array([[0.015]])
    assert speed.use(low, high, np.zeros(1, int)) == pytest.approx(0.75, rel=1e-15)
    assert speed.use(low, -low / 9, np.zeros(1, int)) == pytest.approx(0.5, rel=1e-15)
