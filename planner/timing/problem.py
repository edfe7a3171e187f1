"""A timing problem as the solvers see it: a grid along one run, and every limit's rows on it, normalised."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from kinematics.foundation.arrays import Array
from planner.limits.limit import Limit, Rows, Term, order_of
from planner.limits.lowered import ALL, Shares
from planner.path.actuation import ActuatorPath, Points, make_points
from planner.path.stands import count_zero_derivatives

SIDES = ("start", "end")
IDLE_SHARE = 0.9
"""Share of a limit on force up to which its rows are left out; the rest is for what happens between grid points."""
# The same at every so many grid points and at each piece's first, where all others are then not looked at.
SURELY_IDLE_SHARE, IDLE_STRIDE = 0.5, 16
BOUNDING_TERMS = ({Term.SD}, {Term.SD2}, {Term.SDD, Term.SD2}, {Term.SDD})
"""Terms of the rows that bound ṡ and s̈: of speed, and of acceleration."""
# Shares of the limits that motions aim at: those of solvers, whose tolerance is near 1e-7, and closed forms.
SOLVER_AIM, EXACT_AIM = 1 - 1e-6, 1 - 1e-9
# Of the jerk limit, what is used where the path stands with q′ = q″ = 0, if others are used less one interval on.
PASSED_SHARE, MOST_PASSED_USE = 0.97, 0.8
# What holding still may use of a limit, as a share, and still leave a motion to be found.
MAX_HOLDING_SHARE = 1 - 1e-9
ODD_TERMS = {Term.SDD, Term.SDSDD}
"""Terms that change their sign where a motion is run the other way, from its end to its start."""

Solver = Literal["passes", "toppra"]
"""Of order 2: our own two passes, or toppra."""


@dataclass(frozen=True, slots=True)
class EndCondition:
    """State (ṡ, s̈) in which a run begins or ends, and what of it a solver may choose.

    Where q′ = 0 the axes are at rest whatever ṡ is, since q̇ = q′ ṡ (planner.path.stands). There ṡ,
    or under jerk limits s̈, is free. Where q″ = 0 too, a jerk-limited motion passes at ṡ > 0.

    speed             ṡ
    acceleration      s̈, which only jerk-limited problems use
    zero_derivatives  how many of q′ and q″ are zero
    passing_speed     ṡ of a jerk-limited motion where both are zero; `pose_problem` finds it
    """

    speed: float = 0.0
    acceleration: float = 0.0
    zero_derivatives: int = 0
    passing_speed: float = 0.0

    @property
    def free(self) -> bool:
        """Whether ṡ is free at order 2."""
        return self.speed == 0 and self.zero_derivatives == 1

    @property
    def free_acceleration(self) -> bool:
        """Whether s̈ is free at order 3."""
        return self.free or self.passing_speed > 0

    @property
    def jerk_limited_speed(self) -> float:
        """ṡ at order 3."""
        return max(self.speed, self.passing_speed)

    def reversed(self) -> "EndCondition":
        """Return the condition of the motion run backwards: s̈ changes its sign."""
        return replace(self, acceleration=-self.acceleration)

    def fixed(self) -> "EndCondition":
        """Return the stated state, with nothing left to choose."""
        return EndCondition(self.speed, self.acceleration)


REST = EndCondition()
Ends = tuple[EndCondition, EndCondition]
"""Start and end of a run."""


def at_speeds(start: float, end: float) -> Ends:
    """Return the ends of a run between two speeds ṡ, with s̈ = 0."""
    return EndCondition(start), EndCondition(end)


def fix_passed_ends(ends: Ends) -> Ends:
    """Return ends that rest where a jerk-limited motion might pass."""
    start, end = (each.fixed() if each.zero_derivatives > 1 else each for each in ends)
    return start, end


@dataclass(frozen=True, slots=True)
class Continuation:
    """Motion that a run continues: to follow it farther is one of the motions of the problem.

    s        (K+1,) its grid
    columns  (4, K) its ṡ, s̈, s⃛, h
    room     room of each limit (K,) with which it was solved
    knots    (M,) path lengths farther on at which its s⃛ may step
    """

    s: Array
    columns: Array
    room: Mapping[str, Array]
    knots: Array = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, slots=True)
class Run:
    """Pieces first … last (inclusive) of a path, without a stop between them.

    ends          how it begins and ends
    since, until  path lengths in the first and the last piece between which it runs; None: all
    solver        for order 2
    fineness      number of intervals as a multiple of the usual
    whole         solve as one problem, without cruises in closed form (planner.timing.feed_limited)
    continuation  motion that it continues
    """

    first: int
    last: int
    ends: Ends = (REST, REST)
    since: float | None = None
    until: float | None = None
    solver: Solver = "passes"
    continuation: Continuation | None = None
    fineness: int = 1
    whole: bool = False

    @property
    def speeds(self) -> tuple[float, float]:
        """ṡ at the start and at the end."""
        return self.ends[0].speed, self.ends[1].speed

    def breaks(self, path: ActuatorPath) -> Array:
        """Path lengths of its start, of the breaks between its pieces, and of its end."""
        breaks = np.array(path.breaks[self.first : self.last + 2])
        if self.since is not None:
            breaks[0] = self.since
        if self.until is not None:
            breaks[-1] = self.until
        return breaks

    def cut(self, path: ActuatorPath, since: float, until: float) -> "Run":
        """Return the part between two path lengths, at rest at new ends."""
        breaks = self.breaks(path)
        first = int(np.searchsorted(breaks, since, side="right")) - 1
        last = int(np.searchsorted(breaks, until)) - 1
        begins = since == breaks[0]
        ends = until == breaks[-1]
        return replace(
            self,
            first=self.first + first,
            last=self.first + last,
            ends=(self.ends[0] if begins else REST, self.ends[1] if ends else REST),
            since=self.since if begins else since,
            until=self.until if ends else until,
        )


Midpoints = tuple[Array, Array, Array, Array]
# The power of ṡ that a term is where s̈ is 0; with s⃛ a row leaves its choice.
POWERS = {Term.ONE: 0, Term.SD: 1, Term.SD2: 2, Term.SD3: 3}


@dataclass(frozen=True, slots=True)
class Block:
    """One limit on N intervals, |Σ coefficient · term − room · middle| ≤ room, at each interval's start and end.

    The coefficients (N, m) are divided by half the range between the bounds.

    room    (N,) SOLVER_AIM, or less where the certificate asked for it: what it takes off leaves standing still inside
    middle  (m,) of the range, in ]−1, 1[: 0 where the bounds are the same both ways
    about   (low, high at the start, low, high at the end), each (N, m): as `Rows` has it, None where every row speaks
    hull    of rows with `about`: what keeps them keeps these, at every speed
    """

    name: str
    start: Mapping[Term, Array]
    end: Mapping[Term, Array]
    room: Array
    middle: Array
    about: Midpoints | None = None
    hull: "Block | None" = None

    def around(self, start: Array, end: Array) -> "Block":
        """What speaks near a motion with ṡ (N,) at the intervals' starts and ends; other rows become nothing."""
        if self.about is None:
            return self
        low, high, low_end, high_end = self.about
        sides = []
        for side, speed, least, most in ((self.start, start, low, high), (self.end, end, low_end, high_end)):
            speaks = (least <= speed[:, None]) & (speed[:, None] < most)
            sides.append({term: np.where(speaks, values, 0.0) for term, values in side.items()})
        return replace(self, start=sides[0], end=sides[1], about=None, hull=None)

    def reversed(self) -> "Block":
        """The same rows for the run the other way."""
        start, end = (
            {term: -values[::-1] if term in ODD_TERMS else values[::-1] for term, values in side.items()}
            for side in (self.end, self.start)
        )
        about = None
        if self.about is not None:
            low, high, low_end, high_end = (values[::-1] for values in self.about)
            about = low_end, high_end, low, high
        hull = None if self.hull is None else self.hull.reversed()
        return replace(self, start=start, end=end, room=self.room[::-1], about=about, hull=hull)

    def part(self, own: slice) -> "Block":
        """Of some intervals one after the other."""
        start, end = ({term: values[own] for term, values in side.items()} for side in (self.start, self.end))
        about = None
        if self.about is not None:
            low, high, low_end, high_end = (values[own] for values in self.about)
            about = low, high, low_end, high_end
        return replace(self, start=start, end=end, room=self.room[own], about=about)

    @property
    def holding_use(self) -> Array:
        """(N,) of the room, what holding still uses of it."""
        used = np.zeros(len(self.room))
        for side in (self.start, self.end):
            if Term.ONE in side:
                np.maximum(used, self.share(side[Term.ONE]).max(1), out=used)
        return np.minimum(used, MAX_HOLDING_SHARE * self.room)

    def aimed(self, share: Array | float) -> "Block":
        """With so much of what holding still leaves of the room."""
        still = self.holding_use
        return replace(self, room=still + (self.room - still) * share)

    def share(self, values: Array) -> Array:
        """(N, m) of the range on their own side of zero, what values (N, m) of the sum are; 1 is at the bound."""
        return np.abs(values) / (1 + np.sign(values) * self.middle)


@dataclass(frozen=True, slots=True)
class Problem:
    """A grid s (N+1,) along a run, the piece (N,) of each interval, and the rows of every limit."""

    s: Array
    piece: np.ndarray
    blocks: tuple[Block, ...]
    ends: Ends = (REST, REST)

    @property
    def intervals(self) -> int:
        return len(self.piece)

    @property
    def speeds(self) -> tuple[float, float]:
        """ṡ at the start and at the end."""
        return self.ends[0].speed, self.ends[1].speed

    @property
    def free(self) -> tuple[bool, bool]:
        """Ends at which ṡ is free at order 2."""
        return self.ends[0].free, self.ends[1].free

    @property
    def free_accelerations(self) -> tuple[bool, bool]:
        """Ends at which s̈ is free at order 3."""
        return self.ends[0].free_acceleration, self.ends[1].free_acceleration

    @property
    def is_unconditional(self) -> bool:
        """Whether every row holds at every speed."""
        return all(block.about is None for block in self.blocks)

    def reversed(self) -> "Problem":
        """Return the problem run backwards: s̈ changes its sign, ṡ and s⃛ do not."""
        s = (self.s[0] + self.s[-1] - self.s)[::-1]
        blocks = tuple(block.reversed() for block in self.blocks)
        start, end = self.ends
        return Problem(s, self.piece[::-1], blocks, (end.reversed(), start.reversed()))

    def with_fixed_ends(self) -> "Problem":
        """Return the problem with nothing to choose at its ends."""
        start, end = self.ends
        return replace(self, ends=(start.fixed(), end.fixed()))

    def part(self, own: slice) -> "Problem":
        """Some intervals one after the other, under the same speeds at the ends."""
        s, blocks = self.s[own.start : own.stop + 1], tuple(block.part(own) for block in self.blocks)
        return replace(self, s=s, piece=self.piece[own], blocks=blocks)

    def around(self, start: Array, end: Array) -> "Problem":
        """The rows that speak near a motion with ṡ (N,) at the intervals' starts and ends."""
        return replace(self, blocks=tuple(block.around(start, end) for block in self.blocks))


def split_runs(path: ActuatorPath, stops: np.ndarray, order: int) -> list[Run]:
    """Return the runs between stops (K,); the path's own ends have the speeds that it states."""
    still = count_zero_derivatives(path) % 3  # where q‴ = 0 too, nothing is free
    start, end = (
        EndCondition(speed, acceleration if order == 3 else 0.0)
        for speed, acceleration in zip(path.end_speeds, path.end_accelerations, strict=True)
    )
    outer = {0: start, len(path.breaks) - 1: end}

    def condition(stop: int, side: int, piece: int) -> EndCondition:
        at_stop = outer.get(stop, REST)
        return replace(at_stop, zero_derivatives=int(still[side, piece]))

    return [Run(a, b - 1, (condition(a, 0, a), condition(b, 1, b - 1))) for a, b in pairwise(stops.tolist())]


def pose_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    s: Array,
    piece: np.ndarray,
    ends: Ends = (REST, REST),
) -> Problem:
    """Evaluate the rows of every timing limit on both sides of every grid point, in one batch.

    Rows of loads that no motion within the others can use more than IDLE_SHARE of are left out, but not of proofs.
    """
    # an interval ends where the next one starts, unless that is on another piece
    alone = np.append(np.diff(piece) != 0, True)
    end = np.where(alone, len(piece) - 1 + np.cumsum(alone), np.arange(1, len(piece) + 1))
    places, pieces = np.concatenate([s[:-1], s[1:][alone]]), np.concatenate([piece, piece[alone]])
    points = make_points(path, places, pieces, order_of(limits))
    timed = [limit for limit in limits if not limit.geometric]
    pure = [limit for limit in timed if Term.ONE not in limit.terms]
    posed = {limit.name: _block(limit.name, limit.rows(points), end, limit.shares, points.s) for limit in pure}
    others = [block for block in posed.values() if block is not None]
    for limit in timed:
        if limit.name not in posed and not _is_surely_idle(limit, points, others):
            posed[limit.name] = _block(limit.name, limit.rows(points), end, limit.shares, points.s)
    blocks = [block for limit in timed if (block := posed.get(limit.name)) is not None]
    speeds = ends[0].speed, ends[1].speed
    start = _settle_end(ends[0], blocks, 0)
    last = _settle_end(ends[1], blocks, -1)
    binding = tuple(_open_room(block, speeds) for block in _drop_idle_blocks(blocks))
    return Problem(s, piece, binding, (start, last))


