"""Reading of the joints of a serial arm from its URDF, without pinocchio, which has no wheels for
Windows.

Only links, joints and inertias are read. Shapes and the limits of joints are ignored.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from kinematics.files.plain_text import describe_control_character
from kinematics.files.toml_document import MAX_BYTES, bytes_of
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import Fault, FileError, MotionError
from kinematics.foundation.names import closest, count_noun, nearest
from kinematics.foundation.units import describe_value

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

TURNING, FIXED = ("revolute", "continuous"), "fixed"
"""Types of joints."""
MAX_BASE_DISTANCE = 1e6
"""m within which every joint and the tool must lie.

A larger distance is a slip of units, and overflows.
"""
NAME = re.compile(rb"""\b(?:name|link|joint)\s*=\s*(?:"([^"<]*)"|'([^'<]*)')""")
"""A name as the file has it. XML readers disagree about line ends in it."""


@dataclass(frozen=True, slots=True)
class Joints:
    """Three revolute joints at q = 0, in the base frame: a point on each axis and its direction,
    both (3, 3); the tool.

    tool   (3,) position and (3, 3) rotation of the tool's frame
    links  bodies that each joint moves, at q = 0 in the base frame: mass, centre (3,) and inertia
           (3, 3) about it
    """

    points: Array
    directions: Array
    tool: Array
    tool_rotation: Array
    links: tuple[tuple[float, Array, Array], ...] = ()


@dataclass(frozen=True, slots=True)
class _Link:
    """A link as it lies at q = 0: its frame, the number of the moving joint that carries it (−1:
    none), its mass.
    """

    frame: RigidTransform
    carrier: int
    mass: float
    centre: Array
    inertia: Array


def parse_urdf(path: Path) -> ElementTree.Element:
    """Parse the robot of a URDF.

    Raises FileError, with the line, for a file that is not XML or describes no robot, and for
    unprintable names.
    """
    raw = bytes_of(path, MAX_BYTES)
    if b"<!DOCTYPE" in raw or b"<!ENTITY" in raw:
        raise FileError(
            str(path),
            [Fault("", "a URDF needs no document type, whose entities are not read: delete it")],
        )
    try:
        root = ElementTree.fromstring(raw)
    except ElementTree.ParseError as error:
        line, column = error.position
        reason = error.msg.partition(":")[0]
        message = f"not XML at column {column + 1}: {reason}; the rest was not checked"
        raise FileError(str(path), [Fault("", message, line)]) from None
    if root.tag != "robot":
        raise FileError(
            str(path), [Fault("", f"not a URDF: it begins with <{root.tag}> instead of <robot>", 1)]
        )
    faults = _find_unprintable_names(raw, root)
    if faults:
        raise FileError(str(path), faults)
    return root


def _find_unprintable_names(raw: bytes, root: ElementTree.Element) -> list[Fault]:
    """List names with control characters: as the file has them, else as its character references
    make them.
    """
    faults = []
    # comments become empty lines, which keep their numbers
    raw = re.sub(
        rb"<!--.*?-->", lambda comment: re.sub(rb"[^\r\n]", b"", comment[0]), raw, flags=re.DOTALL
    )
    for match in NAME.finditer(raw):
        name = (match[1] or match[2] or b"").decode("utf-8", "replace")
        if reason := _describe_unprintable(name):
            line = 1 + len(re.findall(rb"\r\n|\r|\n", raw[: match.start()]))
            faults.append(Fault("", f"name {describe_value(name)} {reason}", line))
    if faults:
        return faults
    names = (element.get(key, "") for element in root.iter() for key in ("name", "link", "joint"))
    reasons = {name: _describe_unprintable(name) for name in names}
    return [
        Fault("", f"name {describe_value(name)} {reason}")
        for name, reason in reasons.items()
        if reason
    ]


def _describe_unprintable(name: str) -> str | None:
    # tabs and line ends are fine in a text, and not in a name
    return describe_control_character(name.replace("\t", "\x00").replace("\n", "\r"))


