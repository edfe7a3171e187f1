"""The nearest place at which a motion can reach rest, or the plan at a share of its speed.

From the state (s, ṡ, s̈) at an instant the time-optimal problem is solved again, up to an end that
is sought: the nearest with a motion that keeps every limit. A motion to a nearer end takes less
time, unless the limits change along the way: docs/theory/hold.md.
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from kinematics.foundation.errors import MotionError, attempt
from planner.interruption.instant import Instant
from planner.interruption.section import ProvedMotion, Whole
from planner.timing.attempts import solve_once
from planner.timing.certified_solve import certified_solve
from planner.timing.grid import Task, coarse_jerk_problem
from planner.timing.loss_grid import pose_by_loss
from planner.timing.problem import Continuation, EndCondition, Run, Settings, at_speeds
from planner.trajectory import Trajectory

# Share of a distance by which an end may be farther than the nearest that the search would find:
# each halving is one more rough solve.
NEAR_SHARE = 0.01
# Halvings at most.
HALVINGS = 24
# Times as far in turn, where the rough solve promised a motion that is then not proved.
FARTHER = (1.0, 1.02, 1.1, 1.3)
# Without jerk limits the search begins with this share of the distance ahead, and doubles it. Grids
# of short distances are fine; a coarse grid may show no motion where there is one.
FIRST_SHARE = 1e-4
DOUBLING = 2.0
# With jerk limits it begins with this many times the nearest end without them, then multiplies it
# by GROWTH.
FIRST_WITH_JERK = 1.05
GROWTH = 1.3
# Share of the speed at which the search without jerk limits begins, as the speed itself may be the
# largest allowed.
BEGIN_SPEED = 0.99
# Share of a path's length below which rounding of places is too much of a distance.
SHORTEST = 1e-10
# Nearer ends tried once more, as shares of the distance found: a rough solve may fail where there
# is a motion.
NEARER = (0.8, 0.9, 0.96)

Target = Callable[[float], tuple[float, float]]
"""A place (m) of the plan's path -> ṡ and s̈ to be reached there."""


def find_ramps(
    whole: Whole,
    now: Instant,
    end: float,
    target: Target,
    followed: Trajectory,
) -> Iterator[ProvedMotion]:
    """Find motions from an instant to the target before `end` (m), the nearest place first.

    followed  motion whose s⃛ may step at its knots. On a grid with these knots, following it for a
              while is one of the motions of the problem.
    """
    shortest = SHORTEST * float(whole.path.breaks[-1])
    if end - now.s <= shortest:
        return
    places = np.unique(followed.s)
    knots = places[places > now.s] - now.s
    continuation = Continuation(np.zeros(1), np.zeros((4, 0)), {}, knots)
    search = _Search(whole, now, end, target, continuation)
    distance = search.find_nearest(shortest)
    for farther in FARTHER:
        until = now.s + farther * distance
        if until >= end:
            break
        path = whole.draw(now, until, target(until))
        limits = whole.limits(path)
        solve = partial(
            certified_solve, path, limits, whole.order, settings=Settings(continuation=continuation)
        )
        solution = attempt(solve)
        if not isinstance(solution, MotionError):
            yield ProvedMotion(path, limits, solution.trajectory, solution.certificate, now.s)


class _Search:
    """The search for the nearest end by rough solves."""

    def __init__(
        self,
        whole: Whole,
        now: Instant,
        end: float,
        target: Target,
        continuation: Continuation,
    ) -> None:
        self.now = now
        self.order = whole.order
        self.target = target
        self.continuation = continuation
        self.path = whole.draw(now, end)
        self.limits = whole.limits(self.path)
        self.farthest = float(self.path.breaks[-1])

    def find_nearest(self, shortest: float) -> float:
        """Return the distance (m) to the nearest place with the target, at least `shortest`.

        Where no place is found, the whole distance to the end.
        """
        first = max(FIRST_SHARE * self.farthest, shortest)
        sharp = self._search(2, first, DOUBLING, shortest)
        if self.order == 2:
            return sharp
        distance = self._search(3, FIRST_WITH_JERK * sharp, GROWTH, shortest)
        for share in NEARER:
            nearer = share * distance
            if nearer > sharp and self._reaches(3, nearer):
                return self._narrow(3, sharp, nearer, shortest)
        return distance

    def _search(self, order: int, distance: float, growth: float, shortest: float) -> float:
        """Go outwards until the target is reached, then halve the interval in which it first is."""
        low = 0.0
        high = distance
        while high < self.farthest and not self._reaches(order, high):
            low = high
            high *= growth
        return self._narrow(order, low, min(high, self.farthest), shortest)

    def _narrow(self, order: int, low: float, high: float, shortest: float) -> float:
        """Halve an interval of distances (m) whose upper end has the target; return that end."""
        for _ in range(HALVINGS):
            if high - low <= NEAR_SHARE * high or high <= shortest:
                break
            # geometric where both ends are of the same magnitude
            middle = float(np.sqrt(low * high)) if low > 0.1 * high else (low + high) / 2
            middle = max(middle, shortest)
            if self._reaches(order, middle):
                high = middle
            else:
                low = middle
        return high

    def _reaches(self, order: int, distance: float) -> bool:
        """Return whether a rough solve of this order reaches the target at a distance (m)."""
        last = int(np.searchsorted(self.path.breaks, distance, "left")) - 1
        last = int(np.clip(last, 0, len(self.path.pieces) - 1))
        speed, acceleration = self.target(self.now.s + distance)
        if order == 2:
            begin = self.now.v if self.order == 2 else BEGIN_SPEED * self.now.v
            run = Run(0, last, at_speeds(begin, speed), until=distance)
            return solve_once(Task(self.path, self.limits, run, order)).solved
        run = Run(
            0,
            last,
            (EndCondition(self.now.v, self.now.a), EndCondition(speed, acceleration)),
            until=distance,
            continuation=self.continuation,
        )
        coarse = coarse_jerk_problem(self.path, self.limits, run)
        posed = pose_by_loss(self.path, self.limits, run, coarse)
        return posed is not None and not isinstance(posed, MotionError)
