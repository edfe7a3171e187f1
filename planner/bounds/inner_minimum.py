"""Multipliers of the rows at one place for the lower bound, where those of the dual problem alone prove nothing.

For given a = ṡ², what is left of the bound's inner minimum is a linear programme in b and c:

    minimise e_b b + e_c c  such that  −A₋ ≤ q′b + q″a ≤ A₊  and  −J₋/√a ≤ q′c + 3q″b + q‴a ≤ J₊/√a.

For given b the best c is at the jerk row that binds first, so it is the least of a convex function of b that is linear
in pieces; rows that are exceeded cost so much that they are not, where they can be kept. Of two lines that meet at the
least a mean is flat: its rows' multipliers are those of the programme. About some a's near the motion's, they serve one
part of the range of a each (planner.bounds.lower_bound).
"""

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel
from planner.bounds.lower_bound import RowCells, Trial

# Of a near which the motion's is, those whose programmes are solved, and how much more than what the motion's rows are
# worth it costs to exceed a row.
NEAR = np.array([0.02, 0.15, 0.4, 0.7, 0.85, 0.93, 0.98, 0.995, 1.005, 1.02, 1.07, 1.2, 1.5, 2.5])
PENALTY, MOST_LINES = 3.0, 40


@kernel
def draw_line(
    q: Array, acceleration: Array, jerk: Array, a: float, b: float, e: Array, penalty: Array, out: Array
) -> tuple[float, float]:
    """Value and slope of the function at b, and the rows' multipliers (2, n) that make it up there.

    e (2,): e_b, e_c; penalty (2,): of exceeding acceleration and jerk rows, by b and by c.
    """
    n = q.shape[1]
    out[:] = 0.0
    root = 1 / np.sqrt(a)
    low, high, below, above = -np.inf, np.inf, -1, -1
    value, slope = e[0] * b, e[0]
    for i in range(n):
        if q[0, i] == 0.0:
            continue
        side = 0 if q[0, i] > 0 else 1
        rest = q[2, i] * a + 3 * q[1, i] * b
        most = (jerk[0, i] * root - rest) / q[0, i] if side == 0 else (-jerk[1, i] * root - rest) / q[0, i]
        least = (-jerk[1, i] * root - rest) / q[0, i] if side == 0 else (jerk[0, i] * root - rest) / q[0, i]
        if most < high:
            high, above = most, i
        if least > low:
            low, below = least, i
    if e[1] != 0.0:
        own = below if e[1] > 0 else above
        value += e[1] * (low if e[1] > 0 else high)
        slope -= e[1] * 3 * q[1, own] / q[0, own]
        out[1, own] -= e[1] / q[0, own]
    if low > high:
        value += penalty[1] * (low - high)
        slope -= penalty[1] * 3 * (q[1, below] / q[0, below] - q[1, above] / q[0, above])
        out[1, below] -= penalty[1] / q[0, below]
        out[1, above] += penalty[1] / q[0, above]
    worst, where, sign = 0.0, -1, 0.0
    for i in range(n):
        if q[0, i] == 0.0:
            continue
        plus, minus = acceleration[0, i] - q[1, i] * a, -acceleration[1, i] - q[1, i] * a
        most, least = (plus / q[0, i], minus / q[0, i]) if q[0, i] > 0 else (minus / q[0, i], plus / q[0, i])
        if b - most > worst:
            worst, where, sign = b - most, i, 1.0
        if least - b > worst:
            worst, where, sign = least - b, i, -1.0
    if where >= 0:
        value += penalty[0] * worst
        slope += sign * penalty[0]
        out[0, where] += sign * penalty[0] / q[0, where]
    return value, slope


@kernel
def solve_inner(
    q: Array, acceleration: Array, jerk: Array, a: float, reach: float, e: Array, penalty: Array, out: Array
) -> None:
    """Fill out (2, n): multipliers for a; |b| ≤ reach is searched."""
    left, right, tried = np.zeros(out.shape), np.zeros(out.shape), np.zeros(out.shape)
    at_left, at_right = -reach, reach
    low, fall = draw_line(q, acceleration, jerk, a, at_left, e, penalty, left)
    high, rise = draw_line(q, acceleration, jerk, a, at_right, e, penalty, right)
    for _ in range(MOST_LINES):
        if fall >= 0:
            out[:] = left
            return
        if rise <= 0:
            out[:] = right
            return
        at = (high - low + fall * at_left - rise * at_right) / (fall - rise)
        expected = low + fall * (at - at_left)
        value, slope = draw_line(q, acceleration, jerk, a, at, e, penalty, tried)
        if value <= expected + 1e-9 * (abs(value) + abs(expected)):
            break
        if slope < 0:
            at_left, low, fall, left[:] = at, value, slope, tried
        else:
            at_right, high, rise, right[:] = at, value, slope, tried
    share = rise / (rise - fall)
    out[:] = share * left + (1 - share) * right


@kernel
def fill_sets(rows: RowCells, trial: Trial, chosen: np.ndarray) -> None:
    """Fill the sets of chosen cells from the second on, for a's near the motion's; the first is there."""
    e, penalty = np.zeros(2), np.zeros(2)
    acceleration, jerk, given = rows.acceleration, rows.jerk, trial.rows
    for k in chosen:
        slope = (trial.nodes[k + 1, 1] - trial.nodes[k, 1]) / rows.width[k]
        for side in range(2):
            q, first = rows.ends[k, side], given[k, 0, side]
            e[0] = 2 * trial.nodes[k + side, 0] + slope + (1.0 - 2.0 * side) * trial.bulge[k]
            e[1] = trial.nodes[k + side, 1]
            penalty[:] = np.abs(e)
            for i in range(q.shape[1]):
                penalty[0] += abs(first[0, i] * q[0, i]) + 3 * abs(first[1, i] * q[1, i])
                penalty[1] += abs(first[1, i] * q[0, i])
            for n in range(NEAR.size):
                a = NEAR[n] * trial.about[k]
                reach = np.inf
                for i in range(q.shape[1]):
                    if q[0, i] != 0.0:
                        most = max(acceleration[0, i], acceleration[1, i]) + abs(q[1, i]) * a
                        reach = min(reach, most / abs(q[0, i]))
                solve_inner(q, acceleration, jerk, a, 2 * reach, e, PENALTY * penalty, given[k, n + 1, side])
                share = 0.0 if NEAR[n] < 0.9 else (1.0 if NEAR[n] < 1.03 else 2.0)
                trial.speed[k, n + 1, side] = share * trial.speed[k, 0, side]
