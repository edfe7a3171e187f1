"""How long an axis stays in a band of speed: proved over continuous time.

Time is cut into cells over which q̇ is enclosed (planner.certificate.enclosure). A cell is outside a band, inside, or
open; open ones are halved until they are short. A stay is as long as the cells in a row that are not outside: never too
short.
"""

from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array
from planner.certificate.cells import Cells
from planner.certificate.enclosure import bound_series, enclose
from planner.limits.resonance import Band, Resonance
from planner.trajectory import Trajectory

# Least cell, as a share of the shortest time allowed in a band: a stay is over-estimated by two at most.
MIN_CELL_SHARE = 5e-4
# Order of the expansions, cells looked at together, and cells in all, after which they are halved no more.
EXPANSION, CELL_BATCH, MAX_CELLS = 6, 1024, 400_000


@dataclass(frozen=True, slots=True)
class Stay:
    """From start to end (s) an axis may be in a band: on time pieces first … last of the trajectory.

    inside: the longest time (s) of it in which it surely is, without a break
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


def find_stays(trajectory: Trajectory, limit: Resonance) -> tuple[Stay, ...]:
    """Every stay in the bands that may be crossed, each a proven upper bound of how long it lasts."""
    if not limit.bands:
        return ()
    lengths = np.diff(trajectory.knots)
    cells = Cells(np.arange(len(lengths)), np.zeros(len(lengths)), lengths)
    cells, shortest = cells[lengths > 0], MIN_CELL_SHARE * min(band.time for band in limit.bands)
    done, touched, full = [], [], []
    while len(cells.k):
        possible, sure = _find_in_band(trajectory, limit, cells)
        open_ = (possible & ~sure).any(0) & (cells.hi - cells.lo > shortest)
        if 2 * open_.sum() > MAX_CELLS:
            open_[:] = False
        done.append(cells[~open_])
        touched.append(possible[:, ~open_])
        full.append(sure[:, ~open_])
        cells = cells[open_].parts(2)
    k, lo, hi = (np.concatenate([getattr(each, name) for each in done]) for name in ("k", "lo", "hi"))
    order = np.lexsort((lo, k))
    k, start, end = k[order], (trajectory.knots[k] + lo)[order], (trajectory.knots[k] + hi)[order]
    found = []
    for band, met, sure in zip(
        limit.bands, *(np.concatenate(each, 1)[:, order] for each in (touched, full)), strict=True
    ):
        surely = _find_sequences(sure)
        for a, b in _find_sequences(met):
            inside = max((float(end[d] - start[c]) for c, d in surely if a <= c <= b), default=0.0)
            found.append(Stay(band, float(start[a]), float(end[b]), int(k[a]), int(k[b]), inside))
    return tuple(found)


def _find_sequences(flags: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every row of true flags."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(int))
    return list(zip(np.flatnonzero(edges > 0).tolist(), (np.flatnonzero(edges < 0) - 1).tolist(), strict=True))


def _find_in_band(trajectory: Trajectory, limit: Resonance, cells: Cells) -> tuple[np.ndarray, np.ndarray]:
    """(bands, N) bool each: where |q̇| may be in a band, and where it is throughout."""
    possible, sure = np.zeros((2, len(limit.bands), len(cells.k)), bool)
    for first in range(0, len(cells.k), CELL_BATCH):
        chosen = np.arange(first, min(first + CELL_BATCH, len(cells.k)))
        with np.errstate(invalid="ignore", over="ignore"):
            low, high = bound_series(limit.value(enclose(trajectory, cells[chosen], EXPANSION)), len(chosen))
        least: Array = np.maximum(np.maximum(low, -high), 0.0)
        most: Array = np.maximum(-low, high)
        for n, band in enumerate(limit.bands):
            slow, fast = least[:, band.axis], most[:, band.axis]
            possible[n, chosen] = ~((fast < band.low) | (slow > band.high))
            sure[n, chosen] = (slow >= band.low) & (fast <= band.high)
    return possible, sure
