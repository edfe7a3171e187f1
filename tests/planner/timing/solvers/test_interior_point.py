"""Our interior-point method: analytic motions, FATROP's answers, and the same source without a compiler."""

import os
import subprocess
import sys

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
from planner.timing.goals.stated_duration import quintic_motion
from planner.timing.solvers import interior_point, riccati, sides
from planner.timing.solvers.stage_problem import pose_smoothest, pose_stages
from planner.timing.solvers.stages import evaluate, sum_costs


def posed(path, speed, acceleration, jerk, stands=(0, 0)):
    """An order-3 problem from rest to rest, and what to start from."""
    bounds = zip(speed, acceleration, jerk, strict=True)
    axes = [Axis(f"q{n}", max_speed=v, max_acceleration=a, max_jerk=j) for n, (v, a, j) in enumerate(bounds)]
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
    problem, guess = posed(spline(seed), [1.0] * 3, [3.0] * 3, [30.0] * 3)
    ours, theirs = third_order(problem, guess), solve_by_casadi(problem, guess)
    assert ours.solved
    assert ours.duration == pytest.approx(theirs.duration, rel=1e-6)
    assert np.abs(ours.profile.v - theirs.profile.v).max() < 1e-3 * theirs.profile.v.max()


@pytest.mark.parametrize("seed", [3, 9, 38])
def test_paths_that_stand_at_their_ends(seed):
    """s̈ is free where q′ vanishes: clamped splines."""
    random = random_problem(seed, 3)
    assert "clamped" in random.name
    problem, guess = posed(random.path, random.speed, random.acceleration, random.jerk, stands=(1, 1))
    ours, theirs = third_order(problem, guess), solve_by_casadi(problem, guess)
    assert ours.solved
    assert ours.duration == pytest.approx(theirs.duration, rel=2e-3)


def test_multipliers_are_what_bounds_are_worth():
    """With more room, a motion takes Σ multiplier · change of bound less, in thousandths of the guess' duration."""
    problem, guess = posed(spline(2), [1.0] * 3, [3.0] * 3, [30.0] * 3)
    stages, rows, states, controls, _ = pose_stages(problem, guess)
    more = 1e-4
    sides = [np.where(np.isfinite(side), side * more, 0.0) for side in (rows.low, rows.high)]
    sides[0][:, -2:] = sides[1][:, -2:] = 0.0  # the bounds of ṡ and h stay
    roomy = rows._replace(low=rows.low + sides[0], high=rows.high + sides[1])
    answers = [interior_point.minimise(stages, each, states, controls) for each in (rows, roomy)]
    costs = [1e3 * sum_costs(stages, answer.states, answer.controls) for answer in answers]
    worths = [(one.high_forces * sides[1]).sum() - (one.low_forces * sides[0]).sum() for one in answers]
    assert worths[0] > 1e-5 * costs[0]
    assert costs[0] - costs[1] == pytest.approx(np.mean(worths), rel=1e-3)


def test_the_multiplier_of_a_stated_duration_is_what_more_of_it_is_worth():
    """Without limits the least ∫ jerk² dt goes with 1/T⁵: its slope is −5 times it, for T = 1."""
    line = CubicSpline([0.0, 1.0, 2.0], [[0.0], [0.5], [1.0]])
    problem, _ = posed(line, [1e3], [1e3], [1e4])
    jerks = np.zeros((problem.intervals, 2, 1, 3))
    jerks[..., 0] = 1.0
    stages, rows, states, controls, _ = pose_smoothest(problem, quintic_motion(problem.s, 2.0), jerks)
    answer = interior_point.minimise(stages, rows, states, controls)
    assert answer.status == "solved"
    assert answer.controls[:, 1].sum() == pytest.approx(1.0, abs=1e-9)
    assert answer.time_force == pytest.approx(5e3 * sum_costs(stages, answer.states, answer.controls), rel=1e-6)