def _settle_end(end: EndCondition, blocks: Sequence[Block], at: int) -> EndCondition:
    """Return the condition at the first or last point (at: 0 or −1) with its passing speed.

    Where q′ = q″ = 0, nearly |q‴| ṡ³ = J. The passing speed is 0 where other limits would be used
    up by the next grid point: there the jerk alone does not decide.
    """
    if end.zero_derivatives != 2 or end.speed > 0:
        return end
    used = dict.fromkeys(POWERS, 0.0)
    for block in blocks:
        outer, inner = (block.end, block.start) if at else (block.start, block.end)
        for term in POWERS:
            if term in outer:
                side = outer if term is Term.SD3 else inner
                used[term] = max(used[term], float(block.share(side[term][at]).max()))
    if used[Term.SD3] == 0:
        return end
    speed = float(np.cbrt(PASSED_SHARE / used[Term.SD3]))
    if max(used[Term.SD] * speed, used[Term.SD2] * speed**2) >= MOST_PASSED_USE:
        return end
    return replace(end, passing_speed=speed)


def _open_room(block: Block, speeds: tuple[float, float]) -> Block:
    """With all of its room between two speeds of which one uses more of it than solvers aim at: no way leads on."""
    if min(speeds) == 0:
        return block
    for side, end, speed in ((block.start, 0, speeds[0]), (block.end, -1, speeds[1])):
        if speed > 0 and Term.SDDD not in side:
            used = sum(values[end] * speed ** POWERS[term] for term, values in side.items() if term in POWERS)
            if np.max(block.share(np.asarray(used)), initial=0.0) > block.room[end]:
                return replace(block, room=np.ones(len(block.room)))
    return block


