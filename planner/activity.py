"""What holds a long motion back, when and in which segments: in memory that does not grow with it."""

from collections.abc import Iterable, Sequence
from itertools import islice

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.table import Column, Table
from planner.active_limits import FILE_LINE, find_active
from planner.certificate.continuity import piece_end_lengths
from planner.limits import Limit
from planner.path.actuation import MachinePath
from planner.path.arc_length import find_travel_rates
from planner.program.model import Program, Segment
from planner.trajectory import Trajectory

FIRST_WINDOW = 1e-6
"""s of each window of time at first."""
MOST_WINDOWS = 2000
"""Of time; where there would be more, two become one."""
MOST_SEGMENTS, MOST_SLOW = 50, 10
"""That are listed: of those that take longest, and of the slowest."""
NUMBER, TIME, WAY, IDLE = range(4)
"""Columns of what is held of a segment: its number from 0 over all repetitions, s, m, and s at no limit."""


class Activity:
    """The active limits of a motion that comes part by part, in even windows of time, and its most telling segments.

    names   of the limits that depend on timing
    window  s of each window of time
    count   of the segments that take any time
    """

    def __init__(self, program: Program) -> None:
        self.program, self.names = program, dict[str, int]()
        self.window, self.end, self.count = FIRST_WINDOW, 0.0, 0
        self._held, self._use = np.zeros((MOST_WINDOWS, 1)), np.zeros((MOST_WINDOWS, 0))  # first of held: at no limit
        self._segments, self._open = np.zeros((0, IDLE + 1)), np.zeros((0, IDLE + 1))  # open: the next part may go on

    def add(self, motion: Trajectory, begin: float, limits: Sequence[Limit]) -> None:
        """A part of the motion that begins at a time (s), and the limits along it."""
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
                self._held, self._segments, self._open, self._use = (
                    np.pad(each, ((0, 0), (0, 1))) for each in (self._held, self._segments, self._open, self._use)
                )

    def _spread(self, knots: Array, owner: np.ndarray, use: Array, columns: np.ndarray) -> None:
        """Time pieces (M,) over windows: for how long each limit is active, and its largest share (limits, M)."""
        while self.end > MOST_WINDOWS * self.window:
            self.window *= 2
            pairs = self._held.reshape(MOST_WINDOWS // 2, 2, -1), self._use.reshape(MOST_WINDOWS // 2, 2, -1)
            self._held, self._use = np.zeros_like(self._held), np.zeros_like(self._use)
            self._held[: MOST_WINDOWS // 2], self._use[: MOST_WINDOWS // 2] = pairs[0].sum(1), pairs[1].max(1)
        inner = np.arange(np.ceil(knots[0] / self.window), np.floor(knots[-1] / self.window) + 1) * self.window
        edges = np.union1d(knots, inner[(inner > knots[0]) & (inner < knots[-1])])
        middle = (edges[1:] + edges[:-1]) / 2
        place = np.clip(np.searchsorted(knots, middle, side="right") - 1, 0, len(owner) - 1)
        whose = np.clip((middle / self.window).astype(np.int64), 0, MOST_WINDOWS - 1)
        np.add.at(self._held, (whose, owner[place]), np.diff(edges))
        np.maximum.at(self._use, (whose[:, None], columns), use[:, place].T)

    def _count_segments(self, motion: Trajectory, owner: np.ndarray, begin: float) -> None:
        """The segments of a part; what rests is a dwell, the segment behind that of its piece of path."""
        known, place = np.unique(motion.piece, return_inverse=True)
        places = [motion.path.place(0.0, int(piece)) for piece in known]
        total = len(self.program.segments)
        own = np.array([((one.repetition or 1) - 1) * total + (one.segment or 1) - 1 for one in places])[place]
        times = np.diff(motion.knots)
        rests = (motion.v == 0) & (motion.a == 0) & (motion.j == 0) & (times > 0)
        own = own + rests
        if begin == 0 and rests[0]:
            own[: np.argmin(np.append(rests, False))] = 0  # the program begins with dwells
        numbers, row = np.unique(own, return_inverse=True)
        found = np.zeros((len(numbers), self._open.shape[1]))
        found[:, NUMBER] = numbers
        np.add.at(found[:, TIME], row, times)
        assert isinstance(motion.path, MachinePath)
        rates = find_travel_rates([motion.path.pieces[piece] for piece in known])[place]
        np.add.at(found[:, WAY], row, (piece_end_lengths(motion) - motion.s) * rates)
        np.add.at(found, (row, IDLE + owner), times)
        found = found[found[:, TIME] > 0]
        if len(found) and len(self._open) and self._open[0, NUMBER] == found[0, NUMBER]:
            found[0, TIME:] += self._open[0, TIME:]
            self.count -= 1
        else:
            self._segments = np.concatenate([self._segments, self._open])
        self.count += len(found)
        self._open = found[-1:]
        self._segments = np.concatenate([self._segments, found[:-1]])
        if len(self._segments) > MOST_SEGMENTS:
            keep = {*_longest(self._segments), *_slowest(self._segments), *self._segments[:, IDLE + 1 :].argmax(0)}
            self._segments = self._segments[sorted(keep)]

    @property
    def t(self) -> Array:
        """(windows,) s, where each begins."""
        count = max(1, min(MOST_WINDOWS, int(np.ceil(self.end / self.window))))
        return np.asarray(self.window * np.arange(count))

    @property
    def use(self) -> dict[str, Array]:
        """(windows,) the largest share of each limit that is met in each window."""
        return {name: self._use[: len(self.t), k] for name, k in self.names.items()}

    @property
    def active(self) -> np.ndarray:
        """(windows,) index in `names` of the limit that is active longest in each; −1 where for longer none is."""
        return np.asarray(self._held[: len(self.t)].argmax(1) - 1)

    @property
    def complete(self) -> bool:
        """Whether `tabulate_longest` lists every segment."""
        return self.count <= MOST_SEGMENTS

    def tabulate_longest(self) -> Table:
        """The segments that take longest, the longest first; all in their order, where there are few."""
        rows = self._rows
        found = rows if self.complete else rows[_longest(rows)]
        left, rest = self.count - len(found), self.end - float(found[:, TIME].sum())
        told = f"the other {left} take {rest:.4f} s together, at most {found[:, TIME].min():.4f} s each" if left else ""
        return self._tabulate("the segments that take longest", found, (told,) if told else ())

    def tabulate_slowest(self) -> Table:
        """The segments of the least mean speed, the slowest first, without dwells."""
        return self._tabulate("the slowest segments", self._rows[_slowest(self._rows)], ())

    def tabulate_limits(self) -> Table:
        """For how long each limit is active, and the segment in which it is longest."""
        held, rows, count = self._held.sum(0), self._rows, len(self.names)
        names, numbers, there = [*self.names, "none of them"], list[int | None](), list[float | None]()
        for k in range(count):
            own = rows[:, IDLE + 1 + k]
            best = int(own.argmax())
            numbers.append(int(rows[best, NUMBER]) if own[best] > 0 else None)
            there.append(float(own[best]) if own[best] > 0 else None)
        seconds = np.append(held[1:], held[0])
        columns = (
            Column("limit", names),
            Column("active", seconds, "s", form=".3f"),
            Column("of the duration", 100 * seconds / max(self.end, 1e-300), "%", form=".1f"),
            *self._tell_where([*numbers, None], "longest in segment"),
            Column("there", [*there, None], "s", form=".4f"),
        )
        return Table("time for which each limit is active", columns)

    @property
    def _rows(self) -> Array:
        return np.concatenate([self._segments, self._open])

    def _tabulate(self, title: str, rows: Array, notes: tuple[str, ...]) -> Table:
        held, names = rows[:, IDLE + 1 :], [*self.names]
        longest = held.argmax(1) if names else np.zeros(len(rows), np.int64)
        most = held.max(1, initial=0.0)
        numbers = [int(number) for number in rows[:, NUMBER]]
        segments, total = self.find_segments(numbers), len(self.program.segments)
        columns = (
            *self._tell_where(numbers, "segment"),
            Column("kind", [type(segments[number % total]).__name__.lower() for number in numbers]),
            Column("length", rows[:, WAY], "m", "human", ".3f"),
            Column("time", rows[:, TIME], "s", form=".4f"),
            Column("mean speed", rows[:, WAY] / rows[:, TIME], "m/s", "human", ".4g"),
            Column("held back by", [names[k] if held > 0 else None for k, held in zip(longest, most, strict=True)]),
            Column(
                "for",
                [100 * s / t if s > 0 else None for s, t in zip(most, rows[:, TIME], strict=True)],
                "%",
                form=".0f",
            ),
        )
        return Table(title, columns, notes)

    def _tell_where(self, numbers: Sequence[int | None], name: str) -> list[Column]:
        total, segments = len(self.program.segments), self.find_segments(numbers)
        own = [None if number is None else number % total for number in numbers]
        columns = [Column(name, [None if number is None else number + 1 for number in own])]
        if self.program.repeat > 1:
            columns.append(
                Column("repetition", [None if number is None else number // total + 1 for number in numbers])
            )
        lines = [None if number is None else segments[number].line_number for number in own]
        return [*columns, Column(FILE_LINE, lines)] if any(lines) else columns

    def find_segments(self, numbers: Iterable[int | None]) -> dict[int, Segment]:
        """By their number from 0; the program's file may be read for it, as far as the last."""
        wanted = {number % len(self.program.segments) for number in numbers if number is not None}
        ahead = islice(self.program.segments, max(wanted, default=-1) + 1)
        return {number: segment for number, segment in enumerate(ahead) if number in wanted}


def _longest(rows: Array) -> list[int]:
    return [*map(int, np.argsort(-rows[:, TIME], kind="stable")[:MOST_SEGMENTS])]


def _slowest(rows: Array) -> list[int]:
    moving = np.flatnonzero(rows[:, WAY] > 0)
    speed = rows[moving, WAY] / rows[moving, TIME]
    return [*map(int, moving[np.argsort(speed, kind="stable")[:MOST_SLOW]])]
