"""Tables of what machines with legs share: rest axes, tilt, bodies."""

from math import pi
from typing import Annotated, Any

from pydantic import PlainValidator

from kinematics.clearance import Disc
from kinematics.kinds.poses import Home, Point
from kinematics.schema import Direction, Table, chosen
from kinematics.units import Unit


def _tilt_type(value: object) -> Any:
    return tuple[Tilt, Tilt] if isinstance(value, tuple) else Tilt


def rests(count: int) -> PlainValidator:
    """Annotation of rest axes: one direction, or one for each of so many joints."""
    each = tuple.__class_getitem__((Direction,) * count)

    def pick(value: object) -> Any:
        return each if isinstance(value, tuple) and value and isinstance(value[0], tuple) else Direction

    return chosen(pick)


Radius = Annotated[float, Unit("m", above=0)]
Thickness = Annotated[float, Unit("m", least=0)]
Tilt = Annotated[float, Unit("rad", above=0, most=pi)]


class Plate(Table):
    """A platform's disc, in the platform's own frame.

    radius     of the disc
    thickness  of the disc
    centre     half-way up its thickness
    normal     its axis
    """

    radius: Radius
    thickness: Thickness
    centre: Point = (0.0, 0.0, 0.0)
    normal: Direction = (0.0, 0.0, 1.0)

    @property
    def disc(self) -> Disc:
        return Disc(self.radius, self.thickness, self.centre, self.normal)


class Platforms(Table):
    """What the geometry of a machine with legs has however its joints are given; `rests` says how many axes.

    home           the pose from which travel and pulses count
    base_rest      the axis against which tilt of the base joints counts: one, or one for each; in the base frame, its z
                   if not stated
    platform_rest  the same of the platform joints, in the platform's frame
    max_tilt       of a joint from its rest axis: one angle, or two (base, platform)
    leg_radius     of a leg, a round bar: states that legs take up room
    leg_ends       how far the bar's ends stay from the joint centres
    base_disc      the base plate, as what takes up room
    platform_disc  the platform's plate
    """

    home: Home
    base_rest: tuple[Any, ...] | None = None
    platform_rest: tuple[Any, ...] | None = None
    max_tilt: Annotated[float | tuple[float, float], chosen(_tilt_type)] | None = None
    leg_radius: Radius | None = None
    leg_ends: Thickness | None = None
    base_disc: Plate | None = None
    platform_disc: Plate | None = None

    def options(self) -> dict[str, Any]:
        """The keywords that the machines take."""
        return {
            "home": self.home.pose,
            "base_rest": self.base_rest,
            "platform_rest": self.platform_rest,
            "max_tilt": self.max_tilt,
            "leg_radius": self.leg_radius,
            "leg_ends": self.leg_ends,
            "base_disc": self.base_disc.disc if self.base_disc else None,
            "platform_disc": self.platform_disc.disc if self.platform_disc else None,
        }
