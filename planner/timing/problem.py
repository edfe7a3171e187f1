"""A timing problem as solvers take it: a run, its ends, a grid, and the rows of every limit on it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from kinematics.foundation.arrays import Array
from planner.limits.limit import Term
from planner.path.actuation import ActuatorPath
from planner.path.stands import count_zero_derivatives

# Shares of the limits that motions aim at: those of solvers, whose tolerance is near 1e-7, and
# those in closed form.
SOLVER_AIM, EXACT_AIM = 1 - 1e-6, 1 - 1e-9
# Share of a limit that holding still may use: more would leave no motion to find.
MAX_HOLDING_SHARE = 1 - 1e-9
ODD_TERMS = {Term.SDD, Term.SDSDD}
"""Terms that change their sign where a motion is run backwards."""
POWERS = {Term.ONE: 0, Term.SD: 1, Term.SD2: 2, Term.SD3: 3}
"""Terms that are powers of ṡ, and their exponents."""

Solver = Literal["passes", "toppra"]
"""Solver of order 2: our own two passes, or toppra."""
SideRows = Mapping[Term, Array]
"""Coefficients (N, m) of each term, at one side of N intervals."""
SpeedRanges = tuple[Array, Array, Array, Array]
"""Least and largest ṡ, each (N, m), at the start and then at the end of N intervals."""


@dataclass(frozen=True, slots=True)
class EndCondition:
    """State (ṡ, s̈) in which a run begins or ends, and what of it a solver may choose.

    Where q′ = 0 the axes are at rest for every ṡ, since q̇ = q′ ṡ (planner.path.stands): ṡ is free
    there, or s̈ under jerk limits. Where q″ = 0 too, a jerk-limited motion passes at ṡ > 0.

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
        """True if ṡ is free at order 2."""
        return self.speed == 0 and self.zero_derivatives == 1

    @property
    def free_acceleration(self) -> bool:
        """True if s̈ is free at order 3."""
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
    fineness: float = 1.0
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


@dataclass(frozen=True, slots=True)
class Block:
    """One limit on N intervals, at the start and the end of each:

        |Σ coefficient · term − room · middle| ≤ room

    with coefficients divided by half the range between the bounds.

    room    (N,) SOLVER_AIM, or less where the proof asked for it
    middle  (m,) middle of the range, in ]−1, 1[: 0 where the bounds are the same both ways
    about   ranges of ṡ in which a row of a limit that is not convex counts; None: all rows count
    hull    rows of a convex part of such a limit, which count at every ṡ
    """

    name: str
    start: SideRows
    end: SideRows
    room: Array
    middle: Array
    about: SpeedRanges | None = None
    hull: "Block | None" = None

    @property
    def sides(self) -> tuple[SideRows, SideRows]:
        """Rows at the starts and at the ends of the intervals."""
        return self.start, self.end

    def around(self, start: Array, end: Array) -> "Block":
        """Return the rows that count near ṡ (N,) at the starts and ends; the others become 0."""
        if self.about is None:
            return self

        def select(rows: SideRows, speed: Array, least: Array, most: Array) -> SideRows:
            counts = (least <= speed[:, None]) & (speed[:, None] < most)
            return {term: np.where(counts, values, 0.0) for term, values in rows.items()}

        return replace(
            self,
            start=select(self.start, start, *self.about[:2]),
            end=select(self.end, end, *self.about[2:]),
            about=None,
            hull=None,
        )

    def reversed(self) -> "Block":
        """Return the rows for the run backwards."""

        def turn(rows: SideRows) -> SideRows:
            return {term: -values[::-1] if term in ODD_TERMS else values[::-1] for term, values in rows.items()}

        about = None
        if self.about is not None:
            low, high, low_end, high_end = (values[::-1] for values in self.about)
            about = low_end, high_end, low, high
        return replace(
            self,
            start=turn(self.end),
            end=turn(self.start),
            room=self.room[::-1],
            about=about,
            hull=None if self.hull is None else self.hull.reversed(),
        )

    def part(self, intervals: slice) -> "Block":
        """Return the rows of successive intervals."""

        def cut(rows: SideRows) -> SideRows:
            return {term: values[intervals] for term, values in rows.items()}

        about = None
        if self.about is not None:
            low, high, low_end, high_end = (values[intervals] for values in self.about)
            about = low, high, low_end, high_end
        return replace(
            self,
            start=cut(self.start),
            end=cut(self.end),
            room=self.room[intervals],
            about=about,
        )

    @property
    def holding_use(self) -> Array:
        """Use (N,) of the limit by holding still."""
        use = np.zeros(len(self.room))
        for rows in self.sides:
            if Term.ONE in rows:
                np.maximum(use, self.share(rows[Term.ONE]).max(1), out=use)
        return np.minimum(use, MAX_HOLDING_SHARE * self.room)

    def aimed(self, share: Array | float) -> "Block":
        """Return the rows with a share of the room that holding still leaves."""
        holding = self.holding_use
        return replace(self, room=holding + (self.room - holding) * share)

    def share(self, values: Array) -> Array:
        """Return sums (N, m) of the rows as shares of the bound on their side of zero."""
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
        """Number of intervals."""
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
        """True if every row counts at every speed."""
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

    def part(self, intervals: slice) -> "Problem":
        """Return successive intervals, with the same end conditions."""
        return replace(
            self,
            s=self.s[intervals.start : intervals.stop + 1],
            piece=self.piece[intervals],
            blocks=tuple(block.part(intervals) for block in self.blocks),
        )

    def around(self, start: Array, end: Array) -> "Problem":
        """Return the rows that count near ṡ (N,) at the intervals' starts and ends."""
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
