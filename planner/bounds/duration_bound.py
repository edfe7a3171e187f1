"""How near a motion is to the fastest, proved: cells along its path, multipliers, and more cells where it loses.

What is proved is `planner.bounds.lower_bound`'s; here is chosen what it is proved with, near a known motion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import ceil
from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.bounds.dual import DualCells, Multipliers, maximise_dual
from planner.bounds.inner_minimum import NEAR, fill_sets
from planner.bounds.lower_bound import (
    SPEED_LIMITS,
    RowCells,
    bound_cells,
    bound_rest,
    enclose_rows,
    find_left_out,
    leave_rest,
)
from planner.bounds.worth import weigh_limits, weigh_rest
from planner.limits.limit import Limit, Term
from planner.limits.tool import ToolSpeed
from planner.path.actuation import ActuatorPath
from planner.path.stands import count_zero_derivatives
from planner.timing.attempts import solve_run
from planner.timing.problem import split_runs
from planner.timing.profile import Profile
from planner.timing.repetition import find_first_equals
from planner.trajectory import Trajectory

# Cells near rest begin at so much of a run's time after it, and grow by such a share of the time since.
FIRST_CELL, CELL_GROWTH, LEAST_CELL = 1e-3, 0.15, 5e-5
# How much slower than the motion the search begins, and where in a cell at rest its state is looked at.
SLOWER, INSIDE = 0.97, 0.3
# Cells of a run at least; parts of a cell at most, in one round; rounds; and cells in all, for each of the first round
# of an order.
LEAST_CELLS = 160
MOST_PARTS, ROUNDS, MOST_GROWTH = 8, 2, {2: 1.0, 3: 3.0}
# Where a cell has no bound, λ beside it is made so much smaller, so often at most.
SHRINKAGE, SHRINKAGES = 0.7, 40
# Where a bound is no nearer than so, one round more is tried.
# Cells of a span of a quick bound at least; and how far off it is tried at order 2 as well.
LEAST_SHARED_CELLS, QUICK_POOR_GAP = 24, 0.05
POOR_GAP = 0.01
# From such a gap on, what order 2 proves is looked at as well: it holds at order 3 too.
POOR_GAP_AT_ORDER_3 = 0.002
# Of programs of many runs each is bounded well enough so near: finer cells take most of the time.
MANY_RUNS, FAIR_GAP = 32, 0.001
# Use of a limit on speed from which a motion cruises, and the least share of its run that a cruise
# is bounded by itself for: each span between cruises takes as many cells as a short run.
CRUISING_USE, LEAST_CRUISE = 1 - 2e-4, 0.01
# Share of its duration by which a time piece may differ from one of an equal motion: instants are rounded, by more late
# in a long motion.
SAME_DURATION = 1e-6
# Where a cell loses more than it takes by such a share of the run's time, λ beside it is 0, and sought again; so often.
PARTING_LOSS, MOST_PARTINGS = 0.005, 3


@dataclass(frozen=True, slots=True)
class DurationBound(Result):
    """No motion that keeps the limits takes less, proved.

    value     s
    duration  s, of the motion that it is held against
    left_out  what it knows nothing of: it may lie below the least time by what that costs
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
        """How far the duration may be above the least, as a share of that: ∞ where the bound is 0."""
        return self.duration / self.value - 1 if self.value > 0 else np.inf

    def describe(self) -> str:
        """How near the duration is to it, and what it knows nothing of."""
        left_out = f"; without {', '.join(self.left_out)}" if self.left_out else ""
        if self.gap == np.inf:
            return f"nothing is proved of how near the duration is to the least{left_out}"
        return f"the duration is at most {ceil(1e5 * self.gap) / 1e3:.3f} % above the least{left_out}"

    def tables(self) -> tuple[Table, ...]:
        """The bound and the duration."""
        what, times = ["duration", "lower bound, proved"], [self.duration, self.value]
        notes = Column("note", ["", self.describe()])
        return (
            Table("how near to the fastest", (Column("what", what), Column("time", times, "s", form=".6f"), notes)),
        )


@dataclass(frozen=True, slots=True)
class _Nodes:
    """A run in cells: s, a = ṡ², b = s̈ and t at the nodes (M+1,), and the path piece of each cell (M,)."""

    s: Array
    a: Array
    b: Array
    t: Array
    piece: np.ndarray


