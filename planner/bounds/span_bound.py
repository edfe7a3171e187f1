"""Bound of one span of a run: cells, multipliers, and proof.

`dual` finds multipliers near the motion. `lower_bound` and `rest` prove the bound.
"""

from collections.abc import Iterator, Sequence
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
from planner.bounds.dual import DualProblem, Multipliers, maximise_dual
from planner.bounds.inner_minimum import NEAR, fill_sets
from planner.bounds.lower_bound import (
    RowCells,
    Trial,
    bound_by_speed,
    bound_cells,
    enclose_rows,
)
from planner.bounds.rest import bound_rest, leave_rest
from planner.bounds.spans import Span
from planner.bounds.worth import weigh_limits, weigh_rest
from planner.limits.limit import Limit
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
    """End of a span at which no axis moves: its cell has a bound in closed form, for any λ.

    side      0 for the start, 1 for the end
    zeros     how many of the path's derivatives are 0 there
    standing  whether all accelerations are 0 as well
    """

    side: int
    zeros: int
    standing: bool

    @property
    def inner_node(self) -> int:
        """The node at the other end of its cell."""
        return 1 if self.side == 0 else -2


@dataclass(frozen=True, slots=True)
class _Problem:
    """Cells of a span.

    state (M+1, 2)  a and b of the motion
    free (M+1, 2)   where λ has to be 0
    inner           the cells not next to a rest, for which multipliers are sought
    """

    nodes: Nodes
    rows: RowCells
    state: Array
    free: np.ndarray
    rests: tuple[_Rest, ...]
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
        nodes = refine_nodes(
            case.trajectory,
            span,
            nodes,
            refined.loss,
            growth * len(nodes.piece),
        )
        refined = _bound_nodes(case, span, nodes)
        best = max(best, refined, key=lambda bound: bound.value)
        growth = GROWTH if gap is None else growth
    return best


def bound_span_quickly(
    case: Case,
    span: Span,
    most_cells: int,
) -> SpanBound:
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
    nodes = sample_nodes(case.trajectory, span, span.knots)
    rows = enclose_rows(case.trajectory.path, case.limits, nodes.s, nodes.piece)
    out = bound_by_speed(rows)
    took = np.diff(nodes.t)
    # one per cent more speed saves about one per cent of the time
    worth = np.zeros((len(took), 3, rows.jerk.shape[1]))
    worth[:, 2, 0] = took
    return SpanBound(
        float(out.sum()),
        nodes.s[:-1],
        nodes.piece,
        took - out,
        worth,
        0.01 * worth,
    )


def _bound_nodes(case: Case, span: Span, nodes: Nodes) -> SpanBound:
    """Bound a span by its cells, with λ = 0 around cells that lose too much."""
    problem = _pose(case, span, nodes)
    start = guess_motion(case.trajectory, nodes)
    if case.order == 2:
        start[:, :, 2] = 0.0
    inner = problem.inner
    dual = DualProblem(
        rows=problem.rows.cut(inner),
        given=problem.state[[inner.start, inner.stop]],
        free=problem.free[inner.start : inner.stop + 1],  # a view of free, which changes below
        x=start[inner],
        length=float(nodes.s[-1] - nodes.s[0]),
        time=float(nodes.t[-1] - nodes.t[0]),
    )
    most = np.diff(nodes.t) + PARTING_LOSS * dual.time
    bounds = []
    for _ in range(MOST_PARTINGS + 1):
        multipliers = maximise_dual(dual)
        with np.errstate(all="ignore"):
            bound = _prove(problem, multipliers)
        bounds.append(bound)
        # λ = 0 there cuts the motion in two, with separate bounds
        poor = np.flatnonzero(~(bound.loss < most)[inner]) + inner.start
        if not len(poor):
            break
        problem.free[poor] = True
        problem.free[poor + 1] = True
    return max(bounds, key=lambda each: each.value)


def _pose(case: Case, span: Span, nodes: Nodes) -> _Problem:
    """Enclose the rows over all cells, and find the states and rests at the ends."""
    rows = enclose_rows(case.trajectory.path, case.limits, nodes.s, nodes.piece)
    if case.order == 2:
        rows = _without_jerk(rows)
    count = len(nodes.piece)
    state = np.stack([nodes.a, nodes.b], 1)
    free = np.zeros((count + 1, 2), bool)
    rests = tuple(_find_rests(case, span.stops, state, free))
    resting = [rest.side for rest in rests]
    inner = slice(int(0 in resting), count - int(1 in resting))
    dead = np.flatnonzero(_find_dead(rows.cut(inner), case.order)) + inner.start
    free[dead] = True
    free[dead + 1] = True
    return _Problem(nodes, rows, state, free, rests, inner)


def _without_jerk(rows: RowCells) -> RowCells:
    return rows._replace(jerk=np.full_like(rows.jerk, np.inf))


