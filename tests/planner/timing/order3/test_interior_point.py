"""Our interior-point method: analytic motions, FATROP's answers, and the same source without a
compiler.
"""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from benchmarks.evidence.peers.casadi_ import solve_by_casadi
from benchmarks.evidence.random_problems import random_problem
from kinematics import Axis
from kinematics.foundation.errors import require
from planner.limits import limits_of
from planner.path.polynomial import PolynomialPath
from planner.timing import EndCondition, Run, jerk_problem, third_order
from planner.timing.order3 import active_set, interior_point, riccati
from planner.timing.order3.line_search import Filter, Ray, limit_step, search
from planner.timing.order3.pose import pose_smoothest, pose_stages, pose_weighted
from planner.timing.order3.stages import evaluate, sum_costs


def make_problem(path, speed, acceleration, jerk, stands=(0, 0)):
    """An order-3 problem from rest to rest, and what to start from."""
    bounds = zip(speed, acceleration, jerk, strict=True)
    axes = [
        Axis(f"q{n}", max_speed=v, max_acceleration=a, max_jerk=j)
        for n, (v, a, j) in enumerate(bounds)
    ]
    bare = PolynomialPath(path.x, path.c, [axis.name for axis in axes])
    ends = tuple(EndCondition(zero_derivatives=count) for count in stands)
    run = Run(0, len(bare.breaks) - 2, ends)
    problem, start = require(jerk_problem(bare, limits_of(bare, axes, 3), run))
    return problem, start.on(problem.s)


def spline(seed, axes=3):
    rng = np.random.default_rng(seed)
    return CubicSpline(np.arange(6.0), rng.uniform(-1, 1, (6, axes)))


@pytest.mark.parametrize("seed", range(4))
def test_it_finds_what_fatrop_finds(seed):
    problem, guess = make_problem(spline(seed), [1.0] * 3, [3.0] * 3, [30.0] * 3)
    ours, theirs = third_order(problem, guess), solve_by_casadi(problem, guess)
    assert ours.solved
    assert ours.duration == pytest.approx(theirs.duration, rel=1e-6)
    assert np.abs(ours.profile.v - theirs.profile.v).max() < 1e-3 * theirs.profile.v.max()


@pytest.mark.parametrize("seed", [3, 9, 38])
def test_paths_that_stand_at_their_ends(seed):
    """s̈ is free where q′ vanishes: clamped splines."""
    random = random_problem(seed, 3)
    assert "clamped" in random.name
    problem, guess = make_problem(
        random.path, random.speed, random.acceleration, random.jerk, stands=(1, 1)
    )
    ours, theirs = third_order(problem, guess), solve_by_casadi(problem, guess)
    assert ours.solved
    assert ours.duration == pytest.approx(theirs.duration, rel=2e-3)


def test_multipliers_are_what_bounds_are_worth():
    """With more room, a motion takes Σ multiplier · change of bound less, in thousandths of the
    guess' duration.
    """
    problem, guess = make_problem(spline(2), [1.0] * 3, [3.0] * 3, [30.0] * 3)
    posed = pose_stages(problem, guess)
    stages, rows = posed.stages, posed.rows
    more = 1e-4
    changes = [np.where(np.isfinite(bound), bound * more, 0.0) for bound in (rows.low, rows.high)]
    changes[0][:, -2:] = changes[1][:, -2:] = 0.0  # the bounds of ṡ and h stay
    roomy = rows._replace(low=rows.low + changes[0], high=rows.high + changes[1])
    solutions = [interior_point.minimise(posed._replace(rows=each)) for each in (rows, roomy)]
    costs = [1e3 * sum_costs(stages, solution.states, solution.controls) for solution in solutions]
    worths = [
        (solution.high_multipliers * changes[1]).sum()
        - (solution.low_multipliers * changes[0]).sum()
        for solution in solutions
    ]
    assert worths[0] > 1e-5 * costs[0]
    assert costs[0] - costs[1] == pytest.approx(np.mean(worths), rel=1e-3)