def _block(name: str, rows: Rows, end: np.ndarray, shares: Shares, s: Array) -> Block | None:
    """Rows at points of which the first (N,) are the intervals' starts and those of index `end` (N,) their ends.

    shares: of the limit, by which it was lowered at the points' s. None where nothing is bound.
    """
    count = len(end)
    rows = rows.scale(shares.on_grid(s)[:, None]) if len(shares.values) else rows
    scaled, middle, about = _normalise_rows(rows, max(count, int(end.max()) + 1))
    if not scaled:
        return None
    starts = {term: values[:count] for term, values in scaled.items()}
    ends = {term: values[end] for term, values in scaled.items()}
    speaks = None if about is None else (about[0][:count], about[1][:count], about[0][end], about[1][end])
    hull = None if rows.hull is None else _block(name, rows.hull, end, ALL, s)
    return Block(name, starts, ends, np.ones(count), middle, speaks, hull).aimed(SOLVER_AIM)


def _normalise_rows(rows: Rows, points: int) -> tuple[dict[Term, Array], Array, tuple[Array, Array] | None]:
    """Coefficients of the channels that are bound, over half their range; its middle; and where they speak."""
    bound = np.broadcast_to(rows.bound, (points, np.shape(rows.bound)[-1]))
    binding = np.isfinite(bound).any(0)
    half, middle = bound[:, binding], np.zeros(int(binding.sum()))
    if not binding.any():
        return {}, middle, None
    if rows.below is not None:
        above, below = rows.bound[binding], rows.below[binding]
        half = (above + below) / 2
        middle = (above - below) / 2 / half
    about = None if rows.about is None else (rows.about[0][:, binding], rows.about[1][:, binding])
    return {term: values[:, binding] / half for term, values in rows.coefficients.items()}, middle, about


