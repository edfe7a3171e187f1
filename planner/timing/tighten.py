"""Solving a run again with less room where its motion exceeded a limit.

Solvers keep limits on grid points. A motion that exceeds a limit by a share e in an interval gets
that much less room there and is solved again; what little remains goes by slowing it as a whole.
`tighten_until_kept` does that by sampled use; `planner.timing.certify_loop` and the goals use the
other functions with proved use.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import is_

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Limit
from planner.timing.grid import Task, cut_intervals
from planner.timing.order2.second_order import second_order
from planner.timing.order3.solve import solve_jerk_limited
from planner.timing.problem import Block, Problem
from planner.timing.rows import leave_out_idle
from planner.timing.sampling import MIN_WATCHED_USE, sample_limit_use
from planner.timing.solution import CRUISE, RunSolution

# Room taken off, as a multiple of the excess and of the number of tries: more each time, since a
# peak between grid points heeds the room only in part.
EXCESS_FACTOR = 1.1
# Excess that is a solver's tolerance.
SOLVER_MARGIN = 2e-7
# Number of times that a run is solved before it is slowed instead.
MAX_TRIES = 6
# Excess from which an interval is cut in CUT_PARTS in the second try. Later tries cut from a
# smaller excess on: it then lies between grid points, where less room does not help.
MIN_CUT_EXCESS = 1.03
MIN_LATE_CUT_EXCESS = 1.0003
CUT_PARTS = 4
# Excess up to which the next answer is very near the last.
MIN_NEAR_EXCESS = 1 + 1e-3
# Samples may miss this much of a peak of a jerk-limited motion.
UNSEEN_EXCESS = 1 + 2e-6
# A motion that needs no more slowness than this is slowed: solving again would gain less.
MAX_CHEAP_SLOWNESS = 1 + 3e-5


def required_slowness(limits: Sequence[Limit], use: Mapping[str, Array]) -> float:
    """Return how many times slower a motion with this use must be to keep all limits."""
    known = [limit for limit in limits if limit.name in use]
    return max(limit.slowness(float(use[limit.name].max())) for limit in known)


def tighten_until_kept(
    task: Task,
    solution: RunSolution,
) -> RunSolution:
    """Tighten a motion until samples show no limit exceeded.

    Loads for which the problem has no rows are far from their limits and left to the proof.
    """
    watched = list(task.limits)
    if solution.problem is not None:
        watched = leave_out_idle(task.limits, solution.problem)
    while solution.solved and solution.tries < MAX_TRIES:
        use = solution.use or sample_limit_use(task.path, watched, solution.profile)
        aimed_use = solution.relate_use(use)
        slowness = required_slowness(watched, aimed_use)
        most = {name: values.max() for name, values in aimed_use.items()}
        watched = [limit for limit in watched if most.get(limit.name, 0.0) > MIN_WATCHED_USE]
        if slowness <= 1 + SOLVER_MARGIN:
            break
        if solution.order_2_solver is None:
            slowness *= UNSEEN_EXCESS
        before = solution
        solution = _tighten_part(task, solution, aimed_use, slowness)
        if solution.problem is before.problem:  # it was slowed as a whole
            break
    return solution


def tighten_run(
    task: Task,
    solution: RunSolution,
    use: Mapping[str, Array],
) -> RunSolution:
    """Tighten each part of a motion that exceeds a limit. use (M,): of each time piece."""
    if solution.parts:
        return tighten_parts(solution, use, partial(tighten_run, task))
    aimed_use = solution.relate_use(use)
    slowness = required_slowness(task.limits, aimed_use)
    return _tighten_part(task, solution, aimed_use, slowness)


def tighten_parts(
    solution: RunSolution,
    use: Mapping[str, Array],
    tighten: Callable[[RunSolution, Mapping[str, Array]], RunSolution],
) -> RunSolution:
    """Tighten the parts of a joined motion that exceed a limit; the same motion if none can
    change.
    """
    parts = []
    first = 0
    for part in solution.parts:
        last = first + len(part.profile.h)
        part_use = {name: values[first:last] for name, values in use.items()}
        exceeds = max(map(np.max, part_use.values())) > 1
        parts.append(tighten(part, part_use) if exceeds else part)
        first = last
    if all(map(is_, parts, solution.parts)):
        return solution
    return RunSolution.joined(parts, solution.maker)


def _tighten_part(
    task: Task,
    part: RunSolution,
    use: Mapping[str, Array],
    slowness: float,
) -> RunSolution:
    """Solve again with less room, or slow a motion from rest to rest where that gains more."""
    if part.maker == CRUISE:
        return RunSolution.refused(MotionError("the capped tool speed exceeds another limit"))
    pays = slowness > MAX_CHEAP_SLOWNESS and part.tries < MAX_TRIES
    if part.can_be_solved_again and (pays or part.has_end_speed):
        solution = _solve_again(task, part, use)
        if solution.solved:
            return replace(
                solution,
                lower_estimate=part.lower_estimate,
                tries=part.tries + 1,
            )
        if part.has_end_speed:
            return solution
    if part.has_end_speed:
        start = float(part.profile.v[0])
        end = max(part.profile.last_speed, 0.0)
        return RunSolution.refused(
            MotionError(
                f"no motion from {start:.6g} to {end:.6g} along the path was found "
                "that respects every limit; use slower end speeds"
            )
        )
    return part.slowed(slowness)


def _solve_again(
    task: Task,
    part: RunSolution,
    use: Mapping[str, Array],
) -> RunSolution:
    """Solve again with less room, on a finer grid where less room did not help."""
    assert part.problem is not None
    tighter = lower_rooms(part.problem, use, part.tries)
    if part.order_2_solver is not None:
        return second_order(tighter, solver=part.order_2_solver)
    excess = np.max([use[block.name] for block in tighter.blocks if block.name in use], axis=0)
    guess = part.profile.columns()
    least = MIN_LATE_CUT_EXCESS if part.tries > 2 else MIN_CUT_EXCESS
    if part.tries > 1 and excess.max() > least:
        count = np.where(excess > least, CUT_PARTS, 1)
        tighter = cut_intervals(task.path, task.limits, tighter, count)
        guess = part.profile.on(tighter.s)
    is_near = excess.max() <= MIN_NEAR_EXCESS
    return solve_jerk_limited(tighter, guess, "nearer" if is_near else "near")


def lower_rooms(problem: Problem, use: Mapping[str, Array], tries: int) -> Problem:
    """Return the problem with less room where a limit was exceeded. use (N,): of each interval."""
    blocks = tuple(
        # rows that are no limit's have no use
        _lower_room(block, use[block.name], tries) if block.name in use else block
        for block in problem.blocks
    )
    return replace(problem, blocks=blocks)


def _lower_room(block: Block, excess: Array, tries: int) -> Block:
    """Take the excess (N,) off the room, off the part of it that holding still does not use."""
    taken = EXCESS_FACTOR * tries * (excess - 1) / (1 - block.holding_use)
    lowered = block.aimed((1 - SOLVER_MARGIN) / (1 + taken))
    room = np.where(excess > 1 + SOLVER_MARGIN, lowered.room, block.room)
    return replace(block, room=room)
