"""Models of motion card, their options, and how they refuse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import nearest
from planner.pulses.schedule import COUNTER

SPEED_STEPS = 65535
"""Largest value of the 16-bit speed registers; the smallest is 1."""

OutputMode = Literal[
    "OUT_FALLING_DIR_HIGH",
    "OUT_RISING_DIR_HIGH",
    "OUT_FALLING_DIR_LOW",
    "OUT_RISING_DIR_LOW",
    "CW_CCW_FALLING",
    "CW_CCW_RISING",
]
"""Modes of a channel's two output lines.

HIGH and LOW are the level of DIR towards greater counts, RISING and FALLING the edge with which a
pulse begins. The source uses OUT_RISING_DIR_LOW and OUT_RISING_DIR_HIGH by name [Sahbaz 2007,
Appendix E]. ASSUMPTION: the other names, as the manual of the card is remembered.
"""
MODES = get_args(OutputMode)


class Refused(MotionError):
    """A command that the card does not take."""


@dataclass(frozen=True, slots=True)
class Card:
    """A model of motion card and the options it is set to; the models' figures are those of [Sahbaz
    2007, Appendix A].

    max_speed         pulses/s that a channel can emit at most
    clock_hz          reference clock: a pulse falls on one of its ticks
    while_moving      effect of a command during a move: "replace" the move from its present command
                      position, or "queue" after it (each channel begins when its move ends;
                      assumed: a queue of any length)
    start_from        start speed of a trapezoidal or velocity move that replaces another one: the
                      "commanded" start speed, or the "current" speed if it has the same direction
    short_moves       what a move that is too short for its ramps retains as its top speed is
                      lowered: "keep rate" of acceleration and shorten the ramps, or "keep time" of
                      the ramps and lower the acceleration
    current_speed     output rate of a channel as the host reads it: "signed" by its direction, or
                      only its "magnitude"
    speed_range       pulses/s: full scale of the speed registers, as the host sets their
                      multiplier. Commanded speeds are rounded to steps of speed_range/65535, from
                      one step up to speed_range. None: the lowest speed is a step of the card's
                      whole range, and speeds are not rounded
    channels          of one card; interpolation joins channels of one card alone
    moves_target      whether a move's target can be changed on the fly
    beyond_counter    what a position beyond the counter's range does: "refuse", or "wrap" round
                      (relative and velocity moves; the target of an absolute move is a number of 28
                      bits in any case)
    soft_limits       (lowest, highest) position of each channel, pulses; None: no limits
    at_soft_limit     "refuse" a command that would pass one, or "stop" dead there; a velocity move
                      is stopped anyway
    output_mode       what the two lines of a channel carry: pulse and direction, or a line for each
                      direction
    home_modes        whether the card has numbered modes of home return (`HomeMode`)
    backlash          pulses that each channel fires beforehand when it turns round; None: none
    backlash_speed    pulses/s of these

    Assumed: that soft limits stop dead.
    """

    name: str
    max_speed: float
    clock_hz: int
    while_moving: Literal["replace", "queue"] = "replace"
    start_from: Literal["commanded", "current"] = "commanded"
    short_moves: Literal["keep rate", "keep time"] = "keep rate"
    current_speed: Literal["signed", "magnitude"] = "signed"
    speed_range: float | None = None
    channels: int = 4
    moves_target: bool = True
    beyond_counter: Literal["refuse", "wrap"] = "refuse"
    soft_limits: tuple[tuple[int, int], ...] | None = None
    at_soft_limit: Literal["refuse", "stop"] = "refuse"
    output_mode: OutputMode = "OUT_RISING_DIR_HIGH"
    home_modes: bool = True
    backlash: tuple[int, ...] | None = None
    backlash_speed: float = 1000.0

    def __post_init__(self) -> None:
        for what, speed in (
            ("speed range", self.speed_range),
            ("backlash speed", self.backlash_speed),
        ):
            if speed is not None and not 0 < speed <= self.max_speed:
                raise MotionError(
                    f"{self.name}: {what} {speed} pulses/s must be above zero and at most {self.max_speed:.10g}"
                )
        if self.output_mode not in MODES:
            raise MotionError(
                f'{self.name}: output mode "{self.output_mode}" is not known{nearest(self.output_mode, MODES)}; modes: '
                f"{', '.join(MODES)}"
            )
        for low, high in self.soft_limits or ():
            if not COUNTER[0] <= low <= high <= COUNTER[1]:
                raise MotionError(
                    f"{self.name}: soft limits {low} … {high} must rise within {COUNTER[0]} … {COUNTER[1]} pulses"
                )
        if min(self.backlash or (0,)) < 0:
            raise MotionError(f"{self.name}: backlash {self.backlash} pulses must be zero or more")

    @property
    def top_speed(self) -> float:
        """Pulses/s that can be commanded at most."""
        return self.max_speed if self.speed_range is None else self.speed_range

    @property
    def least_speed(self) -> float:
        """Pulses/s of one step of the speed register."""
        return self.top_speed / SPEED_STEPS

    def round_speed(self, speed: Array) -> Array:
        """Magnitudes of speeds as the speed register holds them."""
        speed = np.abs(speed)
        if self.speed_range is not None:
            speed = np.rint(speed / self.least_speed) * self.least_speed
        return np.maximum(speed, self.least_speed)


PCI_8132 = Card(
    "PCI-8132",
    2.4e6,
    9_830_400,
    channels=2,
    moves_target=False,
    home_modes=False,
)
PCI_8164 = Card("PCI-8164", 6.55e6, 19_660_800)
