"""A pulse schedule: for every axis the clock ticks at which it is stepped, and which way."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.array import frozen
from kinematics.errors import MotionError
from kinematics.result import Result
from kinematics.table import Table
from planner.pulses import schedule_tables

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Ticks = NDArray[np.int64]
Signs = NDArray[np.int8]
BINS = 600
"""Windows of time over which figures average pulse rates."""


@dataclass(frozen=True, slots=True)
class AxisPulses:
    """The pulses of one axis: count·pulse ≈ q(t) - home.

    ticks      (N,) int64, strictly increasing: pulse i falls at ticks[i] / clock_hz
    direction  (N,) int8, +1/-1 in q (not in the wiring's count)
    start      count before the first pulse: (q(0) - home) / pulse rounded to the nearest, half-way cases down
    pulse      m or rad per pulse
    home       m or rad, the axis coordinate from which pulses count
    bound      pulses: |count - (q(t) - home) / pulse| stays within it and one tick's travel

    The class holds what it is given: that the ticks rise and follow the motion is for `planner.pulses.check` to prove.
    """

    name: str
    ticks: Ticks
    direction: Signs
    start: int
    pulse: float
    home: float
    bound: float = 0.5

    def __post_init__(self) -> None:
        object.__setattr__(self, "ticks", frozen(self.ticks, np.int64))
        object.__setattr__(self, "direction", frozen(self.direction, np.int8))
        if self.ticks.ndim != 1 or self.ticks.shape != self.direction.shape:
            shapes = f"ticks {self.ticks.shape} and directions {self.direction.shape}"
            raise MotionError(f"axis {self.name}: {shapes} differ in shape; give one direction per tick")

    def __len__(self) -> int:
        return len(self.ticks)

    def counts(self, ticks: ArrayLike) -> Ticks:
        """(N,) the count after the pulses at or before each tick."""
        running = np.concatenate(([self.start], self.start + np.cumsum(self.direction, dtype=np.int64)))
        return running[np.searchsorted(self.ticks, ticks, side="right")]

    @property
    def final(self) -> int:
        """The count after the last pulse."""
        return self.start + int(self.direction.sum(dtype=np.int64))


@dataclass(frozen=True, slots=True)
class Moved:
    """What keeping its pulses as far apart as it takes them cost an axis.

    pulses  how many were moved
    time    s, the farthest
    error   pulses by which that widened the bound of the counts, at t (s)
    length  m or rad, the same
    """

    axis: str
    pulses: int
    time: float
    error: float
    t: float
    length: float


@dataclass(frozen=True, slots=True)
class Compensation:
    """What an axis counts besides the motion, and what that costs.

    kinds         "lead", "backlash"
    crossings     times that the motor crosses the play
    off           m or rad by which the axis is behind at most while it does: all of its way meanwhile, a loose bound
    windows       (begin, end) in s of each crossing
    unturned      m or rad of the farthest run back, below half a pulse, for which it does not
    speed, acceleration  of the motor at most while it does, m/s and m/s² or rad/s and rad/s², the motion's own included
                  and looked at before its screw's table; neither is in the certificate
    max_speed, max_acceleration  what they keep to; None: nothing
    jerk          m/s³ or rad/s³ of crossing the play, at most: told, and kept to max_jerk only while the axis rests
    """

    axis: str
    kinds: tuple[str, ...]
    crossings: int = 0
    off: float = 0.0
    unturned: float = 0.0
    speed: float = 0.0
    max_speed: float | None = None
    acceleration: float = 0.0
    max_acceleration: float | None = None
    jerk: float = 0.0
    windows: tuple[tuple[float, float], ...] = field(default=(), repr=False)


@dataclass(frozen=True, slots=True)
class PulseSchedule(Result):
    """The pulses of every axis on one clock (clock_hz ticks per second); the motion ends at `duration` (s).

    rule   the firing rule that made them, with its options as `planner.pulses.find_rule` reads them
    moves  what keeping pulses apart cost
    compensations  of the axes that ask for one: they count in the motors' coordinates
    """

    clock_hz: int
    axes: tuple[AxisPulses, ...]
    duration: float
    rule: str = "nearest"
    moves: tuple[Moved, ...] = ()
    compensations: tuple[Compensation, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", tuple(self.axes))
        if not (self.clock_hz > 0 and self.clock_hz == int(self.clock_hz)):
            raise MotionError(f"clock {self.clock_hz} Hz: must be a positive whole number of ticks per second")

    def tables(self) -> tuple[Table, ...]:
        """The pulses of each axis; what keeping them apart and the compensation cost, if anything."""
        return tuple(schedule_tables.tables(self, {}))

    def data(self) -> Table:
        """Every pulse."""
        return schedule_tables.every_pulse(self)

    def files(self) -> Mapping[str, Callable[[Path], None]]:
        """.npz: exact, as `export` writes it; .csv: every pulse; .json: the tables."""
        # a plugged format: what proves schedules must not come to import what formats import
        return {
            ".npz": partial(import_module("planner.export.npz").write, self),
            ".csv": self._csv,
            ".json": self._json,
        }

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Pulse rates over time."""
        from planner.pulses.schedule_plot import pulse_rate

        ax = pulse_rate(self, ax)
        ax.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
        return ax

    def counts(self, t: ArrayLike) -> Ticks:
        """(N, axes) the counts at the instants t (s); a pulse counts from its own instant, ticks / clock_hz, on."""
        # One rounding step up: (T / clock)·clock may fall just short of the tick T it stands for.
        ticks = np.floor(np.nextafter(np.atleast_1d(np.asarray(t, float)) * self.clock_hz, np.inf))
        return np.column_stack([axis.counts(ticks) for axis in self.axes])

    @property
    def total(self) -> int:
        """The number of pulses of all axes together."""
        return sum(len(axis) for axis in self.axes)

    @property
    def smallest_interval(self) -> int | None:
        """Ticks between the two closest pulses of any one axis; None where no axis has two."""
        closest = [int(np.diff(axis.ticks).min()) for axis in self.axes if len(axis) > 1]
        return min(closest, default=None)
