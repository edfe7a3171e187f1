"""The rows of every limit along a run: evaluated, normalised, and left out where they cannot
bind.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from planner.limits.limit import Limit, Rows, Term, order_of, select_timed
from planner.limits.lowered import ALL, Shares
from planner.path.actuation import ActuatorPath, Points, make_points
from planner.timing.problem import (
    POWERS,
    REST,
    SOLVER_AIM,
    Block,
    EndCondition,
    Ends,
    Problem,
    SideRows,
)

# Loads take long to evaluate and seldom bind. A load's rows are left out if no motion within the
# other limits can use more than IDLE_SHARE of it at any grid point (the rest is for what happens
# between them), or more than SURELY_IDLE_SHARE of it at every IDLE_STRIDE-th point.
IDLE_SHARE = 0.9
SURELY_IDLE_SHARE = 0.5
IDLE_STRIDE = 16
BOUNDING_TERMS = ({Term.SD}, {Term.SD2}, {Term.SDD, Term.SD2}, {Term.SDD})
"""Terms of rows that bound ṡ and s̈."""
# Share of the jerk limit that a motion uses where it passes q′ = q″ = 0, if other limits are used
# less than the second share one interval farther on.
PASSED_SHARE = 0.97
MOST_PASSED_USE = 0.8


def pose_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    s: Array,
    piece: np.ndarray,
    ends: Ends = (REST, REST),
) -> Problem:
    """Evaluate the rows of every limit on time on a grid s (N+1,), both sides of every point.

    The rows of loads that surely do not bind are left out. The proof looks at all limits.
    """
    sides = _Sides.of(path, s, piece, order_of(limits))
    timed = select_timed(limits)
    blocks: dict[str, Block | None] = {}
    for limit in timed:
        if Term.ONE not in limit.terms:
            blocks[limit.name] = sides.pose(limit)
    quick = [block for block in blocks.values() if block is not None]
    for limit in timed:
        if Term.ONE in limit.terms and not _is_surely_idle(limit, sides, quick):
            blocks[limit.name] = sides.pose(limit)
    in_order = [block for limit in timed if (block := blocks.get(limit.name)) is not None]
    start = _find_passing_speed(ends[0], in_order, 0)
    end = _find_passing_speed(ends[1], in_order, -1)
    active = tuple(_open_room(block, ends) for block in _drop_idle(in_order))
    return Problem(s, piece, active, (start, end))


@dataclass(frozen=True, slots=True)
class _Sides:
    """Points of a grid from both sides: first the N starts of the intervals, then other ends.

    ends  (N,) index of each interval's end among the points
    """

    points: Points
    ends: np.ndarray

    @classmethod
    def of(cls, path: ActuatorPath, s: Array, piece: np.ndarray, order: int) -> "_Sides":
        """Evaluate the path at the points of a grid."""
        count = len(piece)
        # an interval ends where the next one starts, unless that is on another piece
        alone = np.append(np.diff(piece) != 0, True)
        ends = np.where(alone, count - 1 + np.cumsum(alone), np.arange(1, count + 1))
        places = np.concatenate([s[:-1], s[1:][alone]])
        pieces = np.concatenate([piece, piece[alone]])
        return cls(make_points(path, places, pieces, order), ends)

    def pose(self, limit: Limit) -> Block | None:
        """Return the rows of a limit. None where nothing is bound."""
        return self.normalise(limit.name, limit.rows(self.points), limit.shares)

    def pick(self, intervals: np.ndarray) -> "_Sides":
        """Return the starts of some intervals, as their ends too."""
        points = self.points
        derivatives = tuple(values[intervals] for values in points.derivatives)
        few = Points(points.path, points.s[intervals], points.piece[intervals], derivatives)
        return _Sides(few, np.arange(len(intervals)))

    def normalise(self, name: str, rows: Rows, shares: Shares) -> Block | None:
        """Divide rows by half of the range between their bounds.

        shares  of the limit, by which it is lowered along the path
        """
        count = len(self.ends)
        size = max(count, int(self.ends.max()) + 1)
        if len(shares.values):
            rows = rows.scale(shares.on_grid(self.points.s)[:, None])
        bound = np.broadcast_to(rows.bound, (size, np.shape(rows.bound)[-1]))
        finite = np.isfinite(bound).any(0)
        if not finite.any():
            return None
        half = bound[:, finite]
        middle = np.zeros(int(finite.sum()))
        if rows.below is not None:
            above = rows.bound[finite]
            below = rows.below[finite]
            half = (above + below) / 2
            middle = (above - below) / 2 / half
        scaled = {term: values[:, finite] / half for term, values in rows.coefficients.items()}
        speeds = None
        if rows.speed_range is not None:
            low, high = (values[:, finite] for values in rows.speed_range)
            speeds = np.stack([low[:count], high[:count], low[self.ends], high[self.ends]])
        return Block(
            name,
            {term: values[:count] for term, values in scaled.items()},
            {term: values[self.ends] for term, values in scaled.items()},
            np.ones(count),
            middle,
            speeds,
            None if rows.convex_part is None else self.normalise(name, rows.convex_part, ALL),
        ).aimed(SOLVER_AIM)


def _find_passing_speed(end: EndCondition, blocks: Sequence[Block], at: int) -> EndCondition:
    """Return the condition at the first or last point (at: 0 or −1) with its passing speed.

    Where q′ = q″ = 0, nearly |q‴| ṡ³ = J. The passing speed is 0 where other limits would be used
    up by the next grid point: there the jerk alone does not decide.
    """
    if end.zero_derivatives != 2 or end.speed > 0:
        return end
    use = dict.fromkeys(POWERS, 0.0)
    for block in blocks:
        outer, inner = (block.end, block.start) if at else (block.start, block.end)
        for term in POWERS:
            if term in outer:
                rows = outer if term is Term.SD3 else inner
                use[term] = max(use[term], float(block.share(rows[term][at]).max()))
    if use[Term.SD3] == 0:
        return end
    speed = float(np.cbrt(PASSED_SHARE / use[Term.SD3]))
    if max(use[Term.SD] * speed, use[Term.SD2] * speed**2) >= MOST_PASSED_USE:
        return end
    return replace(end, passing_speed=speed)


def _open_room(block: Block, ends: Ends) -> Block:
    """Give a block all of its room, if stated speeds at both ends need more than solvers aim at."""
    speeds = [end.speed for end in ends]
    if min(speeds) == 0:
        return block
    at_start = block.find_steady_use(0, speeds[0])
    at_end = block.find_steady_use(-1, speeds[1])
    if at_start > block.room[0] or at_end > block.room[-1]:
        return replace(block, room=np.ones(len(block.room)))
    return block


def leave_out_idle(limits: Sequence[Limit], problem: Problem) -> list[Limit]:
    """Return the limits without those on loads that the problem has no rows of."""
    names = {block.name for block in problem.blocks}
    return [limit for limit in limits if limit.name in names or Term.ONE not in limit.terms]


def _is_surely_idle(limit: Limit, sides: _Sides, others: Sequence[Block]) -> bool:
    """Return whether a load is far from binding at a few of the intervals' starts."""
    if not others:
        return False
    count = len(sides.ends)
    piece = sides.points.piece[:count]
    begins = np.diff(piece, prepend=-1) != 0
    few = np.flatnonzero(begins | (np.arange(count) % IDLE_STRIDE == 0))
    if 2 * len(few) > count:
        return False
    block = sides.pick(few).pose(limit)
    if block is None:
        return True
    bounding = []
    for other in _select_bounding(others):
        rows = {term: values[few] for term, values in other.start.items()}
        bounding.append((rows, 1 + np.abs(other.middle)))
    if not bounding:
        return False
    bounds = _bound_terms(bounding)
    return _find_largest_use(block, [bounds, bounds]) <= SURELY_IDLE_SHARE


