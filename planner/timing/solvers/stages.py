"""The order-3 problem stage by stage, in compiled loops: what rows, next states and jerks are.

A stage is one interval: from the state (ṡ, s̈) at its start, with constant s⃛ for the duration h. With x = (ṡ, s̈, s⃛, h),

    ṡ′ = ṡ + s̈ h + s⃛ h²/2     s̈′ = s̈ + s⃛ h     Δs = ṡ h + s̈ h²/2 + s⃛ h³/6

Rows are sums of terms at the stage's start, and at its end (those with s⃛) or in its middle (the others); beside them ṡ
at the start and h are bounded from below.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel

START, MIDDLE, END, OWN = range(4)
"""Where a row is taken; and what is of the stage itself, h."""
PLACE_COUNT = 4
TERM_COUNT = 7
"""Of planner.limits.limit.Term, in whose order terms are counted: 1, ṡ, ṡ², ṡ³, s̈, ṡs̈, s⃛."""


class StageRows(NamedTuple):
    """low ≤ Σ coefficient · term ≤ high of N stages: first all M rows at the starts, then all at the second points.

    terms (B, 7), lengths (B,)  terms of each block, in the order of planner.limits.limit.Term, and how many
    size (B,), at_end (B,)    rows of each block, and whether its second point is the stage's end
    first, second (N, C)      coefficients at the starts and the second points: block by block, row by row, term by term
    low, high (N, 2M + 2)     −∞ and ∞ where nothing is bound; the last two columns bound ṡ and h / duration
    """

    terms: np.ndarray
    lengths: np.ndarray
    size: np.ndarray
    at_end: np.ndarray
    first: Array
    second: Array
    low: Array
    high: Array


class Stages(NamedTuple):
    """N stages: step (N,) Δs, calm (N,) what s⃛² costs, scale (3,) of ṡ, s̈ and s⃛, duration (N,) of h.

    free_start, free_end  whether the first and the last s̈ are to be found
    prize                 what a unit of the first ṡ is worth, in the guess' duration; 0 where that ṡ is given
    stated                whether Σ h is given, as 1, and not part of the cost
    jerks (N, 2, A, 3)    r₀, r₁, r₂ of A jerks r = r₀ s⃛ + r₁ ṡs̈ + r₂ ṡ³ at starts and ends, which are weighed half
                          each: ∫ Σ r² is part of the cost
    pushes (N, 2, A, 2)   the same of accelerations, r₀ s̈ + r₁ ṡ²
    """

    step: Array
    calm: Array
    scale: Array
    duration: Array
    free_start: bool
    free_end: bool
    prize: float
    stated: bool
    jerks: Array
    pushes: Array


class Iterate(NamedTuple):
    """States (N + 1, 2) and controls (N, 2), with the slacks and forces (K,) of the sides of rows that are held."""

    states: Array
    controls: Array
    slack: Array
    force: Array


class Misses(NamedTuple):
    """(K,) of sides with their slacks, (N, 2) of the next states and (N,) of the steps, as shares of these."""

    side: Array
    next: Array
    step: Array


class Slopes(NamedTuple):
    """By x = (ṡ, s̈, s⃛, h) of each stage.

    cost (N, 4)          of the cost
    pull, centre (N, 4)  of cost and sides, the sides' forces taken out to first order: pull + μ · centre
    bend (N, 4, 4)       second ones of the Lagrangian, with the sides' forces over their slacks: the upper half
    """

    cost: Array
    pull: Array
    centre: Array
    bend: Array


@kernel
def reach(v: float, a: float, j: float, h: float) -> tuple[float, float]:
    """(ṡ, s̈) after h with constant s⃛."""
    return v + h * (a + h * j / 2), a + h * j


@kernel
def slope_place(place: int, a: float, j: float, h: float) -> tuple[float, float, float, float]:
    """The time t of a place, t²/2, and by h: ṡ and s̈ there. By s̈ ṡ is t, by s⃛ ṡ is t²/2 and s̈ is t."""
    part = 0.0 if place == START else (0.5 if place == MIDDLE else 1.0)
    t = part * h
    return t, t * t / 2, part * (a + t * j), part * j


@kernel
def add_bends(
    t: float,
    t_square: float,
    by_h: float,
    push_by_h: float,
    vv: float,
    va: float,
    vj: float,
    aa: float,
    aj: float,
    jj: float,
    out: Array,
) -> None:
    """Add what is bent by ṡ, s̈, s⃛ at a place, by x, to the upper half of out (4, 4); see `slope_place`."""
    va_v, va_a = t * vv + va, t * va + aa
    j_v, j_a, j_j = t_square * vv + t * va + vj, t_square * va + t * aa + aj, t_square * vj + t * aj + jj
    h_v, h_a, h_j = by_h * vv + push_by_h * va, by_h * va + push_by_h * aa, by_h * vj + push_by_h * aj
    out[0, 0] += vv
    out[0, 1] += va_v
    out[0, 2] += j_v
    out[0, 3] += h_v
    out[1, 1] += t * va_v + va_a
    out[1, 2] += t * j_v + j_a
    out[1, 3] += t * h_v + h_a
    out[2, 2] += t_square * j_v + t * j_a + j_j
    out[2, 3] += t_square * h_v + t * h_a + h_j
    out[3, 3] += by_h * h_v + push_by_h * h_a


@kernel
def evaluate(stages: Stages, rows: StageRows, states: Array, controls: Array, out: Array) -> None:
    """out (N, 2M + 2): the values of all rows."""
    last, half_width = out.shape[1] - 1, out.shape[1] // 2 - 1
    size, at_end, lengths, kinds = rows.size, rows.at_end, rows.lengths, rows.terms
    terms = np.empty((3, TERM_COUNT))
    for k in range(len(stages.step)):
        v, a, j, h = states[k, 0], states[k, 1], controls[k, 0], controls[k, 1]
        for place in range(3):
            pv, pa = reach(v, a, j, h * place / 2)
            terms[place, 0], terms[place, 1], terms[place, 2], terms[place, 3] = 1.0, pv, pv * pv, pv * pv * pv
            terms[place, 4], terms[place, 5], terms[place, 6] = pa, pv * pa, j
        for half in range(2):
            coefficients = rows.first if half == 0 else rows.second
            at, row = 0, half * half_width
            for b in range(len(size)):
                own, length = terms[START if half == 0 else (END if at_end[b] else MIDDLE)], lengths[b]
                first, second, third = own[kinds[b, 0]], own[kinds[b, 1]], own[kinds[b, 2]]
                for i in range(size[b]):  # three terms written out take half the time
                    value = coefficients[k, at] * first
                    if length > 1:
                        value += coefficients[k, at + 1] * second
                    if length > 2:
                        value += coefficients[k, at + 2] * third
                    for t in range(3, length):
                        value += coefficients[k, at + t] * own[kinds[b, t]]
                    out[k, row + i] = value
                    at += length
                row += size[b]
        out[k, last - 1], out[k, last] = v, h / stages.duration[k]


@kernel
def sum_costs(stages: Stages, states: Array, controls: Array) -> float:
    """What a motion costs."""
    total = 0.0 if stages.stated else -stages.prize * states[0, 0]
    jerks, pushes = stages.jerks, stages.pushes
    for k in range(len(stages.step)):
        v, a, j, h = states[k, 0], states[k, 1], controls[k, 0], controls[k, 1]
        if not stages.stated:
            total += h + stages.calm[k] * j * j
        if jerks.shape[2] + pushes.shape[2] == 0:
            continue
        for side in range(2):
            pv, pa = reach(v, a, j, h * side)
            for i in range(jerks.shape[2]):
                jerk = jerks[k, side, i, 0] * j
                jerk += (jerks[k, side, i, 1] * pa + jerks[k, side, i, 2] * pv * pv) * pv
                total += h / 2 * jerk * jerk
            for i in range(pushes.shape[2]):
                push = pushes[k, side, i, 0] * pa + pushes[k, side, i, 1] * pv * pv
                total += h / 2 * push * push
    return total


@kernel
def add_jerks(jerks: Array, reached: Array, j: float, share: float, sums: Array, bends: Array) -> float:
    """Add share/2 · Σ r² at both ends of a stage to what is by ṡ, s̈, s⃛, and return ½ Σ r²."""
    total = 0.0
    for side in range(2):
        place = START if side == 0 else END
        v, a = reached[place, 0], reached[place, 1]
        own, bend = sums[3, place], bends[place]
        for i in range(jerks.shape[1]):
            r0, r1, r2 = jerks[side, i, 0], jerks[side, i, 1], jerks[side, i, 2]
            r = r0 * j + (r1 * a + r2 * v * v) * v
            total += r * r / 2
            by_v, by_a, by_j = r1 * a + 3 * r2 * v * v, r1 * v, r0
            own[0] += share * r * by_v
            own[1] += share * r * by_a
            own[2] += share * r * by_j
            bend[0] += share * (by_v * by_v + r * 6 * r2 * v)
            bend[1] += share * (by_v * by_a + r * r1)
            bend[2] += share * by_v * by_j
            bend[3] += share * by_a * by_a
            bend[4] += share * by_a * by_j
            bend[5] += share * by_j * by_j
    return total


@kernel
def add_pushes(pushes: Array, reached: Array, share: float, sums: Array, bends: Array) -> float:
    """The same of accelerations."""
    total = 0.0
    for side in range(2):
        place = START if side == 0 else END
        v, a = reached[place, 0], reached[place, 1]
        own, bend = sums[3, place], bends[place]
        for i in range(pushes.shape[1]):
            r0, r1 = pushes[side, i, 0], pushes[side, i, 1]
            r, by_v = r0 * a + r1 * v * v, 2 * r1 * v
            total += r * r / 2
            own[0] += share * r * by_v
            own[1] += share * r * r0
            bend[0] += share * (by_v * by_v + 2 * r * r1)
            bend[1] += share * by_v * r0
            bend[3] += share * r0 * r0
    return total
