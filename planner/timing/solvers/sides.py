"""The sides of rows that an order-3 solve holds: those that its motion comes near, of all that it must keep.

A row with two bounds is two sides, Σ coefficient · term ≤ bound. Most are far from it nearly everywhere: of six axes,
one or two hold a motion back at a time. What is far costs a solve as much as what is near and changes nothing, so that
it is left out until the motion comes near: see constraint reduction in A. L. Tits, P.-A. Absil and W. P. Woessner, SIAM
Journal on Optimization 17 (2006) 119–146. Nothing is left out of what is checked: `evaluate` goes over all rows.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel
from planner.timing.solvers.stages import END, OWN, PLACE_COUNT, START, TERM_COUNT, StageRows

NEAR = 0.5
"""Room of a side up to which it is held, where all that a limit gives is about 1."""


class Sides(NamedTuple):
    """K sides, in the order of stages and of their places.

    begin (4 N + 1,)      first of each place of each stage: start, middle, end, and the stage itself, whose h is bound
    coefficients (K, 7)   of the terms at that place, in the order of planner.limits.limit.Term; of h / duration at the
                          stage itself, where that of ṡ would be
    bound (K,)
    which (K,)            in `held` (2, N, 2M + 2), counted along its rows
    """

    begin: np.ndarray
    coefficients: Array
    bound: Array
    which: np.ndarray


def hold_near(held: np.ndarray, room: Array, reach: int) -> None:
    """Add to the sides that are held (2, N, 2M + 2) those that a motion with so much room is near: there, and so many
    stages before and behind, as it may yet change.
    """
    near = (room <= NEAR) & ~held
    held |= near
    for by in range(1, min(reach, room.shape[1] - 1) + 1):
        held[:, by:] |= near[:, :-by]
        held[:, :-by] |= near[:, by:]
    held &= room < np.inf


def hold_sides(rows: StageRows, held: np.ndarray) -> Sides:
    """Of rows, those sides that are held (2, N, 2M + 2)."""
    count, size = len(rows.low), int(held.sum())
    sides = Sides(
        np.zeros(PLACE_COUNT * count + 1, int), np.zeros((size, TERM_COUNT)), np.empty(size), np.empty(size, int)
    )
    _list_sides(rows, held, sides)
    return sides


def list_bounds(rows: StageRows) -> Array:
    """What each side is held below: of all (2, N, 2M + 2), along their rows."""
    return np.concatenate([-rows.low.ravel(), rows.high.ravel()])


def find_same(some: Sides, more: Sides, count: int) -> np.ndarray:
    """(K,) where each of some sides is among more, of so many in all."""
    where = np.empty(count, np.int64)
    where[more.which] = np.arange(len(more.which))
    return np.asarray(where[some.which])


@kernel
def _list_sides(rows: StageRows, held: np.ndarray, sides: Sides) -> None:
    count, width = rows.low.shape
    n = 0
    for k in range(count):
        for place in range(PLACE_COUNT):
            sides.begin[PLACE_COUNT * k + place] = n
            if place in (START, OWN):
                column = width - 2 if place == START else width - 1
                for side in range(2):
                    if held[side, k, column]:
                        sides.coefficients[n, 1] = _list_side(rows, side, k, column, n, sides)
                        n += 1
            if place == OWN:
                continue
            coefficients = rows.first if place == START else rows.second
            at, first = 0, 0 if place == START else width // 2 - 1
            for b in range(len(rows.size)):
                length = rows.lengths[b]
                if place == START or (place == END) == rows.at_end[b]:
                    for i in range(rows.size[b]):
                        for side in range(2):
                            if held[side, k, first + i]:
                                sign = _list_side(rows, side, k, first + i, n, sides)
                                for t in range(length):
                                    term = rows.terms[b, t]
                                    sides.coefficients[n, term] = sign * coefficients[k, at + i * length + t]
                                n += 1
                at += length * rows.size[b]
                first += rows.size[b]
    sides.begin[PLACE_COUNT * count] = n


@kernel
def _list_side(rows: StageRows, side: int, k: int, column: int, n: int, sides: Sides) -> float:
    """List a side as the n-th, and return the sign that its coefficients take."""
    count, width = rows.low.shape
    sides.which[n] = (side * count + k) * width + column
    sides.bound[n] = -rows.low[k, column] if side == 0 else rows.high[k, column]
    return -1.0 if side == 0 else 1.0
