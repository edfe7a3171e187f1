"""Fastest motion under limits on speed and acceleration, by two passes (`passes`) or by toppra.

With x = ṡ² and u = s̈, constant on each interval, x grows by 2 u Δs. A row a u + b x + c at the end
of an interval is (a + 2 Δs b) u + b x + c at its start, so that rows are imposed at both ends of
each interval (the interpolation scheme of Pham and Pham), with the derivatives of its own side.

Rows with a term in ṡ next to others, as of viscous friction, are not linear in x. They are replaced
by stricter linear ones, since ṡ lies between its chord and its tangent:

    x/V ≤ ṡ ≤ v/2 + x/(2v)  for ṡ ≤ V.

These are exact at ṡ = v. Solved again around its own solution, a motion only becomes faster.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from kinematics.foundation.arrays import Array, largest_in_rows
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Term
from planner.timing.order2 import passes
from planner.timing.order2 import toppra_ as toppra_adapter
from planner.timing.problem import SOLVER_AIM, Block, Problem, Solver
from planner.timing.profile import Profile
from planner.timing.solution import RunSolution, TooFast

TERMS = frozenset({Term.ONE, Term.SD, Term.SD2, Term.SDD})
# Room that a row has at rest at least, as a share of its limit, for the first chords and tangents.
MIN_ROOM = 1e-3
# Growth of ṡ² that each round allows, so that the chords approach the solution; rounds end when one
# gains less than MIN_GAIN of the duration. With a first value of 10, or with every other value
# left out, random runs with friction take longer by 1e-5 to 1e-3.
SPEED_GROWTH = (100.0, 1.0, 0.1, 0.01, 0.001)
MIN_GAIN = 1e-7
# Least unit of time of a scaled problem, where hardly any row bounds it.
MIN_TIME = 1e-9
STARTS = slice(None, -1)
ENDS = slice(1, None)
SIDES = ((STARTS, 0), (ENDS, -1))
"""Grid points at which intervals start and end, and the end of the run among these."""


def second_order(problem: Problem, *, solver: Solver = "passes") -> RunSolution:
    """Find the fastest motion with s̈ constant on each interval; every row holds at both its ends.

    A speed at an end that is not possible is refused as too fast.
    """
    if not _has_linear_rows(problem):
        return _solve_in_rounds(problem, solver)
    rows, ceiling, unit = _scale(problem)
    s = problem.s
    step = np.diff(s) / (s[-1] - s[0])
    start, end = ((speed / unit) ** 2 for speed in problem.speeds)
    if solver == "toppra":
        x = toppra_adapter.largest_speeds(rows, ceiling, step, (start, end))
        if isinstance(x, MotionError):
            return RunSolution.refused(x)
    else:
        x = passes.largest_speeds(rows, ceiling, step, (start, end), problem.free)

    blocked = x[1:] + x[:-1] <= 0
    if blocked.any():
        if start + end > 0:
            largest = passes.largest_ends(rows, ceiling, step, (start, end))
            for number, possible in enumerate(largest):
                if (start, end)[number] > possible:
                    most = float(np.sqrt(possible)) * unit
                    return RunSolution.refused(TooFast(number, problem.speeds[number], most))
        return RunSolution.refused(_blocked_error(s[int(np.argmax(blocked))]))

    v = np.sqrt(x) * unit
    for number, point in enumerate((0, -1)):
        if solver == "toppra" or not problem.free[number]:
            v[point] = problem.speeds[number]  # exactly
    profile = follow_speeds(s, v, problem.piece)
    return RunSolution("solved", profile, maker=solver, problem=problem)


def follow_speeds(s: Array, v: Array, piece: np.ndarray) -> Profile:
    """Return the motion with ṡ = v (N+1,) on a grid and constant s̈ on each interval."""
    h = 2 * np.diff(s) / (v[1:] + v[:-1])
    a = np.diff(v) / h
    return Profile(s[:-1], v[:-1], a, np.zeros(len(h)), h, piece)


def _blocked_error(s: float) -> MotionError:
    return MotionError(
        f"no motion gets past s = {s:.6g}; check for a limit that allows no motion there, or a path that stops"
    )


def _scale(problem: Problem) -> tuple[Array, Array, float]:
    """Return a, b, c (3, N+1, m), the ceiling of x (N+1,) and the unit of ṡ.

    Lengths and times are scaled so that the run and its duration are about one.
    """
    length = float(problem.s[-1] - problem.s[0])
    unit = length / _estimate_time(problem, length)
    ceiling = np.full(problem.intervals + 1, np.inf)
    others: list[Block] = []
    for block in problem.blocks:
        if is_of_speed(block):
            _lower_ceiling(ceiling, block, unit, problem.free)
        else:
            others.append(block)

    count = 2 * sum(len(block.middle) for block in others)
    rows = np.zeros((3, problem.intervals + 1, max(count, 1)))
    a, b, c = rows[:, STARTS]
    ahead = 2 * np.diff(problem.s)[:, None] / length
    first = 0
    for block in others:
        share = 1 / block.room[:, None]
        for side, onward in zip(block.sides, (0.0, ahead), strict=True):
            columns = slice(first, first + len(block.middle))
            first = columns.stop
            if Term.SD2 in side:
                b[:, columns] = side[Term.SD2] * (share * unit**2)
            if Term.SDD in side:
                a[:, columns] = side[Term.SDD] * (share * unit**2 / length)
            a[:, columns] += onward * b[:, columns]
            c[:, columns] = side.get(Term.ONE, 0.0) * share - block.middle
    rows[:, -1] = rows[:, -2]
    return rows, ceiling, unit


def _estimate_time(problem: Problem, length: float) -> float:
    """Return a time in which the run could roughly be done: the longest by any one term."""
    times = [MIN_TIME]
    for block in problem.blocks:
        for term, values in block.start.items():
            size = float(largest_in_rows(np.abs(values)).mean())
            if term is Term.SD:
                times.append(size * length)
            elif term is Term.SD2:
                times.append(np.sqrt(size) * length)
            elif term is Term.SDD:
                times.append(np.sqrt(size * length))
    return max(times)


def _lower_ceiling(
    ceiling: Array,
    block: Block,
    unit: float,
    free: tuple[bool, bool],
) -> None:
    """Lower the ceiling of x by a limit on ṡ; a stated speed at an end may use the whole limit."""
    for number, (points, end) in enumerate(SIDES):
        room = block.room.copy()
        if not free[number]:
            room[end] = 1.0
        slope = largest_in_rows(np.abs(block.sides[number][Term.SD])) * unit
        with np.errstate(divide="ignore"):
            largest = (room / slope) ** 2
        ceiling[points] = np.minimum(ceiling[points], largest)


def _has_linear_rows(problem: Problem) -> bool:
    """Return whether rows bound ṡ by itself, or are linear in s̈ and ṡ², at every speed."""
    return problem.is_unconditional and not any(_is_mixed(block) for block in problem.blocks)


def is_of_speed(block: Block) -> bool:
    """Return whether a limit bounds ṡ by itself."""
    return set(block.start) == {Term.SD}


def _is_mixed(block: Block) -> bool:
    """Return whether rows have a term in ṡ next to others."""
    return Term.SD in block.start and len(block.start) > 1


def _solve_in_rounds(problem: Problem, solver: Solver) -> RunSolution:
    """Solve with linear rows around the fastest motion yet, until the gain is negligible."""
    best = second_order(_linearise(problem), solver=solver)
    highest = np.full(problem.intervals + 1, np.inf)
    for growth in SPEED_GROWTH if best.solved else ():
        last = best.profile.last_speed if problem.free[1] else problem.speeds[1]
        speed = np.append(best.profile.v, last)
        reach = np.where(speed > 0, speed, speed.max())
        highest = np.minimum(highest, np.sqrt(1 + growth) * reach)
        faster = second_order(_linearise(problem, speed, highest), solver=solver)
        if not faster.solved:  # only by rounding: the motion at hand keeps these rows
            break
        gain = 1 - faster.duration / best.duration
        best = faster if gain > 0 else best
        if gain < MIN_GAIN:
            break
    return replace(best, problem=problem) if best.solved else best


def _linearise(
    problem: Problem,
    speed: Array | None = None,
    highest: Array | None = None,
) -> Problem:
    """Return stricter rows that are linear in s̈ and ṡ², for ṡ ≤ highest (N+1,).

    They are exact at a speed (N+1,). Without one, they at least let the machine start from rest.
    """
    count = problem.intervals
    v = np.zeros(count + 1) if speed is None else speed
    if highest is None:
        highest = np.full(count + 1, np.inf)
    slope = 1 / highest[:, None]
    reach = Block(
        "reach",
        {Term.SD: slope[STARTS]},
        {Term.SD: slope[ENDS]},
        np.ones(count),
        np.zeros(1),
    )
    blocks = [reach]
    for block in problem.around(v[STARTS], v[ENDS]).blocks:
        if not _is_mixed(block):
            blocks.append(block)
            continue
        tangents = []
        chords = []
        for side, (points, end) in zip(block.sides, SIDES, strict=True):
            factor = side[Term.SD].copy()
            if v[end] == 0:  # the run rests there, whatever the motion
                factor[end] = 0.0
            if speed is None:
                rest = np.abs(side.get(Term.ONE, 0.0))
                room = np.maximum(block.room[:, None] - rest, MIN_ROOM)
                touching = room / np.where(factor != 0, np.abs(factor), 1.0)
            else:
                touching = np.where(v > 0, v, 1.0)[points, None]
            one = factor * touching / 2
            tangents.append(_replace_speed(side, one, factor / (2 * touching)))
            chords.append(_replace_speed(side, 0.0 * one, factor * slope[points]))
        for starts, ends in (tangents, chords):
            blocks.append(replace(block, start=starts, end=ends))
    return replace(problem, blocks=tuple(blocks))


def _replace_speed(
    side: Mapping[Term, Array],
    one: Array,
    square: Array,
) -> dict[Term, Array]:
    """Return one side's coefficients with the term in ṡ replaced by one + square · ṡ²."""
    replaced = dict(side)
    del replaced[Term.SD]
    replaced[Term.ONE] = side.get(Term.ONE, 0.0) + one
    replaced[Term.SD2] = side.get(Term.SD2, 0.0) + square
    return replaced


