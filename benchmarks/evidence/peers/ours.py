"""Our own solvers on the problems that peers solve."""

from collections.abc import Callable
from copy import copy
from functools import partial

import numpy as np

from benchmarks.evidence.peers.casadi_ import CasadiProblem
from benchmarks.evidence.peers.problems import SHARES, Motion, PathProblem, Solve
from kinematics.foundation.errors import require
from planner.timing import (
    Run,
    Solver,
    certified_solve,
    jerk_problem,
    make_grid,
    pose_problem,
    second_order,
    third_order,
)
from planner.timing.grid import Rule
from planner.trajectory import Trajectory


def sample(trajectory: Trajectory, order: int) -> Motion:
    """Return a motion at many instants of each of its pieces."""
    lengths = np.diff(trajectory.knots)
    piece = np.repeat(np.arange(len(lengths)), len(SHARES))
    state = trajectory.within(piece, np.outer(lengths, SHARES).ravel(), jerk=True)
    jerk = state.qddd if order == 3 else np.full_like(state.q, np.inf)
    return Motion(trajectory.duration, state.q, state.qd, state.qdd, jerk)


def solve_certified(problem: PathProblem, order: int) -> Callable[[], Motion]:
    """Find and prove the fastest motion, as `plan` does. Raises MotionError without a proof."""
    solution = certified_solve(copy(problem.path), problem.limits(order), order)
    return partial(sample, solution.trajectory, order)


def solve_passes(
    problem: PathProblem,
    intervals: int,
    solver: Solver = "passes",
) -> Callable[[], Motion]:
    """Find the fastest motion at order 2 without a proof: our passes, or toppra on our rows."""
    grid = make_grid(problem.path, whole_run(problem), intervals)
    posed = pose_problem(problem.path, problem.limits(2), *grid)
    profile = second_order(posed, solver=solver).require_profile()
    return partial(sample, profile.along(problem.path), 2)


def solve_general(problem: PathProblem) -> Callable[[], Motion]:
    """Find the fastest motion at order 3 without a proof, on a grid even along straight lines."""
    posed, start = require(jerk_problem(problem.path, problem.limits(3), whole_run(problem)))
    profile = third_order(posed, start.on(posed.s)).require_profile()
    return partial(sample, profile.along(problem.path), 3)


def pose_reference(problem: PathProblem, intervals: int) -> tuple[int, Solve]:
    """Return the number of intervals of a fine grid, and what solves order 3 on it by IPOPT."""
    run, rule = whole_run(problem), Rule(intervals, 0, 0)
    posed, start = require(jerk_problem(problem.path, problem.limits(3), run, rule=rule))
    built = CasadiProblem(posed, start.on(posed.s), "ipopt")

    def solve() -> Callable[[], Motion]:
        profile = built.solve().require_profile()
        return partial(sample, profile.along(problem.path), 3)

    return posed.intervals, solve


def whole_run(problem: PathProblem) -> Run:
    """Return the run over the whole path."""
    return Run(0, len(problem.path.breaks) - 2)
