"""What the host knows of the axes that it commands: the drives' data sheet, never the plant of the day."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from controllers.rig import Rig
from controllers.servo import Servo
from controllers.stepper import Stepper
from kinematics.array import Array, frozen
from kinematics.axis import Axis
from kinematics.errors import MotionError

INF = float("inf")


@dataclass(frozen=True, slots=True)
class NominalAxes:
    """The axes of a rig as its maker states them, each (n,), or (1,) where all are alike.

    With c the card's command and x, v the axis' position and speed:
    v̇ = ω (K (c − x) − v) + i − β v − γ sign v,  i̇ = (ω/T) (K (c − x) − v),  ẋ = v, `delay` later; the output stays
    behind x by half of `play`, whichever way it last went.

    position_gain     K, 1/s;  speed_loop  ω, rad/s;  integral_time  T, s
    friction          β, viscous friction by inertia, 1/s
    coulomb           γ, Coulomb friction by inertia, pulses/s²
    delay             s from a pulse of the card to the torque that it brings about
    play              pulses between an encoder at the motor and the output; 0 where the encoder is at the output
    max_speed         pulses/s;  max_acceleration  pulses/s²; infinite where the machine states none
    """

    position_gain: Array
    speed_loop: Array
    integral_time: Array
    friction: Array
    coulomb: Array
    delay: Array
    play: Array
    max_speed: Array
    max_acceleration: Array

    def __post_init__(self) -> None:
        for field in fields(self):
            values = np.atleast_1d(np.asarray(getattr(self, field.name), float))
            object.__setattr__(self, field.name, frozen(values))
            lowest = 0.0 if field.name in _MAY_BE_ZERO else np.finfo(float).tiny
            if not np.all(values >= lowest):
                raise MotionError(
                    f"nominal axes: {field.name} {values.min():g} must be a positive number "
                    f"({', '.join(_MAY_BE_ZERO)} may be zero)"
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


_MAY_BE_ZERO = ("friction", "coulomb", "delay", "play")


def usual() -> NominalAxes:
    """What a law by model assumes without a rig, as `controllers.servo.leg_servo`: [Sahbaz 2007, Table 7.4]."""
    return NominalAxes(*np.array([[30.0], [2 * np.pi * 30.0], [30e-3], [5.0], [0.0], [0.0], [0.0], [INF], [INF]]))


def nominal(rig: Rig) -> NominalAxes:
    """The axes of a rig. It must be the rig as stated: what is tried on it, such as more inertia, a law cannot know.

    A stepper's rotor stands where its pulses put it: it has no loops, whose gains are infinite then.
    """
    numbers = [_numbers(drive, axis) for drive, axis in zip(rig.drives, rig.machine.axes, strict=True)]
    return NominalAxes(*np.array(numbers).T)


def _numbers(drive: Servo | Stepper, axis: Axis) -> tuple[float, ...]:
    top, rate = (
        INF if of is None else float(np.min(of)) / axis.pulse for of in (axis.max_speed, axis.max_acceleration)
    )
    play = drive.play / axis.pulse
    if isinstance(drive, Stepper):
        return (INF, INF, INF, 0.0, 0.0, 0.0, play, top, rate)
    delay = (drive.command_delay + drive.loop_delay) * drive.sample
    seen = play if drive.feedback == "motor" else 0.0
    loop, friction = 2 * np.pi * drive.speed_loop, drive.friction / drive.inertia
    coulomb = drive.coulomb / drive.inertia / axis.pulse
    return (drive.position_gain, loop, drive.integral_time, friction, coulomb, delay, seen, top, rate)