def test_the_multiplier_of_a_stated_duration_is_what_more_of_it_is_worth():
    """Without limits the least ∫ jerk² dt goes with 1/T⁵: its slope is −5 times it, for T = 1."""
    line = CubicSpline([0.0, 1.0, 2.0], [[0.0], [0.5], [1.0]])
    problem, guess = make_problem(line, [1e3], [1e3], [1e4])
    slower = 2.0 / guess[3].sum()
    guess = guess * np.array([1 / slower, 1 / slower**2, 1 / slower**3, slower])[:, None]
    jerks = np.zeros((problem.intervals, 2, 1, 3))
    jerks[..., 0] = 1.0
    posed = pose_smoothest(problem, guess, jerks)
    solution = interior_point.minimise(posed)
    assert solution.status == "solved"
    assert solution.controls[:, 1].sum() == pytest.approx(1.0, abs=1e-9)
    cost = sum_costs(posed.stages, solution.states, solution.controls)
    assert solution.time_multiplier == pytest.approx(5e3 * cost, rel=1e-6)


def test_a_verdict_is_that_of_the_motion_it_comes_with(monkeypatch):
    """However early it is stopped, a motion that is told to keep every row this well does."""
    problem, guess = make_problem(spline(2), [1.0] * 3, [3.0] * 3, [30.0] * 3)
    posed = pose_stages(problem, guess)
    stages, rows = posed.stages, posed.rows
    verdicts, values = [], np.empty(rows.low.shape)
    for most in range(20, 60):
        monkeypatch.setattr(interior_point, "MAX_ITERATIONS", most)
        for loose in (1e-2, 1e-4, 1e-6):
            monkeypatch.setattr(interior_point, "MAX_VIOLATION", loose)
            answer = interior_point.minimise(posed)
            assert answer.iterations <= most
            verdicts.append(answer.status)
            if answer.status == "loose":
                (v, a), (j, h) = answer.states[:-1].T, answer.controls.T
                ends = np.stack([v + h * (a + h * j / 2), a + h * j], axis=1)
                assert (np.abs(ends - answer.states[1:]) <= loose * stages.scale[:2]).all()
                assert h * (v + h * (a / 2 + h * j / 6)) == pytest.approx(stages.step, rel=loose)
                evaluate(stages, rows, answer.states, answer.controls, values)
                assert np.maximum(rows.low - values, values - rows.high).max() <= loose
    assert set(verdicts) == {"slow", "loose", "solved"}


@pytest.mark.parametrize(
    ("share", "status"),
    [(0.9, "solved"), (0.99, "solved"), (1.01, "diverged"), (1.5, "diverged")],
)
def test_where_rows_exclude_each_other_multipliers_diverge(share, status):
    """Within x the largest speed from which jerk j leads to rest, from s̈ = 0, is ∛(j x²)."""
    j = 10.0
    path = CubicSpline([0.0, 1.0], [[0.0], [1.0]])
    problem, guess = make_problem(path, [10.0], [1e3], [j])
    speed = share * np.cbrt(j)
    problem = replace(problem, ends=(EndCondition(speed), problem.ends[1]))
    left = 1 - problem.s
    guess[0] = speed * left[:-1] ** (2 / 3)
    guess[3] = np.diff(problem.s) / (speed * ((left[1:] + left[:-1]) / 2) ** (2 / 3))
    guess[1] = np.diff(guess[0], append=0.0) / guess[3]
    guess[2] = 0.0
    for start in interior_point.FAR_STARTS:
        solution = interior_point.minimise(pose_stages(problem, guess), start)
        assert solution.status == status
        assert solution.iterations < 100


