"""A tripod's TOML."""

from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal

from kinematics.kinds.axes import LinearAxis, LinearDefaults, axes
from kinematics.kinds.legs import Platforms, rests
from kinematics.kinds.masses import Legs, LoadedFile
from kinematics.kinds.poses import Point
from kinematics.tripod import Tripod

ARMS = tuple(f"arm{n}" for n in range(1, 4))


class Geometry(Platforms):
    """Joint centres one by one, each in the frame of its platform; tool: its centre in the plate's frame.

    base_joints      centres in the base frame, arm by arm
    platform_joints  centres in the plate's frame
    tool             the tool's centre, in the plate's frame
    """

    base_rest: Annotated[tuple[Any, ...], rests(3)] | None = None
    platform_rest: Annotated[tuple[Any, ...], rests(3)] | None = None
    base_joints: tuple[Point, Point, Point]
    platform_joints: tuple[Point, Point, Point]
    tool: Point = (0.0, 0.0, 0.0)


class Own(LinearAxis):
    """What one arm has of its own."""

    name: Literal["arm1", "arm2", "arm3"]


class TripodFile(LoadedFile):
    """A tripod, key by key."""

    kind: Literal["tripod"]
    geometry: Geometry
    axes: LinearDefaults
    axis: tuple[Own, ...] = ()
    legs: Legs | None = None


def tripod(file: TripodFile, name: str, folder: Path | Traversable) -> Tripod:
    geometry = file.geometry
    return Tripod(
        geometry.base_joints,
        geometry.platform_joints,
        axes=axes(ARMS, dict.fromkeys(ARMS, file.axes), file.axis, file),
        tool=geometry.tool,
        name=name,
        load=file.load(file.legs),
        **geometry.options(),
    )
