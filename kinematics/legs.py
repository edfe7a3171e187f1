"""Machines with legs: actuators of variable length between joints on a base and joints on a platform."""

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import POSITIVE, Array, finite, frozen, unit_vectors
from kinematics.axis import Axis
from kinematics.body import Body
from kinematics.clearance import Bodies, Disc
from kinematics.errors import BadValue, MotionError
from kinematics.freedom import scaled_jacobian
from kinematics.leg_frames import home_frames, leg_rotation
from kinematics.load import Load
from kinematics.machine import Machine
from kinematics.pose import Pose, column, numbers
from kinematics.skeleton import Bar, Pivot, Skeleton, ring

# Share of the machine's size up to which joint centres are the same point: the rounding of computed geometry.
SAME = 1e-9
# Conditioning up to which home is singular: what rounding makes of 0, and far below anything that could move.
SINGULAR = 1e-10


class Legged(Machine):
    """q_i = ‖p + R a_i − b_i‖, the distance between joint centres b_i (base frame) and a_i (platform frame).

    base, platform            (n, 3) joint centres, m
    base_rest, platform_rest  (3,) or (n, 3) rest axis of each joint in its own frame, +z by default
    max_tilt                  rad between leg and rest axis: one number, or (base, platform); None: unlimited
    leg_radius, leg_ends, base_disc, platform_disc  what takes up room, as in `Bodies`; None: nothing is looked at

    Raises MotionError where joints coincide so that legs do nothing or the same, and for a singular home. Whether
    home is within travel and tilt is told by `check`, as of any pose: it may be a switch beyond the working range.
    """

    legs: ClassVar[int]
    lengths = True

    def __init__(
        self,
        base: ArrayLike,
        platform: ArrayLike,
        *,
        axes: Iterable[Axis],
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
        name, count = type(self).__name__.lower() if name is None else name, self.legs
        self.base, self.platform = joints(name, "base", base, count), joints(name, "platform", platform, count)
        self.base_rest = _directions(name, "base_rest", base_rest, count)
        self.platform_rest = _directions(name, "platform_rest", platform_rest, count)
        self.max_tilt = _tilts(name, max_tilt, count)
        self.characteristic_length = float(np.sqrt((self.platform**2).sum(1).mean()))
        super().__init__(name, axes, home, load=load)
        legs = tuple(axis.name for axis in self.axes)
        self.tilt_names = tuple(f"{leg} {end} joint" for end in ("base", "platform") for leg in legs)
        _refuse_coincident(self, legs)
        shapes = {"leg_ends": leg_ends, "base_disc": base_disc, "platform_disc": platform_disc}
        if leg_radius is not None:
            self.bodies = Bodies(self.base, self.platform, legs, leg_radius, leg_ends, base_disc, platform_disc)
        elif any(given is not None for given in shapes.values()):
            first = next(k for k, given in shapes.items() if given is not None)
            told = f"machine {name}: {first} says nothing without leg_radius; state it"
            raise BadValue(told, key=(first,))

    def _legs(self, position: ca.SX, rotation: ca.SX) -> list[ca.SX]:
        """The vectors from base joint to platform joint, in the base frame."""
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

    def skeleton(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> Skeleton:
        """Legs between the rings of their joints, and the way from the platform's middle to its origin."""
        base = [ca.SX(ca.DM(b)) for b in self.base]
        top = [b + leg for b, leg in zip(base, self._legs(position, rotation), strict=True)]
        legs = [Bar("actuator", a, b, axis.name) for a, b, axis in zip(base, top, self.axes, strict=True)]
        frame = [Bar("frame", base[i], base[j]) for i, j in ring(self.base)]
        platform = [Bar("platform", top[i], top[j]) for i, j in ring(self.platform)]
        middle = position + rotation @ ca.DM(self.platform.mean(0))
        pivots = (Pivot(at, name) for at, name in zip(base + top, self.tilt_names, strict=True))
        return Skeleton((*legs, *frame, *platform, Bar("platform", middle, position)), tuple(pivots))

    def tilts(self, position: ca.SX, rotation: ca.SX) -> ca.SX:
        """cos of the angle between leg and rest axis: base joints first, then platform joints, each in its frame."""
        legs = self._legs(position, rotation)
        base = [ca.dot(leg, rest) for leg, rest in zip(legs, self.base_rest, strict=True)]
        platform = [ca.dot(leg, rotation @ rest) for leg, rest in zip(legs, self.platform_rest, strict=True)]
        lengths = [ca.norm_2(leg) for leg in legs]
        return ca.vertcat(*(d / n for d, n in zip(base + platform, lengths + lengths, strict=True)))


def joints(machine: str, what: str, values: ArrayLike, count: int) -> Array:
    """Joint centres (n, 3) that a caller gives."""
    return frozen(finite(values, f"machine {machine}: {what}", (count, 3), unit="m"))


def _directions(machine: str, what: str, values: ArrayLike | None, count: int) -> Array:
    """(n, 3) unit vectors."""
    given = [0.0, 0.0, 1.0] if values is None else values
    rest = unit_vectors(given, f"machine {machine}: {what}", (3,), (count, 3))
    return frozen(np.broadcast_to(rest, (count, 3)))


def _tilts(machine: str, limit: object, count: int) -> Array:
    """(2n,) rad: n base joints, n platform joints; no joint can turn further than π."""
    given = limit.tolist() if isinstance(limit, np.ndarray) else limit
    ends = tuple(given) if isinstance(given, (tuple, list)) else (given, given)
    if len(ends) != 2:
        raise MotionError(f"machine {machine}: max_tilt {limit} must be one angle or (base, platform), rad")
    what = f"machine {machine}: max_tilt (None: unlimited)"
    angles = [finite(np.pi if e is None else e, what, (), unit="rad", least=POSITIVE, most=np.pi) for e in ends]
    return frozen(np.repeat(angles, count))


def _refuse_coincident(machine: Legged, legs: Sequence[str]) -> None:
    """Raise MotionError, naming them, for legs that hold nothing of their own at home."""
    told, ends = f"machine {machine.name}:", {"base": machine.base, "platform": machine.platform}
    same = SAME * max(np.ptp(points, 0).max() for points in ends.values())
    for end, points in ends.items():
        if np.ptp(points, 0).max() <= same:
            raise MotionError(f"{told} all {end} joints are the same point, {points[0] * 1e3} mm; put them apart")
    for i, j in combinations(range(len(legs)), 2):
        if max(np.abs(points[i] - points[j]).max() for points in ends.values()) <= same:
            raise MotionError(f"{told} {legs[i]} and {legs[j]} coincide, at base and platform; put their joints apart")
    for leg, length in zip(legs, machine.home_q, strict=True):
        if length <= same:
            raise MotionError(f"{told} {leg} has no length at home: its joints are the same point; choose another home")
    left, stretch, _ = np.linalg.svd(scaled_jacobian(machine, numbers(machine.home), machine.home_q)[0])
    if stretch[-1] <= SINGULAR * stretch[0]:
        # the rates of legs that no motion of the platform has
        share = np.abs(left[:, stretch <= SINGULAR * stretch[0]]).max(1)
        idle = ", ".join(leg for leg, part in zip(legs, share, strict=True) if part > np.sqrt(SINGULAR))
        raise BadValue(
            f"{told} home is singular (conditioning {stretch[-1] / stretch[0]:.1g}): {idle} together leave a motion of "
            "the platform free; put their joints elsewhere, or choose another home",
            key=("home",),
        )