@dataclass(frozen=True, slots=True)
class _Span:
    """A stretch of a run between two instants, which is bounded by itself.

    pieces    the trajectory's time pieces (K,)
    begin, end  s, of the trajectory
    breaks    path lengths at its start, at the path's breaks inside, and at its end
    first     the path piece at its start
    stops     the path's breaks at which it starts and ends; None inside a run, where its state is free
    cruising  whether the motion keeps a capped speed over all of it
    """

    pieces: np.ndarray
    begin: float
    end: float
    breaks: Array
    first: int
    stops: tuple[int | None, int | None]
    cruising: bool = False

    @property
    def duration(self) -> float:
        return self.end - self.begin


class _Rest(NamedTuple):
    """An end of a run at which no axis moves.

    side      0 for the start, 1 for the end
    zeros     how many of the path's derivatives are 0 there
    standing  whether no axis accelerates there either
    """

    side: int
    zeros: int
    standing: bool


def bound_duration(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    order: int,
    *,
    gap: float | None = None,
    most_cells: int | None = None,
) -> DurationBound:
    """Prove a lower bound for a motion: of its runs between stops, one by one, and its dwells.

    gap: how near the bound has to come, as a share, within ROUNDS rounds of finer cells; None: one round, and for many
    runs only where it is needed
    most_cells: about how many cells a quick bound has in all, without a round of finer ones; None: no such limit
    """
    if most_cells is not None:
        return _bound_quickly(trajectory, limits, order, most_cells)
    path = trajectory.path
    every = list(pairwise(np.flatnonzero(path.stops(order)).tolist()))
    if gap is None and len(every) > MANY_RUNS:
        gap = FAIR_GAP
    firsts = _find_equal_motions(trajectory, limits, every)
    bounds = {n: _bound_run(trajectory, limits, order, every[n], gap) for n in sorted(set(firsts))}
    return _sum_runs(trajectory, limits, _copy_bounds(trajectory, every, firsts, bounds))


def _find_equal_motions(trajectory: Trajectory, limits: Sequence[Limit], every: Sequence[tuple[int, int]]) -> list[int]:
    """Return for each run the index of an earlier one with an equal path, limits and motion, or else its own index.

    A bound belongs to the pieces of a run, wherever they are on the path, so that it holds for equal runs. The loss on
    each cell depends on the motion as well. Where q′ = 0 at an end of a run, the bound also depends on the neighbours.
    """
    path = trajectory.path
    still = count_zero_derivatives(path)
    runs = [run for stops in every for run in split_runs(path, np.array(stops), 3)]
    firsts = find_first_equals(path, limits, runs)
    for n, first in enumerate(firsts):
        a, b = every[n]
        turns_back = still[0, a] or still[1, b - 1]
        if first != n and (turns_back or not _move_alike(trajectory, every[first], every[n])):
            firsts[n] = n
    return firsts


