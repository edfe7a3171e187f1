"""Lower bound of a cell next to a rest, in closed form: docs/theory/lower_bound.md, "Next to
rests".

There the integrand of `planner.bounds.lower_bound` has no good bound.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from planner.bounds.lower_bound import ROUNDINGS, RowCells


class RestDeparture(NamedTuple):
    """Motion of n axes from rest in the first cell of a run, or reversed to rest in the last.

    An axis that does not turn moves by X in the cell, with ẍ ≤ A and x⃛ ≤ J. Full acceleration and
    full jerk bound its time T in the cell and its state at the inner end:

        T ≥ √(2X/A), ẋ² ≤ 2AX;  T ≥ ∛(6X/J), ẋ² ≤ (3/2) ∛(6J²X⁴), ẍ ≤ ∛(6J²X).

    moves (n,)    whether the axis surely moves without a turn
    time, square, speedup (n,)  bounds of T, ẋ², ẍ
    against (n,)  bound of −ẍ
    slope, curvature (2, n)     least and greatest x′ and x″ at the inner end
    """

    moves: np.ndarray
    time: Array
    square: Array
    speedup: Array
    against: Array
    slope: Array
    curvature: Array


def leave_rest(rows: RowCells, side: int, still: int) -> RestDeparture:
    """Return the motion from rest in the first cell (side 0) or to rest in the last.

    still: how many of the path's first derivatives are 0 at the outer end
    """
    h = rows.width[-side]
    q = rows.ends[-side]
    off = rows.off[-side]
    jerk = rows.jerk
    if side == 1:  # reversed in time, along the path reversed
        q = q[::-1] * np.array([[-1.0], [1.0], [-1.0]])
        jerk = jerk[::-1]
    away = np.sign(q[1, 0])
    q = away * q
    # the chord of the first nonzero derivative at the rest gives the lower ones by integration
    first, last = q[:, still]
    error = off[still]
    slope = np.stack([q[1, 0], off[0]])
    curvature = np.stack([q[1, 1], off[1]])
    mean = h * np.stack([(first + last) / 2, error])
    way = mean
    if still > 0:
        slope = mean
        way = h**2 * np.stack([(2 * first + last) / 6, error / 2])
    if still == 2:
        curvature = mean
        slope = way
        way = h**3 * np.stack([(3 * first + last) / 24, error / 6])
    pairs = (way, slope, curvature)
    way, slope, curvature = (np.stack([middle - rad, middle + rad]) for middle, rad in pairs)
    up, down = rows.acceleration
    onward = np.where(away > 0, up, down)
    against = np.where(away > 0, down, up)
    jerk = np.where(away > 0, jerk[0], jerk[1])
    with np.errstate(invalid="ignore", over="ignore"):
        by_acceleration = np.sqrt(2 * way[0] / onward)
        by_jerk = np.cbrt(6 * way[0] / jerk)
        moves = np.minimum(first, last) > error
        return RestDeparture(
            moves=moves & (way[0] > 0) & (slope[0] > 0),
            time=np.maximum(by_acceleration, by_jerk),
            square=np.minimum(
                2 * onward * way[1],
                1.5 * np.cbrt(6 * jerk**2 * way[1] ** 4),
            ),
            speedup=np.minimum(onward, np.cbrt(6 * jerk**2 * way[1])),
            against=against,
            slope=slope,
            curvature=curvature,
        )


def bound_rest(leaving: RestDeparture, side: int, inner: Array) -> float:
    """Return the proved least time (s) with the terms of λ (2,) at the inner node, or −∞."""
    by_a = (1 - 2 * side) * inner[0]
    by_b = inner[1]
    low = leaving.slope[0]
    with np.errstate(all="ignore"):
        # λa a + λb b in ẋ² = x′²a and ẍ = x′b + x″a
        ratios = [curvature / slope for curvature in leaving.curvature for slope in leaving.slope]
        turned = by_b * np.stack(ratios)
        of_square = np.minimum(by_a - turned.max(0), 0.0) / low**2
        end = np.zeros_like(low)
        if by_b != 0:
            end = by_b / low * (leaving.speedup if by_b < 0 else -leaving.against)
        size = abs(by_a) + np.abs(turned).max(0)
        size = size / low**2 * leaving.square + leaving.time + np.abs(end)
        values = leaving.time + of_square * leaving.square + end - ROUNDINGS * size
    proved = leaving.moves & np.isfinite(values)
    return float(values[proved].max(initial=-np.inf))
