"""The largest speed at an end of a jerk-limited run, where the stated one leaves no motion.

No closed form gives it: bisection finds the largest for which a motion is found.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from kinematics.foundation.arrays import bisect
from planner.timing.grid import Task
from planner.timing.problem import Problem, Run
from planner.timing.solution import TooFast

# Halvings for the largest speed: down to 1e-4 of the largest that the rows allow.
HALVINGS = 14


def find_excessive_end_speed(
    task: Task,
    is_feasible: Callable[[Run], bool],
) -> TooFast | None:
    """Return the refusal of a run's start or end speed, if one of them is too high.

    is_feasible  whether a motion is found along a run
    """
    run = task.run
    for other_at_rest in (False, True):
        for end in (0, 1):
            speed = run.speeds[end]
            if speed == 0:
                continue
            one = set_speed(run, 1 - end, 0.0) if other_at_rest else run
            largest = _find_largest(task.with_run(one), end, is_feasible)
            if 0 < largest < speed:
                return TooFast(end, speed, largest, other_at_rest)
        if min(run.speeds) == 0:
            break
    return None


def set_speed(run: Run, end: int, speed: float) -> Run:
    """Return the run with another speed at its start (0) or end (1)."""
    start, last = run.ends
    if end == 0:
        return replace(run, ends=(replace(start, speed=speed), last))
    return replace(run, ends=(start, replace(last, speed=speed)))


def _find_largest(task: Task, end: int, is_feasible: Callable[[Run], bool]) -> float:
    """Return the largest speed up to the run's that leads to a motion; 0 if none does."""
    bound = largest_end_speed(task.coarse, end)

    def is_possible(speed: float) -> bool:
        return is_feasible(set_speed(task.run, end, float(speed)))

    if is_possible(bound):
        return bound
    return float(bisect(is_possible, 0.0, bound, HALVINGS))


def largest_end_speed(problem: Problem, end: int) -> float:
    """Return the largest speed up to the problem's that the rows without s⃛ allow there, s̈ = 0.

    Solvers keep such rows inside a run only: at its ends the state is given.
    """
    last = problem.intervals - 1
    interval = problem.part(slice(last, last + 1) if end else slice(0, 1))

    def has_room(speed: float) -> bool:
        speeds = np.array([speed])
        blocks = interval.around(speeds, speeds).blocks
        return all(block.find_steady_use(-end, float(speed)) <= 1 for block in blocks)

    high = problem.speeds[end]
    return high if has_room(high) else float(bisect(has_room, 0.0, high))
