"""Bounds of the use of limits by the coarse enclosure, which decides most cells.

Limits on single axes: every cell, and loose cells in parts. Other limits: groups of cells first,
then the cells of those groups that may use the most.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinematics.foundation.arrays import Array, largest_in_rows
from planner.certificate.cells import Cells, Values, evaluate_in_batches
from planner.certificate.enclosure import MotionEnclosure
from planner.certificate.path_enclosure import PathEnclosure, enclose_along_path
from planner.limits.limit import Limit
from planner.trajectory import State, Trajectory

# Cells bounded together: their numbers stay in the processor's cache.
BATCH = 1 << 13
# Parts into which a loose cell of a limit on single axes is split.
PARTS = 8
# Cells in a group, and the number of cells from which on groups pay.
GROUP_CELLS = 16
MIN_GROUPED = 512


def bound_coarsely(trajectory: Trajectory, limits: Sequence[Limit], cells: Cells, order: int) -> Values:
    """Return bounds of each limit's use over N cells and the use attained at some instants,
    (limits, N) each.
    """

    def bound(batch: Cells) -> Values:
        look = _CoarseLook(trajectory, batch, order)
        uses = [look.bound_by_axis(limit) if limit.by_axis else look.bound_in_groups(limit) for limit in limits]
        bounds, attained = zip(*uses, strict=True)
        return replace_nan(np.stack(bounds)), replace_nan(np.stack(attained))

    with np.errstate(invalid="ignore", over="ignore"):
        return evaluate_in_batches(cells, bound, BATCH)


def replace_nan(use: Array) -> Array:
    """Return uses, ∞ where nothing is known."""
    return np.where(np.isnan(use), np.inf, use)


def state_at(trajectory: Trajectory, cells: Cells, share: Array | float, order: int) -> State:
    """Return the motion at these shares of the cells."""
    return trajectory.within(cells.k, cells.lo + share * cells.lengths, jerk=order == 3)


def use_in(limit: Limit, state: State) -> Array:
    """Return the largest use (N,) of a limit at N instants."""
    value = limit.value(state)
    return largest_in_rows(limit.use(value, value, state.piece))


def _bound_in(limit: Limit, motion: MotionEnclosure) -> Array:
    return largest_in_rows(motion.bound_use(limit))


@dataclass(frozen=True)
class _CoarseLook:
    """A batch of cells, and what several limits share about them."""

    trajectory: Trajectory
    cells: Cells
    order: int

    @cached_property
    def motion(self) -> PathEnclosure:
        return enclose_along_path(self.trajectory, self.cells, self.order)

    @cached_property
    def centres(self) -> State:
        return state_at(self.trajectory, self.cells, 0.5, self.order)

    @cached_property
    def groups(self) -> "_Groups":
        return _Groups.of(self)

    def bound_by_axis(self, limit: Limit) -> tuple[Array, Array]:
        """Bound a limit on single axes: what each axis attains is known without evaluating a state."""
        bound, attained = _bound_axes(limit, self.motion)
        most = np.maximum(attained, min(attained.max(), 1.0))
        loose = np.flatnonzero((bound > most + limit.tight(most)) & (bound < np.inf))
        if len(loose):
            parts = self.motion.split(self.trajectory, self.cells[loose].parts(PARTS), np.tile(loose, PARTS))
            tighter = _bound_axes(limit, parts)
            bound[loose], attained[loose] = (each.reshape(PARTS, -1).max(0) for each in tighter)
        return bound, attained

    def bound_in_groups(self, limit: Limit) -> tuple[Array, Array]:
        """Bound any other limit over groups of cells, then over the cells of those groups that may
        use the most.
        """
        count = len(self.cells.k)
        if count < MIN_GROUPED:
            return _bound_in(limit, self.motion), use_in(limit, self.centres)
        groups = self.groups
        group_bound = _bound_in(limit, groups.motion)
        attained = np.zeros(count)
        attained[groups.middle] = use_in(limit, groups.centres)
        most = attained.max()
        bound = group_bound[groups.number]
        loose = np.flatnonzero(~(bound < min(most, 1.0) + limit.tight(most)))
        if len(loose):
            bound[loose] = _bound_in(limit, self.motion[loose])
            attained[loose] = use_in(limit, state_at(self.trajectory, self.cells[loose], 0.5, self.order))
        return bound, attained


def _bound_axes(limit: Limit, motion: PathEnclosure) -> tuple[Array, Array]:
    least, most = (limit.value(each).mid[0] for each in motion.attained)
    return _bound_in(limit, motion), largest_in_rows(limit.use(least, most, motion.piece))


@dataclass(frozen=True, slots=True)
class _Groups:
    """Groups of consecutive cells on one interval of the path.

    motion, centres  enclosure of each group, and the state at the centre of its middle cell
    middle   (G,) the middle cell of each group
    number   (N,) group of each cell
    """

    motion: MotionEnclosure
    centres: State
    middle: np.ndarray
    number: np.ndarray

    @staticmethod
    def of(look: _CoarseLook) -> "_Groups":
        interval = look.motion.interval
        count = len(interval)
        runs = np.flatnonzero(np.diff(interval, prepend=-1))
        place_in_run = np.arange(count) - np.repeat(runs, np.diff(np.append(runs, count)))
        starts = place_in_run % GROUP_CELLS == 0
        first = np.flatnonzero(starts)
        middle = (first + np.append(first[1:], count)) // 2
        centres = state_at(look.trajectory, look.cells[middle], 0.5, look.order)
        return _Groups(look.motion.group(first), centres, middle, np.cumsum(starts) - 1)
