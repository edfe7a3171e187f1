"""A drive and its motor axis: position loop around a speed loop around an inertia, as data and as a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from kinematics.array import Array, frozen
from kinematics.axis import Axis
from kinematics.errors import MotionError


@dataclass(frozen=True, slots=True)
class Servo:
    """One servo axis in the coordinate of its output: metres and newtons, or radians and newton metres.

    Per sample of the drive, with x the motor's position, v its speed, x̂ the encoder's reading and r the position
    command of `command_delay` samples ago:

        speed error    ε = K (r − x̂) − v
        torque         τ = sat(J ω ε + I),  ω = 2π · speed loop; set `loop_delay` samples later
        integral       I ← I + (J ω / T) ε · sample, while τ does not saturate
        motor          J′ v̇ = τ − b v − c sign(v), τ held over the sample; at rest it sticks while |τ| ≤ c
        output         y ∈ [x − play/2, x + play/2]: it stays where it is until an end of the play pushes it

    Assumed of a drive whose documents print only its gains: the speed loop's gain is normalised by the inertia J that
    the drive is set to (the inertia ratio), whatever the true J′ = J · inertia_factor is; the speed is measured without
    quantization (an observer), at the motor; the integral stops while the torque saturates. Assumed of the play: it is
    kinematic. The output is held by friction, the motor feels the whole inertia all the time, and the gear does not
    twist. At the start the output stands in the middle of the play.

    position_gain  K, 1/s
    speed_loop     Hz;  integral_time  T, s
    torque_limit   N or N·m;  inertia  J, kg or kg·m², load included;  friction  b, viscous, N·s/m or N·m·s/rad
    encoder        counts per m or rad
    sample         s, period of the drive's loops
    coulomb        c, N or N·m
    play           m or rad between motor and output
    feedback       where the encoder sits: x̂ is the reading of x ("motor") or of y ("output")
    command_delay, loop_delay  samples
    """

    position_gain: float
    speed_loop: float
    integral_time: float
    torque_limit: float
    inertia: float
    friction: float
    encoder: float
    sample: float = 0.25e-3
    coulomb: float = 0.0
    play: float = 0.0
    feedback: Literal["motor", "output"] = "motor"
    command_delay: int = 0
    loop_delay: int = 0
    inertia_factor: float = 1.0

    def __post_init__(self) -> None:
        if self.feedback not in ("motor", "output"):
            raise MotionError(f'servo: feedback "{self.feedback}" is neither "motor" nor "output"')
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "feedback":
                continue
            if field.name.endswith("_delay") and value != int(value):
                raise MotionError(f"servo: {field.name} {value} must be a whole number of samples")
            lowest = 0.0 if field.name in _MAY_BE_ZERO else np.finfo(float).tiny
            if not lowest <= value < float("inf"):
                zero = ", ".join(_MAY_BE_ZERO)
                raise MotionError(f"servo: {field.name} {value} must be a positive finite number ({zero} may be zero)")


_MAY_BE_ZERO = ("friction", "coulomb", "play", "command_delay", "loop_delay")


def leg_servo(axis: Axis) -> Servo:
    """The servo assumed behind an axis that states none, normalised in the axis' coordinate.

    From [Sahbaz 2007, Table 7.4]: position loop 30 1/s (Pn102), speed loop 30 Hz (Pn100), integral 30 ms (Pn101,
    printed as 3000 in units of 0.01 ms), four encoder counts per command pulse (Pn202/Pn203, 2048 × 4 counts per
    revolution). Assumed: unit inertia (the loops are normalised by it, so it matters for saturation and friction
    alone), viscous friction of 5 1/s of it, and as torque limit the 220 N of the hexapod's actuator [Sahbaz 2007,
    Table 3.1]. The hexapod itself has stepper legs: this servo answers what it would do behind the drives of the
    thesis' other rig.
    """
    return Servo(
        position_gain=30.0,
        speed_loop=30.0,
        integral_time=30e-3,
        torque_limit=220.0,
        inertia=1.0,
        friction=5.0,
        encoder=4 / axis.pulse,
    )


@dataclass(frozen=True, slots=True)
class Drives:
    """Servo axes that share one sample time, discretised exactly for a torque held over the sample; arrays (B, n).

    x ← x + gx v + hx τ,  v ← gv v + hv τ.
    """

    sample: float
    position_gain: Array
    speed_gain: Array
    integral_gain: Array
    torque_limit: Array
    encoder: Array
    gx: Array
    hx: Array
    gv: Array
    hv: Array


@dataclass(frozen=True, slots=True)
class ServoState:
    """Position x, speed v and integral torque of the axes (B, n)."""

    x: Array
    v: Array
    integral: Array

    def __post_init__(self) -> None:
        for name in ("x", "v", "integral"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))


@dataclass(frozen=True, slots=True)
class Response:
    """What the axes did: position and torque (N, B, n) at the drive's samples, and the state after the last of them."""

    position: Array
    torque: Array
    state: ServoState


