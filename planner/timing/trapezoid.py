"""The classical timing of a run: one trapezoid of speed along the path, as fast as such a one can be."""

import numpy as np

from kinematics.array import Array
from planner.limits.limit import Term
from planner.timing.problem import Block, Problem
from planner.timing.profile import Profile

# Share of a limit that counts as room at least, where holding still takes nearly all of it.
LEAST = 1e-3
# How often a trapezoid is sought near the last one, where rows depend on the motion.
ROUNDS = 6


def trapezoid(problem: Problem) -> Profile:
    """The shortest rest-to-rest trapezoid or triangle in arc length that keeps every order-2 row at the grid points.

    With ramps of length d and top speed V, ṡ² = V² x/d at the distance x from an end and s̈ = V²/2d, and the run of
    length L takes (L + 2d)/V. For every d on the grid the largest V is the least of what three kinds of rows allow:
    speed and curvature while cruising, |c| V ≤ 1 and |b| V² ≤ 1;  speed on the ramps, |c| V √(x/d) ≤ 1;
    acceleration on the ramps, |±a + 2 b x| V²/2d ≤ 1 (where its bounds differ, against the one on its side of zero).
    Running maxima from both ends give all d at once. Of rows that mix these, P V² + S V ≤ 1 is kept beside what holds
    still, each part at its largest; of rows that speak near some motions only, those near rest, and then those near
    each faster trapezoid's top speed.
    """
    best = _trapezoid(problem.around(*np.zeros((2, problem.intervals))))
    for _ in range(0 if problem.settled else ROUNDS):
        faster = _trapezoid(problem.around(*np.full((2, problem.intervals), best.v.max())))
        if not faster.duration < best.duration:
            break
        best = faster
    return best


def _trapezoid(problem: Problem) -> Profile:
    s0, length = problem.s[0], problem.s[-1] - problem.s[0]
    # both sides of every interval, as distances from the run's start
    x = np.concatenate([problem.s[:-1], problem.s[1:]]) - s0
    slope, drag, push, bend = *_speeds(problem), *_accelerations(problem, x, length)
    d = np.unique(np.concatenate([np.minimum(x, length - x), [length / 2]]))
    d = d[d > 0]
    near = np.minimum(x, length - x)
    ramp_speed = _running_max(near, slope * np.sqrt(near), d)
    ramp_push, ramp_drag = _running_max(near, push, d) / (2 * d), _running_max(near, drag * np.sqrt(near), d)
    with np.errstate(divide="ignore"):
        cruise = np.minimum(
            1 / _running_max(-near, slope, -d), _root(_running_max(-near, bend, -d), _running_max(-near, drag, -d))
        )
        ramps = np.minimum(np.sqrt(d) / ramp_speed, _root(ramp_push, ramp_drag / np.sqrt(d)))
        top = np.minimum(cruise, ramps)
    best = int(np.argmin((length + 2 * d) / top))
    return _profile(problem, float(d[best]), float(top[best]))


def _root(square: Array, linear: Array) -> Array:
    """V of P V² + S V = 1."""
    return np.asarray(2 / (linear + np.sqrt(linear**2 + 4 * square)))


def _sides(block: Block, term: Term) -> Array:
    """Coefficients of a term (2N, m) at all intervals' starts and ends, as shares of what holding still leaves."""
    if term not in block.start:
        return np.zeros((1, 1))
    room = 1.0
    if Term.ONE in block.start:
        room = np.maximum(1 - np.abs(np.concatenate([block.start[Term.ONE], block.end[Term.ONE]])), LEAST)
    return np.asarray(np.concatenate([block.start[term], block.end[term]]) / room)


def _speeds(problem: Problem) -> tuple[Array, Array]:
    """Largest |coefficient| of ṡ (2N,), in blocks of ṡ alone and in others."""
    alone, mixed = np.zeros((2, 2 * problem.intervals))
    for block in problem.blocks:
        if Term.SD in block.start:
            found = alone if len(block.start) == 1 else mixed
            np.maximum(found, np.abs(_sides(block, Term.SD)).max(1), out=found)
    return alone, mixed


def _accelerations(problem: Problem, x: Array, length: float) -> tuple[Array, Array]:
    """Largest share of ±a + 2 b x on the ramp that a point would lie on, and largest of b (2N,)."""
    push, bend = np.zeros(len(x)), np.zeros(len(x))
    sign, near = np.where(x <= length / 2, 1.0, -1.0)[:, None], np.minimum(x, length - x)[:, None]
    for block in problem.blocks:
        if Term.SDD in block.start:
            a, b = _sides(block, Term.SDD), _sides(block, Term.SD2)
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
