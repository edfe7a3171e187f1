"""A timing problem as solvers take it: a run, its ends, a grid, and the rows of every limit on
it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from kinematics.foundation.arrays import Array, largest_in_rows
from planner.limits.limit import Term
from planner.path.actuation import ActuatorPath
from planner.path.stands import count_zero_derivatives

# Shares of the limits that motions aim at: those of solvers, whose tolerance is near 1e-7, and
# those in closed form.
SOLVER_AIM = 1 - 1e-6
EXACT_AIM = 1 - 1e-9
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


@dataclass(frozen=True, slots=True)
class EndCondition:
    """State (ṡ, s̈) in which a run begins or ends, and what of it a solver may choose.

    Where q′ = 0 the axes are at rest for every ṡ, since q̇ = q′ ṡ: ṡ is free there, or s̈ under
    jerk limits. Where q″ = 0 too, a jerk-limited motion passes at ṡ > 0.

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How runs are solved.

    solver        for order 2
    continuation  motion that the first run continues
    fineness      number of intervals as a multiple of the usual
    whole         solve as one problem, without cruises in closed form (planner.timing.feed_limited)
    """

    solver: Solver = "passes"
    continuation: Continuation | None = None
    fineness: float = 1.0
    whole: bool = False


USUAL = Settings()


@dataclass(frozen=True, slots=True)
class Run(Settings):
    """Pieces first … last (inclusive) of a path, without a stop between them.

    ends          how it begins and ends
    since, until  path lengths in the first and the last piece between which it runs; None: all
    """

    first: int
    last: int
    ends: Ends = (REST, REST)
    since: float | None = None
    until: float | None = None

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

    room    (N,) SOLVER_AIM, less where a peak asked for it, or 1 where a stated speed needs all
    middle  (m,) middle of the range, in ]−1, 1[: 0 where the bounds are the same both ways
    speed_range  (4, N, m) least and largest ṡ at which a row of a limit that is not convex counts,
                 at the starts, then at the ends; None: all rows count
    convex_part  rows of a convex part of such a limit, which count at every ṡ
    """

    name: str
    start: SideRows
    end: SideRows
    room: Array
    middle: Array
    speed_range: Array | None = None
    convex_part: "Block | None" = None

    @property
    def sides(self) -> tuple[SideRows, SideRows]:
        """Rows at the starts and at the ends of the intervals."""
        return self.start, self.end

    def around(self, start: Array, end: Array) -> "Block":
        """Return the rows that count near ṡ (N,) at the starts and ends; the others become 0."""
        if self.speed_range is None:
            return self

        def select(rows: SideRows, speed: Array, least: Array, most: Array) -> SideRows:
            counts = (least <= speed[:, None]) & (speed[:, None] < most)
            return {term: np.where(counts, values, 0.0) for term, values in rows.items()}

        return replace(
            self,
            start=select(self.start, start, *self.speed_range[:2]),
            end=select(self.end, end, *self.speed_range[2:]),
            speed_range=None,
            convex_part=None,
        )

    def reversed(self) -> "Block":
        """Return the rows for the run backwards."""

        def turn(rows: SideRows) -> SideRows:
            turned = {term: values[::-1] for term, values in rows.items()}
            return turned | {term: -turned[term] for term in ODD_TERMS if term in turned}

        speeds = self.speed_range
        return replace(
            self,
            start=turn(self.end),
            end=turn(self.start),
            room=self.room[::-1],
            speed_range=None if speeds is None else speeds[[2, 3, 0, 1], ::-1],
            convex_part=None if self.convex_part is None else self.convex_part.reversed(),
        )

    def part(self, intervals: slice) -> "Block":
        """Return the rows of successive intervals."""

        def cut(rows: SideRows) -> SideRows:
            return {term: values[intervals] for term, values in rows.items()}

        speeds = self.speed_range
        return replace(
            self,
            start=cut(self.start),
            end=cut(self.end),
            room=self.room[intervals],
            speed_range=None if speeds is None else speeds[:, intervals],
            convex_part=None if self.convex_part is None else self.convex_part.part(intervals),
        )

    @property
    def holding_use(self) -> Array:
        """Use (N,) of the limit by holding still."""
        use = np.zeros(len(self.room))
        for rows in self.sides:
            if Term.ONE in rows:
                np.maximum(use, largest_in_rows(self.share(rows[Term.ONE])), out=use)
        return np.minimum(use, MAX_HOLDING_SHARE * self.room)

    def aimed(self, share: Array | float) -> "Block":
        """Return the rows with a share of the room that holding still leaves."""
        holding = self.holding_use
        return replace(self, room=holding + (self.room - holding) * share)

    def find_steady_use(self, at: int, speed: float) -> float:
        """Return the use at the first or last point (at: 0 or −1) by ṡ alone, 0 by rows with s⃛."""
        rows = self.end if at else self.start
        if Term.SDDD in rows:
            return 0.0
        sums = [rows[term][at] * speed**power for term, power in POWERS.items() if term in rows]
        return float(np.max(self.share(np.sum(sums, axis=0)), initial=0.0))

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
        return all(block.speed_range is None for block in self.blocks)

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


def split_runs(
    path: ActuatorPath,
    stops: np.ndarray,
    order: int,
    settings: Settings = USUAL,
) -> list[Run]:
    """Return the runs between stops (K,); the path's own ends have the speeds that it states."""
    zeros = count_zero_derivatives(path)
    zeros = np.where(zeros == 3, 0, zeros)  # where q‴ = 0 too, nothing is free
    start, end = (
        EndCondition(speed, acceleration if order == 3 else 0.0)
        for speed, acceleration in zip(path.end_speeds, path.end_accelerations, strict=True)
    )
    outer = {0: start, len(path.breaks) - 1: end}

    def condition(stop: int, side: int, piece: int) -> EndCondition:
        at_stop = outer.get(stop, REST)
        return replace(at_stop, zero_derivatives=int(zeros[side, piece]))

    runs = [
        Run(
            first,
            after - 1,
            (condition(first, 0, first), condition(after, 1, after - 1)),
            solver=settings.solver,
            fineness=settings.fineness,
            whole=settings.whole,
        )
        for first, after in pairwise(stops.tolist())
    ]
    runs[0] = replace(runs[0], continuation=settings.continuation)
    return runs
