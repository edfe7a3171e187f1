"""The largest block of cells of a grid that all have a property."""

from collections.abc import Sequence

import numpy as np


def largest_block(
    solid: np.ndarray, sides: Sequence[float], holding: tuple[int, int, int] | None = None
) -> tuple[tuple[int, int, int], tuple[int, int, int]] | None:
    """First and end cell of the largest block of a grid (a, b, c) that is all true; `holding` a cell, or any.

    For every width and depth, the places where a block of that base is true, then the longest run of them upwards.
    """
    best, found = 0.0, None
    wide_solid = solid
    for wide in range(1, solid.shape[0] + 1):
        wide_solid = solid if wide == 1 else wide_solid[:-1] & solid[wide - 1 :]
        base = wide_solid
        for deep in range(1, solid.shape[1] + 1):
            base = wide_solid if deep == 1 else base[:, :-1] & wide_solid[:, deep - 1 :]
            if not base.any():
                break
            start, length = _longest_runs(base, None if holding is None else holding[2])
            if holding is not None:  # only blocks that begin at the cell or before, and reach it
                reach = np.zeros(length.shape, bool)
                i, j = holding[:2]
                reach[max(0, i - wide + 1) : i + 1, max(0, j - deep + 1) : j + 1] = True
                length = np.where(reach, length, 0)
            i, j = (int(n) for n in np.unravel_index(int(np.argmax(length)), length.shape))
            size = wide * deep * int(length[i, j]) * float(np.prod(sides))
            if size > best:
                first = int(start[i, j])
                best, found = size, ((i, j, first), (i + wide, j + deep, first + int(length[i, j])))
    return found


def _longest_runs(solid: np.ndarray, through: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Start and length (a, b) of the longest run of true along the last axis, or of the one through an index."""
    number = np.arange(1, solid.shape[2] + 1)
    run = number - np.maximum.accumulate(np.where(solid, 0, number), 2)
    if through is None:
        last = run.argmax(2)
        length = np.take_along_axis(run, last[..., None], 2)[..., 0]
        return last + 1 - length, length
    broken = ~solid[:, :, through:]
    ahead = np.where(broken.any(2), broken.argmax(2), broken.shape[2])
    back = run[:, :, through]
    return through + 1 - back, np.where(back > 0, back + ahead - 1, 0)