def refuse_other_motion(root: ElementTree.Element, wanted: Sequence[str]) -> None:
    """Raise MotionError, with a key, if a joint other than the wanted ones moves, or if one follows
    another (<mimic>).

    The machine has three axes. It cannot move a gripper, and it does not know that one joint moves
    another.
    """
    moving = {
        name: joint
        for joint in root.findall("joint")
        if _moves(joint)
        for name in [joint.get("name", "")]
    }
    for name, joint in moving.items():
        leader = joint.find("mimic")
        if leader is not None:
            raise _Wrong(
                "joints",
                f"joint {describe_value(name)} follows {describe_value(leader.get('joint', ''))} (<mimic>), which an "
                'arm of three independent joints cannot do; write type="fixed", or delete <mimic>',
            )
    others = {name: joint.get("type", "") for name, joint in moving.items() if name not in wanted}
    if not others or len(set(wanted)) != 3 or not set(wanted) <= moving.keys():
        return
    one = len(others) == 1
    listed = ", ".join(f"{describe_value(name)} ({kind})" for name, kind in others.items())
    raise _Wrong(
        "joints",
        f"besides {', '.join(map(str, wanted))} the file has {count_noun(len(others), 'joint')} that "
        f'move{"s" * one}: {listed}; give {"it" if one else "them"} type="fixed" in the URDF, in the position of '
        "the work",
    )


def _moves(joint: ElementTree.Element) -> bool:
    return joint.get("type") != FIXED


def read_joints(path: Path, joints: Sequence[str], tool: str) -> Joints:
    """Read joints as `kinematics.kinds.arm.read_urdf` does with pinocchio. Raises FileError."""
    root = parse_urdf(path)
    with faults_of(path):
        return _read(root, list(joints), tool)


@contextmanager
def faults_of(path: Path) -> Iterator[None]:
    """Raise each MotionError inside as a FileError of a file, with its key."""
    try:
        yield
    except FileError:
        raise
    except MotionError as error:
        raise FileError(str(path), [Fault(str(getattr(error, "key", "")), str(error))]) from None


class _Wrong(MotionError):
    def __init__(self, key: str, message: str) -> None:
        self.key = key
        super().__init__(message)


def _read(root: ElementTree.Element, wanted: list[str], tool: str) -> Joints:
    elements = {element.get("name", ""): element for element in root.findall("joint")}
    moving = [name for name, element in elements.items() if _moves(element)]
    known_joints = f"there are {', '.join(moving)}"
    for name in wanted:
        if name not in moving:
            near = nearest(str(name), moving) if closest(str(name), moving) else ""
            raise _Wrong(
                "joints", f"there is no joint {describe_value(name)}{near}; {known_joints}"
            )
    if len(wanted) != 3 or len(set(wanted)) < 3:
        raise _Wrong(
            "joints", f"wanted are three joints that turn, {describe_value(wanted)}; {known_joints}"
        )
    refuse_other_motion(root, wanted)
    links, axes = _place_links(root, elements, wanted)
    if tool not in links:
        near, known = nearest(str(tool), links), ", ".join(links)
        raise _Wrong("tool", f"there is no frame {describe_value(tool)}{near}; there are {known}")
    if links[tool].carrier != 2:
        by = repr(wanted[links[tool].carrier]) if links[tool].carrier >= 0 else "nothing that moves"
        raise _Wrong(
            "tool", f"frame {tool!r} is carried by {by}, not by the last joint {wanted[-1]!r}"
        )
    points = [point for point, _ in axes]
    frame = links[tool].frame
    if not np.abs([*points, frame.translation]).max() < MAX_BASE_DISTANCE:
        raise _Wrong("joints", f"they do not all lie within {MAX_BASE_DISTANCE:g} m of the base")
    return Joints(
        freeze_array(points),
        freeze_array([direction for _, direction in axes]),
        freeze_array(frame.translation),
        freeze_array(frame.rotation.as_matrix()),
        tuple(
            _combine([link for link in links.values() if link.carrier == k], points[k])
            for k in range(3)
        ),
    )


