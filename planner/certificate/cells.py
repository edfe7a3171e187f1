"""Cells of time, and their refinement by branch and bound: bound every cell, split the loose
ones.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array
from planner.trajectory import State, Trajectory

# Cells evaluated together: their series stay in the processor's cache.
CELL_BATCH = 1024
Values = tuple[np.ndarray, ...]
"""Results for N cells, each (…, N)."""


@dataclass(frozen=True, slots=True)
class Cells:
    """N parts of time pieces k, from lo to hi (s) after the start of the piece."""

    k: np.ndarray
    lo: Array
    hi: Array

    @staticmethod
    def cover(trajectory: Trajectory) -> "Cells":
        """Return one cell for each time piece that lasts."""
        lengths = np.diff(trajectory.knots)
        k = np.flatnonzero(lengths > 0)
        return Cells(k, np.zeros(len(k)), lengths[k])

    @property
    def lengths(self) -> Array:
        return self.hi - self.lo

    def parts(self, count: int) -> "Cells":
        """Split each cell into equal parts: the first part of every cell, then every second
        part.
        """
        cuts = self.lo + self.lengths * np.linspace(0.0, 1.0, count + 1)[:, None]
        cuts[-1] = self.hi
        return Cells(np.tile(self.k, count), cuts[:-1].ravel(), cuts[1:].ravel())

    def __getitem__(self, chosen: np.ndarray | slice) -> "Cells":
        return Cells(self.k[chosen], self.lo[chosen], self.hi[chosen])


def evaluate_in_batches(
    cells: Cells,
    evaluate: Callable[[Cells], Values],
    batch: int = CELL_BATCH,
) -> Values:
    """Evaluate at most `batch` cells at a time and join the results. Overflow means: no bound."""
    firsts = range(0, max(len(cells.k), 1), batch)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        results = [evaluate(cells[first : first + batch]) for first in firsts]
    if len(results) == 1:
        return results[0]
    return tuple(np.concatenate(each, axis=-1) for each in zip(*results, strict=True))


def refine(
    cells: Cells,
    evaluate: Callable[[Cells], Values],
    find_loose: Callable[[Cells, Values], tuple[np.ndarray, int]],
    values: Values | None = None,
) -> tuple[Cells, Values]:
    """Split loose cells and evaluate their parts until all are tight.

    Returns the final cells and their values.

    evaluate    returns the values of a batch of cells
    find_loose  returns which cells (N,) are loose, and into how many parts to split each of them
    values      of the cells at the start, unless `evaluate` shall find them
    """
    if values is None:
        values = evaluate_in_batches(cells, evaluate)
    accepted: list[tuple[Cells, Values]] = []
    while True:
        loose, parts = find_loose(cells, values)
        accepted.append((cells[~loose], tuple(each[..., ~loose] for each in values)))
        if not loose.any():
            break
        cells = cells[loose].parts(parts)
        values = evaluate_in_batches(cells, evaluate)
    columns = zip(
        *((each.k, each.lo, each.hi, *values) for each, values in accepted),
        strict=True,
    )
    k, lo, hi, *joined = (np.concatenate(column, axis=-1) for column in columns)
    return Cells(k, lo, hi), tuple(joined)


def sample_pieces(
    trajectory: Trajectory,
    pieces: np.ndarray,
    shares: Sequence[float] | Array,
) -> State:
    """Return the motion at these shares of time pieces, piece by piece."""
    k = np.repeat(pieces, len(shares))
    lengths = np.diff(trajectory.knots)[k]
    return trajectory.within(k, np.tile(shares, len(pieces)) * lengths)


def find_sequences(flags: np.ndarray) -> list[tuple[int, int]]:
    """Return first and last index of every sequence of true flags."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    return [(first, after - 1) for first, after in edges.reshape(-1, 2).tolist()]
