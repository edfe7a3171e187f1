"""A long motion at a glance: the extremes of its rows in windows of time, as many however long it is."""

import numpy as np

from kinematics.foundation.arrays import Array
from planner.path.actuation import ActuatorPath, MachinePath
from planner.trajectory import Trajectory, column_headings, rows

ROW_PERIOD = 1e-2
"""s between the instants that are looked at, at most unless a part is very long."""
FINENESS = 64
"""Times closer they are at first: as long as a motion is too short for windows of more."""
MOST_ROWS = 50_000
"""Instants of a part that are looked at; of one that takes longer every so many."""
TOOL_SPEED = "tool speed"
"""m/s, a column of a machine's path next to those of its rows."""
MOST_WINDOWS = 2000
"""Of time; where there would be more, two become one."""


class Overview:
    """Extremes of each column of `planner.trajectory.rows`, and of the tool's speed, in even windows of time.

    names          of the columns, once a part is there; their units: units
    window         s of each window of time
    period         s between the instants that are looked at, at most
    first, low, high  (windows, columns)
    segments       (windows,) the program's segment at the first instant of each; 0 without a program
    """

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self.units: tuple[str, ...] = ()
        self.window, self.period = 2 * ROW_PERIOD / FINENESS, ROW_PERIOD / FINENESS
        self._windows = self.segments = np.zeros(0, np.int64)
        self.first = self.low = self.high = np.zeros((0, 0))

    def add(self, motion: Trajectory, begin: float, length: float) -> None:
        """A part of the motion that begins at a time (s) and a path length (m) of the whole."""
        if not self.names:
            self._name_columns(motion.path)
        end = begin + motion.duration
        while end > MOST_WINDOWS * self.window:
            self.window *= 2
            self._windows //= 2
            self._merge()
        usual = min(ROW_PERIOD, self.window / 2)
        period = max(1, int(motion.duration / usual / MOST_ROWS)) * usual
        self.period = max(self.period, period)
        n = np.arange(np.ceil(begin / period), np.floor(end / period) + 1)
        t = np.clip(n * period - begin, 0.0, motion.duration)
        if not len(t):
            return
        columns = rows(motion, t)
        if isinstance(motion.path, MachinePath):
            speed = np.linalg.norm(motion.at(t).tool_velocity, axis=1)
            columns = np.column_stack([columns, speed])
        columns[:, 0] += begin
        columns[:, 1] += length
        pieces = motion.piece[np.clip(np.searchsorted(motion.knots, t, side="right") - 1, 0, len(motion.piece) - 1)]
        known, place = np.unique(pieces, return_inverse=True)
        own = np.array([motion.path.segment(int(piece)) or 0 for piece in known])[place]
        self.segments = np.append(self.segments, own)
        whose = np.minimum(n * period / self.window + 1e-9, MOST_WINDOWS - 1).astype(np.int64)
        self._windows = np.append(self._windows, whose)
        self.first, self.low, self.high = (
            np.concatenate([before, columns]) for before in (self.first, self.low, self.high)
        )
        self._merge()

    def _name_columns(self, path: ActuatorPath) -> None:
        headings = column_headings(path)
        if isinstance(path, MachinePath):
            headings = [*headings, (TOOL_SPEED, "m/s")]
        self.names, self.units = (tuple(each) for each in zip(*headings, strict=True))
        self.first = self.low = self.high = np.zeros((0, len(headings)))

    def _merge(self) -> None:
        """What is in the same window becomes one."""
        if not len(self._windows):
            return
        starts = np.flatnonzero(np.diff(self._windows, prepend=-1))
        self._windows, self.segments, self.first = self._windows[starts], self.segments[starts], self.first[starts]
        self.low, self.high = np.minimum.reduceat(self.low, starts), np.maximum.reduceat(self.high, starts)

    @property
    def t(self) -> Array:
        """(windows,) s, the first instant that was looked at in each."""
        return self.first[:, 0]

    def column(self, name: str) -> tuple[Array, Array, Array]:
        """The first, the least and the largest values (windows,) of a column."""
        k = self.names.index(name)
        return self.first[:, k], self.low[:, k], self.high[:, k]
