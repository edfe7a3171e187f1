"""Tables of what a machine moves, which every kind's file may have: `[platform]`, `[legs]` and `gravity`.

Tables of poses and points that several kinds' files share.
"""

from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.files.schema import Direction, TableSchema, chosen
from kinematics.foundation.errors import MotionError, validation_error
from kinematics.foundation.units import Angle, Length, Unit
from kinematics.kinds.axis_tables import MachineFile
from kinematics.machine.load import GRAVITY, Body, Leg, Load
from kinematics.machine.pose import Pose

Point = tuple[Length, Length, Length]


class HomeTable(TableSchema):
    """The pose from which travel and pulses count: a position, turned by θx, θy, θz about the moving axes in turn.

    to      the platform's origin in the base frame
    rotate  θx, θy, θz about the moving axes in turn
    """

    to: Point
    rotate: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> Pose:
        return RigidTransform.from_components(self.to, Rotation.from_euler("XYZ", self.rotate))


Moment = Annotated[float, Unit("kg*m^2")]
Moments = tuple[Moment, Moment, Moment]
Pull = Annotated[float, Unit("m/s^2")]
Push = Annotated[float, Unit("N")]
Twist = Annotated[float, Unit("N*m")]


def _moments(value: object) -> Any:
    rows = isinstance(value, tuple) and value and isinstance(value[0], tuple)
    return tuple[Moments, Moments, Moments] if rows else Moments


class Mass(TableSchema):
    """A body in the frame of its part.

    mass     of the body
    centre   its centre of mass
    inertia  about the centre of mass: the moments about the axes, or all nine in rows
    """

    mass: Annotated[float, Unit("kg", least=0)]
    centre: Point = (0.0, 0.0, 0.0)
    inertia: Annotated[Any, chosen(_moments)] = (0.0, 0.0, 0.0)

    def body(self, name: str) -> Body:
        given = np.asarray(self.inertia, float)
        return Body(self.mass, np.asarray(self.centre), np.diag(given) if given.ndim == 1 else given, name)


def _check_body(table: Mass) -> Mass:
    try:
        table.body("body")
    except MotionError as error:
        raise validation_error(str(error)) from None
    return table


BodyTable = Annotated[Mass, AfterValidator(_check_body)]


class Carried(Mass):
    """The platform (or tool), and what pushes on it from outside at its origin, in the base frame.

    force   that pushes on the platform's origin, in the base frame
    moment  likewise
    """

    mass: Annotated[float, Unit("kg", least=0)] = 0.0
    force: tuple[Push, Push, Push] = (0.0, 0.0, 0.0)
    moment: tuple[Twist, Twist, Twist] = (0.0, 0.0, 0.0)


class LegsTable(TableSchema):
    """The two parts of every leg: barrel in a frame at the base joint, rod at the platform joint, z along the leg.

    barrel      what turns about the base joint
    rod         what also slides, up to the platform joint
    first_axis  the axis of the base joint that stands still in the base frame; chosen if not stated
    """

    barrel: BodyTable
    rod: BodyTable
    first_axis: Direction | None = None


class LoadedFile(MachineFile):
    """What every machine's file may say of its masses; gravity points down a base that stands upright.

    platform  what the platform (or tool) weighs and bears
    gravity   its acceleration, in the base frame
    legs      what the legs weigh
    """

    platform: Annotated[Carried, AfterValidator(_check_body)] | None = None
    gravity: tuple[Pull, Pull, Pull] = GRAVITY

    def load(self, legs: LegsTable | None = None) -> Load:
        platform = Carried() if self.platform is None else self.platform
        parts: tuple[Leg, ...] = ()
        if legs is not None:
            axis = None if legs.first_axis is None else np.asarray(legs.first_axis)
            parts = (Leg(legs.barrel.body("barrel"), legs.rod.body("rod"), axis),)
        wrench = np.array([*platform.force, *platform.moment])
        return Load(platform.body("platform"), parts, np.asarray(self.gravity), wrench)
