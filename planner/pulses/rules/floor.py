"""The firing rule `floor`: an axis is stepped when it reaches a whole count, and back when it leaves it downwards."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from kinematics.array import Array
from kinematics.axis import Axis
from planner.parallel import Progress
from planner.pulses.levels import COARSE, Levels, cross
from planner.pulses.motion import Motion
from planner.pulses.rules.rule import held_rates, told
from planner.pulses.schedule import PulseSchedule

REACHED = 2 * COARSE  # pulses before a whole count where it counts as reached: more than rounding may take


@dataclass(frozen=True, slots=True)
class Floor:
    """A pulse wherever x = (q(t) - home)/pulse crosses a whole number: the count is the greatest not above x.

    |count - x| ≤ 1 pulse + one tick's travel at all times.

    A whole number counts as reached 0.002 pulse before it, so that rounding takes no pulse from a motion which
    ends on one, and gives none to an axis that rests at home.
    """

    name: ClassVar[str] = "floor"

    def grain(self, clock_hz: int) -> int:
        return 1

    def rates(self, axes: Sequence[Axis], clock_hz: int) -> list[float]:
        return held_rates(axes, clock_hz)

    def fire(self, motion: Motion, axes: Sequence[Axis], home: Array, clock_hz: int, tell: Progress) -> PulseSchedule:
        """Raises as `planner.pulses.levels.cross` does."""
        fired = cross(motion, axes, home, clock_hz, Levels(1 - REACHED), tell)
        return PulseSchedule(clock_hz, fired, motion.duration, told(self))