def _move_alike(trajectory: Trajectory, one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Return whether the motions along two runs are the same, but for the rounding of instants."""
    motions = []
    for a, b in (one, other):
        part = slice(*np.searchsorted(trajectory.piece, [a, b]))
        lengths = np.diff(trajectory.knots[part.start : part.stop + 1])
        motion = np.stack([trajectory.v[part], trajectory.a[part], trajectory.j[part], lengths])
        motions.append(motion[:, motion[:3].any(0)])
    first, second = motions
    if first.shape != second.shape or not np.array_equal(first[:3], second[:3]):
        return False
    return np.allclose(first[3], second[3], rtol=SAME_DURATION, atol=0.0)


def _copy_bounds(
    trajectory: Trajectory,
    every: Sequence[tuple[int, int]],
    firsts: Sequence[int],
    bounds: "Mapping[int, _RunBound]",
) -> "list[_RunBound]":
    """Return the bound of each run: that of the first which equals it, with its places on this run."""
    breaks, copies = trajectory.path.breaks, []
    for n, first in enumerate(firsts):
        bound = bounds[first]
        piece = bound.piece + (every[n][0] - every[first][0])
        s = bound.s if n == first else breaks[piece] + (bound.s - breaks[bound.piece])
        copies.append(replace(bound, s=s, piece=piece))
    return copies


def _bound_quickly(trajectory: Trajectory, limits: Sequence[Limit], order: int, most_cells: int) -> DurationBound:
    """Share the cells out by time pieces; each span between cruises has LEAST_SHARED_CELLS at least."""
    every = list(pairwise(np.flatnonzero(trajectory.path.stops(order)).tolist()))
    firsts = _find_equal_motions(trajectory, limits, every)
    runs = {n: split_run(trajectory, limits, every[n]) for n in sorted(set(firsts))}
    pieces = sum(len(span.pieces) for first in firsts for span in runs[first] if not span.cruising)
    bounds = {}
    for n, spans in runs.items():
        parts = []
        for span in spans:
            if span.cruising:
                parts.append(_bound_cruise(trajectory, limits, order, span))
            else:
                most = max(most_cells * len(span.pieces) // pieces, LEAST_SHARED_CELLS)
                parts.append(_bound_span_quickly(trajectory, limits, order, span, most))
        bounds[n] = _join(parts)
    return _sum_runs(trajectory, limits, _copy_bounds(trajectory, every, firsts, bounds))


def _bound_span_quickly(
    trajectory: Trajectory, limits: Sequence[Limit], order: int, span: _Span, most: int
) -> "_RunBound":
    """Bound what lies between cruises with about `most` cells, once."""
    nodes = _thin_nodes(_place_nodes(trajectory, span), most)
    bound = _bound_nodes(trajectory, limits, order, span, nodes)
    # with few cells less is lost without the jerk
    if order == 3 and span.duration > (1 + QUICK_POOR_GAP) * bound.value:
        other = _bound_nodes(trajectory, limits, 2, span, nodes)
        bound = other if other.value > bound.value else bound
    return bound


def _thin_nodes(nodes: _Nodes, most: int) -> _Nodes:
    """Keep an even selection of about `most` cells, and every break of the path."""
    count = len(nodes.piece)
    if count <= most:
        return nodes
    breaks = np.flatnonzero(np.diff(nodes.piece)) + 1
    ends = np.union1d(np.linspace(0, count, most + 1).round().astype(int), breaks)
    return _Nodes(nodes.s[ends], nodes.a[ends], nodes.b[ends], nodes.t[ends], nodes.piece[ends[:-1]])


def _sum_runs(trajectory: Trajectory, limits: Sequence[Limit], runs: "Sequence[_RunBound]") -> DurationBound:
    """Add up the bounds of all runs, and the dwells."""
    path = trajectory.path
    value = float(path.dwells.sum()) + sum(max(run.value, 0.0) for run in runs)
    value -= 1e-15 * (len(runs) + 8) * abs(value)
    parts = (np.concatenate([getattr(run, name) for run in runs]) for name in ("s", "piece", "loss", "worth", "alone"))
    return DurationBound(value, trajectory.duration, find_left_out(path, limits), *parts)


@dataclass(frozen=True, slots=True)
class _RunBound:
    value: float
    s: Array
    piece: np.ndarray
    loss: Array
    worth: Array
    alone: Array


def _bound_run(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    order: int,
    ends: tuple[int, int],
    gap: float | None,
) -> _RunBound:
    """Bound a run from break to break: the sum over its cruises and what lies between them.

    Between two spans the state is taken as free, which costs next to nothing where both keep the
    capped speed there.
    """
    spans = split_run(trajectory, limits, ends)
    solved = [span for span in spans if not span.cruising]
    if len(spans) > 1 and solved:
        took = sum(span.duration for span in spans)
        share = took / sum(span.duration for span in solved)
        gap = share * (FAIR_GAP if gap is None else gap)
    bounds = [
        _bound_cruise(trajectory, limits, order, span)
        if span.cruising
        else _bound_span(trajectory, limits, order, span, gap)
        for span in spans
    ]
    best = _join(bounds)
    took = sum(span.duration for span in spans)
    if order == 3 and took > (1 + POOR_GAP_AT_ORDER_3) * best.value:
        other = _bound_without_jerk(trajectory, limits, ends, best.value)
        best = other if other is not None and other.value > best.value else best
    return best


def _join(bounds: Sequence[_RunBound]) -> _RunBound:
    """Add up the bounds of stretches that follow each other."""
    value = sum(max(bound.value, 0.0) for bound in bounds)
    names = ("s", "piece", "loss", "worth", "alone")
    parts = (np.concatenate([getattr(bound, name) for bound in bounds]) for name in names)
    return _RunBound(value, *parts)


def split_run(trajectory: Trajectory, limits: Sequence[Limit], ends: tuple[int, int]) -> list[_Span]:
    """Split a run's motion where it begins and ends to keep a capped speed for a while.

    Also where the path turns back, q′ = 0: there no axis moves, whatever ṡ is.
    """
    moving = (trajectory.v != 0) | (trajectory.a != 0) | (trajectory.j != 0)
    inside = (trajectory.piece >= ends[0]) & (trajectory.piece < ends[1])
    moved = np.flatnonzero(moving & inside)
    moved = np.arange(moved[0], moved[-1] + 1)
    knots = trajectory.knots[moved[0] : moved[-1] + 2]
    cruising = _find_cruising(trajectory, limits, moved)
    # time pieces of the same kind in a row; a short cruise is bounded together with its neighbours
    edges = np.flatnonzero(np.diff(cruising, prepend=~cruising[:1], append=~cruising[-1:]))
    kinds: list[tuple[int, int, bool]] = []
    for a, b in pairwise(edges.tolist()):
        long_enough = knots[b] - knots[a] > LEAST_CRUISE * (knots[-1] - knots[0])
        if bool(cruising[a]) and long_enough:
            kinds += _leave_cap(trajectory.piece[moved], knots, a, b)
        else:
            kinds.append((a, b, False))
    turns = _find_turns(trajectory, moved)
    merged: list[tuple[int, int, bool]] = []
    for a, b, cruise in kinds:
        if merged and not cruise and not merged[-1][2]:
            merged[-1] = merged[-1][0], b, False
        else:
            merged.append((a, b, cruise))
    parts = [
        (first, last, cruise)
        for a, b, cruise in merged
        for first, last in pairwise([a, *(turn for turn in turns if a < turn < b), b])
    ]
    return [_make_span(trajectory, moved, ends, part, turns) for part in parts]


def _leave_cap(piece: np.ndarray, knots: Array, a: int, b: int) -> list[tuple[int, int, bool]]:
    """Split a cruise (time pieces a to b) so that its neighbours know its cap.

    piece (K,): path piece of each time piece of the run; knots (K+1,): s. A cap that begins or ends at
    a break of the path holds inside the cruise only: a neighbour that ends at the break would be
    bounded as if it could pass there at any speed. It takes time pieces of the cruise next to the
    break, for a time that is not lost in the rounding of its cells.
    """
    least = LEAST_CRUISE * (knots[-1] - knots[0])
    first, last = a, b
    if a > 0 and piece[a] != piece[a - 1]:
        first = int(np.searchsorted(knots, knots[a] + least))
    if b < len(piece) and piece[b] != piece[b - 1]:
        last = int(np.searchsorted(knots, knots[b] - least, side="right")) - 1
    if first >= last:
        return [(a, b, False)]
    parts = [(a, first, False), (first, last, True), (last, b, False)]
    return [part for part in parts if part[0] < part[1]]


def _find_turns(trajectory: Trajectory, own: np.ndarray) -> list[int]:
    """List which of a run's time pieces own (K,) start at a place where q′ = 0 on both sides."""
    still = count_zero_derivatives(trajectory.path)
    piece = trajectory.piece[own]
    starts = np.flatnonzero(np.diff(piece)) + 1
    turns = starts[(still[0, piece[starts]] > 0) & (still[1, piece[starts] - 1] > 0)]
    return [int(turn) for turn in turns]


def _find_cruising(trajectory: Trajectory, limits: Sequence[Limit], own: np.ndarray) -> np.ndarray:
    """Return whether each time piece (K,) keeps to the tool's cap, or to constant ṡ at another's.

    A motion along which an axis keeps its largest speed while ṡ varies is better bounded together
    with what comes before and after.
    """
    steady = (trajectory.a[own] == 0) & (trajectory.j[own] == 0)
    state = trajectory.within(np.repeat(own, 3), _spread(np.diff(trajectory.knots)[own]))
    used = np.zeros(3 * len(own))
    for limit in limits:
        if isinstance(limit, SPEED_LIMITS):
            value = limit.value(state)
            use = limit.use(value, value, state.piece).max(1)
            if not isinstance(limit, ToolSpeed):
                use = np.where(np.repeat(steady, 3), use, 0.0)
            used = np.maximum(used, use)
    return np.asarray(used.reshape(-1, 3).min(1) > CRUISING_USE)


def _spread(h: Array) -> Array:
    """Return the start, the middle and the end (3K,) of time pieces of duration h (K,)."""
    return np.outer(h, [0.0, 0.5, 1.0]).ravel()


def _make_span(
    trajectory: Trajectory,
    own: np.ndarray,
    ends: tuple[int, int],
    part: tuple[int, int, bool],
    turns: Sequence[int],
) -> _Span:
    """Return the span of some of a run's time pieces own (K,): from one to before another."""
    a, b, cruising = part
    path, pieces = trajectory.path, own[a:b]
    starts, finishes = a == 0, b == len(own)
    first, last = int(trajectory.piece[pieces[0]]), int(trajectory.piece[pieces[-1]])
    breaks = np.array(path.breaks[first : last + 2])
    begin, end = trajectory.knots[pieces[0]], trajectory.knots[pieces[-1] + 1]
    if not starts:
        breaks[0] = trajectory.s[pieces[0]]
    if not finishes:
        breaks[-1] = trajectory.s[own[b]]
    start = ends[0] if starts else first if a in turns else None
    finish = ends[1] if finishes else last + 1 if b in turns else None
    stops = start, finish
    return _Span(pieces, float(begin), float(end), breaks, first, stops, cruising)


def _bound_cruise(trajectory: Trajectory, limits: Sequence[Limit], order: int, span: _Span) -> _RunBound:
    """Bound a cruise by the limits on speed alone: T ≥ ∫ ds / ṡ_max."""
    nodes = _look_at_nodes(trajectory, span, trajectory.knots[np.append(span.pieces, span.pieces[-1] + 1)])
    rows = enclose_rows(trajectory.path, limits, nodes.s, nodes.piece)
    count, axes = len(nodes.piece), rows.acceleration.shape[1]
    still, nothing = np.zeros((count + 1, 2)), np.zeros(count)
    sets, speeds = np.zeros((count, 1, 2, 2, axes)), np.zeros((count, 1, 2))
    out = np.zeros(count)
    bound_cells(rows, order == 3, still, nothing, sets, speeds, nothing, out)
    took = np.diff(nodes.t)
    # one per cent more speed saves about one per cent of the time
    worth = np.zeros((count, 3, axes))
    worth[:, 2, 0] = took
    return _RunBound(float(out.sum()), nodes.s[:-1], nodes.piece, took - out, worth, 0.01 * worth)


def _bound_span(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    order: int,
    span: _Span,
    gap: float | None,
) -> _RunBound:
    """Bound what lies between cruises."""
    nodes = _place_nodes(trajectory, span)
    best = _bound_nodes(trajectory, limits, order, span, nodes)
    refined, first = best, len(nodes.piece)
    took = float(nodes.t[-1] - nodes.t[0])
    for n in range(1, ROUNDS + 2):
        near = took <= (1 + (POOR_GAP if gap is None else gap)) * best.value
        if (near and (n >= ROUNDS or gap is not None)) or n > ROUNDS:
            break
        most = MOST_GROWTH[order] * (first if gap is None else 2 * len(nodes.piece))
        nodes = _refine(trajectory, span, nodes, refined.loss, most)
        refined = _bound_nodes(trajectory, limits, order, span, nodes)
        best = refined if refined.value > best.value else best
    return best


def _bound_without_jerk(
    trajectory: Trajectory, limits: Sequence[Limit], ends: tuple[int, int], least: float
) -> _RunBound | None:
    """Bound a run by the limits on speed and acceleration, from its fastest motion within these.

    None where that motion takes no longer than the bound there is, least, or is not found.
    """
    path = trajectory.path
    gentle = [limit for limit in limits if Term.SDDD not in limit.terms]
    stops = np.flatnonzero(path.stops(2))
    stops = stops[(stops >= ends[0]) & (stops <= ends[1])]
    profiles = []
    for run in split_runs(path, stops, 2):
        fastest = solve_run(path, gentle, run, 2)
        if not fastest.solved:
            return None
        profiles.append(fastest.profile)
    motion = Profile.joined(profiles).along(path)
    if motion.duration <= least:
        return None
    parts = list(pairwise(stops.tolist()))
    return _join([_bound_run(motion, gentle, 2, part, FAIR_GAP) for part in parts])


def _place_nodes(trajectory: Trajectory, span: _Span) -> _Nodes:
    """At the motion's knots, and more near rests."""
    knots = trajectory.knots[span.pieces[0] : span.pieces[-1] + 2]
    begin, took = knots[0], knots[-1] - knots[0]
    growing = FIRST_CELL * (1 + CELL_GROWTH) ** np.arange(1 + int(np.log(0.3 / FIRST_CELL) / np.log(1 + CELL_GROWTH)))
    growing *= took
    wide = np.maximum(np.diff(knots), took * 1e-12)

    def needed(t: Array) -> Array:
        after = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(wide) - 1)
        since = np.minimum(t - begin, knots[-1] - t)
        return np.asarray(t[wide[after] > CELL_GROWTH * since])

    even = np.linspace(begin, knots[-1], LEAST_CELLS + 1)
    even = even[wide[np.clip(np.searchsorted(knots, even, side="right") - 1, 0, len(wide) - 1)] > took / LEAST_CELLS]
    t = np.unique(np.concatenate([knots, even, needed(begin + growing), needed(knots[-1] - growing[::-1])]))
    least = growing[0] * 0.5
    t = t[((t >= begin + least) & (t <= knots[-1] - least)) | (t == begin) | (t == knots[-1])]
    return _look_at_nodes(trajectory, span, t)


