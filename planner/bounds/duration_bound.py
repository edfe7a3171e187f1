"""Proved lower bound of the duration: dwells, and the bounds of the runs between stops.

`spans` splits a run into spans, `span_bound` bounds each span. Equal runs share a bound.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.bounds.lower_bound import find_left_out
from planner.bounds.span_bound import Case, SpanBound, bound_span, bound_span_quickly, join_bounds
from planner.bounds.spans import Span, split_run
from planner.limits.limit import Limit, Term
from planner.path.actuation import ActuatorPath
from planner.path.stands import count_zero_derivatives
from planner.timing.attempts import solve_run
from planner.timing.grid import Task
from planner.timing.problem import split_runs
from planner.timing.profile import Profile
from planner.timing.repetition import find_first_equals
from planner.trajectory import Trajectory

# Number of runs above which each is only refined to FAIR_GAP: finer cells take most of the time.
MANY_RUNS = 32
FAIR_GAP = 0.001
# Gap above which a run is also bounded at order 2, if a gap is stated or runs are many.
POOR_GAP_AT_ORDER_3 = 0.002
# Least number of cells of a span in a quick bound.
LEAST_SHARED_CELLS = 24
# Relative difference of durations of time pieces in equal motions: late instants are rounded more.
SAME_DURATION = 1e-6

# Breaks of the path at both ends of a run.
Ends = tuple[int, int]


@dataclass(frozen=True, slots=True)
class DurationBound(Result):
    """Proved lower bound of the duration of all motions within the limits.

    value     s
    duration  s, of the motion it is compared with
    left_out  limits it leaves out: it is too low by the time that these cost
    s (M,)      path length at the start of each cell
    piece (M,)  piece of each cell
    loss (M,)   s, loss on each cell. Their sum is the duration less the bound
    worth (M, 3, n)  s, fall of the bound per unit of relative change of each axis' acceleration
                     and jerk, and of the speed limit that binds (first entry)
    alone (M, 3, n)  s, `worth` if no other limit changes, for a change of one per cent
    """

    value: float
    duration: float
    left_out: tuple[str, ...]
    s: Array = field(repr=False)
    piece: np.ndarray = field(repr=False)
    loss: Array = field(repr=False)
    worth: Array = field(repr=False)
    alone: Array = field(repr=False)

    @property
    def gap(self) -> float:
        """Greatest relative excess of the duration over the least. ∞ if the bound is 0."""
        return self.duration / self.value - 1 if self.value > 0 else np.inf

    def describe(self) -> str:
        """Return the gap in a sentence, with the limits that are left out."""
        left_out = f"; the bound leaves out {', '.join(self.left_out)}" if self.left_out else ""
        if self.gap == np.inf:
            return f"nothing is proved of how near the duration is to the least{left_out}"
        gap = ceil(1e5 * self.gap) / 1e3
        return f"the duration is at most {gap:.3f} % above the least{left_out}"

    def tables(self) -> tuple[Table, ...]:
        """Return the bound and the duration."""
        names = Column("what", ["duration", "lower bound, proved"])
        times = Column("time", [self.duration, self.value], "s", form=".6f")
        notes = Column("note", ["", self.describe()])
        return (Table("how near to the fastest", (names, times, notes)),)


def bound_duration(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    order: int,
    *,
    gap: float | None = None,
    most_cells: int | None = None,
) -> DurationBound:
    """Prove a lower bound for a motion.

    gap: gap to which cells are refined; None: as far as is quick, to FAIR_GAP for many runs
    most_cells: approximate number of cells of a quick bound, without refinement; None: no limit
    """
    case = Case(trajectory, limits, order)
    path = trajectory.path
    runs = list(pairwise(np.flatnonzero(path.stops(order)).tolist()))
    firsts = _find_equal_motions(case, runs)
    spans = {n: split_run(trajectory, limits, runs[n]) for n in sorted(set(firsts))}
    if most_cells is not None:
        bounds = _bound_quickly(case, spans, firsts, most_cells)
    else:
        if gap is None and len(runs) > MANY_RUNS:
            gap = FAIR_GAP
        bounds = {n: _bound_run(case, runs[n], parts, gap) for n, parts in spans.items()}

    shifts = [runs[n][0] - runs[first][0] for n, first in enumerate(firsts)]
    joined = join_bounds(
        [_shift(path, bounds[first], by) for first, by in zip(firsts, shifts, strict=True)],
    )
    value = float(path.dwells.sum()) + joined.value
    value -= 1e-15 * (len(runs) + 8) * abs(value)  # rounding error
    return DurationBound(value, trajectory.duration, find_left_out(path, limits), *joined[1:])


def _find_equal_motions(case: Case, runs: Sequence[Ends]) -> list[int]:
    """Return for each run the index of the first run with equal path, limits and motion.

    Equal runs have equal bounds, anywhere on the path. The loss on each cell also depends on the
    motion. If q′ = 0 at an end of a run, its bound depends on the neighbours as well.
    """
    path = case.trajectory.path
    zeros = count_zero_derivatives(path)
    posed = [run for ends in runs for run in split_runs(path, np.array(ends), 3)]
    firsts = find_first_equals(path, case.limits, posed)
    for n, first in enumerate(firsts):
        start, end = runs[n]
        turns_back = zeros[0, start] or zeros[1, end - 1]
        if first != n and (turns_back or not _move_alike(case.trajectory, runs[first], runs[n])):
            firsts[n] = n
    return firsts


def _move_alike(trajectory: Trajectory, one: Ends, other: Ends) -> bool:
    """Return whether the motions along two runs are equal up to the rounding of instants."""
    motions = []
    for ends in (one, other):
        part = slice(*np.searchsorted(trajectory.piece, ends))
        durations = np.diff(trajectory.knots[part.start : part.stop + 1])
        motion = np.stack([trajectory.v[part], trajectory.a[part], trajectory.j[part], durations])
        motions.append(motion[:, motion[:3].any(0)])
    first, second = motions
    if first.shape != second.shape or not np.array_equal(first[:3], second[:3]):
        return False
    return np.allclose(first[3], second[3], rtol=SAME_DURATION, atol=0.0)


def _shift(path: ActuatorPath, bound: SpanBound, by: int) -> SpanBound:
    """Return the bound of an equal run that starts `by` path pieces later."""
    if not by:
        return bound
    piece = bound.piece + by
    s = path.breaks[piece] + (bound.s - path.breaks[bound.piece])
    return bound._replace(s=s, piece=piece)


def _bound_quickly(
    case: Case,
    runs: dict[int, list[Span]],
    firsts: Sequence[int],
    most_cells: int,
) -> dict[int, SpanBound]:
    """Bound each run with a share of the cells, and at least LEAST_SHARED_CELLS for a span.

    Shares are in proportion to the number of time pieces.
    """
    pieces = sum(len(span.pieces) for first in firsts for span in runs[first] if not span.cruising)
    bounds = {}
    for n, spans in runs.items():
        parts = []
        for span in spans:
            share = most_cells * len(span.pieces) // max(pieces, 1)
            parts.append(bound_span_quickly(case, span, max(share, LEAST_SHARED_CELLS)))
        bounds[n] = join_bounds(parts)
    return bounds


def _bound_run(case: Case, ends: Ends, spans: Sequence[Span], gap: float | None) -> SpanBound:
    """Bound a run by the sum over its spans, or without jerk limits if that bound is larger."""
    took = sum(span.duration for span in spans)
    solved = sum(span.duration for span in spans if not span.cruising)
    aim = gap
    if len(spans) > 1 and solved > 0:  # cruises have nearly no gap
        aim = took / solved * (FAIR_GAP if gap is None else gap)
    best = join_bounds([bound_span(case, span, aim) for span in spans])
    fair = 0.0 if gap is None else POOR_GAP_AT_ORDER_3
    if case.order == 3 and took > (1 + fair) * best.value:
        other = _bound_without_jerk(case, ends, best.value)
        best = other if other is not None and other.value > best.value else best
    return best


def _bound_without_jerk(case: Case, ends: Ends, least: float) -> SpanBound | None:
    """Bound a run by its limits on speed and acceleration, near its fastest motion within them.

    Return None if there is no such motion, or if it is no longer than the bound `least`.
    """
    path = case.trajectory.path
    limits = [limit for limit in case.limits if Term.SDDD not in limit.terms]
    stops = np.flatnonzero(path.stops(2))
    stops = stops[(stops >= ends[0]) & (stops <= ends[1])]
    if not np.isin(ends, stops).all():
        return None  # without jerk limits the motion does not rest there
    runs = list(pairwise(stops.tolist()))
    profiles = []
    for run in split_runs(path, stops, 2):
        fastest = solve_run(Task(path, limits, run, 2))
        if not fastest.solved:
            return None
        profiles.append(fastest.profile)
    motion = Profile.joined(profiles).along(path)
    if motion.duration <= least:
        return None
    gentle = Case(motion, limits, 2)
    spans = [split_run(motion, limits, run) for run in runs]
    # first as for a plan at order 2, then to a fair gap
    best: SpanBound | None = None
    for gap in (None, FAIR_GAP):
        cases = zip(runs, spans, strict=True)
        joined = join_bounds([_bound_run(gentle, run, parts, gap) for run, parts in cases])
        best = joined if best is None or joined.value > best.value else best
        if motion.duration <= (1 + FAIR_GAP) * best.value:
            break
    return best
