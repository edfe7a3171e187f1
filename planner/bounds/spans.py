"""Spans of a run, bounded one by one: cruises at a capped speed, and the motion between them.

The state between two spans is free, which costs little at a capped speed. A run is also
split where its path turns back, q′ = 0: there no axis moves, for any ṡ.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from planner.bounds.lower_bound import SPEED_LIMITS
from planner.certificate.cells import find_sequences, sample_pieces
from planner.limits.limit import Limit
from planner.limits.tool import ToolSpeed
from planner.path.stands import count_zero_derivatives
from planner.trajectory import Trajectory

# Least use of a speed limit at which a motion cruises.
CRUISING_USE = 1 - 2e-4
# Least share of a run for a cruise: each further span takes as many cells as a short run.
LEAST_CRUISE = 0.01


@dataclass(frozen=True, slots=True)
class Span:
    """Motion of a run between two instants.

    pieces      the trajectory's time pieces (K,)
    knots       s, the trajectory's instants (K+1,) at their ends
    breaks      path lengths at the start, at the path's breaks inside, and at the end
    first       the path piece at the start
    stops       the path's breaks at both ends; None inside a run, where the state is free
    cruising    whether the motion is at a capped speed throughout
    """

    pieces: np.ndarray
    knots: Array
    breaks: Array
    first: int
    stops: tuple[int | None, int | None]
    cruising: bool = False

    @property
    def duration(self) -> float:
        """Duration in s."""
        return float(self.knots[-1] - self.knots[0])


def split_run(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    ends: tuple[int, int],
) -> list[Span]:
    """Split the motion between two breaks of the path."""
    within = (trajectory.piece >= ends[0]) & (trajectory.piece < ends[1])
    moved = np.flatnonzero(within & ~trajectory.resting)
    pieces = np.arange(moved[0], moved[-1] + 1)
    cruising = _find_cruises(trajectory, limits, pieces)
    turns = _find_turns(trajectory, pieces)
    changes = np.flatnonzero(np.diff(cruising)) + 1
    cuts = np.unique([0, *changes, *turns, len(pieces)]).tolist()

    spans = []
    for a, b in pairwise(cuts):
        inside = pieces[a:b]
        first, last = trajectory.piece[inside[[0, -1]]].tolist()
        breaks = np.array(trajectory.path.breaks[first : last + 2])
        start: int | None = ends[0]
        stop: int | None = ends[1]
        if a > 0:
            breaks[0] = trajectory.s[inside[0]]
            start = first if a in turns else None
        if b < len(pieces):
            breaks[-1] = trajectory.s[pieces[b]]
            stop = last + 1 if b in turns else None
        spans.append(
            Span(
                pieces=inside,
                knots=trajectory.knots[inside[0] : inside[-1] + 2],
                breaks=breaks,
                first=first,
                stops=(start, stop),
                cruising=bool(cruising[a]),
            )
        )
    return spans


def _find_cruises(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    pieces: np.ndarray,
) -> np.ndarray:
    """Return whether each time piece (K,) is bounded as part of a cruise. Cruises are long.

    At a break of the path a cap may end. A neighbour that ends at this break would be bounded as if
    it could pass at any speed. So it also gets the time pieces of the cruise next to the break, for
    a time well above rounding.
    """
    keeps_cap = _keep_caps(trajectory, limits, pieces)
    knots = trajectory.knots[pieces[0] : pieces[-1] + 2]
    piece = trajectory.piece[pieces]
    least = LEAST_CRUISE * (knots[-1] - knots[0])
    cruising = np.zeros(len(pieces), bool)
    for a, last in find_sequences(keeps_cap):
        b = last + 1
        if knots[b] - knots[a] <= least:
            continue
        first = a
        end = b
        if a > 0 and piece[a] != piece[a - 1]:
            first = int(np.searchsorted(knots, knots[a] + least))
        if b < len(piece) and piece[b] != piece[b - 1]:
            end = int(np.searchsorted(knots, knots[b] - least, side="right")) - 1
        cruising[first:end] = True
    return cruising


def _keep_caps(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    pieces: np.ndarray,
) -> np.ndarray:
    """Return whether each time piece (K,) is at the tool's cap, or at another cap with constant ṡ.

    Where an axis is at its cap while ṡ varies, the bound is better without a cut.
    """
    state = sample_pieces(trajectory, pieces, (0.0, 0.5, 1.0))
    steady = np.repeat((trajectory.a[pieces] == 0) & (trajectory.j[pieces] == 0), 3)
    used = np.zeros(3 * len(pieces))
    for limit in limits:
        if isinstance(limit, SPEED_LIMITS):
            use = limit.use_at(state).max(1)
            if not isinstance(limit, ToolSpeed):
                use = np.where(steady, use, 0.0)
            used = np.maximum(used, use)
    return np.asarray(used.reshape(-1, 3).min(1) > CRUISING_USE)


def _find_turns(trajectory: Trajectory, pieces: np.ndarray) -> list[int]:
    """List the indices of a run's time pieces (K,) that start where q′ = 0 on both sides."""
    zeros = count_zero_derivatives(trajectory.path)
    piece = trajectory.piece[pieces]
    starts = np.flatnonzero(np.diff(piece)) + 1
    before = zeros[1, piece[starts] - 1]
    after = zeros[0, piece[starts]]
    turns: list[int] = starts[(before > 0) & (after > 0)].tolist()
    return turns
