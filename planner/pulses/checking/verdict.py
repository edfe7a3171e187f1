"""What the check of a pulse schedule found."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class PulseFault:
    """One thing wrong with the pulses of an axis, at a clock tick."""

    axis: str
    tick: int
    what: str


@dataclass(frozen=True, slots=True)
class LineTimes:
    """The least times (s) on the lines of an axis; ∞ where there is nothing to time.

    high, low    that STEP stays at each level, low between two pulses
    setup, hold  from a change of DIR (the file's first level: from time 0) to the next rise of
                 STEP, and from a rise to the next change
    interval     from rise to rise
    """

    axis: str
    high: float
    low: float
    setup: float
    hold: float
    interval: float


@dataclass(frozen=True, slots=True)
class AxisCheck:
    """The findings on one axis.

    time_error         ticks, largest |pulse - where its rule has it| (the true crossing, a look, a
                       listed step), but of pulses that were moved apart; inf where the motion
                       crosses no level there; None under a rule or bound of which nothing else is
                       known
    position_error     pulses, largest |count - (q - home)/pulse| beyond the bound + one tick's
                       travel; 0 within
    smallest_interval  s between two pulses; inf with fewer than two
    final_error        pulses, the last count - where the motion ends; 0 within the bound
    faults             the first few of each kind; fault_count counts all
    lines              the least times on its lines, where a file was checked
    smallest_reversal  s between two pulses of which the second goes back; inf where none does
    first              s from the beginning to the first pulse; inf where there is none
    behind             pulses, largest |axis - planned| behind the play and the screw that its
                       pulses make up for; None where they make up for none
    """

    name: str
    pulses: int
    time_error: float | None
    position_error: float
    smallest_interval: float
    final_error: float
    faults: tuple[PulseFault, ...]
    fault_count: int
    lines: LineTimes | None = None
    behind: float | None = None
    smallest_reversal: float = np.inf
    first: float = np.inf


@dataclass(frozen=True, slots=True)
class PulseCheck:
    """The verdict on a schedule, and its worst figures over all axes (units as in AxisCheck)."""

    axes: tuple[AxisCheck, ...]

    @property
    def holds(self) -> bool:
        return self.fault_count == 0

    @property
    def faults(self) -> tuple[PulseFault, ...]:
        return tuple(fault for axis in self.axes for fault in axis.faults)

    @property
    def fault_count(self) -> int:
        return sum(axis.fault_count for axis in self.axes)

    @property
    def time_error(self) -> float | None:
        """None where no axis has one."""
        known = [axis.time_error for axis in self.axes if axis.time_error is not None]
        return max(known, default=None)

    @property
    def position_error(self) -> float:
        return max((axis.position_error for axis in self.axes), default=0.0)

    @property
    def smallest_interval(self) -> float:
        return min((axis.smallest_interval for axis in self.axes), default=np.inf)

    @property
    def highest_rate(self) -> float:
        """Pulses per second, between the two closest pulses of any one axis; 0 where no axis has
        two.
        """
        return 1 / self.smallest_interval if self.smallest_interval > 0 else np.inf

    @property
    def final_error(self) -> float:
        return max((axis.final_error for axis in self.axes), key=abs, default=0.0)
