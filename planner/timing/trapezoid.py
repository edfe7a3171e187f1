"""The classical timing of a run: one trapezoid of speed along the path, as fast as such a one can be."""

import numpy as np

from kinematics.array import Array
from planner.limits.limit import Term
from planner.timing.problem import Problem
from planner.timing.profile import Profile


def trapezoid(problem: Problem) -> Profile:
    """The shortest trapezoid or triangle in arc length that keeps every order-2 row of the problem at its grid points.

    With ramps of length d and top speed V, ṡ² = V² x/d at the distance x from an end and s̈ = V²/2d, and the run of
    length L takes (L + 2d)/V. For every d on the grid the largest V is the least of what three kinds of rows allow:
    speed and curvature while cruising, |c| V ≤ 1 and |b| V² ≤ 1;  speed on the ramps, |c| V √(x/d) ≤ 1;
    acceleration on the ramps, |±a + 2 b x| V²/2d ≤ 1 (where its bounds differ, against the one on its side of zero).
    Running maxima from both ends give all d at once.
    """
    s0, length = problem.s[0], problem.s[-1] - problem.s[0]
    # both sides of every interval, as distances from the run's start
    x = np.concatenate([problem.s[:-1], problem.s[1:]]) - s0
    slope, push, bend = _largest(problem, Term.SD), *_accelerations(problem, x, length)
    d = np.unique(np.concatenate([np.minimum(x, length - x), [length / 2]]))
    d = d[d > 0]
    near = np.minimum(x, length - x)
    ramp_speed = _running_max(near, slope * np.sqrt(near), d)
    ramp_push = _running_max(near, push, d)
    with np.errstate(divide="ignore"):
        cruise = np.minimum(1 / _running_max(-near, slope, -d), 1 / np.sqrt(_running_max(-near, bend, -d)))
        top = np.minimum(cruise, np.minimum(np.sqrt(d) / ramp_speed, np.sqrt(2 * d / ramp_push)))
    best = int(np.argmin((length + 2 * d) / top))
    return _profile(problem, float(d[best]), float(top[best]))


def _largest(problem: Problem, term: Term) -> Array:
    """Largest |coefficient| of a term (2N,) at the starts and ends of all intervals, in blocks of that term alone."""
    found = np.zeros(2 * problem.intervals)
    for block in problem.blocks:
        if set(block.start) == {term}:
            sides = np.concatenate([block.start[term], block.end[term]])
            np.maximum(found, np.abs(sides).max(1), out=found)
    return found


def _accelerations(problem: Problem, x: Array, length: float) -> tuple[Array, Array]:
    """Largest share of ±a + 2 b x on the ramp that a point would lie on, and largest of b (2N,)."""
    push, bend = np.zeros(len(x)), np.zeros(len(x))
    sign, near = np.where(x <= length / 2, 1.0, -1.0)[:, None], np.minimum(x, length - x)[:, None]
    for block in problem.blocks:
        if Term.SDD in block.start:
            a = np.concatenate([block.start[Term.SDD], block.end[Term.SDD]])
            b = np.concatenate([block.start[Term.SD2], block.end[Term.SD2]])
            np.maximum(push, block.share(sign * a + 2 * near * b).max(1), out=push)
            np.maximum(bend, block.share(b).max(1), out=bend)
    return push, bend


def _running_max(x: Array, values: Array, at: Array) -> Array:
    """max of values over all points with x ≤ at."""
    order = np.argsort(x, kind="stable")
    highest = np.maximum.accumulate(values[order])
    reached = np.searchsorted(x[order], at, side="right")
    return np.asarray(np.where(reached > 0, highest[np.maximum(reached - 1, 0)], 0.0), float)


def _profile(problem: Problem, ramp: float, top: float) -> Profile:
    """The trapezoid cut at the problem's grid and at its own corners."""
    s0, s1 = problem.s[0], problem.s[-1]
    s = np.union1d(problem.s, [s0 + ramp, s1 - ramp])
    s = s[np.concatenate([np.diff(s) > 1e-12 * (s1 - s0), [True]])]
    s[-1] = s1
    near = np.minimum(s - s0, s1 - s)
    v = top * np.sqrt(np.minimum(1.0, near / ramp))
    h = 2 * np.diff(s) / (v[1:] + v[:-1])
    middle = (s[1:] + s[:-1]) / 2
    piece = problem.piece[np.clip(np.searchsorted(problem.s, middle, side="right") - 1, 0, problem.intervals - 1)]
    return Profile(s[:-1], v[:-1], np.diff(v) / h, np.zeros(len(h)), h, piece)
