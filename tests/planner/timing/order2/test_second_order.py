"""Order 2: against closed forms, an independent linear programme, and its own invariances."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.optimize import linprog
from scipy.sparse import diags_array, vstack

from kinematics import Axis, MotionError
from planner import Trajectory
from planner.limits import Term, limits_of
from planner.path.polynomial import PolynomialPath
from planner.timing import (
    SOLVER_AIM,
    Run,
    Task,
    acceleration_problem,
    make_grid,
    pose_problem,
    refine_problem,
    second_order,
    solve_run,
)


def axes_of(speeds, accelerations):
    return [
        Axis(f"axis{k}", max_speed=v, max_acceleration=a)
        for k, (v, a) in enumerate(zip(speeds, accelerations, strict=True))
    ]


def line(*ends):
    """q from the origin to `ends`, over a parameter of the length 1."""
    return PolynomialPath(
        [0.0, 1.0],
        np.array([[ends], [np.zeros(len(ends))]]),
        [f"axis{k}" for k in range(len(ends))],
    )


def solved(path, axes, last=0):
    """By the general solver, straight or not."""
    limits = limits_of(path, axes, 2)
    problem = acceleration_problem(path, limits, Run(0, last))
    profile = second_order(problem).require_profile()
    finer = refine_problem(path, limits, problem, profile)
    return profile if finer is None else second_order(finer).require_profile()


def trapezoid_time(length, speed, acceleration):
    if length * acceleration >= speed**2:
        return length / speed + speed / acceleration
    return 2 * np.sqrt(length / acceleration)


@pytest.mark.parametrize(
    ("length", "speed", "acceleration"),
    [
        (1.0, 1.0, 2.0),  # trapezoid
        (1.0, 1.0, 1.0),  # the edge of both
        (1.0, 10.0, 1.0),  # triangle
        (0.05, 0.02, 0.225),
        (-0.05, 0.02, 0.225),
        (4000.0, 30.0, 0.5),
    ],
)
def test_one_axis(length, speed, acceleration):
    """T = L/V + V/A, or 2 √(L/A).

    A corner within one of 1000 intervals costs up to ¼ Δs/V · Δs/ramp each: 1e-5.
    """
    time = trapezoid_time(abs(length), speed, acceleration)
    found = solved(line(length), axes_of([speed], [acceleration])).duration
    assert time * (1 - 1e-9) <= found <= time * (1 + 1e-5)


def test_ramps_within_one_interval_cost_one_interval_each():
    """Constant acceleration over an eighth of the first of 250 intervals takes twice as long as
    full speed does.
    """
    found = solved(line(1.0), axes_of([0.01], [10.0])).duration
    assert found == pytest.approx((1 + 1e-3) * 100.0, rel=2e-5)


def test_several_axes_are_as_fast_as_the_slowest_of_them():
    """On a straight line every axis is a copy of the others: the least V/d and A/d count, whoever
    has them.
    """
    ends, speeds, accelerations = [0.3, -0.2, 0.0], [0.1, 0.04, 1e-9], [0.5, 2.0, 1e-9]
    found = solved(line(*ends), axes_of(speeds, accelerations)).duration
    # axis 1 is slow (0.2/0.04 s), axis 0 lazy; axis 2 does not move, so that its limits say nothing
    time = trapezoid_time(1.0, 0.04 / 0.2, 0.5 / 0.3)
    assert time * (1 - 1e-9) <= found <= time * (1 + 1e-5)


def test_speed_and_acceleration_are_at_their_limits_all_along():
    """Bang – coast – bang: on every interval one limit or the other is used fully."""
    profile = solved(line(1.0), axes_of([1.0], [2.0]))
    v_end = profile.v + profile.a * profile.h
    full = np.maximum(np.maximum(profile.v, v_end) / 1.0, np.abs(profile.a) / 2.0)
    assert full.max() <= SOLVER_AIM * (1 + 1e-9)
    # two intervals hold the corners
    assert np.sum(full < SOLVER_AIM * (1 - 1e-9)) <= 2
    assert profile.v[0] == 0
    assert v_end[-1] == pytest.approx(0, abs=1e-9)
    assert (profile.j == 0).all()


class Circle:
    """x = r cos(s/r), y = r sin(s/r): all that a timing problem asks of a path."""

    def __init__(self, radius):
        self.radius, self.breaks, self.dwells = (
            radius,
            np.array([0.0, 2 * np.pi * radius]),
            np.zeros(2),
        )
        self.turns = np.array([2 * np.pi])

    def derivatives(self, s, piece, highest=3):
        r, phi = self.radius, s / self.radius
        turns = [
            r ** (1 - k) * np.stack([np.cos(phi + k * np.pi / 2), np.sin(phi + k * np.pi / 2)], 1)
            for k in range(highest + 1)
        ]
        return tuple(turns)


def linear_programme(path, speeds, accelerations, intervals):
    """Least time by max Σ ṡ² over x = ṡ² at grid points, every row at the middles of intervals
    (second-order accurate).

    Linear rows; the maximum of Σx is that of every x, as in [Verscheure et al., IEEE TAC 54 (2009),
    2318].
    """
    s = np.linspace(path.breaks[0], path.breaks[-1], intervals + 1)
    step, none = s[1] - s[0], np.zeros(intervals, int)
    _, slope, curve, _ = path.derivatives((s[1:] + s[:-1]) / 2, none)
    rows = [
        diags_array([curve[:, k] / 2 - slope[:, k] / (2 * step), curve[:, k] / 2 + slope[:, k] / (2 * step)],
                    offsets=[0, 1], shape=(intervals, intervals + 1)) / accelerations[k]
        for k in range(len(accelerations))
    ]  # fmt: skip
    at_grid = np.abs(path.derivatives(s, np.zeros(len(s), int))[1]) / speeds
    highest = np.append(np.minimum(1 / at_grid.max(1) ** 2, 1e6)[:-1], 0.0)
    highest[0] = 0.0
    both = vstack([*rows, *(-row for row in rows)])
    answer = linprog(
        -np.ones(len(s)),
        A_ub=both,
        b_ub=np.ones(both.shape[0]),
        bounds=np.stack([0 * s, highest], 1),
    )
    v = np.sqrt(np.maximum(answer.x, 0))
    return float((2 * step / (v[1:] + v[:-1])).sum())


@pytest.mark.parametrize(
    ("speeds", "accelerations"),
    [([0.5, 0.5], [1.0, 1.0]), ([0.25, 0.6], [1.0, 0.4]), ([9.0, 9.0], [2.0, 5.0])],
)
def test_a_circle_with_axis_limits(speeds, accelerations):
    """Axis limits on a circle, where each axis stands still twice.

    Ours keeps every row at both ends of 1000 intervals: slower by up to 1e-3, never faster than the
    reference's 1e-5.
    """
    path = Circle(0.3)
    limits = limits_of(path, axes_of(speeds, accelerations), 2)
    problem = pose_problem(path, limits, *make_grid(path, Run(0, 0), 1000))
    reference = linear_programme(path, np.array(speeds), np.array(accelerations), 2000)
    assert reference * (1 - 1e-5) <= second_order(problem).duration <= reference * (1 + 1e-3)


def test_a_jump_of_curvature_keeps_the_limits_of_both_sides():
    """Straight on, then a bend y = κ s²/2 without a corner: at the break ÿ = κ ṡ² alone, so that ṡ
    ≤ √(A/κ) there.
    """
    bend, bound = 3.0, 2.0
    pieces = np.zeros((3, 2, 2))
    pieces[1, :, 0] = 1.0  # x = s
    pieces[2, 1, 0] = 1.0
    pieces[0, 1, 1] = bend / 2
    for flipped in (False, True):  # into the bend, and out of it
        if flipped:
            # backwards: s → 2 − s of both pieces
            pieces[2, :, 0], pieces[1, :, 0] = [2.0, 1.0], -1.0
            pieces[0, 0, 1], pieces[1, 0, 1], pieces[2, 0, 1] = bend / 2, -bend, bend / 2
            pieces[:, 1, 1] = 0.0
        path = PolynomialPath([0.0, 1.0, 2.0], pieces, ["x", "y"])
        assert path.stops(2).tolist() == [True, False, True]
        profile = solved(path, axes_of([9.0, 9.0], [50.0, bound]), last=1)
        trajectory = Trajectory(
            path,
            np.append(0.0, np.cumsum(profile.h)),
            profile.s,
            profile.v,
            profile.a,
            profile.j,
            profile.piece,
        )
        k = np.arange(len(profile.h))
        ends = [trajectory.within(k, np.zeros(len(k))), trajectory.within(k, profile.h)]
        for state in ends:
            assert (np.abs(state.qdd) <= np.array([50.0, bound]) * (1 + 1e-7)).all()
        at_break = int(np.searchsorted(profile.piece, 1))
        assert profile.s[at_break] == 1.0
        # reached, too, up to the interval in which the acceleration changes
        assert profile.v[at_break] == pytest.approx(np.sqrt(bound / bend), rel=2e-3)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e3])
@pytest.mark.parametrize("parameter", [1e-6, 1.0, 1e6])
def test_units_and_parameters_change_nothing(unit, parameter):
    """The same curve in microns or kilometres, along a parameter a million times shorter or longer:
    the same time.
    """
    knots = [0.0, 0.7, 1.1, 2.0]
    points = np.array([[0.0, 0.0], [0.3, -0.2], [0.5, 0.4], [0.1, 0.9]])
    times = []
    for scale, pace in ((1.0, 1.0), (unit, parameter)):
        curve = CubicSpline(np.multiply(knots, pace), points * scale)
        path = PolynomialPath(curve.x, curve.c, ["x", "y"])
        times.append(
            solved(path, axes_of([0.5 * scale] * 2, [2.0 * scale, scale]), last=2).duration
        )
    # the linear programmes are scaled to about one: what remains is their own tolerance
    assert times[1] == pytest.approx(times[0], rel=1e-7)


def test_less_room_takes_longer_by_its_root():
    """A room of 1/4 for speed² and acceleration alike is the same motion at half the speed."""
    path = line(1.0)
    problem = pose_problem(
        path, limits_of(path, axes_of([1.0], [2.0]), 2), *make_grid(path, Run(0, 0), 500)
    )
    rooms = {"speed": 0.5, "acceleration": 0.25}
    tight = replace(
        problem, blocks=tuple(replace(b, room=b.room * rooms[b.name]) for b in problem.blocks)
    )
    assert second_order(tight).duration == pytest.approx(
        2 * second_order(problem).duration, rel=1e-9
    )


def test_less_room_is_kept_from_an_interval_s_start_to_its_end():
    path = line(1.0)
    problem = pose_problem(
        path, limits_of(path, axes_of([1.0], [2.0]), 2), *make_grid(path, Run(0, 0), 500)
    )
    rooms = np.ones(500)
    rooms[200:300] = 0.5
    tight = replace(
        problem,
        blocks=tuple(
            replace(b, room=rooms if b.name == "speed" else b.room) for b in problem.blocks
        ),
    )
    profile = second_order(tight).profile
    v_end = profile.v + profile.a * profile.h
    assert max(profile.v[200:300].max(), v_end[200:300].max()) <= 0.5 * (1 + 1e-9)
    assert profile.v.max() > 0.7


@given(
    st.integers(0, 10_000),
    st.floats(-2, 2).map(lambda x: 10**x),
    st.floats(-0.5, 3).map(lambda x: 10**x),
)
@settings(max_examples=40, deadline=None)
def test_no_motion_is_faster_and_toppra_agrees_where_it_answers(seed, slowness, softness):
    """Random splines: every row is kept, no speed can be raised, and toppra's own tolerance is all
    that it is off.
    """
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(rng.integers(3, 8), rng.integers(1, 5)))
    spline = CubicSpline(
        np.arange(len(points)),
        points,
        bc_type=str(rng.choice(["natural", "clamped", "not-a-knot"])),
    )
    path = PolynomialPath(spline.x, spline.c, [f"axis{k}" for k in range(points.shape[1])])
    speeds = slowness * 10 ** rng.uniform(-1, 1, points.shape[1])
    problem = pose_problem(
        path,
        limits_of(path, axes_of(speeds, speeds * softness), 2),
        *make_grid(path, Run(0, len(points) - 2), 300),
    )
    profile = second_order(problem).profile
    x = np.append(profile.v, 0.0) ** 2
    used = np.zeros((2, problem.intervals))
    for block in problem.blocks:
        for side, at in ((block.start, x[:-1]), (block.end, x[1:])):
            if block.name == "speed":
                share = np.abs(side[Term.SD]).max(1) * np.sqrt(at)
            else:
                share = np.abs(
                    side[Term.SDD] * profile.a[:, None] + side[Term.SD2] * at[:, None]
                ).max(1)
            used = np.maximum(used, np.stack([share, share]))
    assert used.max() <= SOLVER_AIM * (1 + 1e-9)
    # bang–bang: a limit is used fully on every interval, but for a few on which they take turns
    assert np.sum(used[0] < SOLVER_AIM * (1 - 1e-6)) <= 12
    theirs = second_order(problem, solver="toppra")
    if not theirs.solved:
        return
    other = theirs.duration
    # toppra's linear programmes keep their rows to some 1e-8 only, which may make it as much faster
    assert profile.duration <= other * (1 + 1e-6)
    assert profile.duration >= other * (1 - 2e-5)


def test_a_cruise_far_slower_than_its_ramps():
    """Ramps of 3e-8 of the way, over a spline that starts and ends with q′ = 0, where toppra gives
    up.
    """
    points = np.array([[0.0, 0.0], [1.0, -0.5], [0.3, 0.8], [2.0, 1.0]])
    spline = CubicSpline(np.arange(4.0), points, bc_type="clamped")
    path = PolynomialPath(spline.x, spline.c, ["x", "y"])
    slow = solved(path, axes_of([1e-3, 1e-3], [10.0, 10.0]), last=2).duration
    # were acceleration free, the axis that moves more would be at full speed everywhere
    u = np.linspace(0, 3, 300_001)
    fastest = np.trapezoid(np.abs(spline(u, 1)).max(1), u) / 1e-3
    assert fastest <= slow <= fastest * (1 + 2e-3)


def test_what_nothing_bounds_is_refused():
    path = line(1.0)
    limits = limits_of(path, [Axis("axis0", max_speed=1.0)], 2)
    with pytest.raises(MotionError, match=r"the motion is unbounded.*acceleration"):
        solve_run(Task(path, limits, Run(0, 0), 2)).require_profile()
