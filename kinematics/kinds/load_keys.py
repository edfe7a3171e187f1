"""Tables that the files of several kinds have: poses, points, and what a machine moves
(`[platform]`, `[legs]`).
"""

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import AfterValidator

from kinematics.files.keys import Chosen, key
from kinematics.files.schema import Direction, TableSchema
from kinematics.foundation.errors import MotionError, validation_error
from kinematics.foundation.rotations import find_angles
from kinematics.foundation.units import Angle, Dimension, Unit
from kinematics.kinds.axis_keys import MachineFile
from kinematics.machine.load import GRAVITY, Body, Leg, Load

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine

Point = tuple[Dimension, Dimension, Dimension]


class HomeTable(TableSchema):
    """The pose from which travel and pulses count: a position, turned by θx, θy, θz about the
    moving axes in turn.
    """

    to: Point = key("position of the platform's origin in the base frame", remedy="give x, y, z")
    rotate: tuple[Angle, Angle, Angle] = key(
        "orientation: θx, θy, θz about the moving axes in turn", default=(0.0, 0.0, 0.0)
    )

    @property
    def numbers(self) -> tuple[float, ...]:
        """x, y, z (m), θx, θy, θz (rad)."""
        return (*self.to, *self.rotate)


HOME = key(
    'home pose in the base frame: zero of travel and pulses; may be turned: rotate = ["0 deg", …]'
)


def home_entries(machine: "Machine") -> dict[str, Any]:
    """Return the entries of the table of a machine's home."""
    (home,) = machine.home_numbers
    (angles,) = find_angles(home[3:].reshape(1, 3, 3))
    return {"to": home[:3], "rotate": angles + 0.0}


Moment = Annotated[float, Unit("kg*m^2")]
Moments = tuple[Moment, Moment, Moment]
Pull = Annotated[float, Unit("m/s^2", file_unit="m/s^2")]
Push = Annotated[float, Unit("N")]
Twist = Annotated[float, Unit("N*m")]


def _moments(value: object) -> Any:
    rows = isinstance(value, tuple) and value and isinstance(value[0], tuple)
    return tuple[Moments, Moments, Moments] if rows else Moments


class Mass(TableSchema):
    """A body in the frame of its part."""

    mass: Annotated[float, Unit("kg", least=0)] = key("mass of the part")
    centre: Point = key(
        "centre of mass in the frame of the part", '["0 mm", "0 mm", "10 mm"]', (0.0, 0.0, 0.0)
    )
    inertia: Annotated[Any, Chosen(_moments)] = key(
        "moments of inertia about the centre of mass: Ixx, Iyy, Izz, or the rows of the matrix",
        '["0.01 kg*m^2", "0.01 kg*m^2", "0.02 kg*m^2"]',
        (0.0, 0.0, 0.0),
    )

    def body(self, name: str) -> Body:
        given = np.asarray(self.inertia, float)
        return Body(
            self.mass, np.asarray(self.centre), np.diag(given) if given.ndim == 1 else given, name
        )


def _check_body(table: Mass) -> Mass:
    try:
        table.body("body")
    except MotionError as error:
        raise validation_error(str(error)) from None
    return table


BodyTable = Annotated[Mass, AfterValidator(_check_body)]


class Carried(Mass):
    """The platform (or tool), and what pushes on it from outside at its origin, in the base
    frame.
    """

    mass: Annotated[float, Unit("kg", least=0)] = key(
        "mass of platform, tool and load", '"1.5 kg"', 0.0
    )
    force: tuple[Push, Push, Push] = key(
        "external force on the platform's origin, in the base frame",
        '["0 N", "0 N", "-10 N"]',
        (0.0, 0.0, 0.0),
    )
    moment: tuple[Twist, Twist, Twist] = key(
        "external moment, in the base frame", '["0 N*m", "0 N*m", "0 N*m"]', (0.0, 0.0, 0.0)
    )


_INERTIA = 'inertia = ["0 kg*m^2", "0 kg*m^2", "0 kg*m^2"]'


class LegsTable(TableSchema):
    """The two parts of every leg: barrel in a frame at the base joint, rod at the platform joint, z
    along the leg.
    """

    barrel: BodyTable = key(
        "part of the leg at the base; its frame is at the base joint, z along the leg",
        f'{{ mass = "0.5 kg", centre = ["0 mm", "0 mm", "50 mm"], {_INERTIA} }}',
    )
    rod: BodyTable = key(
        "part of the leg at the platform; its frame is at the platform joint, z along the leg",
        f'{{ mass = "0.1 kg", centre = ["0 mm", "0 mm", "-50 mm"], {_INERTIA} }}',
    )
    first_axis: Direction | None = key(
        "first axis of the universal joint, fixed in the base frame", "[1, 0, 0]", None
    )


LEG_MASSES = key("masses of the two parts of each leg", default=None)


class LoadedFile(MachineFile):
    """Keys of masses that every machine's file may have; gravity points down the kind's vertical,
    −z of most.
    """

    platform: Annotated[Carried, AfterValidator(_check_body)] | None = key(
        "mass that the machine moves; max_force and torque_speed need it", default=None
    )
    gravity: tuple[Pull, Pull, Pull] | None = key(
        "gravity in the base frame; this value if not stated",
        '["0 m/s^2", "0 m/s^2", "-9.80665 m/s^2"]',
        GRAVITY,
    )

    def load(self, legs: LegsTable | None = None) -> Load:
        platform = Carried() if self.platform is None else self.platform
        parts: tuple[Leg, ...] = ()
        if legs is not None:
            axis = None if legs.first_axis is None else np.asarray(legs.first_axis)
            parts = (Leg(legs.barrel.body("barrel"), legs.rod.body("rod"), axis),)
        wrench = np.array([*platform.force, *platform.moment])
        gravity = None if self.gravity is None else np.asarray(self.gravity)
        return Load(platform.body("platform"), parts, gravity, wrench)
