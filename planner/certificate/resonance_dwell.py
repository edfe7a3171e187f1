"""Dwell of an axis in a band of speed: proved over continuous time.

Over each cell of time q̇ is enclosed. A cell is outside a band, inside, or undecided; undecided
ones are halved until they are short. A stay is as long as the consecutive cells that are not
outside: an upper bound.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from kinematics.foundation.arrays import Array
from planner.certificate.cells import (
    Cells,
    Values,
    find_sequences,
    refine,
)
from planner.certificate.enclosure import enclose
from planner.limits.resonance import Band, Resonance
from planner.trajectory import Trajectory

# Least cell as a share of the shortest time allowed in a band: a stay whose
# ends cross the edges of the band is over-estimated by two of them at most.
MIN_CELL_SHARE = 5e-4
# Order of the series in time.
EXPANSION = 6
# The most cells of one round.
MAX_CELLS = 400_000


@dataclass(frozen=True, slots=True)
class Stay:
    """From start to end (s) an axis may be in a band.

    first, last  time pieces of the trajectory
    inside       longest time (s) in the band, without a break, that is certain
    """

    band: Band
    start: float
    end: float
    first: int
    last: int
    inside: float

    @property
    def use(self) -> float:
        return (self.end - self.start) / self.band.time


def find_stays(
    trajectory: Trajectory,
    limit: Resonance,
) -> tuple[Stay, ...]:
    """Return every stay in the bands that may be crossed, as proved upper bounds of durations."""
    if not limit.bands:
        return ()
    shortest = MIN_CELL_SHARE * min(band.time for band in limit.bands)

    def find_undecided(
        cells: Cells,
        values: Values,
    ) -> tuple[np.ndarray, int]:
        possible, certain = values
        undecided = (possible & ~certain).any(0) & (cells.lengths > shortest)
        if 2 * undecided.sum() > MAX_CELLS:
            undecided[:] = False
        return undecided, 2

    cells = Cells.cover(trajectory)
    locate = partial(_locate, trajectory, limit)
    cells, values = refine(cells, locate, find_undecided)
    order = np.lexsort((cells.lo, cells.k))
    cells = cells[order]
    possible, certain = (each[:, order] for each in values)
    stays: list[Stay] = []
    for n, band in enumerate(limit.bands):
        stays += _join_cells(trajectory, band, cells, possible[n], certain[n])
    return tuple(stays)


def _join_cells(
    trajectory: Trajectory,
    band: Band,
    cells: Cells,
    possible: np.ndarray,
    certain: np.ndarray,
) -> list[Stay]:
    """Return the stays in one band from consecutive cells."""
    start = trajectory.knots[cells.k] + cells.lo
    end = trajectory.knots[cells.k] + cells.hi
    sure = [(first, float(end[last] - start[first])) for first, last in find_sequences(certain)]
    return [
        Stay(
            band=band,
            start=float(start[first]),
            end=float(end[last]),
            first=int(cells.k[first]),
            last=int(cells.k[last]),
            inside=max(
                (time for begin, time in sure if first <= begin <= last),
                default=0.0,
            ),
        )
        for first, last in find_sequences(possible)
    ]


def _locate(
    trajectory: Trajectory,
    limit: Resonance,
    cells: Cells,
) -> Values:
    """Return (bands, N) bool each: where |q̇| may be in a band, and where it is throughout."""
    motion = enclose(trajectory, cells, EXPANSION)
    low, high = motion.bound(limit.value(motion))
    axes = [band.axis for band in limit.bands]
    slowest: Array = np.maximum(np.maximum(low, -high), 0.0).T[axes]
    fastest: Array = np.maximum(-low, high).T[axes]
    lower = np.array([[band.low] for band in limit.bands])
    upper = np.array([[band.high] for band in limit.bands])
    possible = ~((fastest < lower) | (slowest > upper))
    return possible, (slowest >= lower) & (fastest <= upper)
