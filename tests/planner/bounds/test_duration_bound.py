"""The lower bound of the duration: never above what is known exactly or was found, and near it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, PPoly
from scipy.optimize import linprog

from kinematics import load_machine
from planner import Line, Program, load_program, plan, time_optimal
from planner.bounds import bound_cells, bound_duration, bound_rest, enclose_rows, leave_rest
from planner.bounds.duration_bound import MANY_RUNS
from planner.bounds.inner_minimum import InnerProgram, solve_inner
from planner.bounds.lower_bound import Trial, bound_by_speed
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.timing import certified_solve


def straight(length):
    return PPoly(np.array([[[length]], [[0.0]]]), np.array([0.0, 1.0]))


@pytest.fixture(scope="module")
def circle():
    machine = load_machine("hexapod")
    path = actuate(load_program("bare-circle"), machine)
    return {
        order: certified_solve(path, limits_of(path, machine.axes, order), order)
        for order in (2, 3)
    }


@pytest.mark.parametrize("order", [2, 3])
def test_the_circle_is_within_a_thousandth_of_the_least(circle, order):
    bound = circle[order].bound
    assert 0 < circle[order].gap <= 1e-3
    assert circle[order].lower_bound == bound.value
    # what is lost is lost cell by cell, and nowhere less than nothing
    assert bound.loss.sum() == pytest.approx(bound.duration - bound.value, rel=1e-6)
    assert bound.loss.min() > -1e-12
    assert bound.left_out == ("force",)


@pytest.mark.parametrize("order", [2, 3])
def test_what_the_limits_are_worth_is_the_duration(circle, order):
    """Speeds k, accelerations k², jerks k³ times as large make T/k: so T is their worth, weighed by
    these powers.
    """
    worth = circle[order].bound.worth.sum((0, 2))
    assert worth @ [2, 3, 1] == pytest.approx(circle[order].trajectory.duration, rel=2e-3)
    assert (worth[1] > 0) == (order == 3)


@pytest.mark.parametrize("seed", range(8))
def test_straight_moves_in_closed_form(seed):
    rng = np.random.default_rng(seed)
    length = 10 ** rng.uniform(-2, 1)
    speed, acceleration, jerk = 10 ** rng.uniform(-1, 1.5, 3)
    found = time_optimal(
        straight(length), max_speed=speed, max_acceleration=acceleration, max_jerk=jerk
    )
    # the motion is the exact optimum but for 1e-9 of the limits
    assert found.lower_bound <= found.trajectory.duration
    assert found.gap < 3e-3
    found = time_optimal(straight(length), max_speed=1e6, max_acceleration=acceleration)
    exact = 2 * np.sqrt(length / acceleration)
    assert exact * (1 - 2e-3) <= found.lower_bound <= exact


def test_given_speeds_at_the_ends():
    found = time_optimal(
        straight(1.0), max_speed=2.0, max_acceleration=1.0, start_speed=0.5, end_speed=1.0
    )
    top = np.sqrt((0.5**2 + 1.0**2) / 2 + 1.0)
    exact = 2 * top - 0.5 - 1.0
    assert exact * (1 - 2e-3) <= found.lower_bound <= exact * (1 + 1e-12)
    found = time_optimal(
        straight(1.0),
        max_speed=2.0,
        max_acceleration=1.0,
        max_jerk=4.0,
        start_speed=0.5,
        end_speed=1.0,
    )
    assert 0 <= found.gap < 2e-3


@pytest.mark.parametrize("jerk", [None, 20.0])
@pytest.mark.parametrize("seed", range(3))
def test_random_splines(seed, jerk):
    rng = np.random.default_rng(seed)
    curve = CubicSpline(np.arange(8.0), rng.uniform(-1, 1, (8, 3)))
    found = time_optimal(curve, max_speed=1.0, max_acceleration=2.0, max_jerk=jerk)
    assert 0 <= found.gap < 1e-2
    # a faster machine's motion is no proof that this bound is wrong; a slower one's bound is no
    # lower
    slower = time_optimal(curve, max_speed=1.0, max_acceleration=1.8, max_jerk=jerk)
    assert slower.trajectory.duration >= found.lower_bound


@pytest.mark.parametrize("jerk", [None, 5.0])
def test_where_a_path_stands_or_turns_back(jerk):
    cusp = PPoly(
        np.array([[[0.0, 1.0]], [[1.0, 0.0]], [[0.0, 0.0]], [[0.0, 0.0]]]), np.array([0.0, 1.0])
    )
    there_and_back = CubicSpline([0.0, 1.0, 2.0], [[0.0, 0.0], [1.0, 0.5], [0.0, 0.0]])
    for path in (cusp, there_and_back):
        found = time_optimal(path, max_speed=1.0, max_acceleration=2.0, max_jerk=jerk)
        assert found.gap >= 0
        assert found.lower_bound > 0.3 * found.trajectory.duration


QUINTIC = PPoly(
    np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])[:, None, None] * np.array([1.0, 0.5, -0.3]),
    np.array([0.0, 1.0]),
)


@pytest.mark.parametrize("jerk", [None, 20.0])
@pytest.mark.parametrize("ends", ["clamped", "natural", "quintic"])
def test_where_a_path_stands_at_its_ends_the_bound_is_as_near_as_elsewhere(ends, jerk):
    points = np.random.default_rng(1).uniform(-1, 1, (8, 3))
    curve = QUINTIC if ends == "quintic" else CubicSpline(np.arange(8.0), points, bc_type=ends)
    found = time_optimal(curve, max_speed=1.0, max_acceleration=2.0, max_jerk=jerk)
    assert 0 <= found.gap < 2e-3
    assert found.bound.loss[[0, -1]].max() < 1e-3


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("still", [0, 1, 2])
def test_no_motion_from_rest_is_below_the_bound_of_its_cell(still, side):
    """x = s^(still + 1) from rest, by random ẍ and x⃛ within limits, forwards all the time; or that
    back in time.
    """
    rng = np.random.default_rng(still)
    power, last = still + 1, 0.7
    most, least, jerk = 2.0, 3.0, (5.0, 4.0)
    ways = (
        np.poly1d(np.eye(power + 2)[1]),
        np.poly1d(1e-3 * np.eye(power + 2)[0]),
    )  # the other, so that it is no line
    if side:  # the same path backwards
        ways = tuple(way(np.poly1d([-1.0, 1.0])) for way in ways)
    coefficients = np.stack(
        [np.pad(way.coeffs, (power + 2 - len(way.coeffs), 0)) for way in ways], 1
    )
    path = PPoly(coefficients[:, None], np.array([0.0, 1.0]))
    found = time_optimal(
        path,
        max_speed=1e3,
        max_acceleration=[(least, most), (1e6, 1e6)],
        max_jerk=[jerk[::-1], (1e6, 1e6)],
    )
    nodes = np.array([0.0, last, 1.0]) if side == 0 else np.array([0.0, 1 - last, 1.0])
    rows = enclose_rows(found.trajectory.path, found.limits, nodes, np.zeros(2, int))
    if (
        side
    ):  # x = q of falling s, looked at back in time: ẍ ≤ most still, and −x⃛ of the motion is x⃛
        rows = rows._replace(jerk=rows.jerk[::-1].copy())
    leaving = leave_rest(rows, side, still)
    assert leaving.moves[0]
    way = last**power
    slope, bend = power * last ** (power - 1), power * (power - 1) * last ** max(power - 2, 0)
    tried = 0
    dt = 1e-3
    for _ in range(60):
        accelerations = _random_accelerations(rng, most, least, jerk, dt)
        v = np.cumsum(accelerations) * dt
        if (v < 0).any():
            continue
        x = np.cumsum(v) * dt
        at = int(np.searchsorted(x, way))
        if at >= len(x):
            continue
        tried += 1
        a = (v[at] / slope) ** 2
        b = (accelerations[at] - bend * a) / slope
        for inner in rng.normal(size=(20, 2)) * 10.0 ** rng.uniform(-2, 1, (20, 1)):
            bound = bound_rest(leaving, side, inner)
            # back in time s̈ is the same, by s that falls the other way
            value = at * dt + (1 - 2 * side) * inner[0] * a + inner[1] * b
            assert bound <= value + 2e-2 * (1 + np.abs(inner) @ [a, abs(b)])
    assert tried > 10
    # and full acceleration or jerk all the way is as low as it says
    assert leaving.time[0] == pytest.approx(
        max((6 * way / jerk[0]) ** (1 / 3), (2 * way / most) ** 0.5), rel=1e-6
    )


def _random_accelerations(rng, most, least, jerk, dt):
    """From 0 on, with slopes between −jerk[1] and jerk[0], for 3 s."""
    slopes = np.repeat(rng.choice([jerk[0], -jerk[1], 0.3], 20), 150)
    values = np.zeros(len(slopes))
    now = 0.0
    for k, slope in enumerate(slopes):
        now = min(max(now + slope * dt, -least), most)
        values[k] = now
    return values


@pytest.mark.parametrize("wrong", ["random", "sign", "rows", "one", "nothing"])
def test_no_multipliers_lead_above_the_truth(circle, wrong):
    """Weak duality: whatever λ and rows are handed over, what is proved is below what a motion
    takes.
    """
    rng = np.random.default_rng(3)
    found = circle[3]
    path = found.trajectory.path
    nodes = np.linspace(path.breaks[0], path.breaks[-1], 201)
    rows = enclose_rows(path, found.limits, nodes, np.zeros(200, int))
    least = found.trajectory.duration
    for scale in 10.0 ** rng.uniform(-6, 1, 20):
        x = (nodes / nodes[-1])[:, None]
        smooth = scale * np.hstack([4 * (x - 0.5) * 30, -x * (1 - x)])
        multipliers = {
            "random": scale * rng.normal(size=(201, 2)),
            "sign": -smooth,
            "rows": smooth,
            "one": smooth * np.where(np.arange(201) == 77, 3.0, 1.0)[:, None],
            "nothing": 0 * smooth,
        }[wrong]
        given = (
            scale * rng.normal(size=(200, 3, 2, 2, 6))
            if wrong in ("random", "rows")
            else np.zeros((200, 3, 2, 2, 6))
        )
        bulge = scale * rng.normal(size=200) * (wrong == "random")
        out = bound_by_speed(rows)
        assert out.sum() > 0
        trial = Trial(
            multipliers, bulge, given, np.abs(rng.normal(size=(200, 3, 2, 1))), np.full(200, 1e-4)
        )
        bound_cells(rows, trial, out)
        assert out.sum() <= least


def test_the_inner_minimum_is_that_of_its_linear_programme():
    rng = np.random.default_rng(5)
    for _ in range(15):
        q = rng.normal(size=(3, 4))
        acceleration, jerk = rng.uniform(1, 3, (2, 2, 4))
        a, e = rng.uniform(0.05, 0.4), rng.normal(size=2)
        left = np.vstack([q[0], 0 * q[0]]).T, np.vstack([3 * q[1], q[0]]).T
        right = [
            (bound / root - rest)
            for bound, root, rest in ((acceleration, 1, q[1] * a), (jerk, np.sqrt(a), q[2] * a))
        ]
        low = [
            (-bound[1] / root - rest)
            for bound, root, rest in ((acceleration, 1, q[1] * a), (jerk, np.sqrt(a), q[2] * a))
        ]
        rows = np.vstack([left[0], -left[0], left[1], -left[1]])
        bounds = np.concatenate([right[0][0], -low[0], right[1][0], -low[1]])
        truth = linprog(e, rows, bounds, bounds=[(None, None)] * 2)
        if truth.status != 0:
            continue
        out = np.zeros((2, 4))
        program = InnerProgram(q, acceleration, jerk, a, e, np.array([1e3, 1e3]))
        solve_inner(program, 100.0, out)
        cost = np.where(
            out > 0, np.stack([acceleration, jerk])[:, 0], np.stack([acceleration, jerk])[:, 1]
        )
        value = -(np.abs(out) * cost)[0].sum() - (np.abs(out) * cost)[1].sum() / np.sqrt(a)
        value += (out[1] * q[2] + out[0] * q[1]).sum() * a
        assert e[1] + (out[1] * q[0]).sum() == pytest.approx(0, abs=1e-6)
        assert value == pytest.approx(truth.fun, rel=1e-5, abs=1e-6)


def test_a_plan_with_a_corner_and_a_dwell(tmp_path):
    text = """schema = 1