def _find_rests(
    case: Case,
    stops: tuple[int | None, int | None],
    state: Array,
    free: np.ndarray,
) -> Iterator[_Rest]:
    """Fill state and free at both ends of a span, and yield the ends at rest.

    λ has to be 0 where a state is unknown, and next to a rest, whose cell has a bound of its own.
    """
    path = case.trajectory.path
    zero_derivatives = count_zero_derivatives(path)
    for side, stop in enumerate(stops):
        free[-side] = True
        if stop is None:  # inside a run
            continue
        outer = stop in (0, len(path.breaks) - 1)
        speed = path.end_speeds[side] if outer else 0.0
        acceleration = path.end_accelerations[side] if outer else 0.0
        state[-side] = speed**2, acceleration
        zeros = int(zero_derivatives[side, stop - side])
        # a turn without a dwell, which ṡ passes
        passed = zeros > 0 and not outer and path.dwells[stop] == 0
        passed = passed and zero_derivatives[1 - side, stop - 1 + side] > 0
        # q̇ = q′ṡ is 0. At order 3 q̈ = q′s̈ + q″ṡ² is 0 too, unless the motion passes q′ = 0
        standing = zeros > 1 or (not passed and (zeros > 0 or acceleration == 0))
        if speed == 0 and zeros < 3 and (case.order == 2 or standing or passed):
            yield _Rest(side, zeros, bool(standing))
        elif not passed:
            unknown = zeros if speed == 0 else 0
            free[-side] = unknown > 1, unknown > 0


def _find_dead(rows: RowCells, order: int) -> np.ndarray:
    """Return in which cells (M,) no limited axis surely moves."""
    ends = rows.ends[:, :, 0]
    moves = (np.abs(ends).min(1) > rows.off[:, 0]) & (ends.prod(1) > 0)
    kinds = (rows.acceleration, rows.jerk)[: order - 1]
    alive = [(moves & np.isfinite(bounds).all(0)).any(1) for bounds in kinds]
    return np.asarray(~np.logical_and.reduce(alive))


def _make_trial(
    multipliers: Multipliers,
    problem: _Problem,
) -> tuple[Trial, np.ndarray]:
    """Return multipliers of all cells, and the cells that need several sets.

    They are 0 next to rests, and λ where it has to be.
    """
    count = len(problem.rows.width)
    axes = problem.rows.jerk.shape[1]
    inner = problem.inner
    trial = Trial(
        nodes=np.zeros((count + 1, 2)),
        bulge=np.zeros(count),
        rows=np.zeros((count, 1 + len(NEAR), 2, 2, axes)),
        speed=np.zeros((count, 1 + len(NEAR), 2, 1)),
        about=np.zeros(count),
    )
    trial.nodes[inner.start : inner.stop + 1] = multipliers.nodes
    trial.nodes[problem.free] = 0.0  # exactly: the state is unknown there
    trial.bulge[inner] = multipliers.bulge
    used = np.any(trial.nodes, axis=1)
    trial.bulge[~(used[1:] | used[:-1])] = 0.0
    trial.rows[inner, 0] = multipliers.rows
    trial.speed[inner, 0, :, 0] = multipliers.speed
    trial.about[inner] = multipliers.x[:, :, 0].mean(1)

    mu = multipliers.rows[:, :, 1]
    size = np.abs(mu) * np.where(mu > 0, problem.rows.jerk[0], problem.rows.jerk[1])
    most = np.nansum(size, -1).max(1)
    return trial, np.flatnonzero(most > 0.999) + inner.start


def _prove(problem: _Problem, multipliers: Multipliers) -> SpanBound:
    """Return the bound by multipliers. λ shrinks next to cells that lack a bound."""
    trial, jerky = _make_trial(multipliers, problem)
    nodes = trial.nodes
    out = _bound_all(problem, trial, jerky)
    for n in range(SHRINKAGES):
        weak = ~(out > -np.inf)
        if not weak.any():
            break
        factor = SHRINKAGE if n + 1 < SHRINKAGES else 0.0
        nodes[:-1][weak] *= factor
        nodes[1:][weak & ~np.append(weak[1:], False)] *= factor
        trial.bulge[weak] *= factor
        out = _bound_all(problem, trial, jerky)

    edges = np.where(nodes == 0, 0.0, nodes * problem.state)  # λa a, λb b
    loss = np.diff(problem.nodes.t) + np.diff(edges.sum(1)) - out
    value = out.sum() - edges[-1].sum() + edges[0].sum()
    size = np.abs(out).sum() + np.abs(edges[[0, -1]]).sum()
    value -= 1e-15 * len(out) * size  # rounding error
    inner = problem.inner
    rows = problem.rows
    worth, alone = np.zeros((2, len(out), *rows.ends.shape[2:]))
    worth[inner], alone[inner] = weigh_limits(rows.cut(inner), multipliers)
    for rest in problem.rests:
        cell = -rest.side
        leaving = problem.rows_at(rest), rest.side, rest.zeros
        worth[cell], alone[cell] = weigh_rest(*leaving, nodes[rest.inner_node])
    return SpanBound(
        value=float(value),
        s=problem.nodes.s[:-1],
        piece=problem.nodes.piece,
        loss=loss,
        worth=worth,
        alone=alone,
    )


def _bound_all(problem: _Problem, trial: Trial, jerky: np.ndarray) -> Array:
    """Return the least time of each cell (M,), s, with the terms of λ."""
    out = bound_by_speed(problem.rows)
    fill_sets(problem.rows, trial, jerky)
    bound_cells(problem.rows, trial, out)
    for rest in problem.rests:
        leaving = leave_rest(problem.rows_at(rest), rest.side, rest.zeros)
        out[-rest.side] = bound_rest(leaving, rest.side, trial.nodes[rest.inner_node])
    return out
