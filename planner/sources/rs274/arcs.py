"""Arcs of G-code: the centre and the signed angle that I J K or R, P and the end point state.

Points are (2,) there, and angles positive from its first axis to its second.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import atan2, copysign, dist, hypot, pi, sqrt

from kinematics.foundation.errors import MotionError
from planner.program.model import MIN_MOVE
from planner.sources.rs274.modes import Modes
from planner.sources.rs274.words import WordFault

PLANES = {17.0: (0, 1, 2), 18.0: (2, 0, 1), 19.0: (1, 2, 0)}
"""First and second axis of the plane, and its normal."""
OFFSETS, MAX_TURNS = "IJK", 1000

# The distances of the two ends from the centre may differ by ALWAYS_REFUSED, or if by more than
# ROUNDED (m) then by RELATIVE of the radius: what Grbl and LinuxCNC take for rounding.
ALWAYS_REFUSED, ROUNDED, RELATIVE = 0.5e-3, 5e-6, 1e-3

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Way:
    """Points of a block: of the tool, of the end of the blocks before, and of its own end.

    An arc may have left the tool a rounding from `start`. Coordinates in m: x, y, z first, or of
    the arc's plane.
    """

    tool: Sequence[float]
    start: Sequence[float]
    end: Sequence[float]

    def project(self, first: int, second: int) -> "Way":
        """Return the same points in a plane."""
        tool, start, end = ((p[first], p[second]) for p in (self.tool, self.start, self.end))
        return Way(tool, start, end)


@dataclass(frozen=True, slots=True)
class ArcFit:
    """An arc from where the tool is.

    angle  rad, with its sign;  off: m from where it ends to its end point
    """

    centre: Point
    angle: float
    off: float


def arc_by_centre(way: Way, centre: Point, clockwise: bool, most: float | None = None) -> ArcFit:
    """Return the arc about a centre; a full circle if start and end are the same.

    most  m, by which the radii may differ; None: as rounding makes them
    The sense of travel and the points of the file decide the angle (`_sweep`). The arc keeps the
    radius at which the tool is, so it ends on the line from the centre to the end point. Raises
    MotionError if the radii at both ends differ by more than rounding.
    """
    radius, final = dist(way.tool, centre), dist(way.end, centre)
    off = abs(radius - final)
    if min(radius, final) <= MIN_MOVE:
        raise MotionError(
            f"its centre [{_mm(centre)}] mm is its start or end point; give another centre, or R",
        )
    rounding = min(ALWAYS_REFUSED, max(ROUNDED, RELATIVE * max(radius, final)))
    allowed = rounding if most is None else most
    if off > allowed:
        raise MotionError(
            f"its start is {radius * 1e3:.6g} mm from the centre [{_mm(centre)}] mm and its end "
            f"{final * 1e3:.6g} mm; at most {allowed * 1e3:.4g} mm may lie between the two, or what "
            "the option arc_tolerance says"
        )
    return ArcFit(centre, _sweep(way, centre, clockwise), off)


def _sweep(way: Way, centre: Point, clockwise: bool) -> float:
    """Return the signed angle from the tool to the line from the centre to the end point.

    The points of the file state the angle. The tool may be farther from the start than the arc is
    long: an arc that would have to run backwards then runs by the angle that the file states.
    """
    sense = -1.0 if clockwise else 1.0
    if dist(way.start, way.end) <= MIN_MOVE:
        return sense * 2 * pi
    stated = sense * _angle(centre, way.start, way.end)
    if stated <= 0:
        # a full circle but for a gap, or a short arc whose points are rounded: the gap decides
        radius = dist(way.start, centre)
        gap = abs(stated) * radius
        rounding = abs(radius - dist(way.end, centre))
        if gap <= rounding:
            raise MotionError(
                f"its start and end are {gap * 1e6:.3g} um apart along the arc, and "
                f"{rounding * 1e6:.3g} um across it: it may be a full circle or nothing; give both "
                "points the same coordinates, or take the block out"
            )
        stated += 2 * pi
    angle = stated + sense * _angle(centre, way.tool, way.start)
    return sense * (angle if angle > 0 else stated)


def _angle(centre: Sequence[float], begin: Sequence[float], end: Sequence[float]) -> float:
    """Return the angle about a centre from one point to another, above -π and up to π."""
    a, b = begin[0] - centre[0], begin[1] - centre[1]
    c, d = end[0] - centre[0], end[1] - centre[1]
    return atan2(a * d - b * c, a * c + b * d)


def arc_by_radius(way: Way, radius: float, clockwise: bool) -> ArcFit:
    """Return the arc of a radius: of at most half a turn, or for a negative radius the other.

    Raises MotionError if start and end are the same, or farther apart than the circle is wide.
    """
    start, end = way.start, way.end
    over, up = end[0] - start[0], end[1] - start[1]
    half = hypot(over, up) / 2
    if 2 * half <= MIN_MOVE:
        raise MotionError("R does not define a full circle; give its centre with I J K")
    if half - abs(radius) > ROUNDED:
        raise MotionError(
            f"R {radius * 1e3:.6g} mm is too small: its ends are {2 * half * 1e3:.6g} mm apart, so "
            f"give at least {half * 1e3:.6g} mm"
        )
    height = sqrt(max(radius * radius - half * half, 0.0))
    # the centre of a counterclockwise arc of at most half a turn lies to the left of its chord
    side = copysign(height, radius) * (-1 if clockwise else 1) / (2 * half)
    centre = (start[0] + end[0]) / 2 - up * side, (start[1] + end[1]) / 2 + over * side
    return arc_by_centre(way, centre, clockwise)


def _mm(point: Point) -> str:
    return ", ".join(f"{value * 1e3:.6g}" for value in point)


def read_arc(
    values: Mapping[str, float],
    clockwise: bool,
    way: Way,
    modes: Modes,
    most: float | None = None,
) -> ArcFit:
    """Return the arc that a block's words state.

    Raises WordFault, or MotionError as `arc_by_centre` and `arc_by_radius`; most: as of the former.
    """
    first, second, normal = PLANES[modes.plane]
    word = f"G{2 if clockwise else 3}"
    offsets = {letter: values[letter] * modes.unit for letter in OFFSETS if letter in values}
    across = OFFSETS[normal]
    level = 0.0 if modes.from_start else way.start[normal]
    if across in offsets and values[across] != 0 and abs(offsets[across] - level) > MIN_MOVE:
        raise WordFault(across, f"{across} is outside the plane of G{modes.plane:.0f}, and not 0")
    offsets.pop(across, None)
    if ("R" in values) == bool(offsets):
        raise WordFault(
            "R" if offsets else "",
            f"{word} needs either its centre I J K or its radius R",
        )
    plane = way.project(first, second)
    if offsets:
        letters = OFFSETS[first], OFFSETS[second]
        if not modes.from_start and not offsets.keys() >= set(letters):
            raise WordFault("", f"G90.1 asks for both {letters[0]} and {letters[1]}")
        origin = plane.start if modes.from_start else (0.0, 0.0)
        along, up = (offsets.get(letter, 0.0) for letter in letters)
        arc = arc_by_centre(plane, (origin[0] + along, origin[1] + up), clockwise, most)
    else:
        arc = arc_by_radius(plane, values["R"] * modes.unit, clockwise)
    turns = values.get("P", 1.0)
    if turns not in range(1, MAX_TURNS + 1):
        raise WordFault("P", f"{word} takes P, its number of turns, from 1 to {MAX_TURNS}")
    return replace(arc, angle=arc.angle + copysign(2 * pi * (turns - 1), arc.angle))
