"""What the simulation asks of axes of one kind of drive, in lanes: runs by axes (B, n); and the rotor that all share.

A rotor is an inertia with viscous and Coulomb friction under a held torque, in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array


@dataclass(frozen=True, slots=True)
class AxesResponse:
    """What axes did, (K, B, n) at the samples kept: true position of the output, the encoder's reading of it or of the
    motor, speed of the motor, and torque."""

    position: Array
    reading: Array
    speed: Array
    torque: Array

    def __post_init__(self) -> None:
        for name in AxesResponse.__slots__:  # as they are: made for this, and large
            getattr(self, name).setflags(write=False)


class Axes(Protocol):
    """Axes of one kind of drive; what becomes of them is passed from call to call as a state of the kind's own."""

    @property
    def sample(self) -> float:
        """s, period of the drives."""

    def standing(self, x: Array) -> Any:
        """The state at rest at positions x (B, n)."""

    def reading(self, state: Any) -> Array:
        """(B, n) what the host reads of the encoders."""

    def run(self, state: Any, command: Array, kept: np.ndarray) -> tuple[AxesResponse, Any]:
        """Over N samples of the position command (N, B, n); of these, those at the indices `kept` are told of."""

    def count_lost_steps(self, state: Any) -> np.ndarray:
        """(B, n) int64 full steps lost until now."""


def read_encoder(encoder: Array, x: Array) -> Array:
    """The encoders' readings of positions x (…), in the coordinate: whole counts, within half a count of x."""
    return np.asarray(np.rint(x * encoder) / encoder)


def apply_play(output: Array, motor: Array, half_play: Array, part: Array) -> None:
    """The output behind its play, in place: it is pushed where the motor is half the play away. `part`: overwritten."""
    np.subtract(motor, half_play, out=part)
    np.maximum(output, part, out=output)
    np.add(motor, half_play, out=part)
    np.minimum(output, part, out=output)


def stack_values(name: str, drives: Any) -> Array:
    """One quantity of B rows of drives, (B, n)."""
    return freeze_array([[getattr(drive, name) for drive in row] for row in drives])


@dataclass(frozen=True, slots=True)
class Rotor:
    """J v̇ = τ − b v − c sign(v) in lanes (B, n), over a time h in which τ is held.

    While v keeps its sign, with u = τ − c sign(v):  x ← x + gx v + hx u,  v ← gv v + hv u.
    """

    h: float
    inertia: Array
    friction: Array
    coulomb: Array
    gx: Array
    hx: Array
    gv: Array
    hv: Array
    halt: Array
    """(B, n) 0 in lanes with Coulomb friction, whose speed may change its sign by way of rest only; −inf in others."""
    smooth: bool
    """No lane has any."""


def rotor(inertia: Array, friction: Array, coulomb: Array, h: float) -> Rotor:
    """With z = b h/J and φ₁, φ₂ of `_phi`: gv = e⁻ᶻ, hv = φ₁ h/J, gx = φ₁ h, hx = φ₂ h²/J."""
    z = friction * h / inertia
    phi1, phi2 = _phi(z)
    return Rotor(
        h=h,
        inertia=freeze_array(inertia),
        friction=freeze_array(friction),
        coulomb=freeze_array(coulomb),
        gx=freeze_array(phi1 * h),
        hx=freeze_array(phi2 * h * h / inertia),
        gv=freeze_array(np.exp(-z)),
        hv=freeze_array(phi1 * h / inertia),
        halt=freeze_array(np.where(coulomb > 0, 0.0, -np.inf)),
        smooth=not coulomb.any(),
    )


def advance(rotor: Rotor, x: Array, v: Array, torque: Array, work: Array) -> None:
    """x and v (B, n) a time h on under a torque (B, n), in place.

    A lane that stands, or comes to a stand within h, goes by way of rest: from there it moves on only if the torque
    exceeds the Coulomb friction, and it cannot stop again, since the torque is held.

    work  (4, B, n) whatever, overwritten
    """
    push, speed, way, part = work
    if rotor.smooth:
        push = torque
    else:
        np.copysign(rotor.coulomb, v, out=push)
        np.subtract(torque, push, out=push)
    np.multiply(rotor.gv, v, out=speed)
    np.multiply(rotor.hv, push, out=part)
    np.add(speed, part, out=speed)
    np.multiply(rotor.gx, v, out=way)
    np.multiply(rotor.hx, push, out=part)
    np.add(way, part, out=way)
    if not rotor.smooth:
        np.multiply(speed, v, out=part)
        halts = part <= rotor.halt
        if np.count_nonzero(halts):
            stops = np.flatnonzero(halts)
            lanes = [of.ravel()[stops] for of in (v, torque, rotor.inertia, rotor.friction, rotor.coulomb)]
            way.ravel()[stops], speed.ravel()[stops] = _step_through_rest(rotor.h, *lanes)
    np.add(x, way, out=x)
    v[...] = speed


MAX_BRAKING_TIME = 1e100
"""s: no braking takes as long."""


def _step_through_rest(
    h: float, v: Array, torque: Array, inertia: Array, friction: Array, coulomb: Array
) -> tuple[Array, Array]:
    """Way and speed (lanes,) after h, of lanes that stand or come to a stand within it.

    v = 0 is reached after t = log(1 + a w)/a with a = b/J and w = −v J/u, which is t = w without viscous friction.
    """
    push = torque - coulomb * np.sign(v)
    # what neither stands nor is braked came here by a product of speeds that is too small for a float: it stands
    braked = np.sign(push) * np.sign(v) < 0
    v = np.where(braked, v, 0.0)
    w = np.minimum(-v * inertia / np.where(braked, push, 1.0), MAX_BRAKING_TIME)
    a = friction / inertia
    # below 1e-9 the first two terms of the logarithm are exact to rounding
    aw = a * w
    t = np.where(aw < 1e-9, w * (1 - aw / 2), np.log1p(aw) / np.where(a > 0, a, 1.0))
    t = np.minimum(t, h)
    phi1, phi2 = _phi(a * t)
    way = phi1 * t * v + phi2 * t * t * push / inertia
    beyond = np.where(np.abs(torque) > coulomb, torque - coulomb * np.sign(torque), 0.0) / inertia
    left = h - t
    phi1, phi2 = _phi(a * left)
    return way + phi2 * left * left * beyond, phi1 * left * beyond


def _phi(z: Array) -> tuple[Array, Array]:
    """φ₁ = (1 − e⁻ᶻ)/z and φ₂ = (1 − φ₁)/z: 1 and ½ at z = 0."""
    # below 1e-5 the series is exact to rounding, the quotients are not
    small, divisor = z < 1e-5, np.maximum(z, 1e-5)
    phi1 = np.where(small, 1 - z / 2 + z * z / 6, -np.expm1(-z) / divisor)
    return phi1, np.where(small, 0.5 - z / 6 + z * z / 24, (1 - phi1) / divisor)
