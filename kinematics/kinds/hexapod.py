"""A hexapod's TOML: joints on circles, or one by one."""

from importlib.resources.abc import Traversable
from math import inf, nextafter, pi
from pathlib import Path
from typing import Annotated, Any, Literal

from numpy.typing import ArrayLike

from kinematics.hexapod import Hexapod, joint_circle
from kinematics.kinds.axes import LinearAxis, LinearDefaults, axes
from kinematics.kinds.legs import Platforms, Radius, rests
from kinematics.kinds.masses import Legs, LoadedFile
from kinematics.kinds.poses import Point
from kinematics.schema import either
from kinematics.units import Length, Unit

# up to 120 deg, which the file's reader rounds otherwise than a product of floats does
Gap = Annotated[float, Unit("rad", least=0, most=nextafter(2 * pi / 3, inf))]
SixPoints = tuple[Point, Point, Point, Point, Point, Point]
LEGS = tuple(f"leg{n}" for n in range(1, 7))


class Leg(LinearAxis):
    """What one leg has of its own."""

    name: Literal["leg1", "leg2", "leg3", "leg4", "leg5", "leg6"]


class SixLegs(Platforms):
    """Rest axes for six joints at either end."""

    base_rest: Annotated[tuple[Any, ...], rests(6)] | None = None
    platform_rest: Annotated[tuple[Any, ...], rests(6)] | None = None


class JointCircles(SixLegs):
    """Joint centres in pairs on a circle of each platform; heights along z in the platform's own frame.

    base_radius      of the circle of the base joints
    base_gap         angle between the two closest joints
    base_height      of the circle above the base frame's origin
    platform_radius  of the circle of the platform joints
    platform_gap     angle between the two closest joints
    platform_height  of the circle above the platform frame's origin
    """

    base_radius: Radius
    base_gap: Gap
    base_height: Length
    platform_radius: Radius
    platform_gap: Gap
    platform_height: Length

    def joints(self) -> tuple[ArrayLike, ArrayLike]:
        return (
            joint_circle(self.base_radius, self.base_gap, self.base_height),
            joint_circle(self.platform_radius, self.platform_gap, self.platform_height),
        )


class JointPoints(SixLegs):
    """Joint centres one by one, each in the frame of its platform.

    base_joints      centres in the base frame, leg by leg
    platform_joints  centres in the platform's frame
    """

    base_joints: SixPoints
    platform_joints: SixPoints

    def joints(self) -> tuple[ArrayLike, ArrayLike]:
        return self.base_joints, self.platform_joints


class HexapodFile(LoadedFile):
    """A hexapod's TOML, key by key."""

    kind: Literal["hexapod"]
    geometry: Annotated[JointCircles | JointPoints, either(JointCircles, JointPoints)]
    axes: LinearDefaults
    axis: tuple[Leg, ...] = ()
    legs: Legs | None = None


def hexapod(file: HexapodFile, name: str, folder: Path | Traversable) -> Hexapod:
    base, platform = file.geometry.joints()
    own = axes(LEGS, dict.fromkeys(LEGS, file.axes), file.axis, file)
    return Hexapod(base, platform, axes=own, name=name, load=file.load(file.legs), **file.geometry.options())
