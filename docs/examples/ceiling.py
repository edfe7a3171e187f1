"""The firing rule `ceiling`: the count is the least whole number not below the position, in pulses."""

from dataclasses import dataclass
from typing import ClassVar

from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option
from planner.pulses.generation.firing_rule import Rule
from planner.pulses.generation.levels import Levels, find_crossings
from planner.pulses.generation.motion_parts import Fired, MotionPart


@dataclass(frozen=True, slots=True)
class Ceiling(Rule):
    """A pulse as soon as x = (q(t) - home)/pulse leaves a whole number: the axis is never behind its motion.

    |count - x| ≤ 1 pulse + one tick's travel. A whole number counts as left `margin` pulses after it, so that
    rounding gives no pulse to an axis that rests at home.
    """

    name: ClassVar[str] = "ceiling"
    margin: float = option(0.01, "how far beyond a whole count a pulse comes, in pulses; below 0.5")

    def __post_init__(self) -> None:
        if not 0.002 <= self.margin < 0.5:
            raise MotionError(
                f"margin {self.margin!r} pulses: must be from 0.002 to below 0.5, e.g. 0.01"
            )

    def fire(self, part: MotionPart) -> Fired:
        return find_crossings(part, Levels(self.margin))
