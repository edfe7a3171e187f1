"""The lower bound of the cell next to a rest, in closed form: docs/theory/lower_bound.md, "Beside rests".

The integrand of `planner.bounds.lower_bound` has no bound that is good all over that cell.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from planner.bounds.lower_bound import ROUNDINGS, RowCells


class RestDeparture(NamedTuple):
    """How n axes may leave rest in a run's first cell, or come to it in the last, looked at back in time.

    An axis that does not turn in the cell goes by X there, with ẍ ≤ A and x⃛ ≤ J. So it surely takes T, and leaves the
    cell with no more than full acceleration, or full jerk, give it on X:

        T ≥ √(2X/A), ẋ² ≤ 2AX;  T ≥ ∛(6X/J), ẋ² ≤ (3/2) ∛(6J²X⁴), ẍ ≤ ∛(6J²X).

    moves (n,): of which that is known; time, square, speedup (n,): T, ẋ², ẍ; against (n,): most of −ẍ
    slope, bend (2, n): x′ and x″ at the inner end, at least and at most
    """

    moves: np.ndarray
    time: Array
    square: Array
    speedup: Array
    against: Array
    slope: Array
    bend: Array


def leave_rest(rows: RowCells, side: int, still: int) -> RestDeparture:
    """Return how rest is left in the first cell (side 0) or the last.

    still: how many of the path's first derivatives are 0 at its outer end
    """
    k, out, sign = (0, 1, 1.0) if side == 0 else (-1, 0, -1.0)
    h, q, off = rows.width[k], rows.ends[k], rows.off[k]
    away = np.sign(sign * q[out, 0])
    # the first derivative by the way from the rest that is not 0, as its chord, and what follows for those before it
    first, last = (away * sign ** (still + 1) * q[end, still] for end in (1 - out, out))
    error = off[still]
    x1, x2 = away * sign * q[out, 0], away * q[out, 1]
    if still == 0:
        way, bend = h * np.stack([(first + last) / 2, error]), np.stack([x2, off[1]])
        slope = np.stack([x1, off[0]])
    else:
        steep = h * np.stack([(first + last) / 2, error])
        slope, bend = steep, np.stack([x2, off[1]])
        way = h**2 * np.stack([(2 * first + last) / 6, error / 2])
        if still == 2:
            slope, bend = way, steep
            way = h**3 * np.stack([(3 * first + last) / 24, error / 6])
    way, slope, bend = (np.stack([middle - rest, middle + rest]) for middle, rest in (way, slope, bend))
    onward = np.where(away > 0, rows.acceleration[0], rows.acceleration[1])
    against = np.where(away > 0, rows.acceleration[1], rows.acceleration[0])
    jerk = np.where(sign * away > 0, rows.jerk[0], rows.jerk[1])  # back in time it has the other sign
    moves = (np.minimum(first, last) > error) & (way[0] > 0) & (slope[0] > 0)
    with np.errstate(invalid="ignore", over="ignore"):
        return RestDeparture(
            moves,
            np.maximum(np.sqrt(2 * way[0] / onward), np.cbrt(6 * way[0] / jerk)),
            np.minimum(2 * onward * way[1], 1.5 * np.cbrt(6 * jerk**2 * way[1] ** 4)),
            np.minimum(onward, np.cbrt(6 * jerk**2 * way[1])),
            against,
            slope,
            bend,
        )


def bound_rest(leaving: RestDeparture, side: int, inner: Array) -> float:
    """Return the least time of the cell (s) with the terms of λ (2,) of its inner node; −∞ where nothing is proved."""
    by_a, by_b = (1 - 2 * side) * inner[0], inner[1]
    low = leaving.slope[0]
    with np.errstate(all="ignore"):
        # λa a + λb b in ẋ² = x′²a and ẍ = x′b + x″a
        turned = by_b * np.stack([bend / slope for bend in leaving.bend for slope in leaving.slope])
        of_square = np.minimum(by_a - turned.max(0), 0.0) / low**2
        end = by_b / low * (leaving.speedup if by_b < 0 else -leaving.against) if by_b != 0 else 0.0 * low
        size = leaving.time + np.abs(end) + (abs(by_a) + np.abs(turned).max(0)) / low**2 * leaving.square
        values = leaving.time + of_square * leaving.square + end - ROUNDINGS * size
    return float(np.where(leaving.moves & np.isfinite(values), values, -np.inf).max())