def leave_out_idle(limits: Sequence[Limit], problem: Problem) -> list[Limit]:
    """The limits without those on loads that a problem has no rows of: along its run they are far from binding."""
    names = {block.name for block in problem.blocks}
    return [limit for limit in limits if limit.name in names or Term.ONE not in limit.terms]


def _is_surely_idle(limit: Limit, points: Points, others: Sequence[Block]) -> bool:
    """Whether a limit on a load, which takes long to work out, is far from binding at some of the intervals' starts."""
    count = others[0].room.size if others else 0
    piece = points.piece[:count]
    some = np.flatnonzero((np.arange(count) % IDLE_STRIDE == 0) | (np.diff(piece, prepend=-1) != 0))
    if 2 * len(some) > count:
        return False
    few = Points(points.path, points.s[some], piece[some], tuple(values[some] for values in points.derivatives))
    block = _block(limit.name, limit.rows(few), np.arange(len(some)), limit.shares, few.s)
    if block is None:
        return True
    sides = [({term: each[some] for term, each in one.start.items()}, one) for one in _select_bounding(others)]
    bounds = _bound_terms([(side, 1 + np.abs(one.middle)) for side, one in sides]) if sides else {}
    return bool(bounds) and _largest_use(block, [bounds] * len(SIDES)) <= SURELY_IDLE_SHARE


