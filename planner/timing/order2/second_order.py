"""Time-optimal motion under limits on speed and acceleration: two passes of our own, or toppra as a second opinion.

An estimate of the least time that any motion can take comes with it.

Both solvers take rows in ṡ² alone. A problem with rows in ṡ beside other terms is therefore solved from inside: its
rows are replaced by rows in ṡ² that are stricter, and equal to them at a given motion.

ṡ lies below its tangent in x = ṡ² and above its chord from 0,  x/V ≤ ṡ ≤ v/2 + x/(2v)  for ṡ ≤ V, so a row that is kept
with either in its place is kept. A solution keeps the rows taken around it: solved again and again, motions only become
faster.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Term
from planner.timing.order2 import passes
from planner.timing.order2 import toppra_ as toppra_adapter
from planner.timing.problem import SOLVER_AIM, Block, Problem, Solver
from planner.timing.profile import Profile
from planner.timing.solution import RunSolution, TooFast

# Share of the room that a row is given at rest at least: what holds still may not leave less.
MIN_ROOM = 1e-3


def has_linear_rows(problem: Problem) -> bool:
    """Whether the rows are linear in s̈ and ṡ² already, or say how large ṡ may be by itself."""
    return problem.is_unconditional and not any(_has_mixed_terms(block) for block in problem.blocks)


def inner_approximation(problem: Problem, speed: Array | None = None, highest: Array | None = None) -> Problem:
    """Rows in {1, ṡ², s̈} that keep the problem's, and ṡ ≤ `highest` (N+1,) where that is given.

    speed (N+1,) of a motion at which they are exact; without, the machine can at least start from rest.
    """
    count = problem.intervals
    still = np.zeros(count + 1)
    known = still if speed is None else speed
    blocks = []
    for block in problem.around(known[:-1], known[1:]).blocks:
        if not _has_mixed_terms(block):
            blocks.append(block)
            continue
        tangents, chords = [], []
        for side, part, last in ((block.start, slice(None, -1), 0), (block.end, slice(1, None), -1)):
            drop = side[Term.SD].copy()
            if known[last] == 0:  # the run rests there, whatever the motion
                drop[last] = 0.0
            if speed is None:
                room = np.maximum(block.room[:, None] - np.abs(side.get(Term.ONE, 0.0)), MIN_ROOM)
                touched = room / np.where(drop != 0, np.abs(drop), 1.0)
            else:
                touched = np.where(speed[part] > 0, speed[part], 1.0)[:, None]
            tangents.append(_add_terms(side, drop * touched / 2, drop / (2 * touched)))
            chords.append(_add_terms(side, 0.0 * drop, drop / (np.inf if highest is None else highest[part, None])))
        blocks += [replace(block, start=start, end=end) for start, end in (tangents, chords)]
    if highest is not None:
        slope = 1 / highest[:, None]
        blocks.append(Block("inner", {Term.SD: slope[:-1]}, {Term.SD: slope[1:]}, np.ones(count), np.zeros(1)))
    return replace(problem, blocks=tuple(blocks))


def _has_mixed_terms(block: Block) -> bool:
    return Term.SD in block.start and len(block.start) > 1


def _add_terms(side: Mapping[Term, Array], one: Array, square: Array) -> dict[Term, Array]:
    found: dict[Term, Array] = {term: values for term, values in side.items() if term is not Term.SD}
    return found | {Term.ONE: side.get(Term.ONE, 0.0) + one, Term.SD2: side.get(Term.SD2, 0.0) + square}


# Growth of ṡ² that each round allows anywhere, so that the chords close in; rounds end where one gains
# less than MIN_ROUND_GAIN.
SPEED_GROWTH, MIN_ROUND_GAIN = (8.0, 3.0, 1.0, 0.5, 0.25, 0.1, 0.05, 0.02, 0.01, 0.005), 1e-7
TERMS = frozenset({Term.ONE, Term.SD, Term.SD2, Term.SDD})


def second_order(problem: Problem, *, solver: Solver = "passes") -> RunSolution:
    """The fastest motion with s̈ constant on each interval, every row kept at both ends of every interval.

    With x = ṡ² and u = s̈, x grows by 2 u Δs over an interval, so a row a u + b x + c at its end is (a + 2 Δs b) u + b
    x + c at its start: that is the interpolation scheme, with the derivatives of the interval's own side at both ends.
    Lengths and times are scaled so that x and u are about one. Rows in ṡ beside others are kept from inside, in rounds
    around the fastest motion yet. A speed at an end that cannot be is too fast; where nothing gets through, it stops.
    """
    linear, highest = has_linear_rows(problem), None
    best = RunSolution.refused(MotionError("not solved yet"))
    for growth in (0.0, *SPEED_GROWTH):
        if not best.solved:
            posed = problem if linear else inner_approximation(problem)
        else:
            v = best.profile.v
            speed = np.append(v, best.profile.last_speed if problem.free[1] else problem.speeds[1])
            reach = np.sqrt(1 + growth) * np.where(speed > 0, speed, speed.max())
            highest = reach if highest is None else np.minimum(highest, reach)
            posed = inner_approximation(problem, speed, highest)
        rows, ceiling, step, ends, unit = _scale(posed)
        if solver == "toppra":
            x = toppra_adapter.largest_speeds(rows, ceiling, step, ends)
        else:
            x = passes.largest_speeds(rows, ceiling, step, ends, posed.free)
        if isinstance(x, MotionError) or (x[1:] + x[:-1] <= 0).any():
            # in a later round, rounding closed what the motion at hand had left
            return best if best.solved else RunSolution.refused(_stopped(posed, x))
        profile = _profile(posed, np.sqrt(x) * unit, solver)
        gained = 1 - profile.duration / best.duration if best.solved else 1.0
        if gained > 0:
            best = RunSolution("solved", profile, maker=solver, problem=problem)
        if linear or gained < MIN_ROUND_GAIN:
            break
    return best


def _scale(problem: Problem) -> tuple[list[Array], Array, Array, tuple[float, float], float]:
    """Rows, ceiling, steps and x at both ends, lengths and times scaled so that all are about one; the unit of ṡ."""
    length = float(problem.s[-1] - problem.s[0])
    time = _time_scale(problem, length)
    step = np.diff(problem.s) / length
    rows, ceiling = _rows(problem, step, length, time)
    unit = length / time
    first, last = problem.speeds
    return rows, ceiling, step, ((first / unit) ** 2, (last / unit) ** 2), unit


def _profile(problem: Problem, v: Array, solver: Solver) -> Profile:
    """The motion with the speeds v (N+1,) on the grid, those that are given at its ends."""
    first, last = problem.speeds
    if not (problem.free[0] and solver == "passes"):
        v[0] = first
    if not (problem.free[1] and solver == "passes"):
        v[-1] = last
    h = 2 * np.diff(problem.s) / (v[1:] + v[:-1])
    return Profile(problem.s[:-1], v[:-1], np.diff(v) / h, np.zeros(len(h)), h, problem.piece)


def _stopped(problem: Problem, x: Array | MotionError) -> MotionError:
    """Why there is no motion: the speed at an end that is too fast, or where nothing gets through."""
    if isinstance(x, MotionError):
        return x
    rows, ceiling, step, ends, unit = _scale(problem)
    for end, largest in enumerate(passes.largest_ends(rows, ceiling, step, ends) if max(ends) > 0 else ()):
        if ends[end] > largest:
            return TooFast(end, problem.speeds[end], float(np.sqrt(largest)) * unit)
    return MotionError(
        f"no motion gets past s = {problem.s[int(np.argmax(x[1:] + x[:-1] <= 0))]:.6g}; "
        "check for a limit that allows no motion there, or a path that stops"
    )


def _time_scale(problem: Problem, length: float) -> float:
    """A time in which the run could roughly be done."""
    slowest = [1e-9]
    for block in problem.blocks:
        for term, values in block.start.items():
            size = np.abs(values).max(1).mean()
            if term is Term.SD:
                slowest.append(size * length)
            elif term in (Term.SDD, Term.SD2):
                slowest.append(float(np.sqrt(size * length * (length if term is Term.SD2 else 1.0))))
    return max(slowest)


def _rows(problem: Problem, step: Array, length: float, time: float) -> tuple[list[Array], Array]:
    """([a, b, c] each (N+1, rows) with |a u + b x + c| ≤ 1, and the largest x (N+1,) that speed rows allow)."""
    ceiling = np.full(len(step) + 1, np.inf)
    parts: list[list[Array]] = [[], [], []]
    for block in problem.blocks:
        if set(block.start) == {Term.SD}:
            _lower_ceiling(ceiling, block, length / time, problem.free)
            continue
        for side, at_end in ((block.start, False), (block.end, True)):
            zero = np.zeros_like(next(iter(side.values())))
            share = block.room[:, None]
            b = side.get(Term.SD2, zero) * (length / time) ** 2 / share
            a = side.get(Term.SDD, zero) * length / time**2 / share + (2 * step[:, None] * b if at_end else 0.0)
            c = side.get(Term.ONE, zero) / share - block.middle
            for part, values in zip(parts, (a, b, c), strict=True):
                part.append(np.concatenate([values, values[-1:]]))
    return [np.concatenate(part, 1) for part in parts] if parts[0] else [], ceiling


def _lower_ceiling(ceiling: Array, block: Block, unit: float, free: tuple[bool, bool]) -> None:
    for side, points, given in ((block.start, slice(None, -1), 0), (block.end, slice(1, None), -1)):
        room = block.room.copy()
        if not free[given]:
            room[given] = 1.0  # speeds at the ends are not the solver's to choose
        slope = np.abs(side[Term.SD]).max(1) * unit
        with np.errstate(divide="ignore"):
            np.minimum(ceiling[points], (room / slope) ** 2, out=ceiling[points])


def estimate_lower_bound(problem: Problem, fastest: Profile | None = None) -> float | MotionError:
    """The order-2 duration without rows of jerk, on intervals of no length: 2 T(N) − T(N/2), as errors go with 1/N.

    Fewer limits take no longer, and no longer does the least concave limit around one that is not; so it bounds every
    motion of the run from below, but for what the extrapolation is off: an estimate, not a proof. Under limits smaller
    by a factor a motion is at most longer by its inverse, so EXACT_AIM times what it takes is below that of the limits.
    fastest: the order-2 motion of a problem without such rows, where it is known.
    """
    blocks = [block if block.hull is None else block.hull for block in problem.blocks if set(block.start) <= TERMS]
    relaxed = replace(problem, blocks=tuple(block for block in blocks if block.about is None))
    if fastest is None or not problem.is_unconditional:
        found = second_order(relaxed)
        if found.refusal is not None:
            return found.refusal
        fastest = found.profile
    finer = SOLVER_AIM * fastest.duration
    coarser = second_order(_halve_grid(relaxed))
    if coarser.status == "too fast":  # a speed at an end that the coarser grid only just leaves no room for
        return finer
    return 2 * finer - SOLVER_AIM * coarser.duration if coarser.refusal is None else coarser.refusal


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
