"""Peaks of limits between grid points, for which a solution is given less room.

Rows hold at grid points. Between them a limit may be exceeded by an amount that is proportional to
the square of the interval and hardly changes with the motion. So the room of the rows is lowered by
that amount while the solver still iterates.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

import numpy as np

from kinematics.foundation.arrays import Array, largest_in_rows
from planner.limits.limit import Term
from planner.timing.order3.pose import PosedStages, pose_bounds
from planner.timing.problem import SOLVER_AIM, Block, Problem
from planner.timing.profile import Profile
from planner.timing.sampling import MIN_WATCHED_USE

# Use of a limit from which its peaks count; the room lost to a peak, as a multiple of it, since
# peaks move a little; the largest peak that counts; and the least change of a room.
NEAR_USE = 0.98
PEAK_FACTOR = 1.05
MAX_PEAK = 0.3
MIN_CHANGE = 1e-7
# Excess that slowing the motion as a whole removes at next to no cost.
SMALL_EXCESS = 4e-6
Look = Callable[[Profile, Collection[str]], Mapping[str, Array]]
"""A motion on a grid, names of limits -> the largest use (N,) of each of them in each interval."""


class Peaks:
    """Bounds of the rows by the use of the limits between grid points; rooms are only lowered.

    use: of the limits by the last motion, or None if it was given less room
    """

    def __init__(self, problem: Problem, posed: PosedStages, look: Look) -> None:
        self.problem = problem
        self.posed = posed
        self.look = look
        self.use: Mapping[str, Array] | None = None
        self._watched: Collection[str] = {block.name for block in problem.blocks}

    def __call__(
        self,
        states: Array,
        controls: Array,
        values: Array,
        solved: bool,
    ) -> tuple[Array, Array] | None:
        """Return new bounds, or None if no peak needs less room."""
        v, a, j, h = self.posed.columns(states, controls)
        use = self.look(Profile(self.problem.s[:-1], v, a, j, h, self.problem.piece), self._watched)
        self._watched = {name for name, each in use.items() if each.max() > MIN_WATCHED_USE}
        # no limit may be watched any more: the motion then uses less than half of each
        largest = max((float(each.max()) for each in use.values()), default=0.0)
        blocks = self._lower_rooms(use, values)
        pairs = zip(blocks, self.problem.blocks, strict=True)
        lowered = any((block.room < before.room).any() for block, before in pairs)
        if not lowered or (solved and largest <= 1 + SMALL_EXCESS):
            self.use = use
            return None
        self.use = None
        self.problem = replace(self.problem, blocks=blocks)
        return pose_bounds(self.problem)

    def _lower_rooms(self, use: Mapping[str, Array], values: Array) -> tuple[Block, ...]:
        count = values.shape[1] // 2 - 1
        blocks = []
        last = 0
        for block in self.problem.blocks:
            columns = slice(last, last + block.middle.size)
            last = columns.stop
            first = largest_in_rows(block.share(values[:, :count][:, columns]))
            second = largest_in_rows(block.share(values[:, count:][:, columns]))
            on_grid = np.maximum(first, second)
            if Term.SDDD not in block.start:
                # these rows hold in the middle, and where the next interval starts
                on_grid[:-1] = np.maximum(on_grid[:-1], first[1:])
            used = use.get(block.name, on_grid)
            peak = (used - on_grid).clip(0.0, MAX_PEAK)
            short = (used > NEAR_USE) & (SOLVER_AIM - peak < block.room - MIN_CHANGE)
            room = np.where(short, SOLVER_AIM - PEAK_FACTOR * peak, block.room)
            blocks.append(replace(block, room=room))
        return tuple(blocks)
