"""Peaks of limits between grid points, for which a solution is given less room.

Rows hold at grid points. Between them a limit may be exceeded by an amount that is proportional to the square of the
interval and hardly changes with the motion. So the room of the rows is lowered by that amount while the solver still
iterates. In a long run with few such peaks, only windows around them are solved again.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Term
from planner.timing.order3.interior_point import Minimum, try_starts
from planner.timing.order3.pose import PosedStages, pose_bounds, pose_stages
from planner.timing.order3.stages import evaluate
from planner.timing.problem import SOLVER_AIM, Block, EndCondition, Problem
from planner.timing.profile import Profile
from planner.timing.sampling import MIN_WATCHED_USE

# Use of a limit from which its peaks count; the room lost to a peak, as a multiple of it, since peaks move a little;
# the largest peak that counts; and the least change of a room.
NEAR_USE, PEAK_FACTOR, MAX_PEAK, MIN_CHANGE = 0.98, 1.05, 0.3, 1e-7
# Excess that slowing the motion as a whole removes at next to no cost.
SMALL_EXCESS = 4e-6
# Intervals of a run from which windows are solved: a long run takes more iterations, since its worst stage shortens the
# steps of all, and in a short one the ends of a window would matter.
LONG_RUN = 2500
# Intervals of a window on either side of a peak; the largest share of the run in windows; and rounds of windows.
WINDOW_REACH, MAX_WINDOW_SHARE, MAX_ROUNDS = 60, 0.5, 4
Look = Callable[[Profile, Collection[str]], Mapping[str, Array]]
"""A motion on a grid, names of limits -> the largest use (N,) of each of them in each interval."""


class Peaks:
    """Bounds of the rows by what a motion uses of the limits between grid points; rooms are only lowered.

    use      of the solution
    windows  first intervals, and those after the last ones, that are to be solved again
    """

    def __init__(self, problem: Problem, posed: PosedStages, look: Look) -> None:
        self.problem = self.original = problem
        self.posed, self.look = posed, look
        self.use: Mapping[str, Array] | None = None
        self.windows: list[tuple[int, int]] = []
        self._watched: Collection[str] = {block.name for block in problem.blocks}

    def __call__(self, states: Array, controls: Array, values: Array) -> tuple[Array, Array] | None:
        """Return new bounds for the whole run, or None where no peak is left, or only windows are to be solved."""
        columns = self.posed.columns(states, controls)
        v, a, j, h = columns
        use = self.look(Profile(self.problem.s[:-1], v, a, j, h, self.problem.piece), self._watched)
        self._watched = {name for name, each in use.items() if each.max() > MIN_WATCHED_USE}
        self.use, self.windows = None, []
        # no limit may be watched any more: the motion then uses less than half of each
        largest = max((float(each.max()) for each in use.values()), default=0.0)
        first = self.problem is self.original
        blocks = self._lower_rooms(use, values)
        lowered = np.zeros(self.problem.intervals, bool)
        for block, before in zip(blocks, self.problem.blocks, strict=True):
            lowered |= block.room < before.room
        if not lowered.any() or not (first or largest > 1 + SMALL_EXCESS):
            self.use = use
            return None
        self.problem = replace(self.problem, blocks=blocks)
        windows = _join_windows(np.flatnonzero(lowered), len(lowered))
        share = sum(after - begin for begin, after in windows) / len(lowered)
        if first or len(lowered) < LONG_RUN or share > MAX_WINDOW_SHARE:
            return pose_bounds(self.problem)
        self.windows = windows
        return None

    def _lower_rooms(self, use: Mapping[str, Array], values: Array) -> tuple[Block, ...]:
        count = values.shape[1] // 2 - 1
        blocks = []
        last = 0
        for block in self.problem.blocks:
            columns = slice(last, last + block.middle.size)
            last = columns.stop
            first, second = (block.share(half[:, columns]).max(1) for half in (values[:, :count], values[:, count:]))
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


def _join_windows(lowered: np.ndarray, count: int) -> list[tuple[int, int]]:
    """Return WINDOW_REACH intervals on either side of each of some of `count` intervals, joined where they overlap."""
    gaps = np.flatnonzero(np.diff(lowered) > 2 * WINDOW_REACH)
    starts = lowered[np.append(0, gaps + 1)]
    lasts = lowered[np.append(gaps, len(lowered) - 1)]
    return [
        (max(0, int(start) - WINDOW_REACH), min(count, int(last) + 1 + WINDOW_REACH))
        for start, last in zip(starts, lasts, strict=True)
    ]


def solve_windows(peaks: Peaks, solution: Minimum) -> Array:
    """Return the columns (4, N) of a solution, solved again in windows until no peaks are left, or a window fails."""
    posed = peaks.posed
    columns = posed.columns(solution.states, solution.controls)
    values = np.empty(posed.rows.low.shape)
    for _ in range(MAX_ROUNDS):
        if not peaks.windows:
            break
        better = columns.copy()
        for first, after in peaks.windows:
            window = _solve_window(peaks.problem, columns, first, after)
            if isinstance(window, MotionError):
                return columns
            better[:, first:after] = window
        columns = better
        states, controls = solution.states.copy(), np.ascontiguousarray((columns[2:] / posed.unit[2:, None]).T)
        states[:-1] = (columns[:2] / posed.unit[:2, None]).T
        evaluate(posed.stages, posed.rows, states, controls, values)
        peaks(states, controls, values)
    return columns


def _solve_window(problem: Problem, columns: Array, first: int, after: int) -> Array | MotionError:
    """Return the columns of some intervals, solved between the states that the run has at their ends."""
    start, end = problem.ends
    if first > 0:
        start = EndCondition(*columns[:2, first].tolist())
    if after < problem.intervals:
        end = EndCondition(*columns[:2, after].tolist())
    part = replace(problem.part(slice(first, after)), ends=(start, end))
    posed = pose_stages(part, columns[:, first:after])
    solution = try_starts(posed, ("near",))
    if isinstance(solution, MotionError):
        return solution
    return posed.columns(solution.states, solution.controls)
