"""A timing problem as the solvers see it: a grid along one run, and every limit's rows on it, normalised."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.array import Array
from planner.actuation import ActuatorPath, points_of
from planner.limits.limit import Limit, Term


@dataclass(frozen=True, slots=True)
class Run:
    """Pieces first … last (inclusive) of a path, from rest to rest."""

    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Block:
    """One limit on N intervals, |Σ coefficient · term| ≤ room, at each interval's start and end.

    The coefficients (N, m) are divided by the bound.

    room (N,) is 1, or less where the certificate asked for it.
    about (low, high at the start, low, high at the end), each (N, m): as `Rows` has it, None where every row speaks.
    """

    name: str
    start: Mapping[Term, Array]
    end: Mapping[Term, Array]
    room: Array
    about: tuple[Array, Array, Array, Array] | None = None

    def around(self, start: Array, end: Array) -> "Block":
        """What speaks near a motion with ṡ (N,) at the intervals' starts and ends; other rows become nothing."""
        if self.about is None:
            return self
        low, high, low_end, high_end = self.about
        sides = []
        for side, speed, least, most in ((self.start, start, low, high), (self.end, end, low_end, high_end)):
            speaks = (least <= speed[:, None]) & (speed[:, None] < most)
            sides.append({term: np.where(speaks, values, 0.0) for term, values in side.items()})
        return replace(self, start=sides[0], end=sides[1], about=None)


@dataclass(frozen=True, slots=True)
class Problem:
    """Grid s (N+1,) over a run, piece (N,) of each interval, and the blocks of all limits."""

    s: Array
    piece: np.ndarray
    blocks: tuple[Block, ...]

    @property
    def intervals(self) -> int:
        return len(self.piece)

    @property
    def settled(self) -> bool:
        """Whether every row speaks near every motion."""
        return all(block.about is None for block in self.blocks)

    def around(self, start: Array, end: Array) -> "Problem":
        """The rows that speak near a motion with ṡ (N,) at the intervals' starts and ends."""
        return replace(self, blocks=tuple(block.around(start, end) for block in self.blocks))


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
        bound = np.broadcast_to(rows.bound, (2 * count, np.shape(rows.bound)[-1]))
        binding = np.isfinite(bound).any(0)
        if not binding.any():
            continue
        scaled = {term: values[:, binding] / bound[:, binding] for term, values in rows.coefficients.items()}
        start = {term: values[:count] for term, values in scaled.items()}
        end = {term: values[count:] for term, values in scaled.items()}
        about = None
        if rows.about is not None:
            low, high = (values[:, binding] for values in rows.about)
            about = low[:count], high[:count], low[count:], high[count:]
        blocks.append(Block(limit.name, start, end, np.ones(count), about))
    return Problem(s, piece, tuple(blocks))