def _look_at_nodes(trajectory: Trajectory, span: _Span, t: Array) -> _Nodes:
    """The motion at instants t, with a node at every break of the path in between."""
    pieces = span.pieces
    k = np.clip(trajectory.locate(t), pieces[0], pieces[-1])
    tau = t - trajectory.knots[k]
    s = trajectory.s[k] + tau * (trajectory.v[k] + tau * (trajectory.a[k] / 2 + tau * trajectory.j[k] / 6))
    v, b = (
        trajectory.v[k] + tau * (trajectory.a[k] + tau * trajectory.j[k] / 2),
        trajectory.a[k] + tau * trajectory.j[k],
    )
    breaks = span.breaks
    length = breaks[-1] - breaks[0]
    near = 1e-10 * np.min(np.diff(breaks))
    at = np.abs(breaks[np.clip(np.searchsorted(breaks, s), 0, len(breaks) - 1)] - s)
    before = np.abs(breaks[np.clip(np.searchsorted(breaks, s) - 1, 0, len(breaks) - 1)] - s)
    beside = np.minimum(at, before)
    inside = (beside > near) & (s > breaks[0]) & (s < breaks[-1]) & np.append(True, np.diff(s) > 1e-13 * length)
    # at a break, the motion as it is at the nearest of these instants
    nearest = np.clip(np.searchsorted(s, breaks), 1, len(s) - 1)
    nearest -= np.abs(s[nearest - 1] - breaks) < np.abs(s[nearest] - breaks)
    every = np.concatenate([np.flatnonzero(inside), nearest])
    where = np.concatenate([s[inside], breaks])
    order = np.argsort(where, kind="stable")
    every, where = every[order], where[order]
    keep = np.append(True, np.diff(where) > 0)
    every, where = every[keep], where[keep]
    piece = span.first + np.clip(np.searchsorted(breaks, where[:-1], side="right") - 1, 0, len(breaks) - 2)
    return _Nodes(where, np.maximum(v[every], 0.0) ** 2, b[every], np.maximum.accumulate(t[every]), piece)


