"""What a program may give: points, directions and magnitudes that make sense, or a refusal that
says what is wanted.
"""

from collections.abc import Mapping
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinematics.files.plain_text import describe_control_character
from kinematics.foundation.arrays import (
    MAX_DISTANCE,
    MAX_TURNS,
    MIN_MAGNITUDE,
    Array,
    freeze_array,
    most,
)
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_fields, fits

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose

CAPS = {"speed": "m/s", "acceleration": "m/s²", "angular_speed": "rad/s", "max_tool_jerk": "m/s³"}
"""What segments may cap, as far as they have it, and its unit."""
MAX_REPEATS, MOST_SEGMENTS = 1_000_000, 1_000_000
"""Of a program: how often it may be run, and the segments that this comes to."""
UNIT_VECTOR_ROUNDING = 4 * float(np.finfo(float).eps)
"""By which an entry of a unit vector may be off: of a norm of three squares and the division by it,
twice.
"""


def check_point(segment: str, name: str, value: ArrayLike) -> Array:
    """Three finite numbers."""
    try:
        found = freeze_array(value, float)
    except (TypeError, ValueError, OverflowError):
        found = freeze_array([])
    if found.shape != (3,) or not all(
        map(isfinite, found.tolist())
    ):  # of three numbers, sooner than numpy
        raise MotionError(f"{segment}: {name} must be three finite numbers, not {value!r}")
    return found


def check_place(segment: str, name: str, value: ArrayLike) -> Array:
    """A point (3,) in m that is not farther away than any machine reaches."""
    found = check_point(segment, name, value)
    _refuse_far(segment, name, max(map(abs, found.tolist())))
    return found


def _refuse_far(segment: str, name: str, farthest: float) -> None:
    if farthest > MAX_DISTANCE:
        raise MotionError(
            f"{segment}: {name} lies {farthest:g} m away; at most {MAX_DISTANCE:g} m can be taken"
        )


def check_angle(segment: str, angle: float) -> None:
    """An angle (rad) that is none, or of more turns than can be taken."""
    if not isfinite(angle) or angle == 0:
        raise MotionError(f"{segment}: angle {angle} rad must be finite and not zero")
    if abs(angle) > most("rad"):
        turns = abs(angle) / (2 * np.pi)
        raise MotionError(
            f"{segment}: angle {angle:g} rad is {turns:g} turns; at most {MAX_TURNS} can be taken"
        )


def check_points(segment: str, name: str, value: ArrayLike) -> Array:
    """(N, 3) of them, at least one."""
    try:
        found = freeze_array(value, float)
    except (TypeError, ValueError, OverflowError):
        found = freeze_array([])
    if found.ndim != 2 or found.shape[1:] != (3,) or not len(found) or not np.isfinite(found).all():
        raise MotionError(
            f"{segment}: {name} must be points of three finite numbers, at least one, not {value!r:.100}"
        )
    _refuse_far(segment, name, float(np.abs(found).max()))
    return found


def unit_direction(segment: str, name: str, value: ArrayLike) -> Array:
    """A unit vector (3,) of one of any length; of one that is a unit vector to rounding, itself: so
    files keep it.
    """
    given = check_point(segment, name, value)
    largest = np.abs(given).max()
    if largest == 0:
        raise MotionError(
            f"{segment}: {name} is zero; give the direction of the axis, e.g. [0, 0, 1]"
        )
    scaled = given / largest  # the norm of very large or very small vectors would overflow
    unit = scaled / np.linalg.norm(scaled)
    return freeze_array(given if np.abs(given - unit).max() <= UNIT_VECTOR_ROUNDING else unit)


def check_rotation(segment: object, what: str, name: str, *count: int) -> None:
    """Make an orientation that a frozen segment states a Rotation; count: of how many, one by
    default.
    """
    if (given := getattr(segment, name)) is not None:
        from kinematics.machine.pose import read_rotation

        turned = read_rotation(f"{what}: {name}", given, *count)
        if not count and not turned.single:
            raise MotionError(
                f"{what}: {name} must be one rotation, not {len(turned)}; index the one that is meant"
            )
        object.__setattr__(segment, name, turned)


def read_constants(given: object) -> tuple[tuple[str, float], ...]:
    """Names and numbers of a mapping, or of a row of pairs."""
    pairs = tuple(given.items()) if isinstance(given, Mapping) else given
    if not isinstance(pairs, tuple | list) or not all(
        isinstance(pair, tuple | list)
        and len(pair) == 2
        and isinstance(pair[0], str)
        and fits(pair[1], float)
        for pair in pairs
    ):
        raise MotionError(
            f"curve: constants are {given!r:.60}; expected names and numbers, as {{'r': 0.02}}"
        )
    return tuple(dict(pairs).items())


def check_frame(what: str, given: object) -> "Pose":
    """One pose, or the numbers of one."""
    from kinematics.machine.pose import read_pose

    pose = read_pose(what, given)
    if not pose.single:
        raise MotionError(f"{what} must be one pose, not {len(pose)}; index the one that is meant")
    return pose


def check_positive(segment: str, name: str, value: float | None, unit: str) -> None:
    """A magnitude, or nothing."""
    if value is not None and not (isfinite(value) and value > 0):
        raise MotionError(f"{segment}: {name} {value} {unit} must be positive and finite")
    if value is not None and not MIN_MAGNITUDE <= value <= most(unit):
        limit = (
            f"at most {most(unit):g}" if value > MIN_MAGNITUDE else f"at least {MIN_MAGNITUDE:g}"
        )
        raise MotionError(f"{segment}: {name} {value:g} {unit} cannot be taken, {limit} {unit} can")


def legible(segment: str, name: str, value: str | None) -> None:
    """A name that a file may state, or none."""
    if value is not None and (told := describe_control_character(value)):
        raise MotionError(f"{segment}: {name} {told}")


def check_caps(stated: object, what: str, *but: str) -> None:
    """The kinds of all fields but those named, the caps that are stated, and the speed that a
    constant one needs.
    """
    check_fields(stated, *but)
    for name, unit in CAPS.items():
        if (value := getattr(stated, name, None)) is not None:
            check_positive(what, name, value, unit)
    if getattr(stated, "speed_constant", False) and getattr(stated, "speed", None) is None:
        raise MotionError(f"{what}: speed_constant needs a speed: give speed too")


def repeats(number: int) -> str:
    """What to say of a spline whose point of a number, from 1, is its next one as well."""
    return f"points {number} and {number + 1} are the same; omit one of them"
