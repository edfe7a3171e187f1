"""The hexapod: six legs of variable length between a base and a moving platform.

Its TOML has joints on circles, or one by one. Of the preset `hexapod`, the masses of the parts
stand here: the thesis [Sahbaz 2007] prints the mass of an actuator (241 g, Table 3.1) and its size
(43 × 43 × 162 mm), and the platform's plate (a disc 250 mm wide and 10 mm thick). ASSUMPTIONS:
everything else here. How the 241 g are shared and spread, the plate's aluminium, that joints weigh
nothing, and which way the universal joints are turned.
"""

from importlib.resources.abc import Traversable
from math import inf, nextafter, pi, tau
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from kinematics.files.keys import key
from kinematics.files.schema import one_of_tables
from kinematics.foundation.arrays import LEAST_POSITIVE, MAX_DISTANCE, Array, finite_array
from kinematics.foundation.options import check_arguments
from kinematics.foundation.units import Dimension, Unit
from kinematics.kinds.axis_keys import AXES, GEOMETRY, KIND, OWN_AXES, axes
from kinematics.kinds.leg_lengths import LegAxis, refuse_unreachable_home
from kinematics.kinds.legged import (
    BASE_REST,
    PLATFORM_REST,
    Legged,
    Platforms,
    Radius,
    legged_geometry,
    rest_axes_type,
)
from kinematics.kinds.load_keys import LEG_MASSES, LegsTable, LoadedFile, Point
from kinematics.machine.axis import Axis

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose


@check_arguments()
def joint_circle(radius: float, gap: float, height: float) -> Array:
    """Joint centres on a circle, paired: azimuths γ/2, 120°∓γ/2, 240°∓γ/2, −γ/2.

    Source: [Sahbaz 2007, chapter 5].

    Parameters
    ----------
    radius
        m, of the circle.
    gap
        rad, the angle γ between the two joints of a pair.
    height
        m, z of all centres.

    Returns
    -------
    Array
        (6, 3) m.

    Raises
    ------
    MotionError
        The radius is not above 0, or a number is out of range.
    """
    finite_array(
        radius, "joint_circle: radius", (), unit="m", least=LEAST_POSITIVE, most=MAX_DISTANCE
    )
    finite_array(gap, "joint_circle: gap", (), unit="rad", least=-tau, most=tau)
    finite_array(
        height, "joint_circle: height", (), unit="m", least=-MAX_DISTANCE, most=MAX_DISTANCE
    )
    third, half = np.deg2rad(120), gap / 2
    azimuth = np.array(
        [half, third - half, third + half, 2 * third - half, 2 * third + half, -half]
    )
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.full(6, height)], 1)


class Hexapod(Legged):
    """Six legs, six degrees of freedom: joint centres (6, 3) in base and platform frames, of any
    geometry.

    Everything else as `Legged` has it.
    """

    legs = 6
    sorts = ("linear",) * 6

    def assembly_modes(self, q: ArrayLike) -> "Pose":
        """Every pose with leg lengths q (6,), as far as they are found: see
        `kinematics.analysis.assembly_modes`.
        """
        from kinematics.analysis.assembly_modes import assembly_modes

        return assembly_modes(self, q)


# up to 120 deg, which the file's reader rounds otherwise than a product of floats does
Gap = Annotated[float, Unit("rad", least=0, most=nextafter(2 * pi / 3, inf))]
JOINT_ROWS = "give six rows [x, y, z], one for each leg, with decimal points"
SixPoints = tuple[Point, Point, Point, Point, Point, Point]
LEGS = tuple(f"leg{n}" for n in range(1, 7))


class LegTable(LegAxis):
    """What one leg has of its own."""

    name: Literal["leg1", "leg2", "leg3", "leg4", "leg5", "leg6"]


class SixLegs(Platforms):
    """Rest axes for six joints at either end."""

    base_rest: Annotated[tuple[Any, ...], rest_axes_type(6)] | None = BASE_REST
    platform_rest: Annotated[tuple[Any, ...], rest_axes_type(6)] | None = PLATFORM_REST


class JointCircles(SixLegs):
    """Joint centres in pairs on a circle of each platform; heights along z in the platform's own
    frame.
    """

    base_radius: Radius = key("radius of the circle through the base joints")
    base_gap: Gap = key("angle on that circle between the two joints of a pair")
    base_height: Dimension = key("z of the base joints in the base frame")
    platform_radius: Radius = key("radius of the circle through the platform joints")
    platform_gap: Gap = key("angle on that circle between the two joints of a pair")
    platform_height: Dimension = key("z of the platform joints in the platform frame")

    def joints(self) -> tuple[ArrayLike, ArrayLike]:
        return (
            joint_circle(self.base_radius, self.base_gap, self.base_height),
            joint_circle(self.platform_radius, self.platform_gap, self.platform_height),
        )


class JointPoints(SixLegs):
    """Joint centres one by one, each in the frame of its platform."""

    base_joints: SixPoints = key(
        "centres of the base joints in the base frame: x, y, z of leg1 to leg6", remedy=JOINT_ROWS
    )
    platform_joints: SixPoints = key(
        "centres of the platform joints in the platform's own frame: x, y, z of leg1 to leg6",
        remedy=JOINT_ROWS,
    )

    def joints(self) -> tuple[ArrayLike, ArrayLike]:
        return self.base_joints, self.platform_joints


class HexapodFile(LoadedFile):
    """A hexapod's TOML, key by key."""

    first_place = (0, 0, 25)
    kind: Literal["hexapod"] = KIND
    geometry: Annotated[JointCircles | JointPoints, one_of_tables(JointCircles, JointPoints)] = (
        GEOMETRY
    )
    axes: LegAxis = AXES
    axis: tuple[LegTable, ...] = OWN_AXES
    legs: LegsTable | None = LEG_MASSES

    def list_freedom(self) -> tuple[str, ...]:
        return Hexapod.freedom

    def list_axes(self) -> list[Axis]:
        return axes(
            LEGS, dict.fromkeys(LEGS, self.axes), self.axis, self, self.geometry.home_lengths
        )

    @staticmethod
    def geometry_of(machine: Hexapod, complete: bool) -> dict[str, Any]:
        return legged_geometry(machine, np.zeros(3), complete)


def build_hexapod(file: HexapodFile, name: str, folder: Path | Traversable) -> Hexapod:
    base, platform = file.geometry.joints()
    load = file.load(file.legs)
    machine = Hexapod(
        base, platform, axes=file.list_axes(), name=name, load=load, **file.geometry.options()
    )
    refuse_unreachable_home(machine, file.axes, {table.name: table for table in file.axis})
    return machine
