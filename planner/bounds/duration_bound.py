"""How near a motion is to the fastest, proved: the sum of the bounds of its runs between stops, and its dwells.

Each run is split into spans (`spans`), each span is bounded (`span_bound`), and equal runs share a bound.
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
from planner.timing.problem import split_runs
from planner.timing.profile import Profile
from planner.timing.repetition import find_first_equals
from planner.trajectory import Trajectory

# Runs above which each is bounded only to FAIR_GAP: finer cells take most of the time.
MANY_RUNS, FAIR_GAP = 32, 0.001
# Gap of a run from which it is also bounded at order 2 where a gap is stated, or runs are many.
POOR_GAP_AT_ORDER_3 = 0.002
# Least cells of a span of a quick bound.
LEAST_SHARED_CELLS = 24
# Share of its duration by which a time piece may differ from one of an equal motion: instants are rounded, by more late
# in a long motion.
SAME_DURATION = 1e-6

Ends = tuple[int, int]  # breaks of the path at which a run starts and ends


@dataclass(frozen=True, slots=True)
class DurationBound(Result):
    """No motion that keeps the limits takes less, proved.

    value     s
    duration  s, of the motion that it is compared with
    left_out  what it does not account for: it may lie below the least time by what that costs
    s, piece, loss  of all cells: path length at the start of each (M,), its piece (M,), and what is lost on it (M,), s:
                    the loss of all is the duration less the bound
    worth     (M, 3, n) s: by how much the bound falls per unit of relative change, of each axis' acceleration and jerk
              on each cell; the third is of speeds, for whichever binds, in its first entry
    alone     the same for a change of one per cent, up to where the next row binds that has not changed
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
        """Share by which the duration may be above the least: ∞ where the bound is 0."""
        return self.duration / self.value - 1 if self.value > 0 else np.inf

    def describe(self) -> str:
        """Return how near the duration is to it, and what it does not account for."""
        left_out = f"; without {', '.join(self.left_out)}" if self.left_out else ""
        if self.gap == np.inf:
            return f"nothing is proved of how near the duration is to the least{left_out}"
        return f"the duration is at most {ceil(1e5 * self.gap) / 1e3:.3f} % above the least{left_out}"

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

    gap: share of the bound up to which its cells are refined; None: as far as is quick, and for many runs to FAIR_GAP
    most_cells: about how many cells a quick bound has in all, without a round of finer ones; None: no such limit
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
        bounds = {n: _bound_run(case, runs[n], own, gap) for n, own in spans.items()}

    every = [_shift(path, bounds[first], runs[n][0] - runs[first][0]) for n, first in enumerate(firsts)]
    joined = join_bounds(every)
    value = float(path.dwells.sum()) + joined.value
    value -= 1e-15 * (len(runs) + 8) * abs(value)  # by rounding
    return DurationBound(value, trajectory.duration, find_left_out(path, limits), *joined[1:])


def _find_equal_motions(case: Case, runs: Sequence[Ends]) -> list[int]:
    """Return for each run the index of an earlier one with an equal path, limits and motion, or else its own index.

    A bound belongs to the pieces of a run, wherever they are on the path, so that it holds for equal runs. The loss on
    each cell depends on the motion as well. Where q′ = 0 at an end of a run, the bound also depends on the neighbours.
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
    """Return whether the motions along two runs are the same, but for the rounding of instants."""
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
    """Return the bound of an equal run so many path pieces later."""
    piece = bound.piece + by
    return bound._replace(s=path.breaks[piece] + (bound.s - path.breaks[bound.piece]), piece=piece) if by else bound


def _bound_quickly(
    case: Case, runs: dict[int, list[Span]], firsts: Sequence[int], most_cells: int
) -> dict[int, SpanBound]:
    """Share the cells out by time pieces; each span between cruises has LEAST_SHARED_CELLS at least."""
    pieces = sum(len(span.pieces) for first in firsts for span in runs[first] if not span.cruising)
    bounds = {}
    for n, spans in runs.items():
        shares = [max(most_cells * len(span.pieces) // max(pieces, 1), LEAST_SHARED_CELLS) for span in spans]
        parts = [bound_span_quickly(case, span, most) for span, most in zip(spans, shares, strict=True)]
        bounds[n] = join_bounds(parts)
    return bounds


def _bound_run(case: Case, ends: Ends, spans: Sequence[Span], gap: float | None) -> SpanBound:
    """Bound a run: the sum over its spans, or its bound without jerk where that is larger."""
    took = sum(span.duration for span in spans)
    solved = sum(span.duration for span in spans if not span.cruising)
    aim = gap
    if len(spans) > 1 and solved > 0:  # cruises lose next to nothing
        aim = took / solved * (FAIR_GAP if gap is None else gap)
    best = join_bounds([bound_span(case, span, aim) for span in spans])
    fair = 0.0 if gap is None else POOR_GAP_AT_ORDER_3
    if case.order == 3 and took > (1 + fair) * best.value:
        other = _bound_without_jerk(case, ends, best.value)
        best = other if other is not None and other.value > best.value else best
    return best


def _bound_without_jerk(case: Case, ends: Ends, least: float) -> SpanBound | None:
    """Bound a run by the limits on speed and acceleration, from its fastest motion within these.

    None where that motion takes no longer than the bound `least`, or there is none.
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
        fastest = solve_run(path, limits, run, 2)
        if not fastest.solved:
            return None
        profiles.append(fastest.profile)
    motion = Profile.joined(profiles).along(path)
    if motion.duration <= least:
        return None
    gentle = Case(motion, limits, 2)
    spans = [split_run(motion, limits, run) for run in runs]
    # no less than at order 2 itself, where no gap is stated; then to a fair gap
    best: SpanBound | None = None
    for gap in (None, FAIR_GAP):
        bounds = [_bound_run(gentle, run, own, gap) for run, own in zip(runs, spans, strict=True)]
        joined = join_bounds(bounds)
        best = joined if best is None or joined.value > best.value else best
        if motion.duration <= (1 + FAIR_GAP) * best.value:
            break
    return best
