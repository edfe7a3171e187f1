"""A timing problem as the solvers see it: a grid along one run, and every limit's rows on it, normalised."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from kinematics.foundation.arrays import Array
from planner.limits.limit import Limit, Rows, Term, order_of
from planner.limits.lowered import ALL, Shares
from planner.path.actuation import ActuatorPath, Points, make_points

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
class Continuation:
    """How a run begins that goes on with a motion from the midst of it, and what that motion does next: it may do so.

    s, columns  (K+1,) its grid there, and (4, K) of ṡ, s̈, s⃛, h on it
    room, acceleration  by limit (K,) what it was left; s̈ where the run begins
    knots       (M,) where its s⃛ may step farther on: on a grid that holds them, to go on with it keeps every row
    """

    s: Array
    columns: Array
    room: Mapping[str, Array]
    acceleration: float
    knots: Array = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, slots=True)
class Run:
    """Pieces first … last (inclusive) of a path, run from one speed ṡ to another: rest to rest if not told.

    Under jerk limits s̈ is 0 at both ends, but for those of a run that goes on with a motion.

    since, until  path lengths inside the first and the last piece between which it is run; None: all of them
    stands  how the path itself stands at the start and at the end (planner.path.stands): 1 where q′ = 0 and q″ is not,
            so that what is at rest there is so whatever ṡ is, or under jerk limits s̈: these are free; 2 where q″ = 0
            too and q‴ is not, so that under jerk limits ṡ > 0 there and s̈ is free; else 0
    solver  of motions of order 2; fineness: times as many intervals as usual
    whole   solve the run as one problem, without cruises in closed form (planner.timing.feed_limited)
    continuation  of a run that goes on with a motion, whose speed is start_speed; end_acceleration: s̈ where that ends
    """

    first: int
    last: int
    start_speed: float = 0.0
    end_speed: float = 0.0
    since: float | None = None
    until: float | None = None
    stands: tuple[int, int] = (0, 0)
    solver: Solver = "passes"
    continuation: Continuation | None = None
    fineness: int = 1
    start_acceleration: float = 0.0
    end_acceleration: float = 0.0
    whole: bool = False

    @property
    def speeds(self) -> tuple[float, float]:
        return self.start_speed, self.end_speed

    def breaks(self, path: ActuatorPath) -> Array:
        """Path lengths at its start, between its pieces, and at its end."""
        breaks = np.array(path.breaks[self.first : self.last + 2])
        breaks[0] = breaks[0] if self.since is None else self.since
        breaks[-1] = breaks[-1] if self.until is None else self.until
        return breaks


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
    """Grid s (N+1,) over a run, piece (N,) of each interval, the blocks of all limits, and ṡ at its two ends.

    free: the ends at rest where the path stands, as `Run` has them: there ṡ, or under jerk limits s̈, is to be found
    passed: ṡ at the ends at rest where it is not 0 under jerk limits, as q″ = 0 there too; s̈ is to be found there
    accelerations: s̈ at the ends, where that is not free
    """

    s: Array
    piece: np.ndarray
    blocks: tuple[Block, ...]
    speeds: tuple[float, float] = (0.0, 0.0)
    free: tuple[bool, bool] = (False, False)
    passed: tuple[float, float] = (0.0, 0.0)
    accelerations: tuple[float, float] = (0.0, 0.0)

    @property
    def intervals(self) -> int:
        return len(self.piece)

    @property
    def free_push(self) -> tuple[bool, bool]:
        """Whether s̈ at its ends is to be found under jerk limits."""
        return self.free[0] or self.passed[0] > 0, self.free[1] or self.passed[1] > 0

    @property
    def is_unconditional(self) -> bool:
        """Whether every row speaks near every motion."""
        return all(block.about is None for block in self.blocks)

    def reversed(self) -> "Problem":
        """The same run the other way, from its end to its start: s̈ changes its sign, ṡ and s⃛ do not."""
        s, (start, end) = (self.s[0] + self.s[-1] - self.s)[::-1], self.accelerations
        blocks, speeds = tuple(block.reversed() for block in self.blocks), self.speeds[::-1]
        return Problem(s, self.piece[::-1], blocks, speeds, self.free[::-1], self.passed[::-1], (-end, -start))

    def part(self, own: slice) -> "Problem":
        """Some intervals one after the other, under the same speeds at the ends."""
        s, blocks = self.s[own.start : own.stop + 1], tuple(block.part(own) for block in self.blocks)
        return replace(self, s=s, piece=self.piece[own], blocks=blocks)

    def around(self, start: Array, end: Array) -> "Problem":
        """The rows that speak near a motion with ṡ (N,) at the intervals' starts and ends."""
        return replace(self, blocks=tuple(block.around(start, end) for block in self.blocks))


def pose_problem(
    path: ActuatorPath,
    limits: Sequence[Limit],
    s: Array,
    piece: np.ndarray,
    speeds: tuple[float, float] = (0.0, 0.0),
    stands: tuple[int, int] = (0, 0),
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
    start, last = (still if speed == 0 else 0 for still, speed in zip(stands, speeds, strict=True))
    passed = _passed_speed(blocks, 0) if start == 2 else 0.0, _passed_speed(blocks, -1) if last == 2 else 0.0
    kept = tuple(_open_room(block, speeds) for block in _drop_idle_blocks(blocks))
    return Problem(s, piece, kept, speeds, (start == 1, last == 1), passed)


def _passed_speed(blocks: Sequence[Block], end: int) -> float:
    """ṡ that the jerk lets pass at a first or last point, 0 or −1, where q′ = q″ = 0: nearly |q‴| ṡ³ = J.

    0 where other limits would be used up by the next grid point: there the jerk does not tell what can be.
    """
    used = dict.fromkeys(POWERS, 0.0)
    for block in blocks:
        here, beside = (block.end, block.start) if end else (block.start, block.end)
        for term in (each for each in POWERS if each in here):
            size = (here if term is Term.SD3 else beside)[term][end]
            used[term] = max(used[term], float(block.share(size).max()))
    speed = float(np.cbrt(PASSED_SHARE / used[Term.SD3])) if used[Term.SD3] > 0 else 0.0
    return speed if max(used[Term.SD] * speed, used[Term.SD2] * speed**2) < MOST_PASSED_USE else 0.0


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
