"""Bound of one span of a run: cells, multipliers, and proof.

`dual` finds multipliers near the motion, in units of the span's length and duration. `lower_bound`
and `rest` prove the bound.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from planner.bounds.cells import (
    Nodes,
    guess_motion,
    place_nodes,
    refine_nodes,
    sample_nodes,
    thin_nodes,
)
from planner.bounds.dual import DualCells, Multipliers, maximise_dual
from planner.bounds.inner_minimum import NEAR, fill_sets
from planner.bounds.lower_bound import RowCells, Trial, bound_cells, enclose_rows
from planner.bounds.rest import bound_rest, leave_rest
from planner.bounds.spans import Span
from planner.bounds.worth import finite, weigh_limits, weigh_rest
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath
from planner.path.stands import count_zero_derivatives
from planner.trajectory import Trajectory

# Gap to which a span is refined if none is stated, and the most refinements.
POOR_GAP = 0.01
MOST_ROUNDS = 4
# Most refinements for a stated gap.
STATED_ROUNDS = 2
# Growth of the number of cells in the first refinement by order: twice as much for a stated gap.
FIRST_GROWTH = {2: 1.0, 3: 3.0}
# Growth in later refinements.
GROWTH = 2.0
# Gap above which a quick bound also tries order 2: with few cells it is often better without jerk.
QUICK_POOR_GAP = 0.05
# Factor of λ next to a cell without a bound, and how often it is applied. The last is 0.
SHRINKAGE = 0.7
SHRINKAGES = 40
# λ becomes 0 around cells whose loss exceeds their time by this share of the span's time.
PARTING_LOSS = 0.005
# Most searches after that.
MOST_PARTINGS = 3


class SpanBound(NamedTuple):
    """Bound (s), and the fields of `DurationBound` for its cells."""

    value: float
    s: Array
    piece: np.ndarray
    loss: Array
    worth: Array
    alone: Array


class Case(NamedTuple):
    """Motion, with the limits and the order of its bound."""

    trajectory: Trajectory
    limits: Sequence[Limit]
    order: int


class _Rest(NamedTuple):
    """End of a span at which no axis moves.

    side      0 for the start, 1 for the end
    zeros     how many of the path's derivatives are 0 there
    standing  whether all accelerations are 0 as well
    """

    side: int
    zeros: int
    standing: bool


@dataclass(frozen=True, slots=True)
class _Ends:
    """Values of a and b at both ends of a span (2, 2), where λ must be 0 (2, 2), and rests."""

    state: Array
    free: np.ndarray
    rests: tuple[_Rest, ...]


@dataclass(frozen=True, slots=True)
class _Problem:
    """Cells of a span: rows in SI units, and the dual problem in units of its length and time.

    state (M+1, 2)  a and b of the motion
    length, time    m, s
    inner           the cells not next to a rest, whose bound is in closed form, for any λ
    """

    order: int
    nodes: Nodes
    rows: RowCells
    dual: DualCells
    state: Array
    rests: tuple[_Rest, ...]
    length: float
    time: float
    inner: slice

    def rows_at(self, rest: _Rest) -> RowCells:
        """Return the rows next to a rest: without jerk if an axis may accelerate there."""
        return self.rows if rest.standing else _without_jerk(self.rows)


def join_bounds(bounds: Sequence[SpanBound]) -> SpanBound:
    """Add the bounds of consecutive spans or runs."""
    value = sum(max(bound.value, 0.0) for bound in bounds)
    _, *arrays = zip(*bounds, strict=True)
    return SpanBound(value, *map(np.concatenate, arrays))


def bound_span(case: Case, span: Span, gap: float | None) -> SpanBound:
    """Bound a span, and refine its cells to the gap, or at least once if no gap is stated."""
    if span.cruising:
        return _bound_cruise(case, span)
    nodes = place_nodes(case.trajectory, span)
    refined = best = _bound_nodes(case, span, nodes)
    aim, rounds = (POOR_GAP, MOST_ROUNDS) if gap is None else (gap, STATED_ROUNDS)
    growth = FIRST_GROWTH[case.order] * (1 if gap is None else 2)
    for n in range(rounds):
        near = span.duration <= (1 + aim) * best.value
        if near and (n > 0 or gap is not None):
            break
        nodes = refine_nodes(case.trajectory, span, nodes, refined.loss, growth * len(nodes.piece))
        refined = _bound_nodes(case, span, nodes)
        best = max(best, refined, key=lambda bound: bound.value)
        growth = GROWTH if gap is None else growth
    return best


def bound_span_quickly(case: Case, span: Span, most_cells: int) -> SpanBound:
    """Bound a span with about `most_cells` cells, without refinement."""
    if span.cruising:
        return _bound_cruise(case, span)
    nodes = thin_nodes(place_nodes(case.trajectory, span), most_cells)
    bound = _bound_nodes(case, span, nodes)
    if case.order == 3 and span.duration > (1 + QUICK_POOR_GAP) * bound.value:
        other = _bound_nodes(case._replace(order=2), span, nodes)
        bound = max(bound, other, key=lambda each: each.value)
    return bound


def _bound_cruise(case: Case, span: Span) -> SpanBound:
    """Bound a cruise by the limits on speed alone: T ≥ ∫ ds / ṡ_max."""
    knots = case.trajectory.knots[span.pieces[0] : span.pieces[-1] + 2]
    nodes = sample_nodes(case.trajectory, span, knots)
    rows = enclose_rows(case.trajectory.path, case.limits, nodes.s, nodes.piece)
    count = len(nodes.piece)
    axes = rows.acceleration.shape[1]
    out = np.zeros(count)
    trial = Trial(
        nodes=np.zeros((count + 1, 2)),
        bulge=np.zeros(count),
        rows=np.zeros((count, 1, 2, 2, axes)),
        speed=np.zeros((count, 1, 2)),
        about=np.zeros(count),
    )
    bound_cells(rows, case.order == 3, trial, out)
    took = np.diff(nodes.t)
    # one per cent more speed saves about one per cent of the time
    worth = np.zeros((count, 3, axes))
    worth[:, 2, 0] = took
    return SpanBound(float(out.sum()), nodes.s[:-1], nodes.piece, took - out, worth, 0.01 * worth)


def _bound_nodes(case: Case, span: Span, nodes: Nodes) -> SpanBound:
    """Bound a span by its cells, with λ = 0 around cells that lose too much."""
    problem = _pose(case, span, nodes)
    inner = problem.inner
    free = problem.dual.free
    start = guess_motion(case.trajectory, nodes, problem.length, problem.time)
    if case.order == 2:
        start[:, :, 2] = 0.0
    first = inner.start
    last = inner.stop
    dual = problem.dual._replace(
        width=problem.dual.width[inner],
        q=problem.dual.q[inner],
        y=problem.dual.y[inner],
        root=np.sqrt(start[inner, :, 0]),
        free=free[first : last + 1],  # a view of free, which changes below
    )
    bounds = []
    for _ in range(MOST_PARTINGS + 1):
        multipliers = _pad(maximise_dual(dual, start[inner]), first, len(nodes.piece) - last)
        with np.errstate(all="ignore"):
            bound = _prove(problem, multipliers)
        bounds.append(bound)
        # λ = 0 there cuts the motion in two, with separate bounds
        most = np.diff(nodes.t) + PARTING_LOSS * problem.time
        poor = np.flatnonzero(~(bound.loss < most))
        poor = poor[(poor >= first) & (poor < last)]
        if not len(poor):
            break
        free[poor] = free[poor + 1] = True
    return max(bounds, key=lambda each: each.value)


def _pose(case: Case, span: Span, nodes: Nodes) -> _Problem:
    """Enclose the rows over all cells, and scale them."""
    path = case.trajectory.path
    rows = enclose_rows(path, case.limits, nodes.s, nodes.piece)
    if case.order == 2:
        rows = _without_jerk(rows)
    ends = _find_ends(path, case.order, span.stops)
    resting = {rest.side for rest in ends.rests}
    count = len(nodes.piece)
    inner = slice(int(0 in resting), count - int(1 in resting))
    free = np.zeros((count + 1, 2), bool)
    free[[0, -1]] = ends.free
    free[inner.start : inner.stop + 1] |= _find_dead_nodes(rows, case.order, inner)[:, None]
    state = np.stack([nodes.a, nodes.b], 1)
    state[[0, -1]] = ends.state

    length = float(nodes.s[-1] - nodes.s[0])
    time = float(nodes.t[-1] - nodes.t[0])
    units = np.array([(time / length) ** 2, time**2 / length])
    dual = DualCells(
        rows.width / length,
        np.ascontiguousarray(rows.ends * np.array([length, length**2, length**3])[:, None]),
        rows.speed * (length / time) ** 2,
        rows.acceleration * time**2,
        rows.jerk * time**3,
        np.ones((count, 2)),
        state[[inner.start, inner.stop]] * units,
        free,
    )
    return _Problem(case.order, nodes, rows, dual, state, ends.rests, length, time, inner)


def _without_jerk(rows: RowCells) -> RowCells:
    return rows._replace(jerk=np.full_like(rows.jerk, np.inf))


def _pad(multipliers: Multipliers, before: int, after: int) -> Multipliers:
    """Add cells before and after, with multipliers 0."""
    arrays = multipliers[:-1]
    padded = (np.pad(each, [(before, after), *[(0, 0)] * (each.ndim - 1)]) for each in arrays)
    return Multipliers._make([*padded, multipliers.iterations])


def _scale(problem: _Problem, multipliers: Multipliers) -> tuple[Trial, np.ndarray]:
    """Return multipliers in SI units, and the cells that need several sets.

    Multipliers are 0 where they are not finite, and λ where it must be.
    """
    length = problem.length
    time = problem.time
    rows = problem.rows
    nodes = finite(multipliers.nodes) * np.array([time**3 / length**2, time**3 / length])
    nodes[problem.dual.free] = 0.0  # exactly: the state is unknown there
    bulge = finite(multipliers.bulge) * time**3 / length**2
    bulge[(nodes[1:] == 0).all(1) & (nodes[:-1] == 0).all(1)] = 0.0

    size = np.stack([rows.acceleration, rows.jerk], 1)
    bound = np.where(multipliers.rows > 0, size[0], size[1])
    of_rows = finite(np.where(np.isfinite(bound), multipliers.rows / bound, 0.0))
    of_rows[:, :, 0] *= time / length  # those of jerk scale with 1/√a, as the integrand
    sets = np.zeros((len(bulge), 1 + len(NEAR), *of_rows.shape[1:]))
    speeds = np.zeros((len(bulge), 1 + len(NEAR), 2))
    sets[:, 0] = of_rows
    speeds[:, 0] = finite(multipliers.speed) * time / length
    used = np.abs(of_rows[:, :, 1]) * finite(bound[:, :, 1])
    x = np.where(np.isfinite(multipliers.x), multipliers.x, 1.0)
    about = x[:, :, 0].mean(1) * (length / time) ** 2
    jerky = np.flatnonzero(used.sum(-1).max(1) > 0.999)
    return Trial(nodes, bulge, sets, speeds, about), jerky


def _prove(problem: _Problem, multipliers: Multipliers) -> SpanBound:
    """Return the bound by multipliers. λ shrinks next to cells that lack a bound."""
    trial, jerky = _scale(problem, multipliers)
    nodes = trial.nodes
    bulge = trial.bulge
    out = _bound_all(problem, trial, jerky)
    for n in range(SHRINKAGES):
        weak = ~(out > -np.inf)
        if not weak.any():
            break
        factor = SHRINKAGE if n + 1 < SHRINKAGES else 0.0
        nodes[:-1][weak] *= factor
        nodes[1:][weak & ~np.append(weak[1:], False)] *= factor
        bulge[weak] *= factor
        out = _bound_all(problem, trial, jerky)

    edges = np.where(nodes == 0, 0.0, nodes * problem.state)  # λa a, λb b
    loss = np.diff(problem.nodes.t) + np.diff(edges.sum(1)) - out
    value = float(out.sum() - edges[-1].sum() + edges[0].sum())
    size = float(np.abs(out).sum() + np.abs(edges[[0, -1]]).sum())
    value -= 1e-15 * len(out) * size  # rounding error
    worth, alone = weigh_limits(problem.dual, multipliers, problem.time)
    for rest in problem.rests:
        leaving = problem.rows_at(rest), rest.side, rest.zeros
        worth[-rest.side], alone[-rest.side] = weigh_rest(*leaving, nodes[1 - 3 * rest.side])
    return SpanBound(value, problem.nodes.s[:-1], problem.nodes.piece, loss, worth, alone)


def _bound_all(problem: _Problem, trial: Trial, jerky: np.ndarray) -> Array:
    """Return the least time of each cell (M,), s, with the terms of λ."""
    rows = problem.rows
    out = np.zeros(len(trial.bulge))
    fill_sets(rows, trial, jerky)
    bound_cells(rows, problem.order == 3, trial, out)
    for rest in problem.rests:
        leaving = leave_rest(problem.rows_at(rest), rest.side, rest.zeros)
        out[-rest.side] = bound_rest(leaving, rest.side, trial.nodes[1 - 3 * rest.side])
    return out


def _find_ends(path: ActuatorPath, order: int, stops: tuple[int | None, int | None]) -> _Ends:
    """Return the states at both ends of a span. λ must be 0 where a state is unknown."""
    state = np.zeros((2, 2))
    free = np.zeros((2, 2), bool)
    rests = []
    zero_derivatives = count_zero_derivatives(path)
    last = len(path.breaks) - 1
    for side, stop in enumerate(stops):
        if stop is None:  # inside a run
            free[side] = True
            continue
        outer = stop in (0, last)
        zeros = int(zero_derivatives[side, stop - 1 if side else stop])
        # a turn without a dwell, which ṡ passes
        passed = zeros > 0 and not outer and path.dwells[stop] == 0
        passed = passed and zero_derivatives[1 - side, stop if side else stop - 1] > 0
        if outer:
            state[side] = path.end_speeds[side] ** 2, path.end_accelerations[side]
            at_rest = zeros if path.end_speeds[side] == 0 else 0
            free[side] = (at_rest > 0, True) if order == 2 else (at_rest > 1, at_rest > 0)
        elif passed:
            free[side] = True
        elif zeros > 0:
            free[side] = (order == 2 or zeros > 1, True)
        # q̇ = q′ṡ is 0. At order 3 q̈ = q′s̈ + q″ṡ² is 0 too, unless the motion passes q′ = 0
        standing = zeros > 1 or (not passed and (zeros > 0 or state[side, 1] == 0))
        resting = state[side, 0] == 0 and (order == 2 or standing or passed)
        if resting and zeros < 3:
            rests.append(_Rest(side, zeros, bool(standing)))
            free[side] = True
    return _Ends(state, free, tuple(rests))


def _find_dead_nodes(rows: RowCells, order: int, inner: slice) -> np.ndarray:
    """Return whether each node (M+1,) touches a cell in which no limited axis surely moves."""
    ends = rows.ends[inner, :, 0]
    off = rows.off[inner, 0]
    moves = (np.abs(ends).min(1) > off) & (ends[:, 0] * ends[:, 1] > 0)
    dead = ~(moves & (rows.acceleration.max(0) < np.inf)).any(1)
    if order == 3:
        dead |= ~(moves & (rows.jerk.max(0) < np.inf)).any(1)
    return np.asarray(np.append(dead, False) | np.append(False, dead))
