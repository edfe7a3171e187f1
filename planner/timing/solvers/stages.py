"""The order-3 problem stage by stage, in compiled loops: what rows and next states are, and their slopes.

A stage is one interval: from the state (ṡ, s̈) at its start, with constant s⃛ for the duration h. With x = (ṡ, s̈, s⃛, h),

    ṡ′ = ṡ + s̈ h + s⃛ h²/2     s̈′ = s̈ + s⃛ h     Δs = ṡ h + s̈ h²/2 + s⃛ h³/6

Rows are sums of terms at the stage's start, and at its end (those with s⃛) or in its middle (the others); beside them ṡ
at the start and h are bounded from below.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel

START, MIDDLE, END, SPEED, DURATION = range(5)
"""Where a row is taken; the last two are bounds of ṡ and h."""


class StageRows(NamedTuple):
    """low ≤ Σ coefficient · term ≤ high of N stages: first all M rows at the starts, then all at the second points.

    terms (B, 7), lengths (B,)  terms of each block, in the order of planner.limits.limit.Term, and how many
    size (B,), at_end (B,)    rows of each block, and whether its second point is the stage's end
    first, second (N, C)      coefficients at the starts and the second points: block by block, term by term, row by row
    low, high (N, 2M + 2)     −∞ and ∞ where nothing is bound; the last two columns bound ṡ and h / duration
    place (2M + 2,)           of each column
    """

    terms: np.ndarray
    lengths: np.ndarray
    size: np.ndarray
    at_end: np.ndarray
    first: Array
    second: Array
    low: Array
    high: Array
    place: np.ndarray


class Stages(NamedTuple):
    """N stages: step (N,) Δs, calm (N,) what s⃛² costs, scale (3,) of ṡ, s̈ and s⃛, duration (N,) of h.

    free_start, free_end  whether the first and the last s̈ are to be found
    prize                 what a unit of the first ṡ is worth, in the guess' duration; 0 where that ṡ is given
    """

    step: Array
    calm: Array
    scale: Array
    duration: Array
    free_start: bool
    free_end: bool
    prize: float


class Iterate(NamedTuple):
    """States (N + 1, 2) and controls (N, 2), with the rows' slacks and multipliers (N, 2M + 2) below and above."""

    states: Array
    controls: Array
    slack_low: Array
    slack_high: Array
    force_low: Array
    force_high: Array


class Misses(NamedTuple):
    """Values (N, 2M + 2) of the rows, misses (N, 2) of the next states and (N,) of the steps, as shares of these."""

    values: Array
    next: Array
    step: Array


class Slopes(NamedTuple):
    """By x = (ṡ, s̈, s⃛, h) of each stage: of the rows, the next states, the steps and the Lagrangian.

    rows (N, 5, 2M)     by ṡ, s̈, s⃛ at their points, and curvatures ṡṡ and ṡs̈
    next (N, 2, 4), step (N, 4)
    cost (N, 4), bend (N, 4, 4)  of the Lagrangian; bend has the rows' forces over their slacks in it
    """

    rows: Array
    next: Array
    step: Array
    cost: Array
    bend: Array


@kernel
def evaluate(stages: Stages, rows: StageRows, states: Array, controls: Array, misses: Misses) -> None:
    """Fill `misses` for a motion."""
    half_size = (misses.values.shape[1] - 2) // 2
    for k in range(len(stages.step)):
        v, a, j, h = states[k, 0], states[k, 1], controls[k, 0], controls[k, 1]
        v_end, a_end = v + h * (a + h * j / 2), a + h * j
        v_mid, a_mid = v + h / 2 * (a + h * j / 4), a + h * j / 2
        misses.step[k] = h * (v + h * (a / 2 + h * j / 6)) / stages.step[k] - 1
        misses.next[k, 0], misses.next[k, 1] = v_end - states[k + 1, 0], a_end - states[k + 1, 1]
        for half in range(2):
            coefficients = rows.first if half == 0 else rows.second
            at, row = 0, half * half_size
            for b in range(len(rows.size)):
                pv, pa = (v, a) if half == 0 else ((v_end, a_end) if rows.at_end[b] else (v_mid, a_mid))
                size = rows.size[b]
                for i in range(size):
                    misses.values[k, row + i] = 0.0
                for t in range(rows.lengths[b]):
                    factor = _term(rows.terms[b, t], pv, pa, j)
                    for i in range(size):
                        misses.values[k, row + i] += coefficients[k, at + i] * factor
                    at += size
                row += size
        misses.values[k, 2 * half_size] = v
        misses.values[k, 2 * half_size + 1] = h / stages.duration[k]


@kernel
def _term(term: int, v: float, a: float, j: float) -> float:
    if term == 0:
        return 1.0
    if term == 1:
        return v
    if term == 2:
        return v * v
    if term == 3:
        return v * v * v
    if term == 4:
        return a
    return v * a if term == 5 else j


@kernel
def differentiate(stages: Stages, rows: StageRows, states: Array, controls: Array, slopes: Slopes) -> None:
    """Fill `rows`, `next` and `step` of `slopes`."""
    half_size = slopes.rows.shape[2] // 2
    for k in range(len(stages.step)):
        v, a, j, h = states[k, 0], states[k, 1], controls[k, 0], controls[k, 1]
        v_end, a_end = v + h * (a + h * j / 2), a + h * j
        v_mid, a_mid = v + h / 2 * (a + h * j / 4), a + h * j / 2
        for n, value in enumerate((h, h * h / 2, h * h * h / 6, v_end)):
            slopes.step[k, n] = value / stages.step[k]
        for n, value in enumerate((1.0, h, h * h / 2, a_end)):
            slopes.next[k, 0, n] = value
        for n, value in enumerate((0.0, 1.0, h, j)):
            slopes.next[k, 1, n] = value
        for half in range(2):
            coefficients = rows.first if half == 0 else rows.second
            at, row = 0, half * half_size
            for b in range(len(rows.size)):
                pv, pa = (v, a) if half == 0 else ((v_end, a_end) if rows.at_end[b] else (v_mid, a_mid))
                size = rows.size[b]
                by = slopes.rows[k, :, row : row + size]
                by[:] = 0.0
                for t in range(rows.lengths[b]):
                    term = rows.terms[b, t]
                    own = coefficients[k, at : at + size]
                    if term == 1:
                        for i in range(size):
                            by[0, i] += own[i]
                    elif term == 2:
                        for i in range(size):
                            by[0, i] += 2 * own[i] * pv
                            by[3, i] += 2 * own[i]
                    elif term == 3:
                        for i in range(size):
                            by[0, i] += 3 * own[i] * pv * pv
                            by[3, i] += 6 * own[i] * pv
                    elif term == 4:
                        for i in range(size):
                            by[1, i] += own[i]
                    elif term == 5:
                        for i in range(size):
                            by[0, i] += own[i] * pa
                            by[1, i] += own[i] * pv
                            by[4, i] += own[i]
                    elif term == 6:
                        for i in range(size):
                            by[2, i] += own[i]
                    at += size
                row += size
