"""The axes as the host knows them that commands them: the drives' data sheet, never the plant of
the day.

Their positions are a linear map of a command of straight-line speeds, exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from controllers.drives.servo import Servo
from controllers.drives.stepper import Stepper
from controllers.rig import Rig
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis

INF = float("inf")


@dataclass(frozen=True, slots=True)
class NominalAxes:
    """The axes of a rig as its maker states them, each (n,), or (1,) where all are alike.

    With c the card's command and x, v the axis' position and speed:
    v̇ = ω (K (c − x) − v) + i − β v − γ sign v,  i̇ = (ω/T) (K (c − x) − v),  ẋ = v, `delay` later;
                                                  the output stays
    behind x by half of `play`, whichever way it last went.

    position_gain     K, 1/s;  speed_loop  ω, rad/s;  integral_time  T, s
    friction          β, viscous friction by inertia, 1/s
    coulomb           γ, Coulomb friction by inertia, pulses/s²
    delay             s from a pulse of the card to the torque that it brings about
    play              pulses between an encoder at the motor and the output; 0 where the encoder is
                      at the output
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
            object.__setattr__(self, field.name, freeze_array(values))
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
    def from_key(key: tuple[tuple[float, ...], ...], n: int) -> NominalAxes:
        """The n axes of a `key`."""
        return NominalAxes(*(np.broadcast_to(numbers, n) for numbers in key))


_MAY_BE_ZERO = ("friction", "coulomb", "delay", "play")


def usual_axes() -> NominalAxes:
    """What a law by model assumes without a rig, as `controllers.drives.servo.leg_servo`: [Sahbaz
    2007, Table 7.4].
    """
    return NominalAxes(
        *np.array([[30.0], [2 * np.pi * 30.0], [30e-3], [5.0], [0.0], [0.0], [0.0], [INF], [INF]])
    )


def nominal_axes(rig: Rig) -> NominalAxes:
    """The axes of a rig.

    It must be the rig as stated: what is tried on it, such as more inertia, a law cannot know.

    A stepper's rotor stands where its pulses put it: it has no loops, whose gains are infinite
    then.
    """
    numbers = [
        _numbers(drive, axis) for drive, axis in zip(rig.drives, rig.machine.axes, strict=True)
    ]
    return NominalAxes(*np.array(numbers).T)


def _numbers(drive: Servo | Stepper, axis: Axis) -> tuple[float, ...]:
    top, rate = (
        INF if of is None else float(np.min(of)) / axis.pulse
        for of in (axis.max_speed, axis.max_acceleration)
    )
    play = drive.play / axis.pulse
    if isinstance(drive, Stepper):
        return (INF, INF, INF, 0.0, 0.0, 0.0, play, top, rate)
    delay = (drive.command_delay + drive.loop_delay) * drive.sample
    seen = play if drive.feedback == "motor" else 0.0
    loop, friction = 2 * np.pi * drive.speed_loop, drive.friction / drive.inertia
    coulomb = drive.coulomb / drive.inertia / axis.pulse
    return (
        drive.position_gain,
        loop,
        drive.integral_time,
        friction,
        coulomb,
        delay,
        seen,
        top,
        rate,
    )


STATE_SIZE = 4
"""Numbers of an axis' state: position x, speed v, integral i of the speed loop, command c."""