def drives(rigs: Sequence[Sequence[Servo]]) -> Drives:
    """The discrete model of B rigs of one servo per axis. Raises MotionError if their sample times differ.

    Of J v̇ = τ − b v over the sample h, with z = b h/J, φ₁ = (1 − e⁻ᶻ)/z and φ₂ = (1 − φ₁)/z (1 and ½ at z = 0):
    gv = e⁻ᶻ, hv = φ₁ h/J, gx = φ₁ h, hx = φ₂ h²/J.
    """
    periods = {servo.sample for servos in rigs for servo in servos}
    if len(periods) != 1:
        raise MotionError(f"servo axes: sample times {sorted(periods)} s differ; the drives of one machine share one")
    h = periods.pop()
    table = {
        field.name: np.array([[getattr(servo, field.name) for servo in servos] for servos in rigs])
        for field in fields(Servo)
    }
    inertia = table["inertia"]
    z = table["friction"] * h / inertia
    # below 1e-5 the series is exact to rounding, the quotients are not
    small, divisor = z < 1e-5, np.maximum(z, 1e-5)
    phi1 = np.where(small, 1 - z / 2 + z * z / 6, -np.expm1(-z) / divisor)
    phi2 = np.where(small, 0.5 - z / 6 + z * z / 24, (1 - phi1) / divisor)
    speed_gain = inertia * 2 * np.pi * table["speed_loop"]
    return Drives(
        sample=h,
        position_gain=frozen(table["position_gain"]),
        speed_gain=frozen(speed_gain),
        integral_gain=frozen(speed_gain / table["integral_time"] * h),
        torque_limit=frozen(table["torque_limit"]),
        encoder=frozen(table["encoder"]),
        gx=frozen(phi1 * h),
        hx=frozen(phi2 * h * h / inertia),
        gv=frozen(np.exp(-z)),
        hv=frozen(phi1 * h / inertia),
    )


def standing(x: Array) -> ServoState:
    """Axes at rest at positions x (B, n)."""
    return ServoState(x, np.zeros_like(x), np.zeros_like(x))


def measured(model: Drives, x: Array) -> Array:
    """The encoders' readings of positions x (…), in the coordinate: whole counts, within half a count of x."""
    return np.asarray(np.rint(x * model.encoder) / model.encoder)


def drive(model: Drives, state: ServoState, command: Array) -> Response:
    """What the axes do from `state` on, over N samples of the position command (N, B, n), m or rad."""
    x, v, integral = state.x, state.v, state.integral
    position, torque = np.empty_like(command), np.empty_like(command)
    for i, wanted in enumerate(command):
        error = model.position_gain * (wanted - measured(model, x)) - v
        asked = model.speed_gain * error + integral
        given = np.minimum(np.maximum(asked, -model.torque_limit), model.torque_limit)
        integral = integral + model.integral_gain * error * (asked == given)
        position[i], torque[i] = x, given
        x, v = x + model.gx * v + model.hx * given, model.gv * v + model.hv * given
    return Response(position, torque, ServoState(x, v, integral))
