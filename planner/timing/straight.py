"""Runs that are straight in the actuators: their fastest motion in closed form, seven pieces of constant jerk.

Where q′ is constant for every axis, the limits on speed, acceleration and jerk are constants V, A, J of ṡ, s̈, s⃛ (∞
where there is none). A ramp between speeds v and w, s̈ = 0 at its ends, takes |w − v|/A + A/J where A is reached, else
2 √(|w − v|/J), and covers (v + w)/2 times that; the fastest motion ramps to the largest speed that the length allows,
at most V, and back. Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots (2008), 3.4.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kinematics.array import Array
from planner.limits.limit import Term
from planner.timing.ends import TooFast
from planner.timing.problem import Problem
from planner.timing.profile import Profile

# Share of a limit that rows may vary by, or that curvature may use, and still count as straight: rounding.
STRAIGHT = 1e-11
# Halvings that bring a bracket of one order of magnitude down to rounding, and doublings that may bracket at all.
HALVINGS, DOUBLINGS = 60, 2000
# Share of the duration below which a piece of the motion is none.
SLIVER = 1e-14


@dataclass(frozen=True, slots=True)
class _Limits:
    """Of the motion along a straight run: ṡ, s̈, s⃛."""

    speed: float
    acceleration: float
    jerk: float

    def ramp(self, change: float) -> tuple[float, float]:
        """How long the jerk acts at either end of a ramp, and how long s̈ stays between."""
        if change <= 0:
            return 0.0, 0.0
        if change * self.jerk >= self.acceleration**2:
            rise = self.acceleration / self.jerk
            return rise, change / self.acceleration - rise
        return float(np.sqrt(change / self.jerk)), 0.0

    def way(self, low: float, high: float) -> float:
        rise, held = self.ramp(high - low)
        return (low + high) / 2 * (2 * rise + held)


def straight(problem: Problem) -> Profile | None:
    """The fastest motion of a run with constant rows, exact to rounding; None where the run is not straight.

    Raises TooFast where a speed at an end is beyond its limit, or the way to the other end too short for it.
    """
    limits = _limits(problem)
    if limits is None:
        return None
    length, (first, last) = float(problem.s[-1] - problem.s[0]), problem.speeds
    low, high = min(first, last), max(first, last)
    if high > limits.speed * (1 + STRAIGHT) or limits.way(low, high) > length * (1 + STRAIGHT):
        most = min(limits.speed, _root(lambda v: limits.way(low, v) - length, low))
        raise TooFast(int(last > first), high, most)
    top = _root(lambda v: limits.way(first, v) + limits.way(last, v) - length, high)
    top = max(high, min(top, limits.speed))
    cruise = max(0.0, length - limits.way(first, top) - limits.way(last, top)) / top
    return _profile(problem, limits, top, cruise)


def _limits(problem: Problem) -> _Limits | None:
    """The limits along the run, where every row is constant and holds ṡ, s̈ or s⃛ alone; None elsewhere."""
    if not problem.settled:
        return None
    largest = dict.fromkeys((Term.SD, Term.SDD, Term.SDDD), 0.0)
    others: list[tuple[Term, float]] = []
    for block in problem.blocks:
        mixed = sum(bool(np.any(block.start[term])) for term in block.start if term in largest) > 1
        if (block.room != 1).any() or block.middle.any() or mixed:
            return None
        for term in block.start:
            values = np.abs(np.concatenate([block.start[term], block.end[term]]))
            if term not in largest:
                others.append((term, float(values.max(initial=0.0))))
                continue
            most = values.max(0, initial=0.0)
            if (most - values.min(0, initial=np.inf) > STRAIGHT * most.max(initial=0.0)).any():
                return None
            largest[term] = max(largest[term], float(most.max(initial=0.0)))
    if not largest[Term.SDDD] and not largest[Term.SDD]:
        return None
    speed, acceleration, jerk = (1 / size if size else np.inf for size in largest.values())
    length = problem.s[-1] - problem.s[0]
    # what speed and acceleration can come to within the length, where no limit says so
    fast = min(speed, np.sqrt(2 * acceleration * length), np.cbrt(jerk * length**2) * 2)
    hard = min(acceleration, np.cbrt(jerk**2 * length) * 2)
    used = {Term.SD2: fast**2, Term.SD3: fast**3, Term.SDSDD: fast * hard, Term.ONE: np.inf}
    if any(size and size * used[term] > STRAIGHT for term, size in others):
        return None
    return _Limits(speed, acceleration, jerk)


def _root(rising: Callable[[float], float], low: float) -> float:
    """Where a rising function is zero, from a place where it is not above; ∞ where it never is."""
    step = low if low > 0 else 1.0
    while step > 0 and rising(low + step) > 0:
        step /= 2
    high = low + 2 * step
    for _ in range(DOUBLINGS):
        if rising(high) > 0:
            break
        low, high = high, 2 * high
    else:
        return float("inf")
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if rising(middle) > 0 else (middle, high)
    return low


def _profile(problem: Problem, limits: _Limits, top: float, cruise: float) -> Profile:
    """Up, along, down; cut where the path's own pieces end."""
    first, last = problem.speeds
    parts = [*_ramp(limits, top - first, 1.0), (0.0, 0.0, cruise), *_ramp(limits, top - last, -1.0)]
    j, a, h = np.array(parts).T
    j, a, h = (values[h > SLIVER * h.sum()] for values in (j, a, h))
    v = first + np.append(0.0, np.cumsum(h * (a + h * j / 2)))[:-1]
    s = problem.s[0] + np.append(0.0, np.cumsum(h * (v + h * (a / 2 + h * j / 6))))[:-1]
    knots = np.append(0.0, np.cumsum(h))

    def at(t: Array) -> tuple[Array, Array, Array, Array]:
        k = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(h) - 1)
        tau = t - knots[k]
        return (
            s[k] + tau * (v[k] + tau * (a[k] / 2 + tau * j[k] / 6)),
            v[k] + tau * (a[k] + tau * j[k] / 2),
            a[k] + tau * j[k],
            j[k],
        )

    breaks = problem.s[1:-1][np.diff(problem.piece) > 0]
    low, high = np.zeros(len(breaks)), np.full(len(breaks), knots[-1])
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        early = at(middle)[0] < breaks
        low, high = np.where(early, middle, low), np.where(early, high, middle)
    apart = np.abs(high[:, None] - knots).min(1, initial=np.inf) > SLIVER * knots[-1]
    cuts = np.union1d(knots, high[apart])
    piece = problem.piece[0] + np.searchsorted(breaks, at((cuts[1:] + cuts[:-1]) / 2)[0], side="right")
    return Profile(*at(cuts[:-1]), np.diff(cuts), piece)


def _ramp(limits: _Limits, change: float, sign: float) -> list[tuple[float, float, float]]:
    """s⃛, s̈ at the start and duration of the three pieces of a ramp."""
    rise, held = limits.ramp(change)
    if rise + held == 0:
        return []
    push = change / (rise + held)
    jerk = push / rise if rise > 0 else 0.0
    return [(sign * jerk, 0.0, rise), (0.0, sign * push, held), (-sign * jerk, sign * push, rise)]
