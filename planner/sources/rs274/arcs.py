"""Of arcs of G-code: the centre and the signed angle that I J K or R, P and the end point say, in the arc's plane.

Points are (2,) there, and angles positive from its first axis to its second.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import atan2, copysign, dist, hypot, pi, sqrt

from kinematics.foundation.errors import MotionError
from planner.program.model import MIN_MOVE
from planner.sources.rs274.words import WordFault

PLANES = {17.0: (0, 1, 2), 18.0: (2, 0, 1), 19.0: (1, 2, 0)}
"""First and second axis of the plane, and its normal."""
OFFSETS, MAX_TURNS = "IJK", 1000

# The distances of the two ends from the centre may differ by ALWAYS_REFUSED, or if by more than ROUNDED (m) then by
# RELATIVE of the radius: what Grbl and LinuxCNC take for rounding of coordinates.
ALWAYS_REFUSED, ROUNDED, RELATIVE = 0.5e-3, 5e-6, 1e-3

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class ArcFit:
    """An arc from where the tool stands: its centre, signed angle (rad), and how far from its end point it ends (m)."""

    centre: Point
    angle: float
    off: float


def arc_by_centre(
    stands: Point, start: Point, end: Point, offset: Point, clockwise: bool, most: float | None = None
) -> ArcFit:
    """About `start` + `offset`; a full circle where start and end are the same.

    stands  where the tool is, which an arc before it may have left a rounding beside `start`
    most    m, by which the radii may differ; None: as rounding makes them
    It keeps the radius that it stands at, so it ends on the line from the centre to the end point. Raises MotionError
    where the radii at both ends differ by more than rounding.
    """
    centre = start[0] + offset[0], start[1] + offset[1]
    first, last = ((p[0] - centre[0], p[1] - centre[1]) for p in (stands, end))
    radius, final = hypot(*first), hypot(*last)
    off = abs(radius - final)
    if min(radius, final) <= MIN_MOVE:
        raise MotionError(f"its centre [{_mm(centre)}] mm is its start or end point; give another centre, or R")
    allowed = min(ALWAYS_REFUSED, max(ROUNDED, RELATIVE * max(radius, final))) if most is None else most
    if off > allowed:
        raise MotionError(
            f"its start is {radius * 1e3:.6g} mm from the centre [{_mm(centre)}] mm and its end {final * 1e3:.6g} mm; "
            f"at most {allowed * 1e3:.4g} mm may lie between the two, or what the option arc_tolerance says"
        )
    if dist(start, end) <= MIN_MOVE:
        return ArcFit(centre, -2 * pi if clockwise else 2 * pi, off)
    angle = atan2(first[0] * last[1] - first[1] * last[0], first[0] * last[0] + first[1] * last[1])
    if clockwise and angle >= 0:
        angle -= 2 * pi
    elif not clockwise and angle <= 0:
        angle += 2 * pi
    return ArcFit(centre, angle, off)


def arc_by_radius(stands: Point, start: Point, end: Point, radius: float, clockwise: bool) -> ArcFit:
    """Of a radius: the way of at most half a turn, or for a negative radius the other.

    stands  as in `arc_by_centre`
    Raises MotionError where start and end are the same, or farther apart than the circle is wide.
    """
    over, up = end[0] - stands[0], end[1] - stands[1]
    half = hypot(over, up) / 2
    if half == 0 or dist(start, end) <= MIN_MOVE:
        raise MotionError("R does not define a full circle; give its centre with I J K")
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
    return ArcFit(centre, -angle if clockwise else angle, 0.0)


def _mm(point: Point) -> str:
    return ", ".join(f"{value * 1e3:.6g}" for value in point)


def read_arc(
    values: Mapping[str, float],
    clockwise: bool,
    plane: float,
    unit: float,
    from_start: bool,
    points: tuple[Sequence[float], Sequence[float], Sequence[float]],
    most: float | None = None,
) -> ArcFit:
    """The arc that a block's words say. Raises WordFault, or MotionError as `arc_by_centre` and `arc_by_radius`.

    unit        m, of the numbers; from_start: I J K count from where the arc begins
    points      (3,) each, m: where the tool is, where the blocks before lead to, and where this one does
    most        as of `arc_by_centre`
    """
    first, second, normal = PLANES[plane]
    word = f"G{2 if clockwise else 3}"
    offsets = values.keys() & set(OFFSETS)
    if ("R" in values) == bool(offsets):
        raise WordFault("R" if offsets else "", f"{word} needs either its centre I J K or its radius R")
    if OFFSETS[normal] in offsets:
        raise WordFault(OFFSETS[normal], f"{OFFSETS[normal]} is outside the plane of G{plane:.0f}")
    stands, start, end = ((p[first], p[second]) for p in points)
    if offsets:
        said = [values.get(OFFSETS[k], 0.0 if from_start else None) for k in (first, second)]
        if None in said:
            raise WordFault("", f"G90.1 asks for both {OFFSETS[first]} and {OFFSETS[second]}")
        offset = [(value or 0.0) * unit - (0.0 if from_start else at) for value, at in zip(said, start, strict=True)]
        arc = arc_by_centre(stands, start, end, (offset[0], offset[1]), clockwise, most)
    else:
        arc = arc_by_radius(stands, start, end, values["R"] * unit, clockwise)
    turns = values.get("P", 1.0)
    if turns not in range(1, MAX_TURNS + 1):
        raise WordFault("P", f"{word} takes P, its number of turns, from 1 to {MAX_TURNS}")
    return replace(arc, angle=arc.angle + copysign(2 * pi * (turns - 1), arc.angle))
