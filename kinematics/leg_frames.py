"""How a leg is turned: the frame of its universal joint on the base, at home and along any leg vector."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from kinematics.array import Array
from kinematics.body import Leg
from kinematics.errors import MotionError

if TYPE_CHECKING:
    from kinematics.legs import Legged

# Sine of the angle between a universal joint's first axis and the leg at home below which it cannot tilt the leg.
ALONG = 1e-6


def home_frames(machine: Legged, legs: Sequence[Leg]) -> Array:
    """(n, 3, 3) per leg at home: columns x, the universal joint's first axis; y, its second; z, along the leg."""
    along = machine.home.apply(machine.platform) - machine.base
    frames = []
    for axis, leg, z in zip(machine.axes, legs, along / np.linalg.norm(along, axis=1, keepdims=True), strict=True):
        first = np.eye(3)[np.argmin(np.abs(z))] if leg.first_axis is None else np.asarray(leg.first_axis, float)
        x = first / np.linalg.norm(first)
        x = x - (x @ z) * z
        if np.linalg.norm(x) < ALONG:
            raise MotionError(
                f"machine {machine.name}: the first axis of {axis.name}'s universal joint lies along the leg at home; "
                "the joint could not tilt it there"
            )
        x /= np.linalg.norm(x)
        frames.append(np.stack([x, np.cross(z, x), z], 1))
    return np.array(frames)


def leg_rotation(vector: ca.SX, first_axis: Array) -> ca.SX:
    """(3, 3) columns x, y, z of a leg along `vector`: y is the joint's second axis, z × first axis."""
    z = vector / ca.norm_2(vector)
    y = ca.cross(z, ca.DM(first_axis))
    y = y / ca.norm_2(y)
    turned: ca.SX = ca.horzcat(ca.cross(y, z), y, z)
    return turned
