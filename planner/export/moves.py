"""A motion as moves from point to point, for formats whose positions are relative: no rounding adds up."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array
from planner.export.columns import Columns
from planner.export.format import ExportSource
from planner.export.knots import Knots, rows_at


def make_moves(columns: Columns, source: ExportSource, knots: Knots) -> Iterator[tuple[NDArray[np.int64], Array]]:
    """Durations (K,) of segments in steps, and their moves and end speeds (2, K, axes), in blocks.

    Both in whole units of the last decimal. A move leads from rounded point to rounded point, so the sum of any number
    of moves is off by no more than one of them.
    """
    at = None
    for steps, units in columns.blocks(source, knots, 2, rest=True):
        position = units[0] if at is None else np.concatenate([at, units[0]])
        skipped = int(at is None)  # the first point of all is where the axes stand
        at = position[-1:]
        if len(steps) > skipped:
            yield steps[skipped:], np.stack([np.diff(position, axis=0), units[1, skipped:]]) + 0.0


def sum_moves(
    columns: Columns, source: ExportSource, decoded: Iterable[tuple[Array, Array]]
) -> Iterator[tuple[Array, Array]]:
    """Where the moves of a file lead from the start of the motion, at rest: what `roundtrip.compare` takes.

    decoded  in blocks: durations (K,) s, and moves and end speeds (2, K, axes) in the units of the file
    """
    t = 0.0
    stated = rows_at(source.counted, np.zeros(1), 2)
    stated[1] = 0.0
    yield np.zeros(1), stated
    for lasting, numbers in decoded:
        when = t + np.cumsum(lasting)
        t = float(when[-1])
        way, rate = numbers / columns.factor
        stated = np.stack([stated[0, -1] + np.cumsum(way, 0), rate])
        yield when, stated
