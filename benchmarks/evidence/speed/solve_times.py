"""How long the bare circle takes to solve and certify, beside the solvers alone: `python -m
benchmarks.evidence.speed.solve_times`.

The circle has a radius of 15 mm and lies 25 mm above home; rest to rest. Reference durations: independent solves on
graded grids found 1.2615 to 1.2617 s with jerk limits, toppra with 4000 points 1.2040 s without.
"""

from collections.abc import Callable
from functools import partial
from statistics import median
from time import perf_counter, process_time

import numpy as np

from benchmarks.evidence.measuring import Result, time_calls
from benchmarks.evidence.peers.casadi_ import Solver, solve_by_casadi
from kinematics import Machine, load_machine
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import require
from planner import Program, Solution, load_program
from planner.certificate.certify import forget_paths
from planner.limits import limits_of
from planner.path.actuation import ActuatorPath, actuate
from planner.timing.certified_solve import certified_solve
from planner.timing.discretization import jerk_problem
from planner.timing.problem import Problem, Run, make_grid, pose_problem
from planner.timing.solvers.interior_point import minimise
from planner.timing.solvers.second_order import second_order
from planner.timing.solvers.stage_problem import pose_stages
from planner.timing.solvers.third_order import third_order

REPEATS = 7
STAGE_COUNTS = (240, 1000, 2000)
JERK_SOLVERS: tuple[Solver, ...] = ("fatrop", "ipopt")
# What order 2 and 3 are held against, and the time that solving and certifying may take (s).
TARGETS = {2: (1.2046, 0.4), 3: (1.2630, 1.5)}


def time_solver(work: Callable[[], Result]) -> tuple[Result, float, float]:
    """The result, the time of the first call, and the median time of those after it (s)."""
    result, times = time_calls(work, REPEATS, perf_counter)
    return result, times[0], median(times[1:])


def main() -> None:
    machine, program = load_machine("hexapod"), load_program("bare-circle")
    path = actuate(program, machine)
    tiny = pose_problem(path, limits_of(path, machine.axes, 2), *make_grid(path, Run(0, 0), 10))
    second_order(tiny, solver="toppra")  # its imports
    print(f"{'':<44}{'duration':>12}{'first call':>12}{'again':>12}")
    for order in (2, 3):
        solution, first, again = time_solver(partial(solve_program, program, machine, order))
        worst = max(solution.certificate.worst.values())
        print_times(
            f"order {order}, solved and certified ({solution.rounds} rounds)",
            solution.trajectory.duration,
            first,
            again,
        )
        longest, slowest = TARGETS[order]
        print(f"    worst proven ratio {worst:.9f}; wanted: at most {longest} s, solved within {slowest} s")
    for points in (1000, 4000):
        problem = pose_problem(path, limits_of(path, machine.axes, 2), *make_grid(path, Run(0, 0), points))
        for solver in ("passes", "toppra"):
            profile, first, again = time_solver(partial(second_order, problem, solver=solver))
            print_times(f"{solver} alone, {points} intervals, not certified", profile.duration, first, again)
    third, start = require(jerk_problem(path, limits_of(path, machine.axes, 3), Run(0, 0)))
    profile, first, again = time_solver(partial(third_order, third, start.on(third.s)))
    print_times(f"riccati alone, {third.intervals} intervals, not certified", profile.duration, first, again)
    for name in JERK_SOLVERS:
        profile, first, again = time_solver(partial(solve_by_casadi, third, start.on(third.s), name))
        print_times(f"{name} alone, {third.intervals} intervals, not certified", profile.duration, first, again)
    time_stages(path, machine, third, start.on)


def time_stages(path: ActuatorPath, machine: Machine, problem: Problem, on: Callable[[Array], Array]) -> None:
    """The order-3 solver's processor time a stage and iteration, on finer and finer grids."""
    for intervals in STAGE_COUNTS:
        s = np.interp(np.linspace(0, problem.intervals, intervals + 1), np.arange(problem.intervals + 1), problem.s)
        finer = pose_problem(path, limits_of(path, machine.axes, 3), s, np.zeros(intervals, int))
        stages, rows, states, controls, unit = pose_stages(finer, on(s))
        answer, times = time_calls(partial(minimise, stages, rows, states, controls), REPEATS, process_time)
        each = min(times) / intervals / answer.iterations
        print(
            f"riccati, {intervals} stages, {answer.iterations} iterations, {answer.status}: "
            f"{answer.controls[:, 1].sum() * unit[3]:.6f} s, {each * 1e6:.2f} us a stage and iteration"
        )


def solve_program(program: Program, machine: Machine, order: int) -> Solution:
    """From the program on, with the proof of its geometry, which a rerun would have from the first call."""
    forget_paths()
    path = actuate(program, machine)
    return certified_solve(path, limits_of(path, machine.axes, order), order)


def print_times(what: str, duration: float, first: float, again: float) -> None:
    print(f"{what:<44}{duration:>10.6f} s{first:>10.3f} s{again:>10.3f} s")


if __name__ == "__main__":
    main()
