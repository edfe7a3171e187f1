"""Machines with legs: actuators of variable length between joints on a base and joints on a
platform.

How a leg is turned is told by the frame of its universal joint on the base, at home and along any
leg vector. The tables of their files that all of them share: rest axes, tilt, bodies.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from math import pi
from typing import Annotated, Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.analysis.clearance import Bodies, Disc
from kinematics.files.keys import Chosen, key
from kinematics.files.schema import Direction, TableSchema
from kinematics.foundation.arrays import (
    LEAST_POSITIVE,
    Array,
    finite_array,
    freeze_array,
    unit_vectors,
)
from kinematics.foundation.errors import BadValue, MotionError
from kinematics.foundation.units import Unit
from kinematics.kinds.load_keys import HOME, HomeTable, Point, home_entries
from kinematics.machine.axis import Axis
from kinematics.machine.kind import Bar, Pivot, Skeleton, ring
from kinematics.machine.load import Body, Leg, Load
from kinematics.machine.machine import Machine
from kinematics.machine.model import scaled_jacobian
from kinematics.machine.pose import PoseLike, column, make_pose

# Sine of the angle between a universal joint's first axis and the leg at home below which it cannot
# tilt the leg.
MIN_AXIS_SINE = 1e-6


def home_frames(machine: Legged, legs: Sequence[Leg]) -> Array:
    """(n, 3, 3) per leg at home: columns x, the universal joint's first axis; y, its second; z,
    along the leg.
    """
    along = machine.home.apply(machine.platform) - machine.base
    frames = []
    for axis, leg, z in zip(
        machine.axes, legs, along / np.linalg.norm(along, axis=1, keepdims=True), strict=True
    ):
        first = (
            np.eye(3)[np.argmin(np.abs(z))]
            if leg.first_axis is None
            else np.asarray(leg.first_axis, float)
        )
        x = first / np.linalg.norm(first)
        x = x - (x @ z) * z
        if np.linalg.norm(x) < MIN_AXIS_SINE:
            raise MotionError(
                f"machine {machine.name}: the first axis of {axis.name}'s universal joint lies along the leg at home; "
                "the joint could not tilt it there"
            )
        x /= np.linalg.norm(x)
        frames.append(np.stack([x, np.cross(z, x), z], 1))
    return np.array(frames)


def leg_rotation(vector: ca.SX, first_axis: Array) -> ca.SX:
    """(3, 3) columns x, y, z of a leg along `vector`: y is the joint's second axis, z × first
    axis.
    """
    z = vector / ca.norm_2(vector)
    y = ca.cross(z, ca.DM(first_axis))
    y = y / ca.norm_2(y)
    turned: ca.SX = ca.horzcat(ca.cross(y, z), y, z)
    return turned


# Share of the machine's size up to which joint centres are the same point: the rounding of computed
# geometry.
SAME_POINT_SHARE = 1e-9
# Conditioning up to which home is singular: what rounding makes of 0, and far below anything that
# could move.
SINGULAR_CONDITIONING = 1e-10


class Legged(Machine):
    """q_i = ‖p + R a_i − b_i‖, the distance between joint centres b_i (base frame) and a_i
    (platform frame).

    base, platform            (n, 3) joint centres, m
    base_rest, platform_rest  (3,) or (n, 3) rest axis of each joint in its own frame, +z by default
    max_tilt                  rad between leg and rest axis: one number, or (base, platform); None:
                              unlimited
    leg_radius, leg_ends, base_disc, platform_disc  what takes up room, as in `Bodies`; None:
                                                    nothing is looked at

    Raises MotionError where joints coincide so that legs do nothing or the same, and for a singular
    home. Whether home is within travel and tilt is told by `check`, as of any pose: it may be a
    switch beyond the working range.
    """

    legs: ClassVar[int]
    lengths = True

    def __init__(
        self,
        base: ArrayLike,
        platform: ArrayLike,
        *,
        axes: Iterable[Axis],
        home: PoseLike,
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
        self.base, self.platform = (
            joints(name, "base", base, count),
            joints(name, "platform", platform, count),
        )
        self.base_rest = _directions(name, "base_rest", base_rest, count)
        self.platform_rest = _directions(name, "platform_rest", platform_rest, count)
        self.max_tilt = _tilts(name, max_tilt, count)
        self.characteristic_length = float(np.sqrt((self.platform**2).sum(1).mean()))
        super().__init__(name, axes, home, load=load)
        legs = tuple(axis.name for axis in self.axes)
        self.tilt_names = tuple(
            f"{leg} {end} joint" for end in ("base", "platform") for leg in legs
        )
        _refuse_coincident(self, legs)
        shapes = {"leg_ends": leg_ends, "base_disc": base_disc, "platform_disc": platform_disc}
        if leg_radius is not None:
            self.bodies = Bodies(
                self.base, self.platform, legs, leg_radius, leg_ends, base_disc, platform_disc
            )
        elif any(given is not None for given in shapes.values()):
            first = next(k for k, given in shapes.items() if given is not None)
            told = f"machine {name}: {first} says nothing without leg_radius; state it"
            raise BadValue(told, key=(first,))

    def _legs(self, position: ca.SX, rotation: ca.SX) -> list[ca.SX]:
        """The vectors from base joint to platform joint, in the base frame."""
        return [position + rotation @ a - b for a, b in zip(self.platform, self.base, strict=True)]

    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        return ca.vertcat(*(ca.norm_2(leg) for leg in self._legs(position, rotation)))

    def moving_bodies(
        self, position: ca.SX, rotation: ca.SX, q: ca.SX
    ) -> tuple[tuple[Body, ca.SX], ...]:
        """The platform, and barrel and rod of every leg that has masses."""
        found = list(super().moving_bodies(position, rotation, q))
        stated = self.load.legs * (self.legs if len(self.load.legs) == 1 else 1)
        if stated:
            ends = home_frames(self, stated)
            for leg, vector, base, frame in zip(
                stated, self._legs(position, rotation), self.base, ends, strict=True
            ):
                turned = leg_rotation(vector, frame[:, 0])
                found += [
                    (leg.barrel, column(ca.SX(ca.DM(base)), turned)),
                    (leg.rod, column(vector + base, turned)),
                ]
        return tuple(found)

    def skeleton(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> Skeleton:
        """Legs between the rings of their joints, and the way from the platform's middle to its
        origin.
        """
        base = [ca.SX(ca.DM(b)) for b in self.base]
        top = [b + leg for b, leg in zip(base, self._legs(position, rotation), strict=True)]
        legs = [
            Bar("actuator", a, b, axis.name)
            for a, b, axis in zip(base, top, self.axes, strict=True)
        ]
        frame = [Bar("frame", base[i], base[j]) for i, j in ring(self.base)]
        platform = [Bar("platform", top[i], top[j]) for i, j in ring(self.platform)]
        middle = position + rotation @ ca.DM(self.platform.mean(0))
        pivots = (Pivot(at, name) for at, name in zip(base + top, self.tilt_names, strict=True))
        return Skeleton(
            (*legs, *frame, *platform, Bar("platform", middle, position)), tuple(pivots)
        )

    def tilts(self, position: ca.SX, rotation: ca.SX) -> ca.SX:
        """cos of the angle between leg and rest axis: base joints first, then platform joints, each
        in its frame.
        """
        legs = self._legs(position, rotation)
        base = [ca.dot(leg, rest) for leg, rest in zip(legs, self.base_rest, strict=True)]
        platform = [
            ca.dot(leg, rotation @ rest) for leg, rest in zip(legs, self.platform_rest, strict=True)
        ]
        lengths = [ca.norm_2(leg) for leg in legs]
        return ca.vertcat(*(d / n for d, n in zip(base + platform, lengths + lengths, strict=True)))


def joints(machine: str, what: str, values: ArrayLike, count: int) -> Array:
    """Joint centres (n, 3) that a caller gives."""
    return freeze_array(finite_array(values, f"machine {machine}: {what}", (count, 3), unit="m"))


def _directions(machine: str, what: str, values: ArrayLike | None, count: int) -> Array:
    """(n, 3) unit vectors."""
    given = [0.0, 0.0, 1.0] if values is None else values
    rest = unit_vectors(given, f"machine {machine}: {what}", (3,), (count, 3))
    return freeze_array(np.broadcast_to(rest, (count, 3)))


def _tilts(machine: str, limit: object, count: int) -> Array:
    """(2n,) rad: n base joints, n platform joints; no joint can turn further than π."""
    given = limit.tolist() if isinstance(limit, np.ndarray) else limit
    ends = tuple(given) if isinstance(given, (tuple, list)) else (given, given)
    if len(ends) != 2:
        raise MotionError(
            f"machine {machine}: max_tilt {limit} must be one angle or (base, platform), rad"
        )
    what = f"machine {machine}: max_tilt (None: unlimited)"
    angles = [
        finite_array(
            np.pi if e is None else e, what, (), unit="rad", least=LEAST_POSITIVE, most=np.pi
        )
        for e in ends
    ]
    return freeze_array(np.repeat(angles, count))


def _refuse_coincident(machine: Legged, legs: Sequence[str]) -> None:
    """Raise MotionError, naming them, for legs that hold nothing of their own at home."""
    told, ends = f"machine {machine.name}:", {"base": machine.base, "platform": machine.platform}
    same = SAME_POINT_SHARE * max(np.ptp(points, 0).max() for points in ends.values())
    for end, points in ends.items():
        if np.ptp(points, 0).max() <= same:
            raise MotionError(
                f"{told} all {end} joints are the same point, {points[0] * 1e3} mm; put them apart"
            )
    for i, j in combinations(range(len(legs)), 2):
        if max(np.abs(points[i] - points[j]).max() for points in ends.values()) <= same:
            raise MotionError(
                f"{told} {legs[i]} and {legs[j]} coincide, at base and platform; put their joints apart"
            )
    for leg, length in zip(legs, machine.home_q, strict=True):
        if length <= same:
            raise MotionError(
                f"{told} {leg} has no length at home: its joints are the same point; choose another home"
            )
    left, stretch, _ = np.linalg.svd(
        scaled_jacobian(machine, machine.home_numbers, machine.home_q)[0]
    )
    if stretch[-1] <= SINGULAR_CONDITIONING * stretch[0]:
        # the rates of legs that no motion of the platform has
        share = np.abs(left[:, stretch <= SINGULAR_CONDITIONING * stretch[0]]).max(1)
        idle = ", ".join(
            leg
            for leg, part in zip(legs, share, strict=True)
            if part > np.sqrt(SINGULAR_CONDITIONING)
        )
        raise BadValue(
            f"{told} home is singular (conditioning {stretch[-1] / stretch[0]:.1g}): {idle} together leave a motion of "
            "the platform free; put their joints elsewhere, or choose another home",
            key=("home",),
        )


def _tilt_type(value: object) -> Any:
    return tuple[Tilt, Tilt] if isinstance(value, tuple) else Tilt


def rest_axes_type(count: int) -> Chosen:
    """Annotation of rest axes: one direction, or one for each of so many joints."""
    each = tuple.__class_getitem__((Direction,) * count)

    def pick(value: object) -> Any:
        return (
            each
            if isinstance(value, tuple) and value and isinstance(value[0], tuple)
            else Direction
        )

    return Chosen(pick)


Radius = Annotated[float, Unit("m", above=0, plain="length", unit_written=True)]
Thickness = Annotated[float, Unit("m", least=0, plain="length", unit_written=True)]
Tilt = Annotated[float, Unit("rad", above=0, most=pi)]


class Plate(TableSchema):
    """A platform's disc, in the platform's own frame."""

    radius: Radius = key("radius of the plate")
    thickness: Thickness = key("thickness of the plate")
    centre: Point = key("centre of the plate, at half its thickness", default=(0.0, 0.0, 0.0))
    normal: Direction = key("normal of the plate", default=(0.0, 0.0, 1.0))

    @property
    def disc(self) -> Disc:
        return Disc(self.radius, self.thickness, self.centre, self.normal)


BASE_REST = key(
    "axis of the base joints at zero tilt, in the base frame; or one for each joint",
    "[0, 0, 1]",
    None,
)
PLATFORM_REST = key(
    "axis of the platform joints at zero tilt, in the platform frame; or one for each joint",
    "[0, 0, 1]",
    None,
)
_DISC = '{ radius = "20 mm", thickness = "5 mm" }'


class Platforms(TableSchema):
    """What the geometry of a machine with legs has however its joints are given; `rest_axes_type`
    says how many axes.

    Tilt counts from the rest axes, and leg_radius states that legs take up room.
    """

    home: HomeTable = HOME
    base_rest: tuple[Any, ...] | None = BASE_REST
    platform_rest: tuple[Any, ...] | None = PLATFORM_REST
    max_tilt: Annotated[float | tuple[float, float], Chosen(_tilt_type)] | None = key(
        "largest tilt of a joint from its axis at zero tilt; two values: base, platform",
        '"35 deg"',
        None,
    )
    leg_radius: Radius | None = key(
        "radius of a leg as a round bar; without it, collisions are not checked", '"5 mm"', None
    )
    leg_ends: Thickness | None = key(
        "distance from a joint centre to the end of the bar", '"5 mm"', None, needs=["leg_radius"]
    )
    base_disc: Plate | None = key(
        'plate of the base, for collisions; centre = ["0 mm", "0 mm", "0 mm"], normal = [0, 0, 1] if not stated',
        _DISC,
        None,
        needs=["leg_radius"],
    )
    platform_disc: Plate | None = key(
        "plate of the platform, in the platform frame", _DISC, None, needs=["leg_radius"]
    )

    def joints(self) -> tuple[ArrayLike, ArrayLike]:
        """Centres of the joints in the base frame and in the frame that poses are of."""
        raise NotImplementedError

    def home_lengths(self) -> Array:
        """Length of each leg in the home pose, m."""
        base, platform = self.joints()
        at_home = make_pose(self.home.to, self.home.rotate).apply(np.asarray(platform))
        return np.asarray(np.linalg.norm(at_home - np.asarray(base), axis=1))

    def options(self) -> dict[str, Any]:
        """The keywords that the machines take."""
        return {
            "home": self.home.numbers,
            "base_rest": self.base_rest,
            "platform_rest": self.platform_rest,
            "max_tilt": self.max_tilt,
            "leg_radius": self.leg_radius,
            "leg_ends": self.leg_ends,
            "base_disc": self.base_disc.disc if self.base_disc else None,
            "platform_disc": self.platform_disc.disc if self.platform_disc else None,
        }


def legged_geometry(machine: Legged, tool: np.ndarray, complete: bool) -> dict[str, Any]:
    """What [geometry] says of a machine with legs; tool (3,): its platform frame in the file's."""

    def rest(axes: Array) -> Array | None:
        return axes if complete or (axes != [0.0, 0.0, 1.0]).any() else None

    def plate(disc: Disc | None, offset: np.ndarray) -> dict[str, Any] | None:
        if disc is None:
            return None
        centre = np.asarray(disc.centre, float) + offset
        return {
            "radius": disc.radius,
            "thickness": disc.thickness,
            "centre": centre,
            "normal": np.array(disc.normal, float),
        }

    bodies = machine.bodies
    return {
        "base_joints": machine.base,
        "platform_joints": machine.platform + tool,
        "home": home_entries(machine),
        "base_rest": rest(machine.base_rest),
        "platform_rest": rest(machine.platform_rest),
        "max_tilt": machine.max_tilt[[0, -1]] if (machine.max_tilt < pi).any() else None,
        "leg_radius": bodies and bodies.leg_radius,
        "leg_ends": bodies and bodies.leg_ends,
        "base_disc": bodies and plate(bodies.base_disc, np.zeros(3)),
        "platform_disc": bodies and plate(bodies.platform_disc, tool),
    }