def _refine(trajectory: Trajectory, span: _Span, nodes: _Nodes, loss: Array, most: float) -> _Nodes:
    """More cells where more is lost: what is lost goes with the square of a cell."""
    loss = np.minimum(np.where(np.isfinite(loss), loss, np.inf), np.diff(nodes.t))
    share = np.cbrt(np.maximum(loss, 1e-4 * np.abs(loss).mean() + 1e-300))
    parts = np.clip(np.round(share / share.sum() * most), 1, MOST_PARTS)
    # cells at rest stay: times there are as small as rounding of s leaves them
    parts = np.clip(parts, 1, np.maximum(np.diff(nodes.t) / (LEAST_CELL * (nodes.t[-1] - nodes.t[0])), 1)).astype(int)
    parts[[0, -1]] = 1
    first = np.repeat(nodes.t[:-1], parts)
    step = np.repeat(np.diff(nodes.t) / parts, parts)
    within = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    t = np.append(first + within * step, nodes.t[-1])
    return _look_at_nodes(trajectory, span, np.unique(t))


def _bound_nodes(trajectory: Trajectory, limits: Sequence[Limit], order: int, span: _Span, nodes: _Nodes) -> _RunBound:
    """With multipliers found for these cells."""
    partings = MOST_PARTINGS
    path = trajectory.path
    rows = enclose_rows(path, limits, nodes.s, nodes.piece)
    if order == 2:
        rows = rows._replace(jerk=np.full_like(rows.jerk, np.inf))
    given, free, rests = _find_end_states(path, order, span.stops, len(nodes.s))
    # cells beside rests are bounded in closed form, whatever is known of λ there
    resting = {rest.side for rest in rests}
    first, last = int(0 in resting), len(nodes.piece) - int(1 in resting)
    free[first : last + 1] |= _find_dead_nodes(rows, order, first, last)[:, None]
    length, took = nodes.s[-1] - nodes.s[0], nodes.t[-1] - nodes.t[0]
    start = _guess_motion(trajectory, nodes, length, took)
    if order == 2:
        start[:, :, 2] = 0.0
    state = np.stack([nodes.a, nodes.b], 1)
    state[[0, -1]] = given
    scaled = DualCells(
        rows.width / length,
        np.ascontiguousarray(rows.ends * np.array([length, length**2, length**3])[:, None]),
        rows.speed * (length / took) ** 2,
        rows.acceleration * took**2,
        rows.jerk * took**3,
        np.sqrt(start[:, :, 0]),
        state[[first, last]] * np.array([(took / length) ** 2, took**2 / length]),
        free,
    )
    inner = slice(first, last)
    own = scaled._replace(
        width=scaled.width[inner],
        q=scaled.q[inner],
        y=scaled.y[inner],
        root=scaled.root[inner],
        free=free[first : last + 1],
    )
    best: _RunBound | None = None
    while True:
        found = _pad(maximise_dual(own, start[inner]), first, len(nodes.piece) - last)
        with np.errstate(all="ignore"):
            proved = _prove_run(rows, nodes, scaled, found, state, (length, took), order, rests)
        best = proved if best is None or proved.value > best.value else best
        # what is before and after such cells is bounded as if it were not one motion
        poor = np.flatnonzero(~(proved.loss < np.diff(nodes.t) + PARTING_LOSS * took))
        poor = poor[(poor >= first) & (poor < last)]
        partings -= 1
        if partings < 0 or not len(poor):
            return best
        free[poor] = free[poor + 1] = True


