"""Arcs of G-code: the centre and the signed angle of what I J K or R and the end point say.

Everything is in the arc's plane: (2,) points, with the angle positive from the first axis to the second.
"""

from dataclasses import dataclass
from math import atan2, copysign, dist, hypot, pi, sqrt

from kinematics.errors import MotionError
from planner.program import SAME

# The distances of the two ends from the centre may differ by ALWAYS_REFUSED, or if by more than ROUNDED (m) then by
# RELATIVE of the radius: what Grbl and LinuxCNC take for rounding of coordinates.
ALWAYS_REFUSED, ROUNDED, RELATIVE = 0.5e-3, 5e-6, 1e-3

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Found:
    """An arc from where the tool stands: its centre, signed angle (rad), and how far from its end point it ends (m)."""

    centre: Point
    angle: float
    off: float


def by_centre(stands: Point, start: Point, end: Point, offset: Point, clockwise: bool) -> Found:
    """About `start` + `offset`; a full circle where start and end are the same.

    stands  where the tool is, which an arc before it may have left a rounding beside `start`
    It keeps the radius that it stands at, so it ends on the line from the centre to the end point. Raises MotionError
    where the radii at both ends differ by more than rounding.
    """
    centre = start[0] + offset[0], start[1] + offset[1]
    first, last = ((p[0] - centre[0], p[1] - centre[1]) for p in (stands, end))
    radius, final = hypot(*first), hypot(*last)
    off = abs(radius - final)
    if min(radius, final) <= SAME:
        raise MotionError(f"its centre [{_mm(centre)}] mm is where it starts or ends; give one beside it, or R")
    if off > ALWAYS_REFUSED or off > max(ROUNDED, RELATIVE * max(radius, final)):
        raise MotionError(
            f"its start is {radius * 1e3:.6g} mm from the centre [{_mm(centre)}] mm and its end {final * 1e3:.6g} mm; "
            f"at most {min(ALWAYS_REFUSED, max(ROUNDED, RELATIVE * radius)) * 1e3:.4g} mm may lie between the two"
        )
    if dist(start, end) <= SAME:
        return Found(centre, -2 * pi if clockwise else 2 * pi, off)
    angle = atan2(first[0] * last[1] - first[1] * last[0], first[0] * last[0] + first[1] * last[1])
    if clockwise and angle >= 0:
        angle -= 2 * pi
    elif not clockwise and angle <= 0:
        angle += 2 * pi
    return Found(centre, angle, off)


def by_radius(stands: Point, start: Point, end: Point, radius: float, clockwise: bool) -> Found:
    """Of a radius: the way of at most half a turn, or for a negative radius the other; `stands` as by_centre has it.

    Raises MotionError where start and end are the same, or farther apart than the circle is wide.
    """
    over, up = end[0] - stands[0], end[1] - stands[1]
    half = hypot(over, up) / 2
    if half == 0 or dist(start, end) <= SAME:
        raise MotionError("R does not say which circle leads back to its start; give the centre by I J K")
    if half - abs(radius) > ROUNDED:
        raise MotionError(
            f"R {radius * 1e3:.6g} mm is too small: its ends are {2 * half * 1e3:.6g} mm apart, so give at least "
            f"{half * 1e3:.6g} mm"
        )
    height = sqrt(max(radius * radius - half * half, 0.0))
    # the centre of a counterclockwise arc of at most half a turn lies to the left of its chord
    side = copysign(height, radius) * (-1 if clockwise else 1) / (2 * half)
    centre = (stands[0] + end[0]) / 2 - up * side, (stands[1] + end[1]) / 2 + over * side
    short = 2 * atan2(half, height)
    angle = short if radius > 0 else 2 * pi - short
    return Found(centre, -angle if clockwise else angle, 0.0)


def _mm(point: Point) -> str:
    return ", ".join(f"{value * 1e3:.6g}" for value in point)