def test_a_verdict_is_that_of_the_motion_it_comes_with(monkeypatch):
    """However early it is stopped, a motion that is told to keep every row this well does."""
    problem, guess = posed(spline(2), [1.0] * 3, [3.0] * 3, [30.0] * 3)
    stages, rows, states, controls, _ = pose_stages(problem, guess)
    verdicts, values = [], np.empty(rows.low.shape)
    for most in range(20, 60):
        monkeypatch.setattr(interior_point, "MAX_ITERATIONS", most)
        for loose in (1e-2, 1e-4, 1e-6):
            monkeypatch.setattr(interior_point, "LOOSE_ROWS", loose)
            answer = interior_point.minimise(stages, rows, states, controls)
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


@pytest.mark.parametrize("near", [0.5, 1e-3])
def test_sides_that_are_left_out_change_nothing(monkeypatch, near):
    """Even where hardly any is held at first: each is, once the motion comes near it."""
    problem, guess = posed(spline(5, 6), [1.0] * 6, [3.0] * 6, [30.0] * 6)
    stages, rows, states, controls, _ = pose_stages(problem, guess)
    counts = []

    def count_sides(*arguments):
        counts.append(int(arguments[1].sum()))
        return hold(*arguments)

    hold = sides.hold_sides
    monkeypatch.setattr(interior_point, "hold_sides", count_sides)
    monkeypatch.setattr(sides, "NEAR", near)
    monkeypatch.setattr(interior_point, "SHORT", near / 5)
    some, every = (interior_point.minimise(stages, rows, states, controls, start) for start in ("finer", "farther"))
    assert (some.status, every.status) == ("solved", "solved")
    assert counts[0] < counts[-1] / (2 if near == 0.5 else 10)
    assert len(counts) > (1 if near == 0.5 else 3)  # the last is of the other start
    assert some.controls[:, 1].sum() == pytest.approx(every.controls[:, 1].sum(), rel=1e-7)
    for ours, theirs in ((some.low_forces, every.low_forces), (some.high_forces, every.high_forces)):
        assert ours == pytest.approx(theirs, abs=5e-3 * theirs.max())
    values = np.empty(rows.low.shape)
    evaluate(stages, rows, some.states, some.controls, values)
    assert np.maximum(rows.low - values, values - rows.high).max() <= 1e-6


def test_a_step_that_is_no_number_is_none(monkeypatch):
    """Numbers that overflow end a solve with a status, not with an error of the linear algebra."""
    problem, guess = posed(spline(2), [1.0] * 3, [3.0] * 3, [30.0] * 3)
    stages, rows, states, controls, _ = pose_stages(problem, guess)
    roll = riccati.roll

    def overflow(*arguments):
        roll(*arguments)
        arguments[-1].states[-1] = np.nan

    monkeypatch.setattr(riccati, "roll", overflow)
    assert interior_point.minimise(stages, rows, states, controls).status == "not convex"
    monkeypatch.undo()
    # where only the exact step is none, that of the price is taken
    seek = riccati.seek

    def lose(stages, motion, recursion, *asked):
        seek(stages, motion, recursion._replace(choice=recursion.choice * np.nan), *asked)
        assert not recursion.more.any()

    monkeypatch.setattr(riccati, "seek", lose)
    monkeypatch.setattr(riccati, "MISS_LEFT", 0.0)
    monkeypatch.setattr(interior_point, "MAX_ITERATIONS", 1)
    answer = interior_point.minimise(stages, rows, states, controls)
    assert np.isfinite(answer.states).all()
    assert answer.iterations == 1


PLAIN = """
import sys
from tests.planner.timing.solvers.test_interior_point import posed, spline
from planner.timing.solvers.stage_problem import pose_stages
from planner.timing.solvers import interior_point
interior_point.MAX_ITERATIONS = 2
problem, guess = posed(spline(1, 1), [1.0], [3.0], [30.0])
stages, rows, states, controls, unit = pose_stages(problem, guess)
answer = interior_point.minimise(stages, rows, states, controls)
print(repr(float(answer.states.sum())), repr(float(answer.high_forces.sum())), "numba" in sys.modules)
"""


def test_the_same_source_runs_without_a_compiler():
    told = []
    for off in ("0", "1"):
        environment = {**os.environ, "NUMBA_DISABLE_JIT": off}
        done = subprocess.run(
            [sys.executable, "-c", PLAIN], capture_output=True, text=True, check=True, env=environment
        )
        told.append([float(word) for word in done.stdout.split()[:2]])
    assert told[0] == pytest.approx(told[1], rel=1e-9)