@pytest.mark.parametrize("near", [0.5, 1e-3])
def test_constraints_that_are_left_out_change_nothing(monkeypatch, near):
    """Even where hardly any is active at first: each becomes active once the motion comes near
    it.
    """
    problem, guess = make_problem(spline(5, 6), [1.0] * 6, [3.0] * 6, [30.0] * 6)
    posed = pose_stages(problem, guess)
    stages, rows = posed.stages, posed.rows
    counts = []

    def count_active(*arguments):
        counts.append(int(arguments[1].sum()))
        return collect(*arguments)

    collect = active_set.collect_active
    monkeypatch.setattr(interior_point, "collect_active", count_active)
    monkeypatch.setattr(active_set, "NEAR", near)
    monkeypatch.setattr(interior_point, "SHORT", near / 5)
    some, every = (interior_point.minimise(posed, start, 1e-9) for start in ("finer", "farther"))
    assert (some.status, every.status) == ("solved", "solved")
    assert counts[0] < counts[-1] / (2 if near == 0.5 else 10)
    assert len(counts) > (1 if near == 0.5 else 3)  # the last is of the other start
    assert some.controls[:, 1].sum() == pytest.approx(every.controls[:, 1].sum(), rel=1e-7)
    for name in ("low_multipliers", "high_multipliers"):
        # a row's multipliers at both places of an interval are determined as a sum alone
        ours, theirs = (
            getattr(each, name)[:, :-2].reshape(stages.step.size, 2, -1).sum(1)
            for each in (some, every)
        )
        assert ours == pytest.approx(theirs, abs=5e-3 * theirs.max())
    values = np.empty(rows.low.shape)
    evaluate(stages, rows, some.states, some.controls, values)
    assert np.maximum(rows.low - values, values - rows.high).max() <= 1e-6


def newton_system(posed):
    """The first Newton system of a solve, and the arrays for its solution."""
    method = interior_point._Method(posed, "far", interior_point.TOLERANCE)
    method.linearize()
    gradient = method.derivatives.constant + method.mu * method.derivatives.barrier
    last = method.multipliers.next[-1]
    system = riccati.NewtonSystem(
        posed.stages, method.point, method.derivatives.hessian, gradient, last, 0.0, 1.0
    )
    return system, method.recursion, method.direction


@pytest.mark.parametrize("goal", ["fastest", "weighted"])
def test_the_gradient_of_the_objective_is_that_of_finite_differences(goal):
    problem, guess = make_problem(spline(2), [1.0] * 3, [3.0] * 3, [30.0] * 3)
    posed = pose_stages(problem, guess)
    if goal == "weighted":
        slopes = np.random.default_rng(0).uniform(-1, 1, (problem.intervals, 2, 3, 2))
        posed = pose_weighted(problem, guess, slopes, 0.1)
    method = interior_point._Method(posed, "far", interior_point.TOLERANCE)
    method.linearize()
    stages = posed.stages
    for k in (1, 100, problem.intervals - 1):
        for n in range(4):
            change = 1e-5 * (stages.scale[n] if n < 3 else stages.duration[k])
            costs = []
            for sign in (-1, 1):
                states, controls = posed.states.copy(), posed.controls.copy()
                (states if n < 2 else controls)[k, n % 2] += sign * change
                costs.append(stages.objective_scale * sum_costs(stages, states, controls))
            expected = (costs[1] - costs[0]) / (2 * change)
            size = stages.objective_scale / (stages.scale[n] if n < 3 else stages.duration[k])
            assert method.derivatives.objective[k, n] == pytest.approx(
                expected, rel=1e-5, abs=1e-9 * size
            )


