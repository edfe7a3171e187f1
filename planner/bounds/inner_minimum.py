"""Multipliers of the rows at one place, where those of the dual problem prove no lower bound.

For a given a = ṡ², the inner minimum of the bound is a linear program in b and c:

    minimise e_b b + e_c c
    such that  −A₋ ≤ q′b + q″a ≤ A₊  and  −J₋/√a ≤ q′c + 3q″b + q‴a ≤ J₊/√a.

For a given b the best c is at the jerk row that binds first. So the program minimises a convex,
piecewise linear function of b. A penalty replaces rows that cannot be met. At the minimum a convex
combination of the two adjacent lines has slope 0, and its multipliers solve the program. The
multipliers of several a near the motion's each serve one part of the range of a
(planner.bounds.lower_bound).
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.kernels import Floats1, Floats2, Ints1, kernel
from planner.bounds.lower_bound import RowCells, Trial, copy_to

# Values of a whose programs are solved, relative to the motion's a.
NEAR = np.array(
    [0.02, 0.15, 0.4, 0.7, 0.85, 0.93, 0.98, 0.995, 1.005, 1.02, 1.07, 1.2, 1.5, 2.5],
)
# Penalty of a violated row, relative to the worth of the motion's rows.
PENALTY = 3.0
# Iterations of the search for the minimum: the best two lines serve if it is reached.
MOST_LINES = 40


class InnerProgram(NamedTuple):
    """Linear program at one place, for one a.

    q (3, n)          q′, q″, q‴
    acceleration, jerk (2, n)  bounds towards greater and smaller values
    e (2,)            e_b, e_c
    penalty (2,)      cost of violated acceleration and jerk rows, per unit of b and of c
    """

    q: Floats2
    acceleration: Floats2
    jerk: Floats2
    a: float
    e: Floats1
    penalty: Floats1


@kernel
def draw_line(
    program: InnerProgram,
    b: float,
    out: Floats2,
) -> tuple[float, float]:
    """Return value and slope of the function at b. Fill out (2, n) with the multipliers there."""
    q, acceleration, jerk, a, e, penalty = program
    out[:] = 0.0
    root = 1 / np.sqrt(a)
    low = -np.inf
    high = np.inf
    below = above = -1
    worst = 0.0
    violated = -1
    sign = 0.0
    for i in range(q.shape[1]):
        first = q[0, i]
        if first == 0.0:
            continue
        # c between the jerk rows of this axis
        rest = q[2, i] * a + 3 * q[1, i] * b
        one = (jerk[0, i] * root - rest) / first
        other = (-jerk[1, i] * root - rest) / first
        if max(one, other) < high:
            high = max(one, other)
            above = i
        if min(one, other) > low:
            low = min(one, other)
            below = i
        # b between its acceleration rows
        one = (acceleration[0, i] - q[1, i] * a) / first
        other = (-acceleration[1, i] - q[1, i] * a) / first
        if b - max(one, other) > worst:
            worst = b - max(one, other)
            violated = i
            sign = 1.0
        if min(one, other) - b > worst:
            worst = min(one, other) - b
            violated = i
            sign = -1.0

    value = e[0] * b
    slope = e[0]
    if e[1] != 0.0:
        binding = below if e[1] > 0 else above
        value += e[1] * (low if e[1] > 0 else high)
        slope -= e[1] * 3 * q[1, binding] / q[0, binding]
        out[1, binding] -= e[1] / q[0, binding]
    if low > high:
        value += penalty[1] * (low - high)
        slope -= penalty[1] * 3 * (q[1, below] / q[0, below] - q[1, above] / q[0, above])
        out[1, below] -= penalty[1] / q[0, below]
        out[1, above] += penalty[1] / q[0, above]
    if violated >= 0:
        value += penalty[0] * worst
        slope += sign * penalty[0]
        out[0, violated] += sign * penalty[0] / q[0, violated]
    return value, slope


@kernel
def solve_inner(program: InnerProgram, reach: float, out: Floats2) -> None:
    """Fill out (2, n) with the multipliers of the minimum over |b| ≤ reach."""
    left = np.zeros(out.shape)
    right = np.zeros(out.shape)
    tried = np.zeros(out.shape)
    at_left = -reach
    at_right = reach
    low, fall = draw_line(program, at_left, left)
    high, rise = draw_line(program, at_right, right)
    for _ in range(MOST_LINES):
        if fall >= 0:
            copy_to(left, out)
            return
        if rise <= 0:
            copy_to(right, out)
            return
        # the intersection of both lines is a lower bound of the minimum
        at = (high - low + fall * at_left - rise * at_right) / (fall - rise)
        expected = low + fall * (at - at_left)
        value, slope = draw_line(program, at, tried)
        if value <= expected + 1e-9 * (abs(value) + abs(expected)):
            break
        if slope < 0:
            at_left, low, fall = at, value, slope
            copy_to(tried, left)
        else:
            at_right, high, rise = at, value, slope
            copy_to(tried, right)
    share = rise / (rise - fall)
    for m in range(2):
        for i in range(out.shape[1]):
            out[m, i] = share * left[m, i] + (1 - share) * right[m, i]


@kernel
def fill_sets(rows: RowCells, trial: Trial, chosen: Ints1) -> None:
    """Fill all sets of the chosen cells but the first, each for one of the values of a."""
    e = np.zeros(2)
    penalty = np.zeros(2)
    acceleration = rows.acceleration
    for k in chosen:
        slope = (trial.nodes[k + 1, 1] - trial.nodes[k, 1]) / rows.width[k]
        for side in range(2):
            q = rows.ends[k, side]
            first = trial.rows[k, 0, side]
            e[0] = 2 * trial.nodes[k + side, 0] + slope + (1.0 - 2.0 * side) * trial.bulge[k]
            e[1] = trial.nodes[k + side, 1]
            penalty[0] = abs(e[0])
            penalty[1] = abs(e[1])
            for i in range(q.shape[1]):
                penalty[0] += abs(first[0, i] * q[0, i]) + 3 * abs(first[1, i] * q[1, i])
                penalty[1] += abs(first[1, i] * q[0, i])
            penalty[0] *= PENALTY
            penalty[1] *= PENALTY
            for n in range(NEAR.size):
                a = NEAR[n] * trial.about[k]
                reach = np.inf
                for i in range(q.shape[1]):
                    if q[0, i] != 0.0:
                        most = max(acceleration[0, i], acceleration[1, i]) + abs(q[1, i]) * a
                        reach = min(reach, most / abs(q[0, i]))
                program = InnerProgram(q, acceleration, rows.jerk, a, e, penalty)
                solve_inner(program, 2 * reach, trial.rows[k, n + 1, side])
                # the speed row pays above the motion's a only
                share = 0.0 if NEAR[n] < 0.9 else (1.0 if NEAR[n] < 1.03 else 2.0)
                trial.speed[k, n + 1, side, 0] = share * trial.speed[k, 0, side, 0]