def _pad(found: Multipliers, before: int, after: int) -> Multipliers:
    """With cells before and after, in which all of them are 0."""

    def pad(values: Array) -> Array:
        return np.pad(values, [(before, after), *[(0, 0)] * (values.ndim - 1)])

    nodes, bulge, rows, speed, x, iterations = found
    return Multipliers(pad(nodes), pad(bulge), pad(rows), pad(speed), pad(x), iterations)


def _prove_run(
    rows: RowCells,
    nodes: _Nodes,
    scaled: DualCells,
    found: Multipliers,
    state: Array,
    unit: tuple[float, float],
    order: int,
    rests: Sequence[_Rest],
) -> _RunBound:
    """What multipliers prove, in SI units."""
    length, took = unit
    multipliers = np.where(np.isfinite(found.nodes), found.nodes, 0.0) * np.array(
        [took**3 / length**2, took**3 / length]
    )
    multipliers[scaled.free] = 0.0  # exactly: what is there is not known
    bulge = np.where(np.isfinite(found.bulge), found.bulge, 0.0) * took**3 / length**2
    bulge[(multipliers[1:] == 0).all(1) & (multipliers[:-1] == 0).all(1)] = 0.0
    size = np.stack([rows.acceleration, rows.jerk], 1)
    bound = np.where(found.rows > 0, size[0], size[1])
    of_rows = np.where(np.isfinite(found.rows) & np.isfinite(bound), found.rows / bound, 0.0)
    of_rows[:, :, 0] *= took / length  # what jerk's rows hold goes with 1/√a, as the integrand does
    of_speed = np.where(np.isfinite(found.speed), found.speed, 0.0) * took / length
    sets = np.zeros((len(bulge), 1 + len(NEAR), *of_rows.shape[1:]))
    speeds = np.zeros((len(bulge), 1 + len(NEAR), 2))
    sets[:, 0], speeds[:, 0] = of_rows, of_speed
    jerky = (np.abs(of_rows[:, :, 1]) * np.where(np.isfinite(bound[:, :, 1]), bound[:, :, 1], 0)).sum(-1).max(1) > 0.999
    jerky = np.flatnonzero(jerky)
    x = np.where(np.isfinite(found.x), found.x, 1.0)
    about = x[:, :, 0].mean(1) * (length / took) ** 2
    out = np.zeros(len(rows.width))
    rows_at = {
        rest.side: rows if rest.standing else rows._replace(jerk=np.full_like(rows.jerk, np.inf)) for rest in rests
    }

    def prove() -> Array:
        """What is lost on each cell."""
        fill_sets(rows.ends, rows.width, rows.acceleration, rows.jerk, multipliers, bulge, about, jerky, sets, speeds)
        bound_cells(rows, order == 3, multipliers, bulge, sets, speeds, about, out)
        for side, zeros, _ in rests:
            leaving = leave_rest(rows_at[side], side, zeros)
            out[-side] = bound_rest(leaving, side, multipliers[1 - 3 * side])
        return np.asarray(np.diff(nodes.t) + np.diff(np.where(multipliers == 0, 0.0, multipliers * state).sum(1)) - out)

    loss = prove()
    for n in range(SHRINKAGES):
        weak = ~(out > -np.inf)
        if not weak.any():
            break
        # less of λ there proves less, but surely something
        least = SHRINKAGE if n + 1 < SHRINKAGES else 0.0
        multipliers[:-1][weak] *= least
        multipliers[1:][weak & ~np.append(weak[1:], False)] *= least
        bulge[weak] *= least
        loss = prove()
    edge = np.where(multipliers == 0, 0.0, multipliers * state)
    value = float(out.sum() - edge[-1].sum() + edge[0].sum())
    value -= 1e-15 * len(out) * float(np.abs(out).sum() + np.abs(edge[[0, -1]]).sum())
    worth, alone = weigh_limits(scaled, found, took)
    for side, zeros, _ in rests:
        inner = multipliers[1 - 3 * side]
        worth[-side], alone[-side] = weigh_rest(rows_at[side], side, zeros, inner)
    return _RunBound(value, nodes.s[:-1], nodes.piece, loss, worth, alone)


