"""Models of motion card, and how they refuse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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
    """

    name: str
    max_speed: float
    clock_hz: int
    while_moving: Literal["replace", "queue"] = "replace"

    @property
    def least_speed(self) -> float:
        """Pulses/s of one step of the speed register, whose range is the card's whole range."""
        return self.max_speed / SPEED_STEPS


PCI_8132 = Card("PCI-8132", 2.4e6, 9_830_400)
PCI_8164 = Card("PCI-8164", 6.55e6, 19_660_800)