@dataclass(frozen=True, slots=True)
class Response:
    """One step of n axes from the state s = (x, v, i, c): s⁺ = F s + G w, and at m instants x = C s
    + D w.

    w = (v₀, v₁)·dt, pulses: the command's speeds at the step's start and end; c runs c₀ + (w₀ u +
    (w₁ − w₀) u²/2) over the share u of the step. The m instants divide the step, the last is its
    end.

    F (n, 4, 4)  G (n, 4, 2)  C (n, m, 4)  D (n, m, 2)
    """

    F: Array
    G: Array
    C: Array
    D: Array

    def extend(self, steps: int) -> tuple[Array, Array]:
        """The positions (n, steps·m) over several steps, O s + Γ w: O (n, steps·m, 4), Γ (n,
        steps·m, 2·steps).
        """
        n, m, _ = self.C.shape
        through = np.zeros((n, STATE_SIZE, STATE_SIZE + 2 * steps))
        through[:, :, :STATE_SIZE] = np.eye(STATE_SIZE)
        rows = np.zeros((n, steps * m, STATE_SIZE + 2 * steps))
        for k in range(steps):
            here, mine = (
                slice(k * m, (k + 1) * m),
                slice(STATE_SIZE + 2 * k, STATE_SIZE + 2 * k + 2),
            )
            rows[:, here] = self.C @ through
            rows[:, here, mine] += self.D
            through = self.F @ through
            through[:, :, mine] += self.G
        return freeze_array(rows[:, :, :STATE_SIZE]), freeze_array(rows[:, :, STATE_SIZE:])


def response(axes: NominalAxes, dt: float, instants: int) -> Response:
    """The exact response over a step of dt seconds: the exponential of `NominalAxes`' equations
    with c a quadratic.

    Without the axes' delay, which shifts all of it in time, and without Coulomb friction, see
    `friction_response`.
    """
    n = len(axes)
    # x, v, i, c and the command's speed and acceleration
    rates = np.zeros((n, 6, 6))
    rates[:, :STATE_SIZE, :STATE_SIZE] = _rates(axes)
    rates[:, 3, 4] = rates[:, 4, 5] = 1.0
    flow = _flow(rates, dt / instants, instants)[:, 1:]
    # command's speed w₀/dt, acceleration (w₁ − w₀)/dt²
    enter = np.array([[1 / dt, 0.0], [-1 / dt**2, 1 / dt**2]])
    held, driven = flow[..., :STATE_SIZE, :STATE_SIZE], flow[..., :STATE_SIZE, STATE_SIZE:] @ enter
    return Response(
        freeze_array(held[:, -1]),
        freeze_array(driven[:, -1]),
        freeze_array(held[:, :, 0]),
        freeze_array(driven[:, :, 0]),
    )


def friction_response(axes: NominalAxes, tick: float, count: int) -> Array:
    """x (n, count + 1) of axes at rest, every `tick` seconds after an outer torque of unit
    acceleration has set in.
    """
    n = len(axes)
    rates = np.zeros((n, STATE_SIZE + 1, STATE_SIZE + 1))
    rates[:, :STATE_SIZE, :STATE_SIZE] = _rates(axes)
    rates[:, 1, STATE_SIZE] = 1.0
    return freeze_array(_flow(rates, tick, count)[:, :, 0, STATE_SIZE])


def _rates(axes: NominalAxes) -> Array:
    """The derivative (n, 4, 4) of the state by itself."""
    n = len(axes)
    gain, loop, integral, friction = (
        np.broadcast_to(of, n)
        for of in (axes.position_gain, axes.speed_loop, axes.integral_time, axes.friction)
    )
    rates = np.zeros((n, STATE_SIZE, STATE_SIZE))
    rates[:, 0, 1] = rates[:, 1, 2] = 1.0
    for row, strength in ((1, loop), (2, loop / integral)):
        rates[:, row, 0], rates[:, row, 3] = -strength * gain, strength * gain
        rates[:, row, 1] = -strength
    rates[:, 1, 1] -= friction
    return rates


def _flow(rates: Array, tick: float, count: int) -> Array:
    """The exponentials (n, count + 1, ·, ·) of rates (n, ·, ·) over 0, 1, … ticks."""
    from scipy.linalg import expm

    one = expm(rates * tick)
    flow = np.empty((len(rates), count + 1, *one.shape[1:]))
    flow[:, 0] = np.eye(one.shape[1])
    for k in range(count):
        flow[:, k + 1] = one @ flow[:, k]
    return flow
