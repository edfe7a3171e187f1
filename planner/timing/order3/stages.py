"""Stages of the order-3 problem: dynamics, rows, objective and their derivatives.

A stage is one interval of the grid, from the state (v, a) = (ṡ, s̈) at its start with the controls
(j, h): constant s⃛ for a duration. With x = (v, a, j, h),

    v⁺ = v + a h + j h²/2     a⁺ = a + j h     Δs = v h + a h²/2 + j h³/6

A row is a sum of terms at the start of a stage, and at its end (rows with s⃛, which steps there) or
in its middle.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.kernels import Flags1, Floats1, Floats2, Floats4, Ints1, Ints2, kernel

START, MIDDLE, END, WHOLE = range(4)
"""Places of a stage at which rows apply; WHOLE: the bound of its duration."""
PLACE_COUNT = 4
TERM_COUNT = 7
"""Number of terms, in the order of planner.limits.limit.Term: 1, v, v², v³, a, va, j."""


class Rows(NamedTuple):
    """Rows low ≤ Σ coefficient · term ≤ high of N stages: M at the starts, M at the second places.

    terms (B, 7)       numbers of the terms of each block
    lengths (B,)       number of its terms
    size (B,)          number of its rows
    at_end (B,)        whether its second place is the end, not the middle
    first (N, C)       coefficients at the starts, ordered by block, row and term
    second (N, C)      coefficients at the second places
    low (N, 2M + 2)    lower bounds, −∞ for none; the last two columns bound v and h / duration
    high (N, 2M + 2)   upper bounds, ∞ for none
    """

    terms: Ints2
    lengths: Ints1
    size: Ints1
    at_end: Flags1
    first: Floats2
    second: Floats2
    low: Floats2
    high: Floats2


class Stages(NamedTuple):
    """Dynamics and objective of N stages.

    The objective is Σ h + Σ jerk_weight j² + ∫ Σ r² dt − start_reward · v₀, without Σ h if the time
    is fixed, where

        r = r₀ j + r₁ va + r₂ v³ + r₃ a + r₄ v²

    is taken at both ends of each stage, with half of the weight each.

    step (N,)          Δs
    scale (3,)         typical v, a and j
    duration (N,)      typical h
    free_start         whether the first a is a variable
    free_end           whether the last a is a variable
    start_reward       0: the first v is given
    fixed_time         whether Σ h = 1 is a constraint
    jerk_weight (N,)
    squares (N, 2, A, 5)  coefficients of r at start and end of each stage
    objective_scale    factor of the objective in the optimality conditions
    """

    step: Floats1
    scale: Floats1
    duration: Floats1
    free_start: bool
    free_end: bool
    start_reward: float
    fixed_time: bool
    jerk_weight: Floats1
    squares: Floats4
    objective_scale: float


@kernel
def get_stage(states: Floats2, controls: Floats2, k: int) -> tuple[float, float, float, float]:
    """Return v, a, j, h of stage k."""
    return states[k, 0], states[k, 1], controls[k, 0], controls[k, 1]


@kernel
def advance(v: float, a: float, j: float, h: float) -> tuple[float, float]:
    """Return (v, a) after h with constant j."""
    return v + h * (a + h * j / 2), a + h * j


@kernel
def differentiate_place(
    place: int,
    a: float,
    j: float,
    h: float,
) -> tuple[float, float, float, float]:
    """Return derivatives at a place: t = ∂v/∂a = ∂a/∂j, t²/2 = ∂v/∂j, ∂v/∂h and ∂a/∂h."""
    share = 0.0 if place == START else (0.5 if place == MIDDLE else 1.0)
    t = share * h
    return t, t * t / 2, share * (a + t * j), share * j


@kernel
def add_hessian(
    place: tuple[float, float, float, float],
    curvature: tuple[float, float, float, float, float, float],
    out: Floats2,
) -> None:
    """Add second derivatives by x to the upper half of out (4, 4).

    place      of `differentiate_place`
    curvature  second derivatives by v, a, j there: vv, va, vj, aa, aj, jj
    """
    t, half_square, v_h, a_h = place
    vv, va, vj, aa, aj, jj = curvature
    # first index by x, second by (v, a, j) at the place
    a_v = t * vv + va
    a_a = t * va + aa
    j_v = half_square * vv + t * va + vj
    j_a = half_square * va + t * aa + aj
    j_j = half_square * vj + t * aj + jj
    h_v = v_h * vv + a_h * va
    h_a = v_h * va + a_h * aa
    h_j = v_h * vj + a_h * aj
    out[0, 0] += vv
    out[0, 1] += a_v
    out[0, 2] += j_v
    out[0, 3] += h_v
    out[1, 1] += t * a_v + a_a
    out[1, 2] += t * j_v + j_a
    out[1, 3] += t * h_v + h_a
    out[2, 2] += half_square * j_v + t * j_a + j_j
    out[2, 3] += half_square * h_v + t * h_a + h_j
    out[3, 3] += v_h * h_v + a_h * h_a


@kernel
def evaluate(stages: Stages, rows: Rows, states: Floats2, controls: Floats2, out: Floats2) -> None:
    """Fill out (N, 2M + 2) with the values of all rows."""
    last = out.shape[1] - 1
    half_width = out.shape[1] // 2 - 1
    terms = np.empty((3, TERM_COUNT))
    for k in range(len(stages.step)):
        v, a, j, h = get_stage(states, controls, k)
        for place in range(3):
            _fill_terms(v, a, j, h * place / 2, terms[place])
        for half in range(2):
            coefficients = rows.first if half == 0 else rows.second
            at = 0
            row = half * half_width
            for b in range(len(rows.size)):
                here = terms[START if half == 0 else (END if rows.at_end[b] else MIDDLE)]
                numbers = rows.terms[b]
                length = rows.lengths[b]
                first = here[numbers[0]]
                second = here[numbers[1]]
                third = here[numbers[2]]
                # three terms without a loop take half of the time
                for i in range(rows.size[b]):
                    value = coefficients[k, at] * first
                    if length > 1:
                        value += coefficients[k, at + 1] * second
                    if length > 2:
                        value += coefficients[k, at + 2] * third
                    for t in range(3, length):
                        value += coefficients[k, at + t] * here[numbers[t]]
                    out[k, row + i] = value
                    at += length
                row += rows.size[b]
        out[k, last - 1] = v
        out[k, last] = h / stages.duration[k]


@kernel
def _fill_terms(v: float, a: float, j: float, h: float, out: Floats1) -> None:
    v, a = advance(v, a, j, h)
    out[0] = 1.0
    out[1] = v
    out[2] = v * v
    out[3] = v * v * v
    out[4] = a
    out[5] = v * a
    out[6] = j


@kernel
def sum_costs(stages: Stages, states: Floats2, controls: Floats2) -> float:
    """Return the objective, not scaled."""
    total = 0.0 if stages.fixed_time else -stages.start_reward * states[0, 0]
    squares = stages.squares
    for k in range(len(stages.step)):
        v, a, j, h = get_stage(states, controls, k)
        if not stages.fixed_time:
            total += h + stages.jerk_weight[k] * j * j
        for end in range(2 if squares.shape[2] > 0 else 0):
            v_end, a_end = advance(v, a, j, h * end)
            for i in range(squares.shape[2]):
                r = evaluate_square(squares[k, end, i], v_end, a_end, j)
                total += h / 2 * r * r
    return total


@kernel
def evaluate_square(coefficients: Floats1, v: float, a: float, j: float) -> float:
    """Return r of the objective's ∫ r² dt."""
    value: float = coefficients[0] * j + (coefficients[1] * a + coefficients[2] * v * v) * v
    value += coefficients[3] * a + coefficients[4] * v * v
    return value