def _drop_idle(blocks: Sequence[Block]) -> list[Block]:
    """Leave out loads of which no motion within the other limits can use more than IDLE_SHARE."""
    if not any(Term.ONE in block.start for block in blocks):
        return list(blocks)
    bounding = [(block, 1 + np.abs(block.middle)) for block in _select_bounding(blocks)]
    starts = _bound_terms([(block.start, most) for block, most in bounding])
    ends = _bound_terms([(block.end, most) for block, most in bounding])
    return [block for block in blocks if not _find_largest_use(block, [starts, ends]) <= IDLE_SHARE]


def _select_bounding(blocks: Sequence[Block]) -> list[Block]:
    always = [block for block in blocks if block.speed_range is None]
    return [block for block in always if set(block.start) in BOUNDING_TERMS]


def _bound_terms(rows: Sequence[tuple[SideRows, Array]]) -> dict[Term, Array]:
    """Return the largest size (N,) of each term within some rows; ∞ where none bounds it.

    rows  with the largest value (m,) of each
    """
    count = len(next(iter(rows[0][0].values()))) if rows else 1
    v = np.full(count, np.inf)
    a = np.full(count, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for row, most in rows:
            if len(row) == 1 and Term.SDD not in row:
                ((term, size),) = row.items()
                v = np.fmin(v, (most / np.abs(size)).min(1) ** (1 / term.per_time))
        for row, most in rows:
            if Term.SDD in row:
                curvature = 0.0
                if Term.SD2 in row:
                    curvature = np.abs(row[Term.SD2]) * v[:, None] ** 2
                a = np.fmin(a, ((most + curvature) / np.abs(row[Term.SDD])).min(1))
    return {Term.ONE: np.ones(count), Term.SD: v, Term.SD2: v**2, Term.SDD: a}


def _find_largest_use(block: Block, bounds: Sequence[Mapping[Term, Array]]) -> float:
    """Return the largest use of a load by terms of these sizes at both sides; ∞ if one has none."""
    if Term.ONE not in block.start or block.speed_range is not None:
        return np.inf
    if not set(block.start) <= set(bounds[0]):
        return np.inf
    largest = 0.0
    for rows, sizes in zip(block.sides, bounds, strict=True):
        total: Array = np.zeros(1)
        for term, values in rows.items():
            with np.errstate(invalid="ignore"):
                size = np.abs(values) * sizes[term][:, None]
            total = total + np.where(values == 0, 0.0, size)
        use = total / (1 - np.abs(block.middle))
        largest = max(largest, float(np.max(use)))
    return largest
