"""The active limits of a long motion over time and by segment, in memory that does not grow."""

from collections.abc import Iterable, Sequence
from itertools import islice

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.table import Column, Table
from planner.active_limits import FILE_LINE, find_active, measured_columns, name_kind
from planner.certificate.continuity import piece_end_lengths
from planner.limits import Limit
from planner.overview import MOST_WINDOWS
from planner.path.actuation import MachinePath
from planner.path.arc_length import find_travel_rates
from planner.program.model import Program, Segment
from planner.trajectory import Trajectory

FIRST_WINDOW = 1e-6
"""s of each window of time at first: short enough for any motion to fill many windows."""
MOST_SEGMENTS = 50
"""Segments listed of those that take longest. More would make the memory and the page longer."""
MOST_SLOW = 10
"""Segments listed of the slowest."""
NUMBER, TIME, WAY, IDLE = range(4)
"""Columns of a segment: its number from 0 over all repetitions, s, m, s without active limit."""


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
        # s for which each limit is active in each window; first column: for which no limit is
        self._active = np.zeros((MOST_WINDOWS, 1))
        self._use = np.zeros((MOST_WINDOWS, 0))
        self._segments = np.zeros((0, IDLE + 1))
        self._open = np.zeros((0, IDLE + 1))  # the last segment, which the next part may continue

    def add(self, motion: Trajectory, begin: float, limits: Sequence[Limit]) -> None:
        """Add a part of the motion that begins at a time (s), and the limits along it."""
        self._name([limit.name for limit in limits if not limit.geometric])
        use, active = find_active(motion, limits)
        column = np.array([0 if limit.geometric else self.names[limit.name] + 1 for limit in limits])
        owner = np.where(active < 0, 0, column[active])
        self.end = begin + motion.duration
        self._spread(begin + motion.knots, owner, use[column > 0], column[column > 0] - 1)
        self._count_segments(motion, owner, begin)

    def _name(self, names: Sequence[str]) -> None:
        for name in names:
            if name not in self.names:
                self.names[name] = len(self.names)
                for field in ("_active", "_segments", "_open", "_use"):
                    setattr(self, field, np.pad(getattr(self, field), ((0, 0), (0, 1))))

    def _spread(self, knots: Array, owner: np.ndarray, use: Array, columns: np.ndarray) -> None:
        """Add time pieces (M,) to the windows: times of active limits, and largest shares.

        owner (M,): column of the active limit; use (limits, M): shares of the limits in `columns`.
        """
        while self.end > MOST_WINDOWS * self.window:
            self.window *= 2
            for values, join in ((self._active, np.add), (self._use, np.maximum)):
                half = join(values[::2], values[1::2])
                values[:] = 0.0
                values[: len(half)] = half
        first = np.ceil(knots[0] / self.window)
        last = np.floor(knots[-1] / self.window)
        inner = np.arange(first, last + 1) * self.window
        edges = np.union1d(knots, inner[(inner > knots[0]) & (inner < knots[-1])])
        middle = (edges[1:] + edges[:-1]) / 2
        place = np.clip(np.searchsorted(knots, middle, side="right") - 1, 0, len(owner) - 1)
        window = np.clip((middle / self.window).astype(np.int64), 0, MOST_WINDOWS - 1)
        np.add.at(self._active, (window, owner[place]), np.diff(edges))
        np.maximum.at(self._use, (window[:, None], columns), use[:, place].T)

    def _count_segments(self, motion: Trajectory, owner: np.ndarray, begin: float) -> None:
        """Add the segments of a part. A rest is a dwell: the segment after that of its path piece."""
        pieces, place = np.unique(motion.piece, return_inverse=True)
        places = [motion.path.place(0.0, int(piece)) for piece in pieces]
        total = len(self.program.segments)
        turns = np.array([(one.repetition or 1) - 1 for one in places])
        numbers = turns * total + [(one.segment or 1) - 1 for one in places]
        times = np.diff(motion.knots)
        rests = motion.resting & (times > 0)
        number = numbers[place] + rests
        if begin == 0 and rests[0]:
            number[: np.argmin(np.append(rests, False))] = 0  # the program begins with dwells

        numbers, row = np.unique(number, return_inverse=True)
        rows = np.zeros((len(numbers), self._open.shape[1]))
        rows[:, NUMBER] = numbers
        np.add.at(rows[:, TIME], row, times)
        assert isinstance(motion.path, MachinePath)
        rates = find_travel_rates([motion.path.pieces[piece] for piece in pieces])[place]
        np.add.at(rows[:, WAY], row, (piece_end_lengths(motion) - motion.s) * rates)
        np.add.at(rows, (row, IDLE + owner), times)
        rows = rows[rows[:, TIME] > 0]

        if len(rows) and len(self._open) and self._open[0, NUMBER] == rows[0, NUMBER]:
            rows[0, TIME:] += self._open[0, TIME:]
            self.count -= 1
        else:
            self._segments = self._rows
        self.count += len(rows)
        self._open = rows[-1:]
        self._segments = np.concatenate([self._segments, rows[:-1]])
        if len(self._segments) > MOST_SEGMENTS:
            most_active = self._segments[:, IDLE + 1 :].argmax(0)
            chosen = {*_longest(self._segments), *_slowest(self._segments), *most_active}
            self._segments = self._segments[sorted(chosen)]

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
        """Tabulate the segments that take longest, the longest first; if few, all in their order."""
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
        rows = self._rows
        numbers = list[int | None]()
        times = list[float | None]()
        for active in rows[:, IDLE + 1 :].T:
            best = int(active.argmax())
            numbers.append(int(rows[best, NUMBER]) if active[best] > 0 else None)
            times.append(float(active[best]) if active[best] > 0 else None)
        seconds = np.roll(self._active.sum(0), -1)  # the time without active limit comes last
        columns = (
            Column("limit", [*self.names, "none of them"]),
            Column("active", seconds, "s", form=".3f"),
            Column("of the duration", 100 * seconds / max(self.end, 1e-300), "%", form=".1f"),
            *self._place_columns([*numbers, None], "longest in segment"),
            Column("there", [*times, None], "s", form=".4f"),
        )
        return Table("time for which each limit is active", columns)

    @property
    def _rows(self) -> Array:
        return np.concatenate([self._segments, self._open])

    def _tabulate(self, title: str, rows: Array, notes: tuple[str, ...] = ()) -> Table:
        numbers = [int(number) for number in rows[:, NUMBER]]
        segments = self.find_segments(numbers)
        total = len(self.program.segments)
        columns = (
            *self._place_columns(numbers, "segment"),
            Column("kind", [name_kind(segments[number % total]) for number in numbers]),
            *measured_columns(rows[:, WAY], rows[:, TIME], rows[:, IDLE + 1 :], [*self.names]),
        )
        return Table(title, columns, notes)

    def _place_columns(self, numbers: Sequence[int | None], name: str) -> list[Column]:
        """Return the columns for numbers of segments, over all repetitions."""
        total = len(self.program.segments)
        segments = self.find_segments(numbers)
        places = [(None, None) if number is None else divmod(number, total) for number in numbers]
        columns = [Column(name, [None if number is None else number + 1 for _, number in places])]
        if self.program.repeat > 1:
            turns = [None if turn is None else turn + 1 for turn, _ in places]
            columns.append(Column("repetition", turns))
        lines = [None if number is None else segments[number].line_number for _, number in places]
        return [*columns, Column(FILE_LINE, lines)] if any(lines) else columns

    def find_segments(self, numbers: Iterable[int | None]) -> dict[int, Segment]:
        """Return segments by their number from 0. Reads the program's file up to the last one."""
        chosen = {number % len(self.program.segments) for number in numbers if number is not None}
        ahead = islice(self.program.segments, max(chosen, default=-1) + 1)
        return {number: segment for number, segment in enumerate(ahead) if number in chosen}


def _longest(rows: Array) -> list[int]:
    return [*map(int, np.argsort(-rows[:, TIME], kind="stable")[:MOST_SEGMENTS])]


def _slowest(rows: Array) -> list[int]:
    moving = np.flatnonzero(rows[:, WAY] > 0)
    speed = rows[moving, WAY] / rows[moving, TIME]
    return [*map(int, moving[np.argsort(speed, kind="stable")[:MOST_SLOW]])]
