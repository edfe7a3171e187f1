"""A serial arm's TOML, and the URDF that it names."""

from importlib.resources import as_file
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Literal

from pydantic import Field

from kinematics.arm import Arm, read_urdf
from kinematics.errors import MotionError
from kinematics.kinds.axes import RotaryAxis, axes
from kinematics.kinds.masses import LoadedFile
from kinematics.schema import Table
from kinematics.units import Angle


class Geometry(Table):
    """urdf  a file beside this one; joints  its three, from the base; home  their angles, from which travel counts."""

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


def arm(file: ArmFile, name: str, folder: Path | Traversable) -> Arm:
    geometry = file.geometry
    for own in file.axis:
        if own.name not in geometry.joints:
            raise MotionError(f'[[axis]] "{own.name}" is no joint; joints: {", ".join(geometry.joints)}')
    if "/" in geometry.urdf or "\\" in geometry.urdf:
        raise MotionError(f'urdf "{geometry.urdf}" must be the name of a file beside the machine file')
    with as_file(folder / geometry.urdf) as path:
        if not path.is_file():
            raise MotionError(f'urdf "{geometry.urdf}" is no file beside the machine file')
        joints = read_urdf(path, geometry.joints, geometry.tool)
    names = geometry.joints
    return Arm(
        joints,
        axes=axes(names, dict.fromkeys(names, file.axes), file.axis),
        home=geometry.home,
        name=name,
        load=file.load(),
    )
