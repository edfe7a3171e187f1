"""What the simulation asks of axes of one kind of drive, in lanes: runs by axes (B, n); and the
rotor that all share.

A rotor is an inertia with viscous and Coulomb friction under a held torque, in closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.kernels import FixedStrided1, kernel


@dataclass(frozen=True, slots=True)
class AxesResponse:
    """What axes did, (K, B, n) at the samples kept: true position of the output, the encoder's
    reading of it or of the motor, speed of the motor, and torque.
    """

    position: Array
    reading: Array
    speed: Array
    torque: Array

    def __post_init__(self) -> None:
        for name in AxesResponse.__slots__:  # as they are: made for this, and large
            getattr(self, name).setflags(write=False)


class Axes(Protocol):
    """Axes of one kind of drive; what becomes of them is passed from call to call as a state of the
    kind's own.
    """

    @property
    def sample(self) -> float:
        """s, period of the drives."""

    def standing(self, x: Array) -> Any:
        """The state at rest at positions x (B, n)."""

    def reading(self, state: Any) -> Array:
        """(B, n) what the host reads of the encoders."""

    def run(self, state: Any, command: Array, kept: np.ndarray) -> tuple[AxesResponse, Any]:
        """Over N samples of the position command (N, B, n); of these, those at the indices `kept`
        are told of.
        """

    def count_lost_steps(self, state: Any) -> np.ndarray:
        """(B, n) int64 full steps lost until now."""


def read_encoder(encoder: Array, x: Array) -> Array:
    """The encoders' readings of positions x (…), in the coordinate: whole counts, within half a
    count of x.
    """
    return np.asarray(np.rint(x * encoder) / encoder)


@kernel
def apply_play(output: float, motor: float, half_play: float) -> float:
    """Where the output is behind its play: it is pushed where the motor is half the play away."""
    return min(max(output, motor - half_play), motor + half_play)


def stack_values(name: str, drives: Any) -> Array:
    """One quantity of B rows of drives, (B, n)."""
    return freeze_array([[getattr(drive, name) for drive in row] for row in drives])


@dataclass(frozen=True, slots=True)
class Rotor:
    """J v̇ = τ − b v − c sign(v) in lanes, over a time h in which τ is held.

    While v keeps its sign, with u = τ − c sign(v):  x ← x + gx v + hx u,  v ← gv v + hv u.

    lanes  (7, B, n): J, b, c, gx, hx, gv, hv
    """

    h: float
    lanes: Array


def rotor(inertia: Array, friction: Array, coulomb: Array, h: float) -> Rotor:
    """With z = b h/J and φ₁, φ₂ of `_phi`: gv = e⁻ᶻ, hv = φ₁ h/J, gx = φ₁ h, hx = φ₂ h²/J."""
    z = friction * h / inertia
    phi1, phi2 = np.array([_phi(one) for one in z.ravel().tolist()]).T.reshape(2, *z.shape)
    gains = phi1 * h, phi2 * h * h / inertia, np.exp(-z), phi1 * h / inertia
    return Rotor(h, freeze_array([inertia, friction, coulomb, *gains]))


@kernel
def advance(
    h: float, rotor: FixedStrided1, x: float, v: float, torque: float
) -> tuple[float, float]:
    """x and v of one lane, whose rotor is (7,), a time h on under a torque.

    A lane that stands, or comes to a stand within h, goes by way of rest: from there it moves on
    only if the torque exceeds the Coulomb friction, and it cannot stop again, since the torque is
    held. Without Coulomb friction its speed may change its sign on the way.
    """
    inertia, friction, coulomb, gx, hx, gv, hv = rotor
    push = torque - math.copysign(coulomb, v)
    speed = gv * v + hv * push
    if coulomb > 0 and speed * v <= 0:
        way, speed = _step_through_rest(h, v, torque, inertia, friction, coulomb)
        return x + way, speed
    return x + (gx * v + hx * push), speed


MAX_BRAKING_TIME = 1e100
"""s: no braking takes as long."""


@kernel
def _step_through_rest(
    h: float, v: float, torque: float, inertia: float, friction: float, coulomb: float
) -> tuple[float, float]:
    """Way and speed after h, of a lane that stands or comes to a stand within it.

    v = 0 is reached after t = log(1 + a w)/a with a = b/J and w = −v J/u, which is t = w without
    viscous friction.
    """
    a = friction / inertia
    t = way = 0.0
    push = torque - math.copysign(coulomb, v)
    # what neither stands nor is braked came here by a product of speeds that is too small for a
    # float: it stands
    if push != 0 and v != 0 and (push > 0) != (v > 0):
        w = min(-v * inertia / push, MAX_BRAKING_TIME)
        # below 1e-9 the first two terms of the logarithm are exact to rounding
        t = min(w * (1 - a * w / 2) if a * w < 1e-9 else math.log1p(a * w) / a, h)
        phi1, phi2 = _phi(a * t)
        way = phi1 * t * v + phi2 * t * t * push / inertia
    if abs(torque) <= coulomb:
        return way, 0.0
    beyond = (torque - math.copysign(coulomb, torque)) / inertia
    left = h - t
    phi1, phi2 = _phi(a * left)
    return way + phi2 * left * left * beyond, phi1 * left * beyond


@kernel
def _phi(z: float) -> tuple[float, float]:
    """φ₁ = (1 − e⁻ᶻ)/z and φ₂ = (1 − φ₁)/z: 1 and ½ at z = 0."""
    if z < 1e-5:  # the series is exact to rounding, the quotients are not
        return 1 - z / 2 + z * z / 6, 0.5 - z / 6 + z * z / 24
    phi1 = -math.expm1(-z) / z
    return phi1, (1 - phi1) / z
