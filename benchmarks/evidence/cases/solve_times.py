"""Time to solve and certify the bare circle, next to the solvers alone.

The circle has a radius of 15 mm and lies 25 mm above home; rest to rest. Reference durations:
independent solves on graded grids found 1.2615 to 1.2617 s with jerk limits, toppra with 4000
points 1.2040 s without. Wanted are at most 1.2046 s within 0.4 s at order 2, and 1.2630 s within
1.5 s at order 3.
"""

from collections.abc import Callable, Iterator
from functools import partial
from statistics import median
from time import perf_counter

import numpy as np

from benchmarks.evidence.measuring import time_calls
from benchmarks.evidence.peers.casadi_ import Solver, solve_by_casadi
from benchmarks.evidence.table import Row, Table
from kinematics import Machine, load_machine
from kinematics.foundation.errors import require
from planner import Program, load_program
from planner.certificate.limit_use import forget_paths
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.timing import (
    Run,
    RunSolution,
    certified_solve,
    jerk_problem,
    make_grid,
    pose_problem,
    second_order,
    third_order,
)
from planner.trajectory import Trajectory

REPEATS = 7
# Intervals on which our order-3 solver is timed; the other ones solve the first of these problems.
JERK_INTERVALS = (240, 1000, 2000)
JERK_SOLVERS: tuple[Solver, ...] = ("fatrop", "ipopt")


def solve_program(program: Program, machine: Machine, order: int) -> Trajectory:
    """Solve from the program on, with the proof of its geometry, which is retained otherwise."""
    forget_paths()
    path = actuate(program, machine)
    return certified_solve(path, limits_of(path, machine.axes, order), order).trajectory


def time_solver(
    name: str, intervals: int | None, work: Callable[[], Trajectory | RunSolution]
) -> Row:
    """Return the row of a solver: its first call, and the median of the later ones."""
    result, times = time_calls(work, REPEATS, perf_counter)
    return [name, intervals, result.duration, times[0], median(times[1:])]


def solver_rows() -> Iterator[Row]:
    """Yield the rows of certified solves, and of solvers alone on the same problems."""
    machine, program = load_machine("hexapod"), load_program("bare-circle")
    for order in (2, 3):
        work = partial(solve_program, program, machine, order)
        yield time_solver(f"order {order}, certified", None, work)
    path = actuate(program, machine)
    limits = limits_of(path, machine.axes, 2)
    for points in (1000, 4000):
        problem = pose_problem(path, limits, *make_grid(path, Run(0, 0), points))
        for solver in ("passes", "toppra"):
            yield time_solver(solver, points, partial(second_order, problem, solver=solver))
    limits = limits_of(path, machine.axes, 3)
    jerk, start = require(jerk_problem(path, limits, Run(0, 0)))
    for name in JERK_SOLVERS:
        peer = partial(solve_by_casadi, jerk, start.on(jerk.s), name)
        yield time_solver(name, jerk.intervals, peer)
    for intervals in JERK_INTERVALS:
        places = np.linspace(0, jerk.intervals, intervals + 1)
        s = np.interp(places, np.arange(jerk.intervals + 1), jerk.s)
        problem = pose_problem(path, limits, s, np.zeros(intervals, int))
        yield time_solver("riccati", intervals, partial(third_order, problem, start.on(s)))


def measure() -> Iterator[Table]:
    """Yield the times of whole solves and of the solvers alone."""
    columns = ("solver", "intervals", "duration (s)", "first call (s)", "later calls (s)")
    yield Table("", columns, solver_rows())
