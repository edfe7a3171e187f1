"""A pulse schedule: for every axis the clock ticks at which it is stepped, and which way; whole, or
in parts.

Parts follow each other in time. They are joined, or compared without ever being whole.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.result import Result
from kinematics.foundation.short_repr import short_repr
from kinematics.foundation.table import Column, Table
from kinematics.machine.axis import Axis

Ticks = NDArray[np.int64]
Signs = NDArray[np.int8]
RATE_WINDOWS = 600
"""Windows of time over which figures average pulse rates."""


@dataclass(frozen=True, slots=True)
class AxisPulses:
    """The pulses of one axis: count·pulse ≈ q(t) - home.

    ticks      (N,) int64, strictly increasing: pulse i falls at ticks[i] / clock_hz
    direction  (N,) int8, +1/-1 in q (not in the wiring's count)
    start      count before the first pulse: (q(0) - home) / pulse rounded to the nearest, half-way
               cases down
    pulse      m or rad per pulse
    home       m or rad, the axis coordinate from which pulses count
    bound      pulses: |count - (q(t) - home) / pulse| stays within it and one tick's travel

    The class holds what it is given: that the ticks rise and follow the motion is for
    `planner.pulses.checking` to prove.
    """

    __repr__ = short_repr
    name: str
    ticks: Ticks
    direction: Signs
    start: int
    pulse: float
    home: float
    bound: float = 0.5

    def __post_init__(self) -> None:
        object.__setattr__(self, "ticks", freeze_array(self.ticks, np.int64))
        object.__setattr__(self, "direction", freeze_array(self.direction, np.int8))
        if self.ticks.ndim != 1 or self.ticks.shape != self.direction.shape:
            shapes = f"ticks {self.ticks.shape} and directions {self.direction.shape}"
            raise MotionError(
                f"axis {self.name}: {shapes} differ in shape; give one direction per tick"
            )

    def __len__(self) -> int:
        return len(self.ticks)

    def counts(self, ticks: ArrayLike) -> Ticks:
        """(N,) the count after the pulses at or before each tick."""
        running = np.concatenate(
            ([self.start], self.start + np.cumsum(self.direction, dtype=np.int64))
        )
        return running[np.searchsorted(self.ticks, ticks, side="right")]

    @property
    def final(self) -> int:
        """The count after the last pulse."""
        return self.start + int(self.direction.sum(dtype=np.int64))


@dataclass(frozen=True, slots=True)
class MovedPulses:
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
    off           m or rad by which the axis is behind at most while it does: all of its way
                  meanwhile, a loose bound
    windows       (begin, end) in s of each crossing, which ends once the axis is where it should be
    unturned      m or rad of the farthest run back, below half a pulse, for which it does not
    speed, acceleration  of the motor at most while it does, m/s and m/s² or rad/s and rad/s², the
                         motion's own included
                  and looked at before its screw's table; neither is in the certificate
    max_speed, max_acceleration  what they keep to; None: nothing
    jerk          m/s³ or rad/s³ of crossing the play, at most: told, and kept to max_jerk only
                  while the axis rests
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


COUNTER = -(1 << 27), (1 << 27) - 1
"""What the 28-bit position counters of the cards hold [Sahbaz 2007]."""


def refuse_counter(pulses: AxisPulses, axis: Axis) -> None:
    """Raise MotionError where an axis, at rest or moving, stands at a count that its card's
    register does not hold.

    The register counts as the wiring does: an axis of direction -1 the other way.
    """
    counts = np.cumsum(pulses.direction, dtype=np.int64)
    for away in (counts.min(initial=0), counts.max(initial=0)):
        wired = (pulses.start + int(away)) * axis.direction
        if not COUNTER[0] <= wired <= COUNTER[1]:
            raise MotionError(
                f"axis {axis.name}: the motion counts to {wired}, beyond the {COUNTER[0]} .. {COUNTER[1]} of the "
                f"28-bit position counter of card {axis.card}; use a longer pulse, or work nearer to home"
            )


@dataclass(frozen=True, slots=True)
class PulseSchedule(Result):
    """The pulses of every axis on one clock (clock_hz ticks per second); the motion ends at
    `duration` (s).

    rule   the firing rule that made them, with its options as `planner.pulses.find_rule` reads them
    moves  what keeping pulses apart cost
    compensations  of the axes that ask for one: they count in the motors' coordinates
    """

    clock_hz: int
    axes: tuple[AxisPulses, ...]
    duration: float
    rule: str = "nearest"
    moves: tuple[MovedPulses, ...] = ()
    compensations: tuple[Compensation, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", tuple(self.axes))
        if not (self.clock_hz > 0 and self.clock_hz == int(self.clock_hz)):
            raise MotionError(
                f"clock {self.clock_hz} Hz: must be a positive whole number of ticks per second"
            )

    def __repr__(self) -> str:
        count = len(self.axes)
        axes = count_noun(count, "axis")
        pulses = f"{count_noun(self.total, 'pulse')} on {axes}"
        return f"<PulseSchedule: {pulses} in {self.duration:.6g} s, clock {self.clock_hz} Hz>"

    def tables(self) -> tuple[Table, ...]:
        """The pulses of each axis; what keeping them apart and the compensation cost, if
        anything.
        """
        return tuple(schedule_tables(self, {}))

    def data(self) -> Table:
        """Every pulse."""
        return pulse_table(self)

    def counts(self, t: ArrayLike) -> Ticks:
        """(N, axes) the counts at the instants t (s); a pulse counts from its own instant, ticks /
        clock_hz, on.

        Raises MotionError for what is no instant.
        """
        ticks = self.find_ticks(np.atleast_1d(finite_array(t, "counts: t", (), (None,), unit="s")))
        return np.column_stack([axis.counts(ticks) for axis in self.axes])

    def find_ticks(self, t: Array) -> Array:
        """(N,) the last tick at or before each instant t (N,) s."""
        # One rounding step up: (T / clock)·clock may fall just short of the tick T it stands for.
        return np.floor(np.nextafter(t * self.clock_hz, np.inf))

    @property
    def total(self) -> int:
        """The number of pulses of all axes together."""
        return sum(len(axis) for axis in self.axes)

    @property
    def smallest_interval(self) -> int | None:
        """Ticks between the two closest pulses of any one axis; None where no axis has two."""
        closest = [int(np.diff(axis.ticks).min()) for axis in self.axes if len(axis) > 1]
        return min(closest, default=None)


def join_schedules(parts: Iterable[PulseSchedule]) -> PulseSchedule:
    """The whole of one or more parts: what holds for all of it is the last's, start counts are the
    first's.

    Times in which play is crossed are stated by the part in which they are.
    """
    held = list(parts)
    axes = tuple(
        replace(
            each[-1],
            start=each[0].start,
            ticks=np.concatenate([axis.ticks for axis in each]),
            direction=np.concatenate([axis.direction for axis in each]),
        )
        for each in zip(*(part.axes for part in held), strict=True)
    )
    costs = tuple(
        replace(
            each,
            windows=tuple(window for part in held for window in _find_windows(part, each.axis)),
        )
        for each in held[-1].compensations
    )
    return replace(held[-1], axes=axes, compensations=costs)


def _find_windows(part: PulseSchedule, axis: str) -> tuple[tuple[float, float], ...]:
    return next((one.windows for one in part.compensations if one.axis == axis), ())


def holds_same_pulses(schedule: PulseSchedule, parts: Iterable[PulseSchedule]) -> bool:
    """The parts hold exactly the pulses of a schedule."""
    done = [0] * len(schedule.axes)
    for part in parts:
        for k, (got, axis) in enumerate(zip(part.axes, schedule.axes, strict=True)):
            here = slice(done[k], done[k] + len(got))
            if not np.array_equal(got.ticks, axis.ticks[here]):
                return False
            if not np.array_equal(got.direction, axis.direction[here]):
                return False
            done[k] += len(got)
    return done == [len(axis) for axis in schedule.axes]


UNKNOWN_UNIT = "m or rad"
COUNT_BOUND = "bound of the count error at all times, plus the travel in one clock tick"


def schedule_tables(
    schedule: PulseSchedule,
    units: Mapping[str, str],
    counted: Sequence[tuple[int, int]] | None = None,
) -> Iterator[Table]:
    """units: m or rad by axis, where it is known; counted: pulses and net count of each, where they
    are elsewhere.

    What costs nothing has no table.
    """
    axes = schedule.axes
    counted = counted or [(len(axis), axis.final - axis.start) for axis in axes]
    yield Table(
        f"pulses on a clock of {schedule.clock_hz / 1e6:g} MHz, firing rule {schedule.rule}",
        (
            Column("axis", [axis.name for axis in axes]),
            Column("pulses", [pulses for pulses, _ in counted]),
            Column("net count", [net for _, net in counted]),
            Column("error ≤", [axis.bound for axis in axes], "pulses", form=".3f", up=True),
        ),
        (
            f"{count_noun(sum(pulses for pulses, _ in counted), 'pulse')} in all",
            f"error: {COUNT_BOUND}",
        ),
    )
    if moved := schedule.moves:
        yield Table(
            "moved apart, as the axes take them",
            (
                Column("axis", [one.axis for one in moved]),
                Column("pulses", [one.pulses for one in moved]),
                Column("by at most", [one.time for one in moved], "s", "micro", ".3f"),
                Column("error ≤", [one.error for one in moved], "pulses", form=".4f", up=True),
                Column(
                    "length ≤",
                    [one.length for one in moved],
                    [units.get(one.axis, UNKNOWN_UNIT) for one in moved],
                    "micro",
                    ".4f",
                    up=True,
                ),
            ),
        )
    if costs := [cost for cost in schedule.compensations if cost.kinds]:
        own = [units.get(cost.axis, UNKNOWN_UNIT) for cost in costs]
        rates = {
            "speed": ([cost.speed for cost in costs], [cost.max_speed for cost in costs], "/s"),
            "acceleration": (
                [cost.acceleration for cost in costs],
                [cost.max_acceleration for cost in costs],
                "/s^2",
            ),
        }
        yield Table(
            "made up for",
            (
                Column("axis", [cost.axis for cost in costs]),
                Column("kinds", [" and ".join(cost.kinds) for cost in costs]),
                Column("reversals", [cost.crossings for cost in costs]),
                Column("off by ≤", [cost.off for cost in costs], own, "micro", ".3f", up=True),
            ),
        )
        yield Table(
            "the motors while they cross the play, beside what is certified",
            (
                Column("axis", [cost.axis for cost in costs]),
                *(
                    Column(f"{name}{of}", values, [f"{unit}{per}" for unit in own], "human", ".3f")
                    for name, (reached, limits, per) in rates.items()
                    for of, values in (("", reached), (" limit", limits))
                ),
                Column(
                    "jerk",
                    [cost.jerk for cost in costs],
                    [f"{unit}/s^3" for unit in own],
                    "human",
                    ".3g",
                ),
            ),
        )


def pulse_table(schedule: PulseSchedule) -> Table:
    """A row for each pulse, in the order of time: its tick and time, which axis, which way in q,
    and its count then.
    """
    axes = schedule.axes
    ticks = np.concatenate([axis.ticks for axis in axes])
    whose = np.repeat(np.arange(len(axes)), [len(axis) for axis in axes])
    counts = np.concatenate(
        [axis.start + np.cumsum(axis.direction, dtype=np.int64) for axis in axes]
    )
    order = np.lexsort((whose, ticks))
    return Table(
        f"pulses, firing rule {schedule.rule}",
        (
            Column("tick", ticks[order]),
            Column("t", ticks[order] / schedule.clock_hz, "s"),
            Column("axis", np.array([axis.name for axis in axes], dtype=object)[whose[order]]),
            Column("direction", np.concatenate([axis.direction for axis in axes])[order]),
            Column("count", counts[order]),
        ),
    )