def estimate_lower_bound(problem: Problem, fastest: Profile | None = None) -> float:
    """Estimate the least time (s) without jerk limits: 2 T(N) − T(N/2), as errors go with 1/N.

    An estimate, not a proof: the extrapolation has an error. Limits that depend on the speed are
    replaced by the least concave limit around them. Motions aim at SOLVER_AIM of the limits; with
    all of them a motion takes at least that share of its time. 0 where no motion is found.

    fastest  the order-2 motion of a problem without such limits, where it is known
    """
    blocks: list[Block] = []
    for block in problem.blocks:
        convex = block.convex_part or block
        if set(block.start) <= TERMS and convex.speed_range is None:
            blocks.append(convex)
    relaxed = replace(problem, blocks=tuple(blocks))
    if fastest is None or not problem.is_unconditional:
        fastest = second_order(relaxed).profile
    finer = SOLVER_AIM * fastest.duration
    coarser = second_order(_halve_grid(relaxed))
    if not coarser.solved:  # the finer grid only just leaves room for a speed at an end
        return finer
    return max(2 * finer - SOLVER_AIM * coarser.duration, 0.0)


def _halve_grid(problem: Problem) -> Problem:
    """Return the problem on every other grid point."""
    first = np.arange(0, problem.intervals, 2)
    last = np.minimum(first + 1, problem.intervals - 1)
    blocks: list[Block] = []
    for block in problem.blocks:
        start = {term: values[first] for term, values in block.start.items()}
        end = {term: values[last] for term, values in block.end.items()}
        room = np.minimum(block.room[first], block.room[last])
        blocks.append(Block(block.name, start, end, room, block.middle))
    return replace(
        problem,
        s=np.append(problem.s[first], problem.s[-1]),
        piece=problem.piece[first],
        blocks=tuple(blocks),
    )