def _drop_idle_blocks(blocks: Sequence[Block]) -> tuple[Block, ...]:
    """The blocks without those of forces that no motion within the others can use more than IDLE_SHARE of."""
    if not any(Term.ONE in block.start for block in blocks):
        return tuple(blocks)
    sure = [(block, 1 + np.abs(block.middle)) for block in _select_bounding(blocks)]
    bounds = [_bound_terms([(getattr(block, side), most) for block, most in sure]) for side in SIDES]
    return tuple(block for block in blocks if not _largest_use(block, bounds) <= IDLE_SHARE)


def _select_bounding(blocks: Sequence[Block]) -> list[Block]:
    return [block for block in blocks if block.about is None and set(block.start) in BOUNDING_TERMS]


def _bound_terms(rows: Sequence[tuple[Mapping[Term, Array], Array]]) -> dict[Term, Array]:
    """Largest size (N,) of each term at grid points, ∞ where no row holds it; of rows, and what each may be (m,)."""
    count = len(next(iter(rows[0][0].values()))) if rows else 1
    v, a = np.full(count, np.inf), np.full(count, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for row, most in rows:
            if len(row) == 1 and Term.SDD not in row:
                ((term, size),) = row.items()
                v = np.fmin(v, (most / np.abs(size)).min(1) ** (1 / term.per_time))
        for row, most in rows:
            if Term.SDD in row:
                bent = np.abs(row[Term.SD2]) * v[:, None] ** 2 if Term.SD2 in row else 0.0
                a = np.fmin(a, ((most + bent) / np.abs(row[Term.SDD])).min(1))
    return {Term.ONE: np.ones(count), Term.SD: v, Term.SD2: v**2, Term.SDD: a}


def _largest_use(block: Block, bounds: Sequence[Mapping[Term, Array]]) -> float:
    """Of a load, by terms of such sizes at both ends of the intervals; ∞ of what these do not bound."""
    if Term.ONE not in block.start or block.about is not None or not set(block.start) <= set(bounds[0]):
        return float("inf")
    most = 0.0
    for side, size in zip((block.start, block.end), bounds, strict=True):
        with np.errstate(invalid="ignore"):
            terms = [np.where(rows == 0, 0.0, np.abs(rows) * size[term][:, None]) for term, rows in side.items()]
        most = max(most, float((np.sum(terms, axis=0) / (1 - np.abs(block.middle))).max()))
    return most
