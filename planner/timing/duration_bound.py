"""How near a motion is to the fastest, proved: cells along its path, multipliers, and more cells where it loses.

What is proved is `planner.certificate.lower_bound`'s; here is chosen what it is proved with, near a known motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.certificate.lower_bound import RowCells, bound_cells, bound_rest, enclose_rows, find_left_out, leave_rest
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath
from planner.path.stands import count_zero_derivatives
from planner.timing.solvers.dual import DualCells, Multipliers, maximise_dual
from planner.timing.solvers.inner_minimum import NEAR, fill_sets
from planner.timing.solvers.limit_worth import weigh_limits, weigh_rest
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
# Cells of a run of a quick bound at least; and how far off it is tried at order 2 as well.
LEAST_SHARED_CELLS, QUICK_POOR_GAP = 24, 0.05
# Where a bound is no nearer than so, one round more is tried, and order 2.
POOR_GAP = 0.01
# Of programs of many runs each is bounded well enough so near: finer cells take most of the time.
MANY_RUNS, FAIR_GAP = 32, 0.001
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


def bound_duration(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    order: int,
    *,
    gap: float | None = None,
    effort: int = ROUNDS,
    most_cells: int | None = None,
) -> DurationBound:
    """Prove a lower bound for a motion: of its runs between stops, one by one, and its dwells.

    gap: how near it shall come, as a share, if so many rounds of finer cells (effort) allow; None: one round of them,
    and of many runs a round where it is needed
    most_cells: about how many cells a quick bound has in all, without a round of finer ones; None: no such limit
    """
    if most_cells is not None:
        return _bound_quickly(trajectory, limits, order, most_cells)
    path = trajectory.path
    every = list(pairwise(np.flatnonzero(path.stops(order)).tolist()))
    if gap is None and len(every) > MANY_RUNS:
        gap = FAIR_GAP
    rounds = ROUNDS if gap is None else effort
    runs = [_bound_run(trajectory, limits, order, ends, gap, rounds) for ends in every]
    return _sum_runs(trajectory, limits, runs)


def _bound_quickly(trajectory: Trajectory, limits: Sequence[Limit], order: int, most_cells: int) -> DurationBound:
    """Share the cells out by the runs' time pieces; each run has LEAST_SHARED_CELLS at least."""
    path = trajectory.path
    stops = np.flatnonzero(path.stops(order))
    moving = (trajectory.v != 0) | (trajectory.a != 0) | (trajectory.j != 0)
    owner = np.searchsorted(stops, trajectory.piece[moving], side="right") - 1
    pieces = np.bincount(owner, minlength=len(stops) - 1)
    cells = np.maximum(most_cells * pieces // pieces.sum(), LEAST_SHARED_CELLS).tolist()
    runs = []
    for ends, most in zip(pairwise(stops.tolist()), cells, strict=True):
        nodes = _thin_nodes(_place_nodes(trajectory, order, ends), most)
        run = _bound_nodes(trajectory, limits, order, ends, nodes)
        took = float(nodes.t[-1] - nodes.t[0])
        if order == 3 and took > (1 + QUICK_POOR_GAP) * run.value:  # with few cells less is lost without the jerk
            other = _bound_nodes(trajectory, limits, 2, ends, nodes)
            run = other if other.value > run.value else run
        runs.append(run)
    return _sum_runs(trajectory, limits, runs)


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
    trajectory: Trajectory, limits: Sequence[Limit], order: int, ends: tuple[int, int], gap: float | None, rounds: int
) -> _RunBound:
    """A run from break to break."""
    nodes = _place_nodes(trajectory, order, ends)
    best = _bound_nodes(trajectory, limits, order, ends, nodes)
    found, first = best, len(nodes.piece)
    took = float(nodes.t[-1] - nodes.t[0])
    for n in range(1, rounds + 2):
        near = took <= (1 + (POOR_GAP if gap is None else gap)) * best.value
        if (near and (n >= rounds or gap is not None)) or n > rounds:
            break
        most = MOST_GROWTH[order] * (first if gap is None else 2 * len(nodes.piece))
        nodes = _refine(trajectory, nodes, found.loss, most)
        found = _bound_nodes(trajectory, limits, order, ends, nodes)
        best = found if found.value > best.value else best
    if order == 3 and took > (1 + POOR_GAP) * best.value:  # without jerk, what is proved is the more surely so
        found = _bound_nodes(trajectory, limits, 2, ends, _place_nodes(trajectory, 2, ends))
        best = found if found.value > best.value else best
    return best


def _place_nodes(trajectory: Trajectory, order: int, ends: tuple[int, int]) -> _Nodes:
    """At the motion's knots, and more near rests."""
    moving = (trajectory.v != 0) | (trajectory.a != 0) | (trajectory.j != 0)
    own = np.flatnonzero(moving & (trajectory.piece >= ends[0]) & (trajectory.piece < ends[1]))
    knots = trajectory.knots[own[0] : own[-1] + 2]
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
    return _look_at_nodes(trajectory, ends, own, t)