machine = "hexapod"
length = "mm"
[[segment]]
line = { to = [0, 0, 8] }
[[segment]]
dwell = "0.2 s"
[[segment]]
line = { to = [5, 0, 8] }
"""
    (tmp_path / "corner.toml").write_text(text)
    found = plan(load_program(tmp_path / "corner.toml"), load_machine("hexapod"))
    assert 0 < found.gap < 2e-3
    assert found.trajectory.duration / (1 + found.gap) == pytest.approx(found.lower_bound)
    assert found.lower_bound > 0.2
    assert "force" in found.left_out
    (table, *_) = found.tables()
    assert "lower bound, proved" in table.columns[0].values


def test_a_program_of_many_short_lines_is_bounded_as_surely_and_in_fewer_cells():
    """Each of 40 lines alone has its exact time: what is proved of all is below their sum, and
    within a thousandth.
    """
    machine = load_machine("cartesian")
    lines = [Line(to=(0.001 * (k + 1), 0.0005 * (k % 2), 0.0)) for k in range(MANY_RUNS + 8)]
    planned = plan(Program(lines), machine, order=3)
    many = bound_duration(planned.trajectory, planned.limits, 3)
    assert 0 < many.value <= planned.trajectory.duration
    assert many.gap < 1e-3
    first = bound_duration(planned.trajectory, planned.limits, 3, gap=1.0)  # a round for each
    assert len(many.s) <= 2 * len(first.s)


@pytest.mark.parametrize("seed", [11, 23])
def test_where_a_single_axis_turns_back_it_is_at_rest(seed):
    """q̇ = 0 wherever q′ = 0, though the path's parameter goes on: order 3 proves no less than
    order 2.

    Without that, 6 and 21 % were left of these paths, and order 2 proved more.
    """
    rng = np.random.default_rng(seed)
    axes = int(rng.integers(1, 8))
    way = rng.uniform(-1, 1, (int(rng.integers(2, 30)), axes))
    path = CubicSpline(np.linspace(0, 1, len(way)), way, bc_type="natural")
    limits = {"max_speed": rng.uniform(0.5, 3, axes), "max_acceleration": rng.uniform(2, 20, axes)}
    jerk = limits["max_acceleration"] * rng.uniform(5, 50)
    jerky = time_optimal(path, max_jerk=jerk, **limits)
    assert axes == 1
    assert jerky.gap < 2e-3
    assert jerky.lower_bound >= time_optimal(path, **limits).lower_bound


@pytest.mark.parametrize("seed", [13, 21])
def test_order_3_proves_no_less_than_order_2(seed):
    """Jerk limits only take motions away.

    On these paths the multipliers of order 3 prove 0.2 % less.
    """
    rng = np.random.default_rng(seed)
    axes = int(rng.integers(1, 8))
    way = rng.uniform(-1, 1, (int(rng.integers(2, 30)), axes))
    path = CubicSpline(np.linspace(0, 1, len(way)), way, bc_type="natural")
    limits = {"max_speed": rng.uniform(0.5, 3, axes), "max_acceleration": rng.uniform(2, 20, axes)}
    jerky = time_optimal(path, max_jerk=limits["max_acceleration"] * rng.uniform(5, 50), **limits)
    gentle = time_optimal(path, **limits)
    assert jerky.lower_bound >= gentle.lower_bound * (1 - 1e-9)


@settings(max_examples=4, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10**6),
    pieces=st.integers(1, 3),
    axes=st.integers(1, 3),
    jerk=st.floats(1.0, 1e4),
)
def test_jerk_limits_never_lower_what_is_proved(seed, pieces, axes, jerk):
    """Every motion within limits of jerk is one without them: its bound holds as well, however
    large the jerk is.
    """
    points = np.random.default_rng(seed).uniform(-1, 1, (pieces + 2, axes))
    path = CubicSpline(np.arange(pieces + 2.0), points, bc_type="natural")
    limits = {"max_speed": 1.0, "max_acceleration": 2.0}
    jerky = time_optimal(path, max_jerk=jerk, **limits)
    assert jerky.lower_bound <= jerky.trajectory.duration
    assert jerky.lower_bound >= time_optimal(path, **limits).lower_bound * (1 - 1e-12)


def test_nothing_is_proved_without_jerk_by_multipliers_of_what_jerk_bounds(circle):
    """At order 2, c = db/ds is free, so that no λb but 0 leads to a bound."""
    path, limits = circle[2].trajectory.path, circle[2].limits
    nodes = np.linspace(path.breaks[0], path.breaks[-1], 21)
    rows = enclose_rows(path, limits, nodes, np.zeros(20, int))
    multipliers = np.zeros((21, 2))
    multipliers[10, 1] = 1e-9
    trial = Trial(
        multipliers, np.zeros(20), np.zeros((20, 1, 2, 2, 6)), np.zeros((20, 1, 2, 1)), np.ones(20)
    )
    out = bound_by_speed(rows)
    bound_cells(rows, trial, out)
    assert (out[9:11] == -np.inf).all()
    assert np.isfinite(np.delete(out, [9, 10])).all()
