"""A timing problem as the solvers see it: a grid along one run, and every limit's rows on it, normalised."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.array import Array
from planner.actuation import ActuatorPath, points_of
from planner.limits.limit import Limit, Rows, Term


@dataclass(frozen=True, slots=True)
class Run:
    """Pieces first … last (inclusive) of a path, from rest to rest."""

    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Block:
    """One limit on N intervals, |Σ coefficient · term − room · middle| ≤ room, at each interval's start and end.

    The coefficients (N, m) are divided by half the range between the bounds.

    room    (N,) 1, or less where the certificate asked for it: what it takes off leaves standing still inside
    middle  (m,) of the range, in ]−1, 1[: 0 where the bounds are the same both ways
    """

    name: str
    start: Mapping[Term, Array]
    end: Mapping[Term, Array]
    room: Array
    middle: Array

    def share(self, values: Array) -> Array:
        """(N, m) of the range on their own side of zero, what values (N, m) of the sum are; 1 is at the bound."""
        return np.abs(values) / (1 + np.sign(values) * self.middle)


@dataclass(frozen=True, slots=True)
class Problem:
    """Grid s (N+1,) over a run, piece (N,) of each interval, and the blocks of all limits."""

    s: Array
    piece: np.ndarray
    blocks: tuple[Block, ...]

    @property
    def intervals(self) -> int:
        return len(self.piece)


def grid(path: ActuatorPath, run: Run, intervals: int, spread: Array | None = None) -> tuple[Array, np.ndarray]:
    """Grid of at least `intervals` intervals that holds every break of the run, and the piece of each interval.

    spread (K,) in [0, 1], rising from 0 to 1: where points should lie, as a share of the run (evenly if None).
    """
    breaks = path.breaks[run.first : run.last + 2]
    share = np.linspace(0, 1, intervals + 1) if spread is None else spread
    s = breaks[0] + (breaks[-1] - breaks[0]) * share
    if len(breaks) > 2:
        # a point too near a break would make a sliver: the break takes its place
        gap = np.abs(s[:, None] - breaks[None, :]).min(1)
        near = np.maximum(np.gradient(s), 0) / 3
        s = np.union1d(s[gap > near], breaks)
    else:
        s[0], s[-1] = breaks
    piece = run.first + np.clip(np.searchsorted(breaks, (s[1:] + s[:-1]) / 2, side="right") - 1, 0, len(breaks) - 2)
    return s, piece


def pose_problem(path: ActuatorPath, limits: Sequence[Limit], s: Array, piece: np.ndarray) -> Problem:
    """Evaluate the rows of every timing limit on both sides of every grid point, in one batch."""
    count = len(piece)
    both = np.concatenate([piece, piece])
    points = points_of(path, np.concatenate([s[:-1], s[1:]]), both)
    blocks = []
    for limit in limits:
        if limit.geometric:
            continue
        rows = limit.rows(points)
        scaled, middle = _normalised(rows, 2 * count)
        if scaled:
            start = {term: values[:count] for term, values in scaled.items()}
            end = {term: values[count:] for term, values in scaled.items()}
            blocks.append(Block(limit.name, start, end, np.ones(count), middle))
    return Problem(s, piece, tuple(blocks))


def _normalised(rows: Rows, points: int) -> tuple[dict[Term, Array], Array]:
    """Coefficients of the channels that are bound, over half their range, and its middle."""
    bound = np.broadcast_to(rows.bound, (points, np.shape(rows.bound)[-1]))
    binding = np.isfinite(bound).any(0)
    half, middle = bound[:, binding], np.zeros(int(binding.sum()))
    if rows.below is not None:
        above, below = rows.bound[binding], rows.below[binding]
        half = (above + below) / 2
        middle = (above - below) / 2 / half
    return {
        term: values[:, binding] / half for term, values in rows.coefficients.items()
    } if binding.any() else {}, middle
