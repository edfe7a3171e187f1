"""Where the jerk lets a run by only slowly, as in small blends: motions slow enough there, to start a solve from.

Along a piece with q‴ a steady ṡ has the jerk q‴ ṡ³, so that no more than ṡ = (J/|q‴|)^⅓ gets through, while the order-2
motion that starts a solve goes by √(A/|q″|): through a blend of reach d, d^(2/3) against d^(1/2), ever farther off the
smaller the blend. From there solvers find no answer, and from rest at such places (which s̈ = 0 makes a motion too) the
slowest of many.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from kinematics.array import Array
from planner.limits.limit import Term
from planner.timing.problem import Problem
from planner.timing.profile import Profile
from planner.timing.smooth import Smoothed

# A start passes a slow break with this share of the speed that the jerk leaves; measured on corners with blends of 1e-9
# to 1e-3 m: 0.3 to 1 lead to the same answers.
SHARE = 0.7
# Newton steps to what a ramp can reach, from above: to rounding.
STEPS = 30


class Passing:
    """Averaged motions one after the other, each beginning with the speed that the one before it ends with."""

    def __init__(self, parts: Sequence[Smoothed], breaks: Array) -> None:
        """breaks (P+1,): path lengths from where to where each goes."""
        self.parts, self.breaks = tuple(parts), breaks

    def on(self, s: Array) -> Array:
        """(4, N) of ṡ, s̈, s⃛, h on a grid s (N+1,) that holds the breaks."""
        return np.concatenate([part.on(s[own.start : own.stop + 1]) for part, own in self._each(s)], 1)

    def profile(self, problem: Problem) -> Profile:
        """The motions themselves."""
        return Profile.joined(
            [part.profile(problem.part(own)) for part, own in self._each(problem.s)],
        )

    def _each(self, s: Array) -> list[tuple[Smoothed, slice]]:
        """Every part and its intervals of a grid."""
        at = np.searchsorted(s, self.breaks)
        at[[0, -1]] = 0, len(s) - 1
        return [(part, slice(int(a), int(b))) for part, (a, b) in zip(self.parts, pairwise(at), strict=True)]


def slow_breaks(problem: Problem, start: Smoothed, breaks: Array) -> tuple[np.ndarray, Array]:
    """The inner breaks of a run that `start` passes faster than the jerk lets, and a speed for each.

    breaks (P+1,) of the run. A speed can be reached from the one before and the one after, under the jerk alone.
    """
    count = len(breaks) - 1
    bent, push = _largest(problem, Term.SD3, count), _largest(problem, Term.SDDD, count)
    with np.errstate(divide="ignore"):
        allowed, jerk = np.cbrt(1 / bent), 1 / push
    allowed = np.maximum(allowed[:-1], allowed[1:])  # the easier side leads on to the other as slowly as it must
    now = start.on(np.concatenate([problem.s[:1], breaks[1:-1], problem.s[-1:]]))[0, 1:]
    slow = np.flatnonzero(now > allowed)
    at = np.concatenate([[0], slow + 1, [count]])
    speeds = np.concatenate([problem.speeds[:1], SHARE * allowed[slow], problem.speeds[1:]])
    between = [(float(jerk[a:b].min()), float(breaks[b] - breaks[a])) for a, b in pairwise(at)]
    for k, (least, way) in enumerate(between[:-1]):
        speeds[k + 1] = min(speeds[k + 1], _reached(speeds[k], least, way))
    for k, (least, way) in reversed(list(enumerate(between[1:], 1))):
        speeds[k] = min(speeds[k], _reached(speeds[k + 1], least, way))
    return slow + 1, speeds[1:-1]


def _largest(problem: Problem, term: Term, count: int) -> Array:
    """(count,) the largest coefficient of a term on each piece."""
    size, first = np.zeros(count), problem.piece[0]
    for block in problem.blocks:
        for side in (block.start, block.end):
            if term in side:
                np.maximum.at(size, problem.piece - first, np.abs(side[term]).max(1))
    return size


def _reached(speed: float, jerk: float, way: float) -> float:
    """w of a ramp from a speed v, s̈ = 0 at both ends, over some way: (v + w) √((w − v)/J) = way."""
    if not np.isfinite(jerk):
        return float("inf")
    square = jerk * way**2
    more = np.cbrt(square)
    for _ in range(STEPS):
        total = 2 * speed + more
        more -= (total**2 * more - square) / (total * (total + 2 * more))
    return float(speed + more)
