"""The largest speed at an end of a jerk-limited run, where the stated one leaves no motion.

No closed form gives it: the largest speed that the solver reaches is sought first, then the
largest near it for which a motion is found. A bisection over motions would take 5 to 40 times as
long.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from kinematics.foundation.arrays import bisect
from kinematics.foundation.errors import MotionError
from planner.timing.grid import Task, jerk_problem
from planner.timing.order3.solve import settle_rows, third_order
from planner.timing.problem import Problem, Run
from planner.timing.solution import TooFast

# Shares of the largest speed without jerk limits from which the search with them starts.
START_SHARES = (0.9, 0.5, 0.2)
# The grid is made for the speed that the solver starts from. So it is started again from a little
# below its answer, until the answer changes by less than this share, and this many times at most.
SETTLED_CHANGE, MAX_RESOLVES, RESTART_SHARE = 1e-4, 3, 0.998
# Shares of the solver's answer, tried in turn until one leads to a motion; then halvings between
# that and the one before it.
NEAR_SHARES, HALVINGS = (0.9995, 0.998, 0.99, 0.95, 0.8, 0.5), 3


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
    most = 0.0
    for share in START_SHARES:
        if share * bound > most:
            most = max(most, _solve_for_speed(task, end, share * bound, bound))
    if most == 0:
        return 0.0
    for _ in range(MAX_RESOLVES):
        before = most
        most = _solve_for_speed(task, end, RESTART_SHARE * most, bound) or before
        if abs(most / before - 1) < SETTLED_CHANGE:
            break
    return _narrow(task.run, end, most, is_feasible)


def _narrow(run: Run, end: int, most: float, is_feasible: Callable[[Run], bool]) -> float:
    """Return the largest feasible speed near the solver's answer; 0 if none is feasible."""

    def is_possible(share: float) -> bool:
        return is_feasible(set_speed(run, end, float(share * most)))

    high = 1.0
    for low in NEAR_SHARES:
        if is_possible(low):
            share = float(bisect(is_possible, low, high, HALVINGS)) if high < 1 else low
            return share * most
        high = low
    return 0.0


def _solve_for_speed(task: Task, end: int, start: float, bound: float) -> float:
    """Maximise the speed at an end up to `bound`, from a motion that has `start` there."""
    posed = jerk_problem(task.path, task.limits, set_speed(task.run, end, start))
    if isinstance(posed, MotionError):
        return 0.0
    problem, guess_motion = posed
    guess = guess_motion.on(problem.s)
    problem = settle_rows(problem, guess)
    ends = list(problem.ends)
    ends[end] = replace(ends[end], speed=bound)
    bounded = replace(problem, ends=(ends[0], ends[1]))
    solution = third_order(bounded, guess, fast_end=end)
    if not solution.solved:
        return 0.0
    return solution.profile.last_speed if end else float(solution.profile.v[0])


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
