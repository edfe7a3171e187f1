"""Models of motion card, and how they refuse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError

COUNTER = (-(2**27), 2**27 - 1)
"""Range of the 28-bit position counters [Sahbaz 2007, Appendix A]."""
SPEED_STEPS = 65535
"""Largest value of the 16-bit speed registers; the smallest is 1."""


class Refused(MotionError):
    """A command that the card does not take."""


@dataclass(frozen=True, slots=True)
class Card:
    """A model of motion card; its figures are those of [Sahbaz 2007, Appendix A].

    max_speed     pulses/s that a channel can emit at most
    clock_hz      reference clock: a pulse falls on one of its ticks
    while_moving  what a command does that arrives during a move: "replace" it from the command position of that
                  instant, or "queue" behind it (each channel begins when its own move ends)
    speed_range   pulses/s, the top of the speed registers as the host sets their multiplier: commanded speeds are
                  rounded to steps of speed_range/65535, of which one is the least, and none goes beyond it. None: the
                  least speed is a step of the card's whole range, and speeds are not rounded
    """

    name: str
    max_speed: float
    clock_hz: int
    while_moving: Literal["replace", "queue"] = "replace"
    speed_range: float | None = None

    def __post_init__(self) -> None:
        if self.speed_range is not None and not 0 < self.speed_range <= self.max_speed:
            raise MotionError(
                f"{self.name}: speed range {self.speed_range} pulses/s must be above zero and at most "
                f"{self.max_speed:.10g}"
            )

    @property
    def top_speed(self) -> float:
        """Pulses/s that can be commanded at most."""
        return self.max_speed if self.speed_range is None else self.speed_range

    @property
    def least_speed(self) -> float:
        """Pulses/s of one step of the speed register."""
        return self.top_speed / SPEED_STEPS

    def registered(self, speed: Array) -> Array:
        """Magnitudes of speeds as the speed register holds them."""
        speed = np.abs(speed)
        if self.speed_range is not None:
            speed = np.rint(speed / self.least_speed) * self.least_speed
        return np.maximum(speed, self.least_speed)


PCI_8132 = Card("PCI-8132", 2.4e6, 9_830_400)
PCI_8164 = Card("PCI-8164", 6.55e6, 19_660_800)
