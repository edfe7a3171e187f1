"""Proved lower bounds of durations, and how far durations are above them.

`--kind paths`     the circle at both orders, and the spline through 50 waypoints
`--kind splines`   COPP's random ones
`--kind straight`  random moves of one axis from rest to rest, with their shortest durations
`--kind random`    random problems at order 3, and how many are bounded within 1 %
`--kind zoo`       random problems of one run, with other solvers: toppra at order 2, FATROP and
                   IPOPT at order 3 on a grid twice as fine, each motion slowed until no sample is
                   above a limit
"""

from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from typing import Literal, get_args

import numpy as np
from scipy.interpolate import PPoly

from benchmarks.evidence.measuring import time_calls
from benchmarks.evidence.peers.casadi_ import Solver, solve_by_casadi
from benchmarks.evidence.peers.problems import spline
from benchmarks.evidence.peers.random_splines import Suite
from benchmarks.evidence.random_problems import random_problem
from benchmarks.evidence.table import Row, Table, quantile_table
from kinematics import load_machine
from kinematics.foundation.errors import MotionError, attempt
from planner import load_program, time_optimal
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.timing import Settings, Solution, certified_solve, jerk_problem, sample_limit_use
from planner.timing.problem import split_runs
from planner.timing.tighten import required_slowness

COLUMNS = ("motion", "duration (s)", "at least (s)", "gap (%)", "cells", "time (s)", "of solving")
LIMITS = ("max_speed", "max_acceleration", "max_jerk")

Solve = Callable[[], Solution]


def measure(
    kind: Literal["paths", "splines", "straight", "random", "zoo"],
    count: int = 100,
) -> Iterator[Table]:
    """Yield how far durations are above their bounds."""
    if kind in ("paths", "splines"):
        problems = list_paths() if kind == "paths" else islice(list_splines(), count)
        yield Table("Lower bounds", COLUMNS, (describe(*problem) for problem in problems))
        return
    if kind == "random":
        yield measure_random(count)
        return
    gaps: dict[str, list[float]] = defaultdict(list)
    for name, bound, duration in solve_straight(count) if kind == "straight" else solve_zoo(count):
        gaps[name].append(1 - bound / duration)
    yield quantile_table("1 - bound / duration, below 0 for a bound that is wrong", gaps)


def measure_random(count: int) -> Table:
    """Return how many random problems at order 3 come within some gaps of their bounds."""
    solutions = [attempt(random_problem(seed, 3).solve) for seed in range(count)]
    gaps = np.array([solution.gap for solution in solutions if isinstance(solution, Solution)])
    rows = ((gap, int((100 * gaps <= gap).sum()), len(gaps)) for gap in (0.1, 0.3, 1, 3, 10))
    return Table("Random problems at order 3", ("gap (%)", "within it", "of"), rows)


def list_paths() -> Iterator[tuple[str, Solve]]:
    """Yield the circle and the spline, with what solves them."""
    machine = load_machine("hexapod")
    circle = actuate(load_program("bare-circle"), machine)
    case = spline()
    for path, axes, order in (
        (circle, machine.axes, 2),
        (circle, machine.axes, 3),
        (case.path, case.axes, 3),
    ):
        solve = partial(certified_solve, path, limits_of(path, axes, order), order)
        solve()  # loads the kernels
        yield f"{'circle' if path is circle else 'spline'}, order {order}", solve


def list_splines() -> Iterator[tuple[str, Solve]]:
    """Yield COPP's random splines, with what solves them."""
    for number, (path, bounds) in enumerate(Suite().problems()):
        limits = np.asarray(bounds).transpose(0, 2, 1)
        yield (
            f"spline {number}",
            partial(time_optimal, path, **dict(zip(LIMITS, limits, strict=True))),
        )


def describe(name: str, solve: Solve) -> Row:
    """Return the row of a motion: its bound, and how long that takes compared with solving."""
    solution, (solving,) = time_calls(solve)
    bound, (bounding,) = time_calls(lambda: solution.bound)
    return (
        name,
        bound.duration,
        bound.value,
        100 * bound.gap,
        len(bound.s),
        bounding,
        bounding / solving,
    )


def solve_straight(count: int, seed: int = 0) -> Iterator[tuple[str, float, float]]:
    """Yield the bound and the shortest duration (s) of random moves from rest to rest."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        length = float(10 ** rng.uniform(-3, 2))
        limits = 10 ** rng.uniform(-1, 1.5, 3)
        path = PPoly([[[length]], [[0.0]]], [0.0, 1.0])
        solution = time_optimal(path, **dict(zip(LIMITS, limits, strict=True)))
        yield "straight", solution.lower_bound, find_shortest(length, *limits)


def find_shortest(length: float, speed: float, acceleration: float, jerk: float) -> float:
    """Return s of the fastest move from rest to rest along a line, in closed form."""
    ramped = acceleration**2 / jerk  # m/s, up to which jerk alone limits
    peak = float(np.cbrt(length**2 * jerk / 4))
    if peak > ramped:
        peak = (np.sqrt(ramped**2 + 4 * acceleration * length) - ramped) / 2
    peak = min(peak, speed)
    ramp = peak / acceleration + acceleration / jerk if peak > ramped else 2 * np.sqrt(peak / jerk)
    return float(ramp + length / peak)


def solve_zoo(count: int) -> Iterator[tuple[str, float, float]]:
    """Yield the bounds of random problems, and the shorter of our duration and another's (s)."""
    for order in (2, 3):
        for seed in range(count):
            ours = attempt(random_problem(seed, order).solve)
            if isinstance(ours, Solution):
                for name, theirs in find_others(ours):
                    yield name, ours.lower_bound, min(ours.trajectory.duration, theirs)


def find_others(ours: Solution) -> Iterator[tuple[str, float]]:
    """Yield the durations (s) of other solvers' motions that hold, if the path has one run."""
    path = ours.trajectory.path
    if path.stops(ours.order)[1:-1].any():
        return
    if ours.order == 2:
        theirs = attempt(
            partial(certified_solve, path, ours.limits, 2, settings=Settings(solver="toppra"))
        )
        if isinstance(theirs, Solution):
            yield "toppra", theirs.trajectory.duration
        return
    (run,) = split_runs(path, np.array([0, len(path.breaks) - 1]), 3, Settings(fineness=2))
    posed = jerk_problem(path, ours.limits, run)
    if isinstance(posed, MotionError):
        return
    fine, start = posed
    for solver in get_args(Solver):
        solution = solve_by_casadi(fine, start.on(fine.s), solver)
        if solution.solved:
            use = sample_limit_use(path, ours.limits, solution.profile)
            slowness = required_slowness(ours.limits, use)
            yield solver, solution.duration * max(slowness, 1.0)
