"""Active constraints: the inequalities near which a motion is, of all that it must satisfy.

A row with two bounds is two inequalities, Σ coefficient · term ≤ bound. Most are far from their
bounds nearly everywhere: of six axes, one or two limit a motion at a time. An inactive constraint
costs as much time as an active one and changes nothing, so it is left out until the motion comes
near it (constraint reduction: A. L. Tits, P.-A. Absil and W. P. Woessner, SIAM Journal on
Optimization 17 (2006) 119–146). Every solution is checked against all rows.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import Flags3, Floats1, Floats2, Ints1, Ints2, kernel
from planner.timing.order3.stages import END, PLACE_COUNT, START, TERM_COUNT, WHOLE, Rows

# Distance to its bound up to which a constraint is activated, where the whole range is about 1. A
# smaller one makes iterations cheaper, and activations, which interrupt the method, more frequent.
NEAR = 0.5


class ActiveSet(NamedTuple):
    """K active constraints, ordered by stage and place.

    begin (N, 5)          index of the first at each place of each stage, and of the next stage
    coefficients (K, 7)   of the terms at that place; at WHOLE, entry 1 is that of h / duration
    bound (K,)
    flat (K,)             index in a flat (2, N, 2M + 2): lower and upper bounds of all rows
    """

    begin: Ints2
    coefficients: Floats2
    bound: Floats1
    flat: Ints1


def activate_near(mask: np.ndarray, room: Array, reach: int) -> None:
    """Add constraints with little room to a mask (2, N, 2M + 2), on `reach` stages around too."""
    near = (room <= NEAR) & ~mask
    mask |= near
    for by in range(1, min(reach, room.shape[1] - 1) + 1):
        mask[:, by:] |= near[:, :-by]
        mask[:, :-by] |= near[:, by:]
    mask &= room < np.inf


def collect_active(rows: Rows, mask: np.ndarray) -> ActiveSet:
    """Return the constraints that a mask (2, N, 2M + 2) selects."""
    size = int(mask.sum())
    begin = np.zeros((len(rows.low), PLACE_COUNT + 1), int)
    active = ActiveSet(begin, np.zeros((size, TERM_COUNT)), np.empty(size), np.empty(size, int))
    _fill_active(rows, mask, active)
    set_bounds(active, rows)
    return active


def set_bounds(active: ActiveSet, rows: Rows) -> None:
    """Set the bounds of active constraints to those of the rows."""
    active.bound[:] = np.concatenate([-rows.low.ravel(), rows.high.ravel()])[active.flat]


def find_common(few: ActiveSet, many: ActiveSet, total: int) -> np.ndarray:
    """Return the positions (K,) in `many` of the constraints in `few`; total: length of a mask."""
    position = np.empty(total, np.int64)
    position[many.flat] = np.arange(len(many.flat))
    return np.asarray(position[few.flat])


@kernel
def _fill_active(rows: Rows, mask: Flags3, active: ActiveSet) -> None:
    """Fill all of the active set except the bounds."""
    count, width = rows.low.shape
    n = 0
    for k in range(count):
        for place in range(PLACE_COUNT):
            active.begin[k, place] = n
            column = width - 2 if place == START else width - 1
            if place in (START, WHOLE):
                for side in range(2):
                    if mask[side, k, column]:
                        active.flat[n] = (side * count + k) * width + column
                        active.coefficients[n, 1] = 2.0 * side - 1.0
                        n += 1
            if place == WHOLE:
                continue
            coefficients = rows.first if place == START else rows.second
            at = 0
            column = 0 if place == START else width // 2 - 1
            for b in range(len(rows.size)):
                length = rows.lengths[b]
                applies = place == START or (place == END) == rows.at_end[b]
                for i in range(rows.size[b] if applies else 0):
                    for side in range(2):
                        if mask[side, k, column + i]:
                            active.flat[n] = (side * count + k) * width + column + i
                            for t in range(length):
                                value = coefficients[k, at + i * length + t]
                                sign = 2.0 * side - 1.0
                                active.coefficients[n, rows.terms[b, t]] = sign * value
                            n += 1
                at += length * rows.size[b]
                column += rows.size[b]
        active.begin[k, PLACE_COUNT] = n
