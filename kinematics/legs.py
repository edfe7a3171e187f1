"""Machines with legs: actuators of variable length between joints on a base and joints on a platform."""

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array, frozen
from kinematics.axis import Axis
from kinematics.body import Body
from kinematics.clearance import Bodies, Disc
from kinematics.errors import MotionError
from kinematics.leg_frames import home_frames, leg_rotation
from kinematics.load import Load
from kinematics.machine import Machine
from kinematics.pose import Pose, column


class Legged(Machine):
    """q_i = ‖p + R a_i − b_i‖, the distance between joint centres b_i (base frame) and a_i (platform frame).

    base, platform            (n, 3) joint centres, m
    base_rest, platform_rest  (3,) or (n, 3) rest axis of each joint in its own frame, +z by default
    max_tilt                  rad between leg and rest axis: one number, or (base, platform); None: unlimited
    leg_radius, leg_ends, base_disc, platform_disc  what takes up room, as in `Bodies`; None: nothing is looked at
    """

    def __init__(
        self,
        base: ArrayLike,
        platform: ArrayLike,
        *,
        axes: Sequence[Axis],
        home: Pose,
        base_rest: ArrayLike | None = None,
        platform_rest: ArrayLike | None = None,
        max_tilt: float | tuple[float | None, float | None] | None = None,
        name: str | None = None,
        leg_radius: float | None = None,
        leg_ends: float | None = None,
        base_disc: Disc | None = None,
        platform_disc: Disc | None = None,
        load: Load | None = None,
    ) -> None:
        kind, count = type(self).__name__.lower(), self.legs
        name = kind if name is None else name
        self.base, self.platform = _points(name, "base", base, count), _points(name, "platform", platform, count)
        if len(axes) != count:
            raise MotionError(f"machine {name}: {len(axes)} axes; a {kind} has {count}")
        self.base_rest = _directions(name, "base_rest", base_rest, count)
        self.platform_rest = _directions(name, "platform_rest", platform_rest, count)
        self.tilt_names = tuple(f"{axis.name} {end} joint" for end in ("base", "platform") for axis in axes)
        self.max_tilt = _tilts(name, max_tilt, count)
        self.characteristic_length = float(np.sqrt((self.platform**2).sum(1).mean()))
        super().__init__(name, axes, home, load=load)
        if leg_radius is not None:
            legs = tuple(axis.name for axis in axes)
            self.bodies = Bodies(self.base, self.platform, legs, leg_radius, leg_ends, base_disc, platform_disc)
        elif leg_ends is not None or base_disc or platform_disc:
            raise MotionError(f"machine {name}: leg_ends and discs say nothing without leg_radius; state it")

    def _legs(self, position: ca.SX, rotation: ca.SX) -> list[ca.SX]:
        """The six vectors from base joint to platform joint, in the base frame."""
        return [position + rotation @ a - b for a, b in zip(self.platform, self.base, strict=True)]

    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        return ca.vertcat(*(ca.norm_2(leg) for leg in self._legs(position, rotation)))

    def moved(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> tuple[tuple[Body, ca.SX], ...]:
        """The platform, and barrel and rod of every leg that has masses."""
        found = list(super().moved(position, rotation, q))
        stated = self.load.legs * (self.legs if len(self.load.legs) == 1 else 1)
        if stated:
            ends = home_frames(self, stated)
            for leg, vector, base, frame in zip(stated, self._legs(position, rotation), self.base, ends, strict=True):
                turned = leg_rotation(vector, frame[:, 0])
                found += [(leg.barrel, column(ca.SX(ca.DM(base)), turned)), (leg.rod, column(vector + base, turned))]
        return tuple(found)

    def tilts(self, position: ca.SX, rotation: ca.SX) -> ca.SX:
        """cos of the angle between leg and rest axis: base joints first, then platform joints, each in its frame."""
        legs = self._legs(position, rotation)
        base = [ca.dot(leg, rest) for leg, rest in zip(legs, self.base_rest, strict=True)]
        platform = [ca.dot(leg, rotation @ rest) for leg, rest in zip(legs, self.platform_rest, strict=True)]
        lengths = [ca.norm_2(leg) for leg in legs]
        return ca.vertcat(*(d / n for d, n in zip(base + platform, lengths + lengths, strict=True)))


def _points(machine: str, what: str, values: ArrayLike, count: int) -> Array:
    points = np.asarray(values, float)
    if points.shape != (count, 3) or not np.isfinite(points).all():
        raise MotionError(
            f"machine {machine}: {what} must be {count} finite points ({count}, 3) in m, not {_outline(points)}"
        )
    return frozen(points)


def _directions(machine: str, what: str, values: ArrayLike | None, count: int) -> Array:
    rest = np.asarray([0.0, 0.0, 1.0] if values is None else values, float)
    if rest.shape not in ((3,), (count, 3)) or not np.isfinite(rest).all() or not rest.any(-1).all():
        raise MotionError(
            f"machine {machine}: {what} must be one direction (3,), or one for each of {count} legs, "
            f"finite and not zero, not {_outline(rest)}"
        )
    return frozen(np.broadcast_to(rest / np.linalg.norm(rest, axis=-1, keepdims=True), (count, 3)))


def _tilts(machine: str, limit: float | tuple[float | None, float | None] | None, count: int) -> Array:
    """(2n,) rad: n base joints, n platform joints; no joint can turn further than π."""
    ends = limit if isinstance(limit, tuple) else (limit, limit)
    angles = [np.pi if end is None else end for end in ends]
    if len(angles) != 2 or not all(0 < angle <= np.pi for angle in angles):
        raise MotionError(
            f"machine {machine}: max_tilt {limit} must be one angle or (base, platform), "
            "each above 0 and at most π rad (or None: unlimited)"
        )
    return frozen(np.repeat(angles, count))


def _outline(array: Array) -> str:
    """What was given instead: its shape, and the values where they are few."""
    return f"shape {array.shape}{f': {array.tolist()}' if array.size <= 18 else ''}"
