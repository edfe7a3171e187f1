"""A run in parts, each timed by itself: passages as fast as can be, and constant speeds with their ramps.

A segment is at its constant speed from its first place to its last wherever it is joined without a stop: the ramp lies
in the neighbour, where that is free to be as fast. Of two constant speeds the ramp lies in the faster: each is its
segment's cap as well. Where the motion comes from rest, or out of a slower segment, the ramp lies in its own segment.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import chain, pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Limit
from planner.limits.tool import ToolSpeed
from planner.path.actuation import ActuatorPath
from planner.place import ConstantRefused, Infeasible
from planner.timing.certified_run import MAX_CERTIFY_ROUNDS, RunCertifier, Timing, tighten_run
from planner.timing.constant_speed import (
    joined_speed_error,
    solve_constant_speed,
    speed_error,
    tighten_constant_speed,
)
from planner.timing.problem import EndCondition, Run
from planner.timing.profile import IN_PARTS, MADE_CONSTANT_SPEED, RunSolution
from planner.timing.run import solve_run

# Slower speeds that are tried where one is refused, each this share of what the last refusal left possible.
MAX_TRIALS, SPEED_SHARE = 4, 0.9995
AskedSpeeds = Mapping[int, float | None]
"""Of each piece of a run, the constant speed that is asked for, if any."""


def solve_in_parts(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int) -> RunSolution:
    """A run, in parts where its segments ask for constant speeds.

    Infeasible where a constant speed cannot be, or where the passage before or after it cannot reach it: with one that
    was proved to do, where one was found.
    """
    asked = {piece: path.constant(piece) for piece in range(run.first, run.last + 1)}
    found = _solve_parts(path, limits, run, order, asked)
    no = found.refusal
    if isinstance(no, ConstantRefused):
        slower = _find_slower_speed(path, limits, run, order, asked, no)
        return found if slower is None else RunSolution.refused(no.add_possible_speed(slower))
    return found


def tighten_in_parts(
    path: ActuatorPath, limits: Sequence[Limit], solution: RunSolution, use: Mapping[str, Array]
) -> RunSolution:
    """The parts that exceed a limit, each tightened by itself."""
    if solution.maker != IN_PARTS:
        tighten = tighten_constant_speed if solution.maker == MADE_CONSTANT_SPEED else tighten_run
        return tighten(path, limits, solution, use)
    parts: list[RunSolution] = []
    ends = np.cumsum([0, *(len(part.profile.h) for part in solution.parts)])
    for part, (a, b) in zip(solution.parts, pairwise(ends), strict=True):
        own = {name: values[a:b] for name, values in use.items()}
        found = tighten_in_parts(path, limits, part, own) if max(map(np.max, own.values())) > 1 else part
        if found.status in ("stopped", "too fast"):  # a ramp between given speeds, which does not know where it lies
            place = path.place(float(part.profile.s[0]), int(part.profile.piece[0]))
            remedy = 'lower the adjacent constant speed, or write join = "stop" between the segments'
            error = MotionError(f"the ramp from {place}: {found.refusal}: {remedy}")
            return RunSolution.refused(error.in_segment(place.segment))
        parts.append(found)
    return RunSolution.joined(parts, IN_PARTS)


def _find_slower_speed(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, asked: AskedSpeeds, no: ConstantRefused
) -> float | None:
    """A constant speed instead of the one refused, just below what is possible there, at which the run is proved."""
    speed = no.possible
    for _ in range(MAX_TRIALS):
        speed *= SPEED_SHARE
        instead = {piece: speed if one == no.requested else one for piece, one in asked.items()}
        changed = [piece for piece, one in asked.items() if one == no.requested]
        if not changed or speed <= 0:
            return None
        timing = Timing(partial(_solve_parts, order=order, asked=instead), tighten_in_parts)
        found = RunCertifier(path, _cap_tool_speed(limits, changed, speed), order, timing)([run])
        if isinstance(found, ConstantRefused):
            if found.requested != speed:
                return None
            speed = min(speed, found.possible)
        elif not isinstance(found, MotionError):
            (one,) = found
            if one.rounds < MAX_CERTIFY_ROUNDS and all(np.max(use) < np.inf for use in one.known.use.values()):
                return speed
    return None


def _cap_tool_speed(limits: Sequence[Limit], pieces: Sequence[int], speed: float) -> tuple[Limit, ...]:
    """The limits, with the tool no faster on some pieces."""
    slower: list[Limit] = []
    for limit in limits:
        if isinstance(limit, ToolSpeed):
            caps = np.array(limit.caps)
            caps[pieces] = np.minimum(caps[pieces], speed)
            slower.append(ToolSpeed(caps).lower(limit.shares))
        else:
            slower.append(limit)
    return tuple(slower)


def _solve_parts(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, asked: AskedSpeeds) -> RunSolution:
    """The run in parts, at the constant speeds asked for."""
    blocks = _split_blocks(limits, run, asked)
    if len(blocks) == 1 and asked[run.first] is None:
        return solve_run(path, limits, run, order)
    for block in blocks:
        speed = asked[block.first]
        no = None if speed is None else joined_speed_error(path, limits, block, order, speed)
        if no is not None:
            return RunSolution.refused(no)
    for before, after in pairwise(blocks):
        both = np.array([before.last, after.first])
        no = speed_error(path, limits, path.breaks[[after.first, after.first]], both, after.speeds[0])
        if no is not None:
            return RunSolution.refused(no)
    parts: dict[int, Sequence[RunSolution]] = {}
    # constant speeds first: why they cannot be is soon known
    for block in sorted(blocks, key=lambda block: asked[block.first] is None):
        speed = asked[block.first]
        if speed is None:
            found: Sequence[RunSolution] = [solve_run(path, limits, block, order)]
        else:
            found = solve_constant_speed(path, limits, block, order, speed)
        if found[0].refusal is not None:
            return RunSolution.refused(_end_speed_error(path, block, run, speed, found[0].refusal))
        parts[block.first] = found
    return RunSolution.joined([*chain(*(parts[block.first] for block in blocks))], IN_PARTS)


def _split_blocks(limits: Sequence[Limit], run: Run, asked: AskedSpeeds) -> list[Run]:
    """The parts of a run that ask for different speeds, each from and to the largest that both sides are allowed."""
    inner = range(run.first + 1, run.last + 1)
    starts = [run.first, *(piece for piece in inner if asked[piece] != asked[piece - 1]), run.last + 1]
    if len(starts) == 2:
        return [run]
    (caps,) = (limit.caps for limit in limits if isinstance(limit, ToolSpeed))  # a constant speed is one of them
    inner_ends = [EndCondition(float(caps[[k - 1, k]].min())) for k in starts[1:-1]]
    ends = [run.ends[0], *inner_ends, run.ends[1]]
    return [
        Run(first, after - 1, both, solver=run.solver, whole=True)
        for (first, after), both in zip(pairwise(starts), pairwise(ends), strict=True)
    ]


def _end_speed_error(path: ActuatorPath, block: Run, run: Run, own: float | None, no: MotionError) -> MotionError:
    """What to say where a part cannot be run from or to the constant speeds about it: which of them, and the remedy."""
    kind, joint = no.kind if isinstance(no, Infeasible) else "", block.speeds
    for kinds, joined, end, piece, words in (
        (("start speed", ""), block.first > run.first, 0, block.first, ("from", "before")),
        (("end speed", ""), block.last < run.last, -1, block.last, ("to", "after")),
    ):
        if kind in kinds and joined:
            place = path.place(float(block.breaks(path)[end]), piece)
            lies = (
                f"segment {place.segment} is at its constant speed where it joins the segment {words[1]} "
                f"it without a stop, and no motion {words[0]} that speed was found in it"
                if own == joint[end]
                else f"the ramp {words[0]} the constant speed of the segment {words[1]} lies in segment "
                f"{place.segment}, joined to it without a stop"
            )
            remedy = f'{lies}: lower that speed, or write join = "stop" between the two'
            if isinstance(no, Infeasible):
                told = "constant speed", no.axis, place, no.value, no.limit, no.unit, remedy
                return ConstantRefused(*told, requested=joint[end], possible=no.limit / 1e3)
            return MotionError(f"{place}: {no}; {remedy}").in_segment(place.segment)
    return no
