"""An estimate of the least time that a run can take: a motion of order 2 on ever finer grids."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planner.limits.force import TorqueSpeed
from planner.limits.limit import Limit, order_of
from planner.limits.resonance import Resonance
from planner.timing.ends import TooFast
from planner.timing.problem import SOLVER_AIM, Block, Problem
from planner.timing.profile import Profile
from planner.timing.solvers.second_order import TERMS, second_order


def floor(problem: Problem, fastest: Profile | None = None) -> float:
    """The order-2 duration without rows of jerk, on intervals of no length: 2 T(N) − T(N/2), as errors go with 1/N.

    Fewer limits take no longer, and no longer does the least concave limit around one that is not; so it bounds every
    motion of the run from below, but for what the extrapolation is off: an estimate, not a proof. Under limits smaller
    by a factor a motion is at most longer by its inverse, so AIM times what it takes is below that of the limits.
    fastest: the order-2 motion of a problem without such rows, where it is known.
    """
    blocks = [block if block.hull is None else block.hull for block in problem.blocks if set(block.start) <= TERMS]
    relaxed = replace(problem, blocks=tuple(block for block in blocks if block.about is None))
    finer = SOLVER_AIM * (second_order(relaxed) if fastest is None or not problem.settled else fastest).duration
    try:
        return 2 * finer - SOLVER_AIM * second_order(_halve_grid(relaxed)).duration
    except TooFast:  # a speed at an end that the coarser grid only just leaves no room for
        return finer


def left_out(limits: Sequence[Limit]) -> tuple[str, ...]:
    """What the estimate knows nothing of, or less than there is: it may lie below the least time by what that costs."""
    found = ["jerk"] if order_of(limits) == 3 else []
    for limit in limits:
        if isinstance(limit, TorqueSpeed):
            found.append("of torque-speed curves, what is not concave")
        if isinstance(limit, Resonance) and limit.bands:
            found.append("how long an axis may stay in a resonance band")
    return tuple(found)


def _halve_grid(problem: Problem) -> Problem:
    """On every other grid point."""
    first = np.arange(0, problem.intervals, 2)
    last = np.minimum(first + 1, problem.intervals - 1)
    blocks = [
        Block(
            block.name,
            {term: values[first] for term, values in block.start.items()},
            {term: values[last] for term, values in block.end.items()},
            np.minimum(block.room[first], block.room[last]),
            block.middle,
        )
        for block in problem.blocks
    ]
    return replace(
        problem, s=np.append(problem.s[first], problem.s[-1]), piece=problem.piece[first], blocks=tuple(blocks)
    )
