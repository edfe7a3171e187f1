"""Spans of a run that are bounded one by one: cruises at a capped speed, and what lies between them.

Between two spans the state is free, which costs next to nothing where both keep the capped speed there. A run is also
split where its path turns back, q′ = 0: there no axis moves, whatever ṡ is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from planner.bounds.lower_bound import SPEED_LIMITS
from planner.limits.limit import Limit
from planner.limits.tool import ToolSpeed
from planner.path.stands import count_zero_derivatives
from planner.trajectory import Trajectory

# Use of a limit on speed from which a motion cruises.
CRUISING_USE = 1 - 2e-4
# Least share of its run for which a cruise is a span: each span between cruises takes as many cells as a short run.
LEAST_CRUISE = 0.01


@dataclass(frozen=True, slots=True)
class Span:
    """A stretch of a run between two instants.

    pieces    the trajectory's time pieces (K,)
    begin, end  s, of the trajectory
    breaks    path lengths at its start, at the path's breaks inside, and at its end
    first     the path piece at its start
    stops     the path's breaks at which it starts and ends; None inside a run, where its state is free
    cruising  whether the motion keeps a capped speed over all of it
    """

    pieces: np.ndarray
    begin: float
    end: float
    breaks: Array
    first: int
    stops: tuple[int | None, int | None]
    cruising: bool = False

    @property
    def duration(self) -> float:
        """s."""
        return self.end - self.begin


def split_run(trajectory: Trajectory, limits: Sequence[Limit], ends: tuple[int, int]) -> list[Span]:
    """Split the motion between two breaks of the path."""
    moving = (trajectory.v != 0) | (trajectory.a != 0) | (trajectory.j != 0)
    inside = (trajectory.piece >= ends[0]) & (trajectory.piece < ends[1])
    moved = np.flatnonzero(moving & inside)
    pieces = np.arange(moved[0], moved[-1] + 1)
    cruising = _find_cruises(trajectory, limits, pieces)
    turns = _find_turns(trajectory, pieces)
    cuts = np.unique([0, *(np.flatnonzero(np.diff(cruising)) + 1), *turns, len(pieces)]).tolist()

    spans = []
    for a, b in pairwise(cuts):
        own = pieces[a:b]
        first, last = trajectory.piece[own[[0, -1]]].tolist()
        breaks = np.array(trajectory.path.breaks[first : last + 2])
        start, stop = None, None
        if a == 0:
            start = ends[0]
        else:
            breaks[0] = trajectory.s[own[0]]
            start = first if a in turns else None
        if b == len(pieces):
            stop = ends[1]
        else:
            breaks[-1] = trajectory.s[pieces[b]]
            stop = last + 1 if b in turns else None
        begin, end = trajectory.knots[[own[0], own[-1] + 1]].tolist()
        spans.append(Span(own, begin, end, breaks, first, (start, stop), bool(cruising[a])))
    return spans


def _find_cruises(trajectory: Trajectory, limits: Sequence[Limit], own: np.ndarray) -> np.ndarray:
    """Return which time pieces (K,) are bounded as cruises: long ones, without what their neighbours need.

    A cap that begins or ends at a break of the path holds inside the cruise only: a neighbour that ends at the break
    would be bounded as if it could pass there at any speed. It takes time pieces of the cruise next to the break, for
    a time that is not lost in the rounding of its cells.
    """
    keeps_cap = _keep_caps(trajectory, limits, own)
    edges = np.flatnonzero(np.diff(keeps_cap, prepend=False, append=False))
    knots, piece = trajectory.knots[own[0] : own[-1] + 2], trajectory.piece[own]
    least = LEAST_CRUISE * (knots[-1] - knots[0])
    cruising = np.zeros(len(own), bool)
    for a, b in edges.reshape(-1, 2).tolist():
        if knots[b] - knots[a] <= least:
            continue
        first, last = a, b
        if a > 0 and piece[a] != piece[a - 1]:
            first = int(np.searchsorted(knots, knots[a] + least))
        if b < len(piece) and piece[b] != piece[b - 1]:
            last = int(np.searchsorted(knots, knots[b] - least, side="right")) - 1
        cruising[first:last] = True
    return cruising


def _keep_caps(trajectory: Trajectory, limits: Sequence[Limit], own: np.ndarray) -> np.ndarray:
    """Return whether each time piece (K,) keeps to the tool's cap, or to constant ṡ at another's.

    A motion along which an axis keeps its largest speed while ṡ varies is better bounded together with what comes
    before and after.
    """
    steady = np.repeat((trajectory.a[own] == 0) & (trajectory.j[own] == 0), 3)
    instants = np.outer(np.diff(trajectory.knots)[own], [0.0, 0.5, 1.0]).ravel()
    state = trajectory.within(np.repeat(own, 3), instants)
    used = np.zeros(3 * len(own))
    for limit in limits:
        if isinstance(limit, SPEED_LIMITS):
            value = limit.value(state)
            use = limit.use(value, value, state.piece).max(1)
            if not isinstance(limit, ToolSpeed):
                use = np.where(steady, use, 0.0)
            used = np.maximum(used, use)
    return np.asarray(used.reshape(-1, 3).min(1) > CRUISING_USE)


def _find_turns(trajectory: Trajectory, own: np.ndarray) -> list[int]:
    """List which of a run's time pieces (K,) start at a place where q′ = 0 on both sides."""
    zeros = count_zero_derivatives(trajectory.path)
    piece = trajectory.piece[own]
    starts = np.flatnonzero(np.diff(piece)) + 1
    turning = (zeros[0, piece[starts]] > 0) & (zeros[1, piece[starts] - 1] > 0)
    return [int(start) for start in starts[turning]]
