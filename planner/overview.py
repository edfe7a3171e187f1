"""The extremes of a long motion's rows in windows of time, in memory that does not grow."""

import numpy as np

from kinematics.foundation.arrays import Array
from planner.path.actuation import ActuatorPath, MachinePath
from planner.trajectory import Trajectory, column_headings, rows

ROW_PERIOD = 1e-2
"""Largest time (s) between sampled instants; longer only in a part of more than MOST_ROWS."""
FINENESS = 64
"""Factor by which they are closer at first, so that a short motion fills many windows."""
MOST_ROWS = 50_000
"""Largest number of sampled instants of a part: it bounds the memory and time for a long part."""
TOOL_SPEED = "tool speed"
"""m/s, a column of a machine's path next to those of its rows."""
MOST_WINDOWS = 2000
"""Largest number of windows of time; before there are more, pairs are joined.

More windows show finer detail and take more memory, as a page of the report does.
"""


class Overview:
    """Extremes of the columns of `planner.trajectory.rows` and the tool's speed, in time windows.

    names, units      of the columns, after the first part
    window            s of each window of time
    period            s between the sampled instants, at most
    first, low, high  (windows, columns) first, least and largest values
    segments          (windows,) the program's segment at the first instant; 0 without a program
    """

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self.units: tuple[str, ...] = ()
        self.window = 2 * ROW_PERIOD / FINENESS
        self.period = ROW_PERIOD / FINENESS
        self._windows = self.segments = np.zeros(0, np.int64)
        self.first = self.low = self.high = np.zeros((0, 0))

    def add(self, motion: Trajectory, begin: float, length: float) -> None:
        """Add a part of the motion that begins at a time (s) and a path length (m) of the whole."""
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
        pieces, place = np.unique(motion.piece[motion.locate(t)], return_inverse=True)
        segments = np.array([motion.path.segment(int(piece)) or 0 for piece in pieces])[place]
        self.segments = np.append(self.segments, segments)
        # an instant on an edge belongs to the later window, in spite of rounding
        windows = np.minimum(n * period / self.window + 1e-9, MOST_WINDOWS - 1).astype(np.int64)
        self._windows = np.append(self._windows, windows)
        self.first = np.concatenate([self.first, columns])
        self.low = np.concatenate([self.low, columns])
        self.high = np.concatenate([self.high, columns])
        self._merge()

    def _name_columns(self, path: ActuatorPath) -> None:
        headings = column_headings(path)
        if isinstance(path, MachinePath):
            headings = [*headings, (TOOL_SPEED, "m/s")]
        self.names = tuple(name for name, _ in headings)
        self.units = tuple(unit for _, unit in headings)
        self.first = self.low = self.high = np.zeros((0, len(headings)))

    def _merge(self) -> None:
        """Join the rows of each window."""
        if not len(self._windows):
            return
        starts = np.flatnonzero(np.diff(self._windows, prepend=-1))
        self._windows = self._windows[starts]
        self.segments = self.segments[starts]
        self.first = self.first[starts]
        self.low = np.minimum.reduceat(self.low, starts)
        self.high = np.maximum.reduceat(self.high, starts)

    @property
    def t(self) -> Array:
        """First sampled instant (windows,) s of each window."""
        return self.first[:, 0]

    def column(self, name: str) -> tuple[Array, Array, Array]:
        """Return the first, the least and the largest values (windows,) of a column."""
        k = self.names.index(name)
        return self.first[:, k], self.low[:, k], self.high[:, k]
