"""A problem with rows in ṡ beside others, from inside: rows in ṡ² alone that keep it, exact at a given motion.

ṡ lies below its tangent in x = ṡ² and above its chord from 0,  x/V ≤ ṡ ≤ v/2 + x/(2v)  for ṡ ≤ V, so a row that is kept
with either in its place is kept. A solution keeps the rows taken around it: solved again and again, motions only become
faster.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from kinematics.array import Array
from planner.limits.limit import Term
from planner.timing.problem import Block, Problem

# Share of the room that a row is given at rest at least: what holds still may not leave less.
LEAST = 1e-3


def straight(problem: Problem) -> bool:
    """Whether the rows are linear in s̈ and ṡ² already, or say how large ṡ may be by itself."""
    return problem.settled and not any(_mixed(block) for block in problem.blocks)


def inner(problem: Problem, speed: Array | None = None, highest: Array | None = None) -> Problem:
    """Rows in {1, ṡ², s̈} that keep the problem's, and ṡ ≤ `highest` (N+1,) where that is given.

    speed (N+1,) of a motion at which they are exact; without, the machine can at least start from rest.
    """
    count = problem.intervals
    still = np.zeros(count + 1)
    known = still if speed is None else speed
    blocks = []
    for block in problem.around(known[:-1], known[1:]).blocks:
        if not _mixed(block):
            blocks.append(block)
            continue
        tangents, chords = [], []
        for side, part, last in ((block.start, slice(None, -1), 0), (block.end, slice(1, None), -1)):
            drop = side[Term.SD].copy()
            if known[last] == 0:  # the run rests there, whatever the motion
                drop[last] = 0.0
            if speed is None:
                room = np.maximum(block.room[:, None] - np.abs(side.get(Term.ONE, 0.0)), LEAST)
                touched = room / np.where(drop != 0, np.abs(drop), 1.0)
            else:
                touched = np.where(speed[part] > 0, speed[part], 1.0)[:, None]
            tangents.append(_with(side, drop * touched / 2, drop / (2 * touched)))
            chords.append(_with(side, 0.0 * drop, drop / (np.inf if highest is None else highest[part, None])))
        blocks += [replace(block, start=start, end=end) for start, end in (tangents, chords)]
    if highest is not None:
        slope = 1 / highest[:, None]
        blocks.append(Block("inner", {Term.SD: slope[:-1]}, {Term.SD: slope[1:]}, np.ones(count), np.zeros(1)))
    return replace(problem, blocks=tuple(blocks))


def _mixed(block: Block) -> bool:
    return Term.SD in block.start and len(block.start) > 1


def _with(side: Mapping[Term, Array], one: Array, square: Array) -> dict[Term, Array]:
    found: dict[Term, Array] = {term: values for term, values in side.items() if term is not Term.SD}
    return found | {Term.ONE: side.get(Term.ONE, 0.0) + one, Term.SD2: side.get(Term.SD2, 0.0) + square}
