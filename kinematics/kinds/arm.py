"""The serial arm: a yaw and two parallel joints (3R); its TOML, and its joints read from a URDF.

pinocchio reads it where it is installed. Nothing else imports that; `kinematics.analysis.dynamics`
takes it from here.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from importlib.resources import as_file
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.files.keys import key
from kinematics.files.schema import TableSchema
from kinematics.files.toml_document import Key
from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.errors import BadValue, Fault, FileError, MotionError, NotInstalled
from kinematics.foundation.names import closest, nearest
from kinematics.foundation.options import check_arguments
from kinematics.foundation.units import Angle, describe_value
from kinematics.kinds.axis_keys import AXES, GEOMETRY, KIND, OWN_AXES, RotaryAxis, axes
from kinematics.kinds.load_keys import LoadedFile
from kinematics.kinds.traverser import nearest_turn
from kinematics.kinds.urdf import (
    MAX_BASE_DISTANCE,
    Joints,
    faults_of,
    parse_urdf,
    read_joints,
    refuse_other_motion,
)
from kinematics.machine.axis import Axis
from kinematics.machine.kind import Bar, Pivot, Skeleton, side
from kinematics.machine.load import Body, Load
from kinematics.machine.machine import Machine
from kinematics.machine.pose import column

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose


def pinocchio(what: str) -> Any:
    """The module. Raises NotInstalled, naming what needs it, where it is not installed."""
    try:
        import pinocchio
    except ImportError as missing:
        raise NotInstalled(what, "pin (pinocchio)") from missing
    return pinocchio


def inertia(body: Body) -> Any:
    """pinocchio's spatial inertia of a body, in the body's frame."""
    return pinocchio("an inertia").Inertia(body.mass, body.centre, body.inertia)


# How far (m, or sine of an angle) joints may lie off the form that the closed inverse needs.
FORM_TOLERANCE = 1e-9


class Arm(Machine):
    """3R arm: yaw about a vertical axis, then two joints with horizontal, parallel axes.

    In the upright plane that the yaw turns, r outwards and z up from the second joint, with E = A₃
    − A₂:

        r = l₂ cos A₂ + l₃ cos A₃,   z = l₂ sin A₂ + l₃ sin A₃,   cos E = (r² + z² − l₂² − l₃²)/(2
                                     l₂ l₃),
        A₂ = atan2(z, r) − atan2(l₃ sin E, l₂ + l₃ cos E);

    the joints turn by A₂ and E less what they are at q = 0. Elbow (the sign of E), side (whether
    the arm reaches to the front of its yaw or over its back) and turns are those at `near`; a pose
    that only the other side reaches gets that. x, y, z are controlled, the orientation follows.
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
        angles = finite_array(home, f"machine {name}: home", (3,), unit="rad")
        yaw, second, third = joints.directions
        for what, off in (
            ("the first joint's axis must be upright", float(np.hypot(yaw[0], yaw[1]))),
            ("the second joint's axis must be level", abs(float(second[2]))),
            (
                "the third joint's axis must be parallel to the second's",
                float(np.linalg.norm(np.cross(second, third))),
            ),
        ):
            if off > FORM_TOLERANCE:
                degrees = np.rad2deg(np.arcsin(min(off, 1.0)))
                raise MotionError(f"machine {name}: {what}; it is off by {degrees:.6g} deg")
        # a turn about the second axis lifts what is outwards
        outwards, across = np.array([-second[1], second[0], 0.0]), second
        legs = np.diff(np.concatenate([joints.points[1:], joints.tool[None]]), axis=0)
        (r2, r3), (z2, z3) = legs @ outwards, legs[:, 2]
        self.upper, self.fore = float(np.hypot(r2, z2)), float(np.hypot(r3, z3))
        if min(self.upper, self.fore) < FORM_TOLERANCE:
            raise MotionError(
                f"machine {name}: its links measure {self.upper} m and {self.fore} m; neither may vanish"
            )
        self.out, self.height = (
            float((joints.points[1] - joints.points[0]) @ outwards),
            float(joints.points[1, 2]),
        )
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
        """q_k, near, of the angle sense·q + zero that has this sine and cosine (times what is
        positive).
        """
        sense, zero = float(self._sense[k]), float(self._zero[k])
        return sense * (nearest_turn(sine, cosine, sense * near + zero) - zero)

    def alternatives(self, near: Array) -> list[Array]:
        """The same place over the other side: half a turn of the yaw, A₂ → π − A₂, E → −E."""
        yaw, second, bend = self._sense * near + self._zero
        over = np.array([yaw + np.pi, np.pi - second, -bend])
        return [self._sense * (over - self._zero)]

    def fill_pose(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        oriented: ca.SX = self._joint_motions(q)[-1][1] @ self.joints.tool_rotation
        return position, oriented

    def _joint_motions(self, q: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
        """Per joint, the motion p, R: r -> p + R r that it gives to what it moves, from where that
        lies at q = 0.
        """
        place, turned, frames = ca.SX.zeros(3), ca.SX.eye(3), []
        for k, (on, axis) in enumerate(
            zip(self.joints.points, self.joints.directions, strict=True)
        ):
            skew, point = ca.skew(ca.DM(axis)), ca.DM(on)
            turn = ca.SX.eye(3) + ca.sin(q[k]) * skew + (1 - ca.cos(q[k])) * (skew @ skew)
            place, turned = place + turned @ (point - turn @ point), turned @ turn
            frames.append((place, turned))
        return frames

    def moving_bodies(
        self, position: ca.SX, rotation: ca.SX, q: ca.SX
    ) -> tuple[tuple[Body, ca.SX], ...]:
        """The links, and the tool as the last of them carries it: all by the coordinates alone."""
        frames = self._joint_motions(q)
        place, turned = frames[-1]
        tool = column(
            place + turned @ ca.DM(self.joints.tool), turned @ ca.DM(self.joints.tool_rotation)
        )
        links = zip(self.joints.links, frames, strict=False)
        return (
            (self.load.platform, tool),
            *((Body(*link), column(*frame)) for link, frame in links),
        )

    def skeleton(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> Skeleton:
        """The column up to the shoulder's height, and every link from its joint to the next, or to
        the tool.
        """
        yaw, shoulder, elbow = self.joints.points
        foot, top = (ca.DM([yaw[0], yaw[1], height]) for height in (0.0, shoulder[2]))
        hinge, bend, tip = (
            place + turned @ ca.DM(end)
            for (place, turned), end in zip(
                self._joint_motions(q), (shoulder, elbow, self.joints.tool), strict=True
            )
        )
        first, second, third = (axis.name for axis in self.axes)
        bars = [
            Bar("link", foot, top, first),
            Bar("link", hinge, bend, second),
            Bar("link", bend, tip, third),
        ]
        if np.hypot(*(shoulder - yaw)[:2]) > FORM_TOLERANCE:
            bars.insert(1, Bar("link", top, hinge, first))
        return Skeleton(tuple(bars), (Pivot(top), Pivot(hinge), Pivot(bend)))

    def pose_of(self, q: Array) -> "Pose":
        """The tool's pose at joint angles (N, 3) or (3,): the product of the joints' turns."""
        from scipy.spatial.transform import RigidTransform, Rotation

        pose = RigidTransform.from_components(
            self.joints.tool, Rotation.from_matrix(self.joints.tool_rotation)
        )
        for k in reversed(range(3)):
            axis, on = self.joints.directions[k], self.joints.points[k]
            turn = RigidTransform.from_rotation(Rotation.from_rotvec(q[..., k, None] * axis))
            pose = (
                RigidTransform.from_translation(on)
                * turn
                * RigidTransform.from_translation(-on)
                * pose
            )
        return pose

    @cached_property
    def _tool_map(self) -> Expression:
        """q (3) -> the tool's pose numbers (12)."""
        q = ca.SX.sym("q", 3)
        return Expression("tool", q, self.moving_bodies(ca.SX.zeros(3), ca.SX.eye(3), q)[0][1])

    def start(self, q: Array, near: Array) -> Array:
        return self._tool_map(q)


@check_arguments()
def read_urdf(path: Path, joints: Sequence[str], tool: str) -> Joints:
    """Read three joints and the tool frame at q = 0, in the base frame, from a URDF file.

    pinocchio reads it where it is installed, else `kinematics.kinds.urdf`.

    Parameters
    ----------
    path
        Of the URDF file.
    joints
        Names of three revolute joints, each carried by the one before, from the base.
    tool
        Name of the frame of the tool, which the last joint carries.

    Returns
    -------
    Joints
        Their points and axes, and the tool's frame.

    Raises
    ------
    FileError
        The file does not hold them.
    """
    try:
        pin = pinocchio("an arm's URDF")
    except NotInstalled:
        return read_joints(path, joints, tool)
    root = parse_urdf(path)
    with faults_of(path):
        refuse_other_motion(root, list(joints))
    try:
        model = pin.buildModelFromUrdf(str(path))
    except (ValueError, RuntimeError) as failure:
        raise FileError(
            str(path), [Fault("", f"{failure} (the parser says why on stderr)")]
        ) from failure
    faults = list(_faults(model, list(joints), tool))
    if faults:
        raise FileError(str(path), faults)
    numbers = [model.getJointId(name) for name in joints]
    data = model.createData()
    # at q = 0, and with unit speed of one joint after the other: its axis in the base frame
    directions = []
    for name, joint in zip(joints, numbers, strict=True):
        speeds = np.zeros(3)
        speeds[model.joints[joint].idx_v] = 1.0
        pin.forwardKinematics(model, data, pin.neutral(model), speeds)
        spin = pin.getVelocity(
            model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        ).angular.copy()
        if not abs(np.linalg.norm(spin) - 1) < 1e-9:
            raise FileError(
                str(path),
                [Fault("joints", f'{name!r} has no axis: write e.g. <axis xyz="0 0 1"/>')],
            )
        directions.append(spin)
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    frame = data.oMf[model.getFrameId(tool)]
    points = [data.oMi[joint].translation.copy() for joint in numbers]
    if not np.abs([*points, frame.translation]).max() < MAX_BASE_DISTANCE:
        raise FileError(
            str(path),
            [Fault("joints", f"they do not all lie within {MAX_BASE_DISTANCE:g} m of the base")],
        )
    moved = [data.oMi[joint].act(model.inertias[joint]) for joint in numbers]
    return Joints(
        freeze_array(points),
        freeze_array(directions),
        freeze_array(frame.translation),
        freeze_array(frame.rotation),
        tuple(
            (float(link.mass), freeze_array(link.lever), freeze_array(link.inertia))
            for link in moved
        ),
    )


def _faults(model: Any, joints: list[str], tool: str) -> list[Fault]:
    """What keeps a model from being three joints that turn, one after the other, the last with the
    tool.
    """
    names = list(model.names)[1:]
    there = f"there are {', '.join(names)}"
    faults = [
        Fault(
            "joints",
            f"there is no joint {describe_value(name)}{nearest(name, names)}; {there}",
            nearest=closest(name, names),
        )
        for name in joints
        if not model.existJointName(name)
    ]
    if not faults and (len(joints) != 3 or len(set(joints)) < 3 or model.njoints != 4):
        faults = [
            Fault("joints", f"wanted are three joints that turn, {describe_value(joints)}; {there}")
        ]
    if not isinstance(tool, str) or not model.existFrame(tool):
        known = [frame.name for frame in model.frames]
        told = f"there is no frame {describe_value(tool)}{nearest(str(tool), known)}; there are {', '.join(known)}"
        faults.append(Fault("tool", told, nearest=closest(str(tool), known)))
    if faults:
        return faults
    numbers = [model.getJointId(name) for name in joints]
    for name, joint, before in zip(joints, numbers, [0, *numbers], strict=False):
        if (
            not model.joints[joint].shortname().startswith("JointModelR")
        ):  # R…, Revolute…: pinocchio's that turn
            faults.append(
                Fault(
                    "joints", f"{name!r} does not turn; an arm's joints are revolute or continuous"
                )
            )
        elif model.parents[joint] != before:
            faults.append(
                Fault(
                    "joints",
                    f"{joints} do not follow each other; the order from the base is {names}",
                )
            )
    carrier = model.frames[model.getFrameId(tool)].parentJoint
    if carrier != numbers[-1]:
        carried = repr(model.names[carrier]) if carrier else "nothing that moves"
        faults.append(
            Fault(
                "tool",
                f"frame {tool!r} is carried by {carried}, not by the last joint {joints[-1]!r}",
            )
        )
    return faults


class ArmGeometry(TableSchema):
    """How a serial arm is built."""

    urdf: str = key(
        "URDF file in the folder of this file",
        remedy='write the name of a file in the same folder, e.g. "arm.urdf"',
    )
    joints: tuple[str, str, str] = key("names of the three joints in the URDF, from the base on")
    tool: str = key("name of the tool's link in the URDF")
    home: tuple[Angle, Angle, Angle] = key(
        "joint angles of the home pose: zero of travel and pulses"
    )


class ArmAxisTable(RotaryAxis):
    name: str


class ArmFile(LoadedFile):
    """An arm, key by key."""

    kind: Literal["arm"] = KIND
    geometry: ArmGeometry = GEOMETRY
    axes: RotaryAxis = AXES
    axis: tuple[ArmAxisTable, ...] = OWN_AXES

    def list_freedom(self) -> tuple[str, ...]:
        return Arm.freedom

    def list_axes(self) -> list[Axis]:
        names = self.geometry.joints
        return axes(names, dict.fromkeys(names, self.axes), self.axis, self)


def find_stray_axis_tables(data: Mapping[str, Any]) -> Iterator[tuple[Key, MotionError]]:
    """Every [[axis]] table that is named after none of the joints, where a file states joints."""
    joints, tables = joints_of(data), data.get("axis")
    if not joints:
        return
    for n, table in enumerate(tables if isinstance(tables, tuple) else ()):
        name = table.get("name") if isinstance(table, dict) else None
        if isinstance(name, str) and name not in joints:
            told = f"{describe_value(name)} is no joint{nearest(name, joints)}; joints: {', '.join(joints)}"
            yield (
                ("axis", n, "name"),
                BadValue(told, allowed=", ".join(joints), nearest=closest(name, joints)),
            )


def joints_of(data: Mapping[str, Any]) -> tuple[str, ...]:
    """The joints that a file states; none where it does not, or not by names."""
    geometry = data.get("geometry")
    joints = geometry.get("joints") if isinstance(geometry, dict) else None
    named = isinstance(joints, tuple) and all(isinstance(joint, str) for joint in joints)
    return joints if named else ()  # type: ignore[return-value]  # a tuple of str


def build_arm(file: ArmFile, name: str, folder: Path | Traversable) -> Arm:
    geometry = file.geometry
    if "/" in geometry.urdf or "\\" in geometry.urdf:
        raise FileError(
            geometry.urdf, [Fault("urdf", "must be the name of a file beside the machine file")]
        )
    with as_file(folder / geometry.urdf) as path:
        joints = read_urdf(path, geometry.joints, geometry.tool)
    return Arm(joints, axes=file.list_axes(), home=geometry.home, name=name, load=file.load())
