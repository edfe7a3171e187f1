"""A linkage's TOML."""

from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Literal

from kinematics.kinds.axes import LinearAxis, LinearDefaults, axes
from kinematics.kinds.masses import LoadedFile
from kinematics.kinds.poses import Home
from kinematics.linkage import Linkage
from kinematics.schema import Table
from kinematics.units import Angle, Length, Unit

NAMES = ("a", "b")


class Geometry(Table):
    """How a linkage is built.

    base_a  joint of actuator a in the plane
    base_b  joint of actuator b
    offset  from the actuators' common joint to the point
    angle   at that joint, from actuator a to the point
    home    the pose from which travel and pulses count
    near    lengths that say which of home's are meant; the longer a if not stated
    """

    base_a: tuple[Length, Length]
    base_b: tuple[Length, Length]
    offset: Annotated[float, Unit("m", least=0)]
    angle: Angle
    home: Home
    near: tuple[Length, Length] | None = None


class Own(LinearAxis):
    name: Literal["a", "b"]


class LinkageFile(LoadedFile):
    """A linkage, key by key."""

    kind: Literal["linkage"]
    geometry: Geometry
    axes: LinearDefaults
    axis: tuple[Own, ...] = ()


def linkage(file: LinkageFile, name: str, folder: Path | Traversable) -> Linkage:
    geometry = file.geometry
    return Linkage(
        geometry.base_a,
        geometry.base_b,
        geometry.offset,
        geometry.angle,
        axes=axes(NAMES, dict.fromkeys(NAMES, file.axes), file.axis, file),
        home=geometry.home.pose,
        near=geometry.near,
        name=name,
        load=file.load(),
    )
