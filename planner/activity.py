"""The active limits of a long motion over time and by segment, in memory that does not grow."""

from collections.abc import Iterable, Sequence
from itertools import islice

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.table import Column, Table
from planner.active_limits import (
    IDLE,
    NUMBER,
    TIME,
    WAY,
    find_active,
    line_columns,
    measure_segments,
    segment_columns,
)
from planner.certificate.continuity import piece_end_lengths
from planner.limits import Limit
from planner.overview import MOST_WINDOWS
from planner.program.model import Program, Segment
from planner.trajectory import Trajectory

FIRST_WINDOW = 1e-6
"""s of each window of time at first: short enough for any motion to fill many windows."""
MOST_SEGMENTS = 50
"""Segments listed of those that take longest. More would make the memory and the page longer."""
MOST_SLOW = 10
"""Segments listed of the slowest."""


class Activity:
    """The active limits of a motion in parts, in even windows of time, and its slowest segments.

    names   indices of the limits that depend on timing, by name
    window  s of each window of time
    end     s, duration of all parts so far
    count   number of segments that take any time
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self.names = dict[str, int]()
        self.window = FIRST_WINDOW
        self.end = 0.0
        self.count = 0
        # s for which no limit is active, and for which each is, in each window of time
        self._active = np.zeros((MOST_WINDOWS, 1))
        self._use = np.zeros((MOST_WINDOWS, 0))
        # measured segments, numbered from 0 over all repetitions; the next part may continue the
        # last
        self._rows = np.zeros((0, IDLE + 1))
        # segments that tables have named so far, by number from 0
        self._segments = dict[int, Segment]()

    def add(self, motion: Trajectory, begin: float, limits: Sequence[Limit]) -> None:
        """Add a part of the motion that begins at a time (s), and the limits along it."""
        timed = [limit for limit in limits if not limit.geometric]
        self._add_names([limit.name for limit in timed])
        use, active = find_active(motion, timed)
        columns = np.array([self.names[limit.name] for limit in timed], int)
        active = np.append(columns, -1)[active]
        self.end = begin + motion.duration
        self._add_windows(begin + motion.knots, active, columns, use)
        owner = self._number_pieces(motion, begin)
        ways = piece_end_lengths(motion) - motion.s
        self._add_segments(measure_segments(motion, ways, owner, active, len(self.names)))

    def _add_names(self, names: Sequence[str]) -> None:
        new = [name for name in names if name not in self.names]
        self.names |= {name: len(self.names) + k for k, name in enumerate(new)}
        wider = ((0, 0), (0, len(new)))
        self._active = np.pad(self._active, wider)
        self._use = np.pad(self._use, wider)
        self._rows = np.pad(self._rows, wider)

    def _add_windows(
        self,
        knots: Array,
        active: np.ndarray,
        columns: np.ndarray,
        use: Array,
    ) -> None:
        """Add time pieces (M,) to the windows: times of active limits, and largest shares.

        active (M,): column in `names` of the active limit; −1: none.
        use (limits, M): shares of the limits in `columns`.
        """
        pairs = np.arange(0, MOST_WINDOWS, 2)
        emptied = ((0, len(pairs)), (0, 0))
        while self.end > MOST_WINDOWS * self.window:
            self.window *= 2
            self._active = np.pad(np.add.reduceat(self._active, pairs), emptied)
            self._use = np.pad(np.maximum.reduceat(self._use, pairs), emptied)
        first = np.ceil(knots[0] / self.window)
        last = np.floor(knots[-1] / self.window)
        inner = np.arange(first, last + 1) * self.window
        edges = np.union1d(knots, inner[(inner > knots[0]) & (inner < knots[-1])])
        middle = (edges[1:] + edges[:-1]) / 2
        piece = np.clip(np.searchsorted(knots, middle, side="right") - 1, 0, len(active) - 1)
        window = np.clip((middle / self.window).astype(np.int64), 0, MOST_WINDOWS - 1)
        np.add.at(self._active, (window, active[piece] + 1), np.diff(edges))
        np.maximum.at(self._use, (window[:, None], columns), use[:, piece].T)

    def _number_pieces(self, motion: Trajectory, begin: float) -> np.ndarray:
        """Return the number (M,) of the segment of each time piece, from 0 over all repetitions.

        A rest is a dwell: the segment after that of its path piece.
        """
        pieces, place = np.unique(motion.piece, return_inverse=True)
        places = [motion.path.place(0.0, int(piece)) for piece in pieces]
        turns = np.array([(one.repetition or 1) - 1 for one in places])
        segments = np.array([(one.segment or 1) - 1 for one in places])
        rests = motion.resting & (np.diff(motion.knots) > 0)
        numbers = (turns * len(self.program.segments) + segments)[place] + rests
        if begin == 0 and rests[0]:
            numbers[: np.argmin(np.append(rests, False))] = 0  # the program begins with dwells
        return np.asarray(numbers)

    def _add_segments(self, rows: Array) -> None:
        """Add the segments of a part, and retain the ones for the tables."""
        before = self._rows
        if len(rows) and len(before) and before[-1, NUMBER] == rows[0, NUMBER]:
            rows[0, TIME:] += before[-1, TIME:]
            before = before[:-1]
            self.count -= 1
        self.count += len(rows)
        self._rows = np.concatenate([before, rows])
        complete = self._rows[:-1]
        if len(complete) > MOST_SEGMENTS:
            most_active = complete[:, IDLE + 1 :].argmax(0)
            chosen = {*_longest(complete), *_slowest(complete), *most_active}
            self._rows = self._rows[[*sorted(chosen), -1]]

    @property
    def t(self) -> Array:
        """Begin (windows,) s of each window."""
        count = max(1, min(MOST_WINDOWS, int(np.ceil(self.end / self.window))))
        return np.asarray(self.window * np.arange(count))

    @property
    def use(self) -> dict[str, Array]:
        """Largest sampled share (windows,) of each limit in each window, by name."""
        return {name: self._use[: len(self.t), k] for name, k in self.names.items()}

    @property
    def active(self) -> np.ndarray:
        """Index (windows,) in `names` of the longest active limit; −1 if no limit is for longer."""
        return np.asarray(self._active[: len(self.t)].argmax(1) - 1)

    @property
    def complete(self) -> bool:
        """True if `tabulate_longest` lists every segment."""
        return self.count <= MOST_SEGMENTS

    def tabulate_longest(self) -> Table:
        """Tabulate the segments that take longest, the longest first; if few, all in their
        order.
        """
        rows = self._rows
        if self.complete:
            return self._tabulate("the segments that take longest", rows)
        rows = rows[_longest(rows)]
        rest = self.end - float(rows[:, TIME].sum())
        most = f"at most {rows[:, TIME].min():.4f} s each"
        note = f"the other {self.count - len(rows)} take {rest:.4f} s together, {most}"
        return self._tabulate("the segments that take longest", rows, (note,))

    def tabulate_slowest(self) -> Table:
        """Tabulate the segments of the least mean speed, the slowest first, without dwells."""
        return self._tabulate("the slowest segments", self._rows[_slowest(self._rows)])

    def tabulate_limits(self) -> Table:
        """Tabulate for how long each limit is active, and in which segment for longest."""
        active = self._rows[:, IDLE + 1 :]
        longest = self._rows[active.argmax(0), NUMBER]
        times = [time or None for time in active.max(0).tolist()]
        pairs = zip(longest, times, strict=True)
        numbers = [None if time is None else int(number) for number, time in pairs]
        segments = self.find_segments(numbers)
        total = len(self.program.segments)
        named = [None if number is None else segments[number % total] for number in numbers]
        seconds = np.roll(self._active.sum(0), -1)  # the time without active limit comes last
        columns = (
            Column("limit", [*self.names, "none of them"]),
            Column("active", seconds, "s", form=".3f"),
            Column("of the duration", 100 * seconds / max(self.end, 1e-300), "%", form=".1f"),
            *self._number_columns([*numbers, None], "longest in segment"),
            *line_columns([*named, None]),
            Column("there", [*times, None], "s", form=".4f"),
        )
        return Table("time for which each limit is active", columns)

    def _tabulate(self, title: str, rows: Array, notes: tuple[str, ...] = ()) -> Table:
        numbers: list[int] = rows[:, NUMBER].astype(int).tolist()
        segments = self.find_segments(numbers)
        chosen = [segments[number % len(self.program.segments)] for number in numbers]
        columns = (
            *self._number_columns(numbers, "segment"),
            *segment_columns(rows, chosen, [*self.names]),
        )
        return Table(title, columns, notes)

    def _number_columns(self, numbers: Sequence[int | None], name: str) -> list[Column]:
        """Return the columns for numbers of segments, over all repetitions."""
        total = len(self.program.segments)
        columns = [Column(name, [None if n is None else n % total + 1 for n in numbers])]
        if self.program.repeat > 1:
            turns = [None if n is None else n // total + 1 for n in numbers]
            columns.append(Column("repetition", turns))
        return columns

    def find_segments(self, numbers: Iterable[int | None]) -> dict[int, Segment]:
        """Return segments by their number from 0.

        Reads the program's file once for those of all tables.
        """
        total = len(self.program.segments)
        chosen = {number % total for number in numbers if number is not None}
        if not chosen <= self._segments.keys():
            needed = chosen | {int(number) % total for number in self._rows[:, NUMBER]}
            ahead = islice(self.program.segments, max(needed) + 1)
            self._segments |= {
                number: segment for number, segment in enumerate(ahead) if number in needed
            }
        return {number: self._segments[number] for number in chosen}


def _longest(rows: Array) -> list[int]:
    return [*map(int, np.argsort(-rows[:, TIME], kind="stable")[:MOST_SEGMENTS])]


def _slowest(rows: Array) -> list[int]:
    moving = np.flatnonzero(rows[:, WAY] > 0)
    speed = rows[moving, WAY] / rows[moving, TIME]
    return [*map(int, moving[np.argsort(speed, kind="stable")[:MOST_SLOW]])]
