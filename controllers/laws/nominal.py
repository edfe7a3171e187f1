"""What the host knows of the axes that it commands: the drives' data sheet, never the plant of the day."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from controllers.rig import Rig
from kinematics.array import Array, frozen
from kinematics.errors import MotionError


@dataclass(frozen=True, slots=True)
class NominalAxes:
    """The axes of a rig as its maker states them, each (n,), or (1,) where all are alike.

    With c the card's command and x, v the axis' position and speed:
    v̇ = ω (K (c − x) − v) + i − β v,  i̇ = (ω/T) (K (c − x) − v),  ẋ = v, `delay` later.

    position_gain     K, 1/s;  speed_loop  ω, rad/s;  integral_time  T, s
    friction          β, viscous friction by inertia, 1/s
    delay             s from a pulse of the card to the torque that it brings about
    max_speed         pulses/s;  max_acceleration  pulses/s²; infinite where the machine states none
    """

    position_gain: Array
    speed_loop: Array
    integral_time: Array
    friction: Array
    delay: Array
    max_speed: Array
    max_acceleration: Array

    def __post_init__(self) -> None:
        for field in fields(self):
            values = np.atleast_1d(np.asarray(getattr(self, field.name), float))
            object.__setattr__(self, field.name, frozen(values))
            lowest = 0.0 if field.name in ("friction", "delay") else np.finfo(float).tiny
            if not np.all(values >= lowest):
                raise MotionError(
                    f"nominal axes: {field.name} {values.min():g} must be a positive number (friction and delay may be "
                    "zero)"
                )

    def __len__(self) -> int:
        return max(len(getattr(self, field.name)) for field in fields(self))

    def key(self) -> tuple[tuple[float, ...], ...]:
        """The numbers, to remember by what was computed from them."""
        return tuple(tuple(getattr(self, field.name).tolist()) for field in fields(self))

    @staticmethod
    def of(key: tuple[tuple[float, ...], ...], n: int) -> NominalAxes:
        """The n axes of a `key`."""
        return NominalAxes(*(np.broadcast_to(numbers, n) for numbers in key))


def usual() -> NominalAxes:
    """The drive assumed where none is stated, as `controllers.servo.leg_servo`: [Sahbaz 2007, Table 7.4]."""
    return NominalAxes(30.0, 2 * np.pi * 30.0, 30e-3, 5.0, 0.0, np.inf, np.inf)  # type: ignore[arg-type]


def nominal(rig: Rig) -> NominalAxes:
    """The axes of a rig. It must be the rig as stated: what is tried on it, such as more inertia, a law cannot know."""
    drives, axes = rig.drives, rig.machine.axes

    def limit(name: str) -> Array:
        stated = [getattr(axis, name, None) for axis in axes]
        return np.array([np.inf if of is None else of / axis.pulse for of, axis in zip(stated, axes, strict=True)])

    return NominalAxes(
        position_gain=np.array([drive.position_gain for drive in drives]),
        speed_loop=2 * np.pi * np.array([drive.speed_loop for drive in drives]),
        integral_time=np.array([drive.integral_time for drive in drives]),
        friction=np.array([drive.friction / drive.inertia for drive in drives]),
        delay=np.array([getattr(drive, "delay", 0.0) for drive in drives]),
        max_speed=limit("max_speed"),
        max_acceleration=limit("max_acceleration"),
    )