def test_a_newton_step_solves_its_equations():
    """Linearized dynamics hold, and the Lagrangian of the quadratic model is stationary in every
    free variable.
    """
    problem, guess = make_problem(spline(2), [1.0] * 3, [3.0] * 3, [30.0] * 3)
    system, recursion, step = newton_system(pose_stages(problem, guess))
    assert riccati.solve_newton(system, recursion, step)
    stages, point = system.stages, system.point
    (_, a), (j, h) = point.states[:-1].T, point.controls.T
    dv, da, dj, dh = step.stages.T
    end_v = point.states[1:, 0] + point.next[:, 0]
    changes = [
        point.next[:, 0] + dv + h * da + h**2 / 2 * dj + (a + h * j) * dh,
        point.next[:, 1] + da + h * dj + j * dh,
    ]
    assert np.stack(changes, axis=1) == pytest.approx(step.states[1:], abs=1e-9)
    lengths = h * dv + h**2 / 2 * da + h**3 / 6 * dj + end_v * dh
    assert lengths == pytest.approx(-point.step * stages.step, abs=1e-12)
    full = np.triu(system.hessian) + np.triu(system.hessian, 1).mT
    size = np.stack([*np.broadcast_to(stages.scale, (len(h), 3)).T, stages.duration], axis=1)
    slope = (
        (full @ step.stages[:, :, None])[:, :, 0]
        + system.delta_w / size**2 * step.stages
        + system.gradient
    )
    next_v, next_a = step.next[1:].T
    slope += np.stack(
        [
            next_v,
            h * next_v + next_a,
            h**2 / 2 * next_v + h * next_a,
            (a + h * j) * next_v + j * next_a,
        ],
        axis=1,
    )
    slope += (step.step / stages.step)[:, None] * np.stack([h, h**2 / 2, h**3 / 6, end_v], axis=1)
    slope[1:, :2] -= step.next[1:-1]
    slope[0, :2] = 0.0  # the first state is given
    assert np.abs(slope * size).max() < 1e-6 * np.abs(system.gradient * size).max()


def test_where_no_step_is_accepted_the_length_is_that_of_the_step_taken():
    """The multipliers of the equality constraints move by the same length as the point."""
    problem, guess = make_problem(spline(2), [1.0] * 3, [3.0] * 3, [30.0] * 3)
    method = interior_point._Method(pose_stages(problem, guess), "far", 1e-7)
    method.linearize()
    assert method.find_direction()
    limits = limit_step(
        method.program, method.point, method.derivatives, method.mu, method.direction
    )
    ray = Ray(method.program, method.point, method.merit, method.direction, limits, method.mu)
    nothing = Filter()  # θ_max = 0
    alpha, _ = search(ray, nothing, method.trial)
    assert 0 < alpha < limits.alpha / 1000
    step = method.point.controls + alpha * method.direction.stages[:, 2:]
    assert method.trial.controls == pytest.approx(step, rel=1e-14)


def test_a_newton_step_that_overflows_is_refused():
    problem, guess = make_problem(spline(2), [1.0] * 3, [3.0] * 3, [30.0] * 3)
    system, recursion, step = newton_system(pose_stages(problem, guess))
    assert riccati.solve_newton(system, recursion, step)
    huge = np.full_like(system.gradient, np.inf)
    assert not riccati.solve_newton(system._replace(gradient=huge), recursion, step)


def test_multipliers_that_overflow_leave_the_step_of_the_penalty():
    problem, guess = make_problem(spline(2), [1.0] * 3, [3.0] * 3, [30.0] * 3)
    system, recursion, step = newton_system(pose_stages(problem, guess))
    assert riccati.solve_newton(system, recursion, step)
    before = recursion.p.copy()
    lost = recursion._replace(control=recursion.control * np.nan)
    riccati.enforce_ends(system, lost, np.array([True, True, False]))
    assert not recursion.change.any()
    assert (recursion.p == before).all()


def iterate_twice():
    """Return the sums of states and multipliers after two iterations."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(interior_point, "MAX_ITERATIONS", 2)
        problem, guess = make_problem(spline(1, 1), [1.0], [3.0], [30.0])
        solution = interior_point.minimise(pose_stages(problem, guess))
    return float(solution.states.sum()), float(solution.high_multipliers.sum())


def test_the_same_source_runs_without_a_compiler():
    code = f"from {__name__} import iterate_twice; print(*iterate_twice())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
    )
    assert [float(word) for word in done.stdout.split()] == pytest.approx(iterate_twice(), rel=1e-9)
