"""A serial arm's TOML, and the URDF that it names."""

from collections.abc import Iterator, Mapping
from importlib.resources import as_file
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from kinematics.arm import Arm
from kinematics.document import Key
from kinematics.errors import MotionError
from kinematics.kinds.axes import RotaryAxis, axes
from kinematics.kinds.masses import LoadedFile
from kinematics.registry import nearest
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


def of_a_joint(data: Mapping[str, Any]) -> Iterator[tuple[Key, str]]:
    """Every [[axis]] table that is named after none of the joints, where a file states joints."""
    geometry, tables = data.get("geometry"), data.get("axis")
    joints = geometry.get("joints") if isinstance(geometry, dict) else None
    if not isinstance(joints, tuple) or not all(isinstance(joint, str) for joint in joints):
        return
    for n, table in enumerate(tables if isinstance(tables, tuple) else ()):
        name = table.get("name") if isinstance(table, dict) else None
        if isinstance(name, str) and name not in joints:
            yield ("axis", n, "name"), f"{shown(name)} is no joint{nearest(name, joints)}; joints: {', '.join(joints)}"


def arm(file: ArmFile, name: str, folder: Path | Traversable) -> Arm:
    geometry = file.geometry
    if "/" in geometry.urdf or "\\" in geometry.urdf:
        raise MotionError(f'urdf "{geometry.urdf}" must be the name of a file beside the machine file')
    with as_file(folder / geometry.urdf) as path:
        if not path.is_file():
            raise MotionError(f'urdf "{geometry.urdf}" is no file beside the machine file')
        joints = read_urdf(path, geometry.joints, geometry.tool)
    names = geometry.joints
    return Arm(
        joints,
        axes=axes(names, dict.fromkeys(names, file.axes), file.axis, file),
        home=geometry.home,
        name=name,
        load=file.load(),
    )
