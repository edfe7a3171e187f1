"""The firing rule `floor`: an axis is stepped when it reaches a whole count, and back when it leaves it downwards."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from kinematics.foundation.arrays import Array
from kinematics.machine.axis import Axis
from planner.parallel import Progress
from planner.pulses.generation.levels import MAX_COUNT_BLUR, Levels, find_crossings
from planner.pulses.generation.rule import kept_rates, told
from planner.pulses.motion import AxesMotion
from planner.pulses.schedule import PulseSchedule

COUNT_ROUNDING = (
    2 * MAX_COUNT_BLUR
)  # pulses before a whole count where it counts as reached: more than rounding may take


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
        return kept_rates(axes, clock_hz)

    def fire(
        self, motion: AxesMotion, axes: Sequence[Axis], home: Array, clock_hz: int, tell: Progress
    ) -> PulseSchedule:
        """Raises as `planner.pulses.generation.levels.find_crossings` does."""
        fired = find_crossings(motion, axes, home, clock_hz, Levels(1 - COUNT_ROUNDING), tell)
        return PulseSchedule(clock_hz, fired, motion.duration, told(self))