def _place_links(
    root: ElementTree.Element, joints: Mapping[str, ElementTree.Element], wanted: list[str]
) -> tuple[dict[str, _Link], list[tuple[Array, Array]]]:
    """Return every link, and a point and the direction of every wanted joint's axis, at q = 0 in
    the base frame.
    """
    from scipy.spatial.transform import RigidTransform

    bodies = {element.get("name", ""): element for element in root.findall("link")}
    ways = {
        name: (_linked(joint, "parent"), _linked(joint, "child")) for name, joint in joints.items()
    }
    children = [child for _, child in ways.values()]
    bases = [name for name in bodies if name not in children]
    if len(bases) != 1 or len(set(children)) < len(children) or not {*children} <= bodies.keys():
        raise _Wrong(
            "", "its links are no tree with one base: every link but one is the child of one joint"
        )
    links = {bases[0]: _link(bodies[bases[0]], RigidTransform.identity(), -1)}
    axes: dict[int, tuple[Array, Array]] = {}
    left = dict(ways)
    while ready := [name for name, (parent, _) in left.items() if parent in links]:
        for name in ready:
            parent, child = left.pop(name)
            frame, carrier = links[parent].frame * _origin(joints[name]), links[parent].carrier
            if name in wanted:
                if joints[name].get("type") not in TURNING:
                    raise _Wrong(
                        "joints",
                        f"{name!r} does not turn; an arm's joints are revolute or continuous",
                    )
                if wanted.index(name) != carrier + 1:
                    raise _Wrong("joints", f"{wanted} do not follow each other from the base")
                carrier += 1
                axes[carrier] = frame.translation, frame.rotation.apply(_axis(name, joints[name]))
            links[child] = _link(bodies[child], frame, carrier)
    if left:
        raise _Wrong("", f"joint {next(iter(left))!r} does not hang on the base")
    return links, [axes[k] for k in range(3)]


def _link(element: ElementTree.Element, frame: RigidTransform, carrier: int) -> _Link:
    inertial = element.find("inertial")
    if inertial is None:
        return _Link(frame, carrier, 0.0, np.zeros(3), np.zeros((3, 3)))
    placed = frame * _origin(inertial)
    xx, yy, zz, xy, xz, yz = (
        _value(inertial, "inertia", name) for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    turned = placed.rotation.as_matrix()
    inertia = turned @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turned.T
    return _Link(frame, carrier, _value(inertial, "mass", "value"), placed.translation, inertia)


def _combine(links: Sequence[_Link], joint: Array) -> tuple[float, Array, Array]:
    """Return mass, centre and inertia about it of links that move as one.

    Without mass the centre is the joint.
    """
    mass = sum(link.mass for link in links)
    centre = sum((link.mass * link.centre for link in links), np.zeros(3)) / mass if mass else joint
    inertia = np.zeros((3, 3))
    for link in links:
        off = link.centre - centre
        inertia += link.inertia + link.mass * (off @ off * np.eye(3) - np.outer(off, off))
    return float(mass), freeze_array(centre), freeze_array(inertia)


def _origin(element: ElementTree.Element) -> RigidTransform:
    """Return x, y, z (m) and roll, pitch, yaw (rad) about the fixed axes in turn; the identity if
    not stated.
    """
    from scipy.spatial.transform import RigidTransform, Rotation

    origin = element.find("origin")
    if origin is None:
        return RigidTransform.identity()
    place, angles = (_numbers(element, origin.get(name, "0 0 0"), name) for name in ("xyz", "rpy"))
    return RigidTransform.from_components(place, Rotation.from_euler("xyz", angles))


def _axis(name: str, joint: ElementTree.Element) -> Array:
    stated = joint.find("axis")
    axis = (
        np.array([1.0, 0.0, 0.0])
        if stated is None
        else _numbers(joint, stated.get("xyz", "1 0 0"), "axis")
    )
    size = float(np.linalg.norm(axis))
    if not size > 0:
        raise _Wrong("joints", f'{name!r} has no axis: write e.g. <axis xyz="0 0 1"/>')
    return np.asarray(axis / size)


def _linked(joint: ElementTree.Element, end: str) -> str:
    """Return the name of the link at the `parent` or `child` end of a joint."""
    element = joint.find(end)
    if element is None or not element.get("link"):
        raise _Wrong("", f"joint {joint.get('name')!r} states no <{end} link=…/>")
    return element.get("link", "")


def _value(element: ElementTree.Element, part: str, name: str) -> float:
    child = element.find(part)
    return float(
        _numbers(element, "" if child is None else child.get(name, ""), f"{part} {name}", 1)[0]
    )


def _numbers(element: ElementTree.Element, text: str, what: str, count: int = 3) -> Array:
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        numbers = np.array([])
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        needed = f"{count_noun(count, 'finite number')}, not {describe_value(text)}"
        raise _Wrong("", f"{element.tag} {element.get('name', '')}: {what} must be {needed}")
    return numbers
