"""A serial arm's TOML, and the URDF that it names."""

from collections.abc import Iterator, Mapping
from importlib.resources import as_file
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from kinematics.arm import Arm
from kinematics.document import Key
from kinematics.errors import BadValue, Fault, FileError, MotionError
from kinematics.kinds.axes import RotaryAxis, axes
from kinematics.kinds.masses import LoadedFile
from kinematics.registry import closest, nearest
from kinematics.schema import Table
from kinematics.units import Angle, shown
from kinematics.urdf import read_urdf


class Geometry(Table):
    """How a serial arm is built.

    urdf    a file beside this one
    joints  its three, from the base
    tool    the link of the file whose frame is moved
    home    angles of the joints, from which travel counts
    """

    urdf: str = Field(description='write the name of a file beside this one, e.g. "arm.urdf"')
    joints: tuple[str, str, str]
    tool: str
    home: tuple[Angle, Angle, Angle]


class Own(RotaryAxis):
    name: str


class ArmFile(LoadedFile):
    """An arm, key by key."""

    kind: Literal["arm"]
    geometry: Geometry
    axes: RotaryAxis
    axis: tuple[Own, ...] = ()


def of_a_joint(data: Mapping[str, Any]) -> Iterator[tuple[Key, MotionError]]:
    """Every [[axis]] table that is named after none of the joints, where a file states joints."""
    joints, tables = joints_of(data), data.get("axis")
    if not joints:
        return
    for n, table in enumerate(tables if isinstance(tables, tuple) else ()):
        name = table.get("name") if isinstance(table, dict) else None
        if isinstance(name, str) and name not in joints:
            told = f"{shown(name)} is no joint{nearest(name, joints)}; joints: {', '.join(joints)}"
            yield ("axis", n, "name"), BadValue(told, allowed=", ".join(joints), nearest=closest(name, joints))


def joints_of(data: Mapping[str, Any]) -> tuple[str, ...]:
    """The joints that a file states; none where it does not, or not by names."""
    geometry = data.get("geometry")
    joints = geometry.get("joints") if isinstance(geometry, dict) else None
    named = isinstance(joints, tuple) and all(isinstance(joint, str) for joint in joints)
    return joints if named else ()  # type: ignore[return-value]  # a tuple of str


def arm(file: ArmFile, name: str, folder: Path | Traversable) -> Arm:
    geometry = file.geometry
    if "/" in geometry.urdf or "\\" in geometry.urdf:
        raise FileError(geometry.urdf, [Fault("urdf", "must be the name of a file beside the machine file")])
    with as_file(folder / geometry.urdf) as path:
        joints = read_urdf(path, geometry.joints, geometry.tool)
    names = geometry.joints
    return Arm(
        joints,
        axes=axes(names, dict.fromkeys(names, file.axes), file.axis, file),
        home=geometry.home,
        name=name,
        load=file.load(),
    )