def _find_end_states(
    path: ActuatorPath, order: int, ends: tuple[int | None, int | None], count: int
) -> tuple[Array, np.ndarray, list[_Rest]]:
    """Return a and b at both ends (2, 2), where λ has to be 0 (count, 2), and the ends at rest.

    λ has to be 0 where a or b is not known.
    """
    given, free = np.zeros((2, 2)), np.zeros((count, 2), bool)
    rests = []
    still = count_zero_derivatives(path)
    last = len(path.breaks) - 1
    for side, stop in enumerate(ends):
        at = -1 if side else 0
        if stop is None:  # inside a run, in a state that is free
            free[at] = True
            continue
        outer = stop in (0, last)
        zeros = int(still[side, stop - 1 if side else stop])
        passed = zeros > 0 and not outer and still[1 - side, stop if side else stop - 1] > 0 and path.dwells[stop] == 0
        if outer:
            given[side] = path.end_speeds[side] ** 2, path.end_accelerations[side]
            resting_zeros = zeros if path.end_speeds[side] == 0 else 0
            free[at] = (resting_zeros > 0, True) if order == 2 else (resting_zeros > 1, resting_zeros > 0)
        elif passed:
            free[at] = True
        elif zeros > 0:
            free[at] = (True, True) if order == 2 or zeros > 1 else (False, True)
        # q̇ = q′ṡ is 0; at order 3 so is q̈ = q′s̈ + q″ṡ², but where the motion goes on through q′ = 0
        standing = zeros > 1 or (not passed and (zeros > 0 or given[side, 1] == 0))
        resting = given[side, 0] == 0 and (order == 2 or standing or passed)
        if resting and zeros < 3:
            rests.append(_Rest(side, zeros, standing))
            free[at] = True
    return given, free, rests


