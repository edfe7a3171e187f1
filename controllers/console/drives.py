"""What the console makes of a machine: steps, rates and ends of every axis, on the virtual card."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.card import PCI_8164, Card
from kinematics.foundation.arrays import Array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import directional_bounds
from kinematics.machine.machine import Machine
from planner.pulses.motion import COUNTER

JOG_SPEED_SHARE = 0.1
"""Share of its speed at which an axis jogs: "slowly traversed", says the source, and no number (assumed)."""
WHOLE_TOLERANCE = 1e-6
"""Pulses by which a travel may miss a whole number of them and still be it: rounding of units."""


@dataclass(frozen=True, slots=True)
class Drives:
    """The axes of a machine in pulses of the card, which count where the axis' own coordinate grows, from home on.

    The speed v is the least of max_speed, the pulse rate, and where there are any, the first resonance band's foot;
    the acceleration a is max_acceleration, so that the ramp takes X_a = v²/(2 a). Speeds are whole steps of the card's
    speed register, rounded down. Where an axis states two magnitudes, the smaller is used both ways.

    names         (n,) in capitals, as commands name the axes
    signs         (n,) +1/-1: the coordinate's direction in which the motor turns clockwise, the wiring's positive count
    speed, acceleration  (n,) pulses/s, pulses/s²
    low, high     (n,) int64, the ends of travel; of an endless axis those of the card's counter
    """

    card: Card
    names: tuple[str, ...]
    signs: np.ndarray
    speed: Array
    acceleration: Array
    low: np.ndarray
    high: np.ndarray

    def __post_init__(self) -> None:
        freeze_fields(self, "signs", "speed", "acceleration", "low", "high")

    @property
    def ramp(self) -> Array:
        """X_a (n,), pulses of the way in which an axis comes to its speed: v²/(2 a)."""
        return np.asarray(self.speed**2 / (2 * self.acceleration))

    def reach(self) -> tuple[np.ndarray, np.ndarray]:
        """Ends of where a slide can stand: travel, and its zero, where the switch is, which may lie outside."""
        return np.minimum(self.low, 0), np.maximum(self.high, 0)

    def within(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ends, no farther than the counter's."""
        return np.maximum(low, COUNTER[0]), np.minimum(high, COUNTER[1])


def machine_drives(machine: Machine) -> Drives:
    """The drives of a machine. Raises MotionError for an axis without speed or acceleration, or that compensates."""
    speed, acceleration = [], []
    for axis in machine.axes:
        for name in ("max_speed", "max_acceleration"):
            if getattr(axis, name) is None:
                raise MotionError(f"console: axis {axis.name} states no {name}; give one in the machine's file")
        if axis.compensate:
            raise MotionError(
                f"console: axis {axis.name} compensates {' and '.join(axis.compensate)}, so its pulses count the motor "
                "and a register would not tell where the axis is; take compensate out of the machine's file"
            )
        band = axis.resonance[0][0] if axis.resonance else np.inf
        speed.append(min(min(*directional_bounds(axis.max_speed), band) / axis.pulse, axis.pulse_rate))
        acceleration.append(min(directional_bounds(axis.max_acceleration)) / axis.pulse)
    card = replace(PCI_8164, channels=len(machine.axes), speed_range=min(max(speed), PCI_8164.max_speed))
    steps = np.floor(np.minimum(speed, card.top_speed) / card.least_speed + WHOLE_TOLERANCE)
    ends = np.array([np.divide(axis.travel, axis.pulse) for axis in machine.axes])
    low, high = np.clip([np.ceil(ends[:, 0] - WHOLE_TOLERANCE), np.floor(ends[:, 1] + WHOLE_TOLERANCE)], *COUNTER)
    return Drives(
        card,
        tuple(axis.name.upper() for axis in machine.axes),
        np.array([axis.direction for axis in machine.axes], np.int64),
        np.maximum(steps, 1.0) * card.least_speed,
        np.array(acceleration),
        low.astype(np.int64),
        high.astype(np.int64),
    )