def _look_at_nodes(trajectory: Trajectory, ends: tuple[int, int], own: np.ndarray, t: Array) -> _Nodes:
    """The motion at instants t, with a node at every break of the path in between."""
    path = trajectory.path
    k = np.clip(trajectory.locate(t), own[0], own[-1])
    tau = t - trajectory.knots[k]
    s = trajectory.s[k] + tau * (trajectory.v[k] + tau * (trajectory.a[k] / 2 + tau * trajectory.j[k] / 6))
    v, b = (
        trajectory.v[k] + tau * (trajectory.a[k] + tau * trajectory.j[k] / 2),
        trajectory.a[k] + tau * trajectory.j[k],
    )
    breaks = path.breaks[ends[0] : ends[1] + 1]
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
    piece = ends[0] + np.clip(np.searchsorted(breaks, where[:-1], side="right") - 1, 0, len(breaks) - 2)
    return _Nodes(where, np.maximum(v[every], 0.0) ** 2, b[every], np.maximum.accumulate(t[every]), piece)


def _refine(trajectory: Trajectory, nodes: _Nodes, loss: Array, most: float) -> _Nodes:
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
    ends = int(nodes.piece[0]), int(nodes.piece[-1]) + 1
    own = np.array([trajectory.locate(nodes.t[:1])[0], max(trajectory.locate(nodes.t[-1:] * (1 - 1e-15))[0], 0)])
    return _look_at_nodes(trajectory, ends, own, np.unique(t))


def _bound_nodes(
    trajectory: Trajectory, limits: Sequence[Limit], order: int, ends: tuple[int, int], nodes: _Nodes
) -> _RunBound:
    """With multipliers found for these cells."""
    partings = MOST_PARTINGS
    path = trajectory.path
    rows = enclose_rows(path, limits, nodes.s, nodes.piece)
    if order == 2:
        rows = rows._replace(jerk=np.full_like(rows.jerk, np.inf))
    given, free, still = _find_end_states(path, order, ends, len(nodes.s))
    # cells beside rests are bounded in closed form, whatever is known of λ there
    first, last = int(still[0] >= 0), len(nodes.piece) - int(still[1] >= 0)
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
            proved = _prove_run(rows, nodes, scaled, found, state, (length, took), order, still)
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
    still: np.ndarray,
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
    rests = [(side, int(still[side])) for side in (0, 1) if still[side] >= 0]

    def prove() -> Array:
        """What is lost on each cell."""
        fill_sets(rows.ends, rows.width, rows.acceleration, rows.jerk, multipliers, bulge, about, jerky, sets, speeds)
        bound_cells(rows, order == 3, multipliers, bulge, sets, speeds, about, out)
        for side, zeros in rests:
            out[-side] = bound_rest(leave_rest(rows, side, zeros), side, multipliers[1 - 3 * side])
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
    for side, zeros in rests:
        worth[-side], alone[-side] = weigh_rest(rows, side, zeros, multipliers[1 - 3 * side])
    return _RunBound(value, nodes.s[:-1], nodes.piece, loss, worth, alone)


def _find_end_states(
    path: ActuatorPath, order: int, ends: tuple[int, int], count: int
) -> tuple[Array, np.ndarray, np.ndarray]:
    """a and b at both ends (2, 2); which nodes' λ (count, 2) have to be 0 as these are not known; and how many of the
    path's derivatives are 0 at the ends (2,) at which all axes rest, −1 at others."""
    given, free, rests = np.zeros((2, 2)), np.zeros((count, 2), bool), np.full(2, -1)
    still = count_zero_derivatives(path)
    last = len(path.breaks) - 1
    for side, stop in enumerate(ends):
        at = -1 if side else 0
        outer = stop in (0, last)
        own = int(still[side, ends[1] - 1 if side else ends[0]])
        passed = own > 0 and not outer and still[1 - side, stop if side else stop - 1] > 0 and path.dwells[stop] == 0
        if outer:
            given[side] = path.end_speeds[side] ** 2, path.end_accelerations[side]
            stands = own if path.end_speeds[side] == 0 else 0
            free[at] = (stands > 0, True) if order == 2 else (stands > 1, stands > 0)
        elif passed:
            free[at] = True
        elif own > 0:
            free[at] = (True, True) if order == 2 or own > 1 else (False, True)
        # q̇ = q′ṡ is 0 at order 2; at order 3 q̈ = q′s̈ + q″ṡ² too
        resting = given[side, 0] == 0 and (order == 2 or own > 1 or (not passed and (own > 0 or given[side, 1] == 0)))
        if resting and own < 3:
            rests[side], free[at] = own, True
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
