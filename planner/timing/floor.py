"""An estimate of the least time that a run can take: a motion of order 2 on ever finer grids."""

from dataclasses import replace

import numpy as np

from planner.timing.ends import TooFast
from planner.timing.problem import Block, Problem
from planner.timing.profile import Profile
from planner.timing.second_order import TERMS, second_order


def floor(problem: Problem, fastest: Profile | None = None) -> float:
    """The order-2 duration without rows of jerk, on intervals of no length: 2 T(N) − T(N/2), as errors go with 1/N.

    Fewer limits take no longer, so that it bounds every motion of the run from below, but for what the extrapolation
    is off: an estimate, not a proof. fastest: the order-2 motion of a problem without such rows, where it is known.
    """
    relaxed = replace(
        problem, blocks=tuple(block for block in problem.blocks if set(block.start) <= TERMS and block.about is None)
    )
    finer = (second_order(relaxed) if fastest is None or not problem.settled else fastest).duration
    try:
        return 2 * finer - second_order(_halved(relaxed)).duration
    except TooFast:  # a speed at an end that the coarser grid only just leaves no room for
        return finer


def _halved(problem: Problem) -> Problem:
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
