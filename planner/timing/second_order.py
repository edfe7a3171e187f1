"""Time-optimal motion under limits on speed and acceleration: two passes of our own, or toppra as a second opinion."""

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.limits.limit import Term
from planner.timing import passes, toppra_adapter
from planner.timing.ends import TooFast
from planner.timing.inner import inner, straight
from planner.timing.problem import Block, Problem, Solver
from planner.timing.profile import Profile

# Growth of ṡ² that each round allows anywhere, so that the chords close in; rounds end where one gains less than GAIN.
GROWTH, GAIN = (8.0, 3.0, 1.0, 0.5, 0.25, 0.1, 0.05, 0.02, 0.01, 0.005), 1e-7
TERMS = frozenset({Term.ONE, Term.SD, Term.SD2, Term.SDD})


def second_order(problem: Problem, *, solver: Solver = "passes") -> Profile:
    """The fastest motion with s̈ constant on each interval, every row kept at both ends of every interval.

    With x = ṡ² and u = s̈, x grows by 2 u Δs over an interval, so a row a u + b x + c at its end is (a + 2 Δs b) u + b
    x + c at its start: that is the interpolation scheme, with the derivatives of the interval's own side at both ends.
    Lengths and times are scaled so that x and u are about one. Rows in ṡ beside others are kept from inside, in rounds
    (planner.timing.inner). Raises TooFast where a speed at an end cannot be, MotionError where nothing gets through.
    """
    if straight(problem):
        return _solved(problem, solver)
    profile, highest = _solved(inner(problem), solver), None
    for growth in GROWTH:
        speed = np.append(profile.v, profile.last_speed if problem.free[1] else problem.speeds[1])
        reach = np.sqrt(1 + growth) * np.where(speed > 0, speed, speed.max())
        highest = reach if highest is None else np.minimum(highest, reach)
        try:
            faster = _solved(inner(problem, speed, highest), solver)
        except MotionError:  # rounding closed what the motion at hand had left
            break
        gained = 1 - faster.duration / profile.duration
        if gained > 0:
            profile = faster
        if gained < GAIN:
            break
    return profile


def _solved(problem: Problem, solver: Solver) -> Profile:
    length = problem.s[-1] - problem.s[0]
    time = _time_scale(problem, length)
    step = np.diff(problem.s) / length
    rows, ceiling = _rows(problem, step, length, time)
    unit = length / time
    first, last = problem.speeds
    ends = (first / unit) ** 2, (last / unit) ** 2
    if solver == "toppra":
        x = toppra_adapter.largest_speeds(rows, ceiling, step, ends)
    else:
        x = passes.largest_speeds(rows, ceiling, step, ends, problem.free)
    stuck = x[1:] + x[:-1] <= 0
    if stuck.any():
        for end, largest in enumerate(passes.largest_ends(rows, ceiling, step, ends) if max(ends) > 0 else ()):
            if ends[end] > largest:
                raise TooFast(end, problem.speeds[end], float(np.sqrt(largest)) * unit)
        raise MotionError(
            f"no motion gets past s = {problem.s[int(np.argmax(stuck))]:.6g}; "
            "check for a limit that leaves no room there, or a path that stands still"
        )
    v = np.sqrt(x) * unit
    if not (problem.free[0] and solver == "passes"):
        v[0] = first
    if not (problem.free[1] and solver == "passes"):
        v[-1] = last
    h = 2 * np.diff(problem.s) / (v[1:] + v[:-1])
    return Profile(problem.s[:-1], v[:-1], np.diff(v) / h, np.zeros(len(h)), h, problem.piece)


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
            _cap(ceiling, block, length / time, problem.free)
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


def _cap(ceiling: Array, block: Block, unit: float, free: tuple[bool, bool]) -> None:
    for side, points, given in ((block.start, slice(None, -1), 0), (block.end, slice(1, None), -1)):
        room = block.room.copy()
        if not free[given]:
            room[given] = 1.0  # speeds at the ends are not the solver's to choose
        slope = np.abs(side[Term.SD]).max(1) * unit
        with np.errstate(divide="ignore"):
            np.minimum(ceiling[points], (room / slope) ** 2, out=ceiling[points])
