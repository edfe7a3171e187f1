"""The largest speed at an end of a jerk-limited run, where the stated one leaves no motion.

No closed form gives it: the largest speed that the solver reaches is sought first, then the
largest near it for which a motion is found.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.errors import MotionError
from planner.limits.limit import Limit, Term
from planner.path.actuation import ActuatorPath
from planner.timing.grid import coarse_jerk_problem, jerk_problem
from planner.timing.order3.solve import settle_rows, third_order
from planner.timing.problem import POWERS, Problem, Run
from planner.timing.solution import TooFast

# Shares of the largest speed without jerk limits from which the search with them starts.
START_SHARES = (0.9, 0.5, 0.2)
# The grid is made for the speed that the solver starts from. So it is started again from a little
# below its answer, until the answer changes by less than this share, and this many times at most.
SETTLED_CHANGE, MAX_RESOLVES, RESTART_SHARE = 1e-4, 3, 0.998
# Shares of the solver's answer, tried in turn until one leads to a motion; then halvings between
# that and the one before it.
NEAR_SHARES, HALVINGS = (0.9995, 0.998, 0.99, 0.95, 0.8, 0.5), 3
# Halvings for the largest speed that the rows leave room for: down to rounding.
ROW_HALVINGS = 50


def find_excessive_end_speed(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    is_feasible: Callable[[Run], bool],
) -> TooFast | None:
    """Return the refusal of a run's start or end speed, if one of them is too high.

    is_feasible  whether a motion is found along a run
    """
    search = _Search(path, limits, is_feasible)
    for other_at_rest in (False, True):
        for end in (0, 1):
            speed = run.speeds[end]
            if speed == 0:
                continue
            one = set_speed(run, 1 - end, 0.0) if other_at_rest else run
            largest = search.find_largest(one, end)
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


@dataclass(frozen=True, slots=True)
class _Search:
    path: ActuatorPath
    limits: Sequence[Limit]
    is_feasible: Callable[[Run], bool]

    def find_largest(self, run: Run, end: int) -> float:
        """Return the largest speed up to the run's that leads to a motion; 0 if none does."""
        bound = largest_end_speed(coarse_jerk_problem(self.path, self.limits, run), end)
        most = 0.0
        for share in START_SHARES:
            if share * bound > most:
                most = max(most, self._solve_for_speed(run, end, share * bound, bound))
        if most == 0:
            return 0.0
        for _ in range(MAX_RESOLVES):
            before = most
            most = self._solve_for_speed(run, end, RESTART_SHARE * most, bound) or before
            if abs(most / before - 1) < SETTLED_CHANGE:
                break
        return self._narrow(run, end, most)

    def _narrow(self, run: Run, end: int, most: float) -> float:
        """Return the largest feasible speed near the solver's answer."""
        high = 1.0
        for low in NEAR_SHARES:
            if self.is_feasible(set_speed(run, end, low * most)):
                break
            high = low
        else:
            return 0.0
        if high < 1:
            for _ in range(HALVINGS):
                middle = (low + high) / 2
                if self.is_feasible(set_speed(run, end, middle * most)):
                    low = middle
                else:
                    high = middle
        return low * most

    def _solve_for_speed(self, run: Run, end: int, start: float, bound: float) -> float:
        """Maximise the speed at an end up to `bound`, from a motion that has `start` there."""
        posed = jerk_problem(self.path, self.limits, set_speed(run, end, start))
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
    low = 0.0
    high = problem.speeds[end]
    if _has_room(interval, end, high):
        return high
    for _ in range(ROW_HALVINGS):
        middle = (low + high) / 2
        if _has_room(interval, end, middle):
            low = middle
        else:
            high = middle
    return low


def _has_room(interval: Problem, end: int, speed: float) -> bool:
    """Return whether the rows at the start or end of one interval leave room for a speed."""
    speeds = np.array([speed])
    for block in interval.around(speeds, speeds).blocks:
        side = block.end if end else block.start
        if Term.SDDD in side:
            continue
        used = sum(values[0] * speed ** POWERS[term] for term, values in side.items() if term in POWERS)
        if np.max(block.share(used)) > 1:
            return False
    return True
