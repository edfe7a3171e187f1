"""What segments say beside where they lead: how they join, events along them, freedom of
orientation.
"""

from dataclasses import dataclass, field
from math import pi, radians

from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_fields
from kinematics.foundation.units import Angle, Length
from planner.program.validation import check_positive, legible


@dataclass(frozen=True, slots=True)
class Stop:
    """A join at which the motion stops.

    stated  whether somebody asked for the stop; False: nothing was said of the join
    """

    stated: bool = field(default=True, compare=False)


@dataclass(frozen=True, slots=True)
class Through:
    """A join without a stop where the path is smooth enough for the motion's order, else a stop.

    Order 2 needs a common tangent (and turning rate), order 3 a common curvature too.
    """


@dataclass(frozen=True, slots=True)
class Blend:
    """A rounded join: it deviates from the programmed corner by at most `tolerance` (m), and
    `angle` (rad).

    angle  None: what turns points at the machine's characteristic length by the tolerance
    """

    tolerance: Length
    angle: Angle | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        check_positive("blend", "tolerance", self.tolerance, "m")
        check_positive("blend", "angle", self.angle, "rad")

    def angle_at(self, characteristic: float) -> float:
        """The tolerance of the orientation, rad, where so many m count like a radian."""
        return self.tolerance / characteristic if self.angle is None else self.angle


CORNER_ANGLE = radians(35)
"""Between two directions, above which a fit keeps a corner unless it says another."""


@dataclass(frozen=True, slots=True)
class Fit:
    """A join in a chain that becomes a smooth curve, within `tolerance` (m) and `angle` (rad) of
    what is programmed.

    angle   None: what turns points at the machine's characteristic length by the tolerance
    corner  rad between two directions above which the join stays a corner, that is rounded like a
            `Blend`
    stop    whether the motion rests at such a corner instead
    (planner.path.fit)
    """

    tolerance: Length
    angle: Angle | None = None
    corner: Angle = CORNER_ANGLE
    stop: bool = False

    def __post_init__(self) -> None:
        check_fields(self)
        check_positive("fit", "tolerance", self.tolerance, "m")
        check_positive("fit", "angle", self.angle, "rad")
        check_positive("fit", "corner", self.corner, "rad")

    def angle_at(self, characteristic: float) -> float:
        """The tolerance of the orientation, rad, where so many m count like a radian."""
        return self.tolerance / characteristic if self.angle is None else self.angle


Join = Stop | Through | Blend | Fit
STOP = Stop(stated=False)
"""The join where nothing is said."""


def choose_join(name: str, blend: float | None, fit: float | None) -> Join:
    """The join that options say: fitted or rounded within a tolerance (m), or by name, "stop" or
    "through".

    Raises MotionError where both tolerances are given.
    """
    if blend is not None and fit is not None:
        raise MotionError(
            "blend and fit exclude each other: a fit blends the corners that it keeps; omit blend"
        )
    if fit is not None:
        return Fit(fit)
    return Blend(blend) if blend is not None else Stop() if name == "stop" else Through()


@dataclass(frozen=True, slots=True)
class Trigger:
    """A named event at a position: a share of the tool path of its segment (1: its end).

    Where the segment only turns the tool, at a share of the angle; where it is a dwell, of its
    time.

    after_rest  at the start of the segment, when the motion goes on from a rest there, not when it
                comes to it
    """

    name: str
    at: float = 1.0
    after_rest: bool = False

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.name:
            raise MotionError(
                "trigger: its name is empty; give the name of the output line or event"
            )
        legible("trigger", "its name", self.name)
        if not 0 <= self.at <= 1:
            raise MotionError(
                f"trigger {self.name}: at {self.at} must be a share of its segment, from 0 to 1"
            )
        if self.after_rest and self.at != 0:
            raise MotionError(
                f"trigger {self.name}: after_rest is of the start of its segment: give at = 0 with it"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Free:
    """Free orientation of a segment: the rotation about the tool's z axis, and a tilt of that axis.

    yaw       whether the turn is free
    tilt      rad by which the axis may lean from where the program has it, any way; 0: not at all
    controls  what was chosen, as `planner.path.shape` has it; None: nothing yet
    """

    yaw: bool = True
    tilt: Angle = 0.0
    controls: Array | None = None

    def __post_init__(self) -> None:
        check_fields(self, "controls")
        if not 0 <= self.tilt < pi / 2:
            raise MotionError(
                f"free: tilt {self.tilt} rad must not be negative, and be less than a right angle"
            )
        if not self.yaw and self.tilt == 0:
            raise MotionError("free: free yaw, a tilt, or both; otherwise omit free")
        if self.controls is not None:
            object.__setattr__(
                self, "controls", freeze_array(finite_array(self.controls, "free: controls"))
            )
