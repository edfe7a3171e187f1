"""What becomes of a motion that exceeds a limit: solved again with less room there, or slowed as a whole."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath
from planner.timing.problem import Block
from planner.timing.profile import AVERAGED, STRAIGHT, WITH_RESTS, RunSolution, sample_limit_use
from planner.timing.solvers.second_order import second_order
from planner.timing.solvers.third_order import solve_jerk_limited

# Room taken off: this share of the excess, more with every try, and a little for the solver's own tolerance.
EXCESS_FACTOR, SOLVER_MARGIN = 1.1, 2e-7
# How often a leg is solved before it is slowed instead.
MAX_TRIES = 5
# A motion that only so much slowness keeps from holding is slowed: solving again would cost more than it gains.
MAX_CHEAP_SLOWNESS = 1 + 3e-5


def required_slowness(limits: Sequence[Limit], use: Mapping[str, Array]) -> float:
    """How many times slower a motion that uses so much of the limits must be, to keep them all."""
    return max(limit.slowness(float(use[limit.name].max())) for limit in limits if limit.name in use)


def tighten_run(
    path: ActuatorPath, limits: Sequence[Limit], solution: RunSolution, use: Mapping[str, Array]
) -> RunSolution:
    """A motion that exceeds the limits less, each of its legs by itself. use (M,): of each time piece, per limit."""
    parts, first = [], 0
    for part in solution.parts or (solution,):
        last = first + len(part.profile.h)
        own = part.aimed({name: values[first:last] for name, values in use.items()})
        slowness, first = required_slowness(limits, own), last
        exceeds = slowness > 1 + SOLVER_MARGIN or not solution.parts
        parts.append(tighten_leg(part, own, slowness) if exceeds else part)
    return RunSolution.joined(parts, WITH_RESTS)


def tighten_until_kept(path: ActuatorPath, limits: Sequence[Limit], leg: RunSolution) -> RunSolution:
    """Solved again, or slowed where that costs next to nothing, until no limit is seen to be exceeded.

    A proof takes far longer than a look: most runs need one only.
    """
    while leg.solved and leg.tries < MAX_TRIES:
        use = leg.aimed(sample_limit_use(path, limits, leg.profile))
        slowness = required_slowness(limits, use)
        if slowness <= 1 + SOLVER_MARGIN:
            break
        before, leg = leg, tighten_leg(leg, use, slowness)
        if leg.problem is before.problem:  # slowed as a whole: that holds
            break
    return leg


def tighten_leg(leg: RunSolution, use: Mapping[str, Array], slowness: float) -> RunSolution:
    """Solved again with less room wherever a limit was found exceeded: use per limit and interval, as `aimed`.

    Where that does not help, or would cost more than it gains, the same motion slowed as a whole: what holds wherever
    anything does. Only a leg from rest to rest can be slowed: another is tried on.
    """
    problem, solved = leg.problem, leg.maker not in (AVERAGED, STRAIGHT) and leg.slowness == 1
    worth = leg.moving or (slowness > MAX_CHEAP_SLOWNESS and leg.tries < MAX_TRIES)
    if problem is not None and solved and worth:
        blocks = tuple(
            tighten_block(block, use[block.name], leg.tries) if block.name in use else block  # START is no limit
            for block in problem.blocks
        )
        tighter = replace(problem, blocks=blocks)
        if leg.maker in ("passes", "toppra"):
            found = second_order(tighter, solver="passes" if leg.maker == "passes" else "toppra")
        else:
            found = solve_jerk_limited(tighter, leg.profile.columns())
        if found.solved:
            return replace(found, bound=leg.bound, tries=leg.tries + 1)
        if leg.moving:
            return found
    if problem is not None and leg.moving:
        start, end = problem.speeds
        return RunSolution.refused(
            MotionError(
                f"no motion from {start:.6g} to {end:.6g} along the path was found "
                "that respects every limit; use slower end speeds"
            )
        )
    return leg.slowed(slowness)


def tighten_block(block: Block, excess: Array, tries: int) -> Block:
    """With less room where there was an excess (N,): of the part of it that holding still does not use."""
    less = block.aimed((1 - SOLVER_MARGIN) / (1 + EXCESS_FACTOR * tries * (excess - 1) / (1 - block.still)))
    return replace(block, room=np.where(excess > 1 + SOLVER_MARGIN, less.room, block.room))