def _find_dead_nodes(rows: RowCells, order: int, first: int, last: int) -> np.ndarray:
    """Nodes beside cells, from the first to before the last, in which no axis with a limit surely moves."""
    ends, off = rows.ends[first:last], rows.off[first:last]
    most = np.abs(ends[:, :, 0]).min(1) - off[:, 0]
    moves = (most > 0) & (ends[:, 0, 0] * ends[:, 1, 0] > 0)
    dead = ~(moves & (rows.acceleration.max(0) < np.inf)).any(1)
    if order == 3:
        dead |= ~(moves & (rows.jerk.max(0) < np.inf)).any(1)
    found = np.zeros(len(dead) + 1, bool)
    found[:-1] |= dead
    found[1:] |= dead
    return found


def _guess_motion(trajectory: Trajectory, nodes: _Nodes, length: float, took: float) -> Array:
    """(M, 2, 3): a, b, c at both ends of each cell, scaled, of the motion a little slower; inside of cells at rest."""
    mean = np.diff(nodes.s) / np.maximum(np.diff(nodes.t), 1e-15 * took)
    out = np.zeros((len(mean), 2, 3))
    for e, t in enumerate((nodes.t[:-1], nodes.t[1:])):
        own = t.copy()
        rests = nodes.a[e : len(mean) + e] < 1e-6 * mean**2
        own[rests] = (INSIDE * nodes.t[1 - e : len(mean) + 1 - e] + (1 - INSIDE) * t)[rests]
        k = trajectory.locate((nodes.t[:-1] + nodes.t[1:]) / 2)
        tau = np.clip(own - trajectory.knots[k], 0.0, np.diff(trajectory.knots)[k])
        v = trajectory.v[k] + tau * (trajectory.a[k] + tau * trajectory.j[k] / 2)
        v = np.maximum(v, 0.05 * mean) * SLOWER * took / length
        out[:, e, 0] = v**2
        out[:, e, 1] = SLOWER**2 * (trajectory.a[k] + tau * trajectory.j[k]) * took**2 / length
        out[:, e, 2] = SLOWER**3 * trajectory.j[k] * took**3 / length / v
    return out
