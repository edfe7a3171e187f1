"""The serial arm: a yaw and two parallel joints (3R)."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.array import Array, finite
from kinematics.axis import Axis
from kinematics.body import Body
from kinematics.errors import MotionError
from kinematics.expression import Expression
from kinematics.kind import side
from kinematics.load import Load
from kinematics.machine import Machine
from kinematics.pose import Pose, column
from kinematics.skeleton import Bar, Pivot, Skeleton
from kinematics.traverser import nearest_turn

# How far (m, or sine of an angle) joints may lie off the form that the closed inverse needs.
STRAIGHT = 1e-9


@dataclass(frozen=True, slots=True)
class Joints:
    """Three revolute joints at q = 0, in the base frame: a point on each axis and its direction, both (3, 3); the tool.

    tool   (3,) position and (3, 3) rotation of the tool's frame
    links  what each joint moves, as it lies at q = 0 in the base frame: mass, centre (3,) and inertia (3, 3) about it
    """

    points: Array
    directions: Array
    tool: Array
    tool_rotation: Array
    links: tuple[tuple[float, Array, Array], ...] = ()


class Arm(Machine):
    """3R: yaw about an upright axis, then two joints with level, parallel axes.

    In the upright plane that the yaw turns, r outwards and z up from the second joint, with E = A₃ − A₂:

        r = l₂ cos A₂ + l₃ cos A₃,   z = l₂ sin A₂ + l₃ sin A₃,   cos E = (r² + z² − l₂² − l₃²)/(2 l₂ l₃),
        A₂ = atan2(z, r) − atan2(l₃ sin E, l₂ + l₃ cos E);

    the joints turn by A₂ and E less what they are at q = 0. Elbow (the sign of E), side (whether the arm reaches to the
    front of its yaw or over its back) and turns are those at `near`; a pose that only the other side reaches gets that.
    x, y, z are controlled, the orientation follows.
    """

    freedom = ("x", "y", "z")
    follows = ("rx", "ry", "rz")
    branched = True
    sorts = ("rotary",) * 3

    def __init__(
        self,
        joints: Joints,
        *,
        axes: Iterable[Axis],
        home: ArrayLike,
        name: str = "arm",
        load: Load | None = None,
    ) -> None:
        """home (3,): the joint angles at home, rad."""
        self.joints = joints
        angles = finite(home, f"machine {name}: home", (3,), unit="rad")
        yaw, second, third = joints.directions
        for what, off in (
            ("the first joint's axis must be upright", float(np.hypot(yaw[0], yaw[1]))),
            ("the second joint's axis must be level", abs(float(second[2]))),
            ("the third joint's axis must be parallel to the second's", float(np.linalg.norm(np.cross(second, third)))),
        ):
            if off > STRAIGHT:
                degrees = np.rad2deg(np.arcsin(min(off, 1.0)))
                raise MotionError(f"machine {name}: {what}; it is off by {degrees:.6g} deg")
        # a turn about the second axis lifts what is outwards
        outwards, across = np.array([-second[1], second[0], 0.0]), second
        legs = np.diff(np.concatenate([joints.points[1:], joints.tool[None]]), axis=0)
        (r2, r3), (z2, z3) = legs @ outwards, legs[:, 2]
        self.upper, self.fore = float(np.hypot(r2, z2)), float(np.hypot(r3, z3))
        if min(self.upper, self.fore) < STRAIGHT:
            raise MotionError(f"machine {name}: its links measure {self.upper} m and {self.fore} m; neither may vanish")
        self.out, self.height = float((joints.points[1] - joints.points[0]) @ outwards), float(joints.points[1, 2])
        self.aside = -float((joints.tool - joints.points[0]) @ across)
        self._sense = np.array([np.sign(yaw[2]), 1.0, float(np.sign(second @ third))])
        a2, a3 = np.arctan2(z2, r2), np.arctan2(z3, r3)
        self._zero = np.array([np.arctan2(outwards[1], outwards[0]), a2, a3 - a2])
        self.characteristic_length = self.upper + self.fore
        super().__init__(name, axes, self.pose_of(angles), near=angles, load=load)

    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        _, second, bend = (self._sense[k] * near[k] + self._zero[k] for k in range(3))
        front = side(self.out + self.upper * ca.cos(second) + self.fore * ca.cos(second + bend))
        x, y = position[0] - self.joints.points[0, 0], position[1] - self.joints.points[0, 1]
        reach = front * ca.sqrt(x**2 + y**2 - self.aside**2)
        r, z = reach - self.out, position[2] - self.height
        cosine = (r**2 + z**2 - self.upper**2 - self.fore**2) / (2 * self.upper * self.fore)
        sine = ca.sqrt(1 - cosine**2) * side(ca.sin(bend))
        beside, along = self.fore * sine, self.upper + self.fore * cosine
        angles = [
            (y * reach - x * self.aside, x * reach + y * self.aside),
            (z * along - r * beside, r * along + z * beside),
            (sine, cosine),
        ]
        return ca.vertcat(*(self._joint(k, *angle, near[k]) for k, angle in enumerate(angles)))

    def _joint(self, k: int, sine: ca.SX, cosine: ca.SX, near: ca.SX) -> ca.SX:
        """q_k, near, of the angle sense·q + zero that has this sine and cosine (times what is positive)."""
        sense, zero = float(self._sense[k]), float(self._zero[k])
        return sense * (nearest_turn(sine, cosine, sense * near + zero) - zero)

    def alternatives(self, near: Array) -> list[Array]:
        """The same place over the other side: half a turn of the yaw, A₂ → π − A₂, E → −E."""
        yaw, second, bend = self._sense * near + self._zero
        over = np.array([yaw + np.pi, np.pi - second, -bend])
        return [self._sense * (over - self._zero)]

    def carried(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        oriented: ca.SX = self._turned(q)[-1][1] @ self.joints.tool_rotation
        return position, oriented

    def _turned(self, q: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
        """Per joint, the motion p, R: r -> p + R r that it gives to what it moves, from where that lies at q = 0."""
        place, turned, frames = ca.SX.zeros(3), ca.SX.eye(3), []
        for k, (on, axis) in enumerate(zip(self.joints.points, self.joints.directions, strict=True)):
            skew, point = ca.skew(ca.DM(axis)), ca.DM(on)
            turn = ca.SX.eye(3) + ca.sin(q[k]) * skew + (1 - ca.cos(q[k])) * (skew @ skew)
            place, turned = place + turned @ (point - turn @ point), turned @ turn
            frames.append((place, turned))
        return frames

    def moved(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> tuple[tuple[Body, ca.SX], ...]:
        """The links, and the tool as the last of them carries it: all by the coordinates alone."""
        frames = self._turned(q)
        place, turned = frames[-1]
        tool = column(place + turned @ ca.DM(self.joints.tool), turned @ ca.DM(self.joints.tool_rotation))
        links = zip(self.joints.links, frames, strict=False)
        return ((self.load.platform, tool), *((Body(*link), column(*frame)) for link, frame in links))

    def skeleton(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> Skeleton:
        """The column up to the shoulder's height, and every link from its joint to the next, or to the tool."""
        yaw, shoulder, elbow = self.joints.points
        foot, top = (ca.DM([yaw[0], yaw[1], height]) for height in (0.0, shoulder[2]))
        hinge, bend, tip = (
            place + turned @ ca.DM(end)
            for (place, turned), end in zip(self._turned(q), (shoulder, elbow, self.joints.tool), strict=True)
        )
        first, second, third = (axis.name for axis in self.axes)
        bars = [Bar("link", foot, top, first), Bar("link", hinge, bend, second), Bar("link", bend, tip, third)]
        if np.hypot(*(shoulder - yaw)[:2]) > STRAIGHT:
            bars.insert(1, Bar("link", top, hinge, first))
        return Skeleton(tuple(bars), (Pivot(top), Pivot(hinge), Pivot(bend)))

    def pose_of(self, q: Array) -> Pose:
        """The tool's pose at joint angles (N, 3) or (3,): the product of the joints' turns."""
        pose = RigidTransform.from_components(self.joints.tool, Rotation.from_matrix(self.joints.tool_rotation))
        for k in reversed(range(3)):
            axis, on = self.joints.directions[k], self.joints.points[k]
            turn = RigidTransform.from_rotation(Rotation.from_rotvec(q[..., k, None] * axis))
            pose = RigidTransform.from_translation(on) * turn * RigidTransform.from_translation(-on) * pose
        return pose

    @cached_property
    def _tool_map(self) -> Expression:
        """q (3) -> the tool's pose numbers (12)."""
        q = ca.SX.sym("q", 3)
        return Expression("tool", q, self.moved(ca.SX.zeros(3), ca.SX.eye(3), q)[0][1])

    def start(self, q: Array, near: Array) -> Array:
        return self._tool_map(q)
