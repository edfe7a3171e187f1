"""The goal "constant speed": segments at the constant tool speeds that they state, the rest
fastest.

A segment is at its constant speed from end to end wherever it is joined without a stop: the ramp
lies in the neighbour, where that may be as fast as it can. Of two constant speeds the ramp lies in
the faster segment, because each is its segment's cap as well. Where the motion comes from rest, or
from a slower segment, the ramp lies in its own segment.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Limit
from planner.limits.tool import ToolSpeed
from planner.path.actuation import ActuatorPath
from planner.place import ConstantRefused, Infeasible
from planner.timing.attempts import solve_run
from planner.timing.certify_loop import RunCertifier
from planner.timing.goals.constant_speed_errors import speed_error
from planner.timing.goals.constant_stretch import (
    joined_speed_error,
    refuse_excess,
    solve_constant_stretch,
)
from planner.timing.grid import Task
from planner.timing.problem import EndCondition, Run
from planner.timing.solution import IN_PARTS, MADE_CONSTANT_SPEED, RunSolution
from planner.timing.tighten import tighten_parts, tighten_run

# Slower speeds that are tried in turn where one is refused, as shares of the one that the last
# refusal gives: it knows the limits at grid points only.
SPEED_SHARES = (0.9995, 0.999, 0.998, 0.995)


@dataclass(frozen=True, slots=True)
class ConstantSpeed:
    """The fastest motion at the constant speeds that segments state.

    instead  speeds of pieces that replace those of their segments
    """

    instead: Mapping[int, float] = field(default_factory=dict)
    uniform: bool = True

    def solve(self, task: Task) -> RunSolution:
        """Solve a run in parts, one for each speed.

        Infeasible where a constant speed is not possible, or where the part before or after cannot
        reach it; with a speed that was proved to be possible, if one was found.
        """
        solution = self._solve_parts(task)
        refusal = solution.refusal
        if not isinstance(refusal, ConstantRefused) or self.instead:
            return solution
        slower = self._find_slower_speed(task, refusal)
        if slower is None:
            return solution
        return RunSolution.refused(refusal.add_possible_speed(slower))

    def tighten(self, task: Task, solution: RunSolution, use: Mapping[str, Array]) -> RunSolution:
        """Tighten each part that exceeds a limit by itself."""
        if solution.maker == MADE_CONSTANT_SPEED:
            return refuse_excess(task, solution, use)
        if solution.maker != IN_PARTS:
            return tighten_run(task, solution, use)
        return tighten_parts(solution, use, partial(self._tighten_part, task))

    def _tighten_part(
        self,
        task: Task,
        part: RunSolution,
        use: Mapping[str, Array],
    ) -> RunSolution:
        """Tighten one part. A ramp between given speeds is refused with its place."""
        tightened = self.tighten(task, part, use)
        if tightened.status in ("stopped", "too fast"):
            return RunSolution.refused(_ramp_error(task.path, part, tightened))
        return tightened

    def _find_stated(self, path: ActuatorPath, piece: int) -> float | None:
        """Return the constant speed of a piece, if there is one."""
        return self.instead.get(piece, path.constant(piece))

    def _solve_parts(self, task: Task) -> RunSolution:
        """Solve the parts of a run in which the stated speed is one."""
        blocks = self._split(task)
        stated = [self._find_stated(task.path, block.run.first) for block in blocks]
        if stated == [None]:
            return solve_run(task)
        refusal = self._refuse_speeds(blocks, stated)
        if refusal is not None:
            return RunSolution.refused(refusal)
        parts: dict[int, Sequence[RunSolution]] = {}
        # constant speeds first: whether they are possible shows soon
        in_order = sorted(zip(blocks, stated, strict=True), key=lambda each: each[1] is None)
        for block, speed in in_order:
            if speed is None:
                solutions: Sequence[RunSolution] = [solve_run(block)]
            else:
                solutions = solve_constant_stretch(block, speed)
            refusal = solutions[0].refusal
            if refusal is not None:
                return RunSolution.refused(_end_speed_error(block, task.run, speed, refusal))
            parts[block.run.first] = solutions
        joined = [solution for block in blocks for solution in parts[block.run.first]]
        return RunSolution.joined(joined, IN_PARTS)

    def _split(self, task: Task) -> list[Task]:
        """Split a run where the stated speed changes, at the largest speed that both sides
        allow.
        """
        run = task.run
        pieces = range(run.first, run.last + 1)
        stated = [self._find_stated(task.path, piece) for piece in pieces]
        neighbours = zip(pieces[1:], pairwise(stated), strict=True)
        changes = [after for after, (one, other) in neighbours if one != other]
        if not changes:
            return [task]
        # a constant speed is one of the tool's caps
        (caps,) = (limit.caps for limit in task.limits if isinstance(limit, ToolSpeed))
        inner = [EndCondition(float(caps[[piece - 1, piece]].min())) for piece in changes]
        starts = pairwise([run.first, *changes, run.last + 1])
        ends = pairwise([run.ends[0], *inner, run.ends[1]])
        plain = replace(run, since=None, until=None, continuation=None, whole=True)
        return [
            task.with_run(replace(plain, first=first, last=after - 1, ends=both))
            for (first, after), both in zip(starts, ends, strict=True)
        ]

    def _refuse_speeds(
        self,
        blocks: Sequence[Task],
        stated: Sequence[float | None],
    ) -> MotionError | None:
        """Return why a stated speed is not possible where parts meet."""
        for block, speed in zip(blocks, stated, strict=True):
            refusal = None if speed is None else joined_speed_error(block, speed)
            if refusal is not None:
                return refusal
        for before, after in pairwise(blocks):
            sides = np.array([before.run.last, after.run.first])
            s = after.path.breaks[[after.run.first, after.run.first]]
            refusal = speed_error(after, (s, sides), after.run.speeds[0])
            if refusal is not None:
                return refusal
        return None

    def _find_slower_speed(self, task: Task, refusal: ConstantRefused) -> float | None:
        """Return a speed in place of the refused one at which the run is proved."""
        path = task.path
        pieces = range(task.run.first, task.run.last + 1)
        changed = [piece for piece in pieces if path.constant(piece) == refusal.requested]
        speed = refusal.possible
        for share in SPEED_SHARES:
            speed *= share
            if not changed or speed <= 0:
                return None
            goal = ConstantSpeed(dict.fromkeys(changed, speed))
            capped = _cap_tool_speed(task.limits, changed, speed)
            outcome = RunCertifier(path, capped, task.order, goal)([task.run])
            if not isinstance(outcome, MotionError):
                # a proof that fails by rounding fails at every speed
                holds = all(np.max(use) <= 1 for use in outcome[0].known.use.values())
                return speed if holds else None
            if isinstance(outcome, ConstantRefused):
                if outcome.requested != speed:
                    return None
                speed = min(speed, outcome.possible)
        return None


def _cap_tool_speed(
    limits: Sequence[Limit],
    pieces: Sequence[int],
    speed: float,
) -> tuple[Limit, ...]:
    """Return the limits with the tool no faster than a speed on some pieces."""
    capped: list[Limit] = []
    for limit in limits:
        if isinstance(limit, ToolSpeed):
            caps = np.array(limit.caps)
            caps[pieces] = np.minimum(caps[pieces], speed)
            capped.append(ToolSpeed(caps).lower(limit.shares))
        else:
            capped.append(limit)
    return tuple(capped)


def _ramp_error(path: ActuatorPath, ramp: RunSolution, tightened: RunSolution) -> MotionError:
    """Return the refusal of a ramp between given speeds, with its place."""
    place = path.place(ramp.profile.s[0], ramp.profile.piece[0])
    remedy = 'lower the adjacent constant speed, or write join = "stop" between the segments'
    error = MotionError(f"the ramp from {place}: {tightened.refusal}: {remedy}")
    return error.in_segment(place.segment)


def _end_speed_error(
    task: Task,
    run: Run,
    speed: float | None,
    error: MotionError,
) -> MotionError:
    """Return the refusal of a part that cannot begin or end at its neighbour's constant speed."""
    block = task.run
    kind = error.kind if isinstance(error, Infeasible) else ""
    if kind in ("start speed", "") and block.first > run.first:
        end = 0
        piece = block.first
        direction = "from"
        neighbour = "before"
    elif kind in ("end speed", "") and block.last < run.last:
        end = -1
        piece = block.last
        direction = "to"
        neighbour = "after"
    else:
        return error
    path = task.path
    place = path.place(block.breaks(path)[end], piece)
    joint_speed = block.speeds[end]
    if speed == joint_speed:
        reason = (
            f"segment {place.segment} is at its constant speed where it joins the segment {neighbour} "
            f"it without a stop, and no motion {direction} that speed was found in it"
        )
    else:
        reason = (
            f"the ramp {direction} the constant speed of the segment {neighbour} lies in segment "
            f"{place.segment}, joined to it without a stop"
        )
    remedy = f'{reason}: lower that speed, or write join = "stop" between the two'
    if not isinstance(error, Infeasible):
        return MotionError(f"{place}: {error}; {remedy}").in_segment(place.segment)
    return ConstantRefused(
        "constant speed",
        error.axis,
        place,
        error.value,
        error.limit,
        error.unit,
        remedy,
        requested=joint_speed,
        possible=error.limit / 1e3,
    )
