"""From a program to the pieces of its path: frames, arcs through where the path stands, turns, dwells, joins."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.machine import Machine
from kinematics.pose import Pose
from planner.path.arc import arc
from planner.path.join import Blended, join
from planner.path.line import line, turn_angle
from planner.path.shape import Piece
from planner.path.spline import spline
from planner.program import CAPS, SAME, Arc, Dwell, Join, Line, Program, Segment, Spline, Turn

# An arc may start this share of its radius out of its plane.
IN_PLANE = 1e-6


@dataclass(frozen=True, slots=True)
class Chain:
    """Pieces of a path in the machine's base frame; stops (P+1,) and dwells (P+1,) s at their ends, as of MachinePath.

    blends: what became of every join that asks for one
    """

    pieces: tuple[Piece, ...]
    stops: np.ndarray
    dwells: Array
    blends: tuple[Blended, ...]


def chain(program: Program, machine: Machine) -> Chain:
    """The program's path for a machine. Raises MotionError naming the segment that cannot be drawn."""
    here = program.start if program.start is not None else _default_start(program, machine)
    frame = machine.home if program.frame == "home" else RigidTransform.identity()
    drawn: list[list[Piece]] = []
    joins: list[Join] = []
    dwells = [0.0]
    for number, segment in enumerate(program.segments, 1):
        if isinstance(segment, Dwell):
            dwells[-1] += segment.duration
            continue
        there = _end(segment, number, here)
        speed, acceleration, angular = (program.cap(segment, name) for name in CAPS)
        drawn.append(
            [
                replace(piece, tool_speed=speed, tool_acceleration=acceleration, angular_speed=angular)
                for piece in _pieces(segment, number, here, there, frame, machine.characteristic_length)
            ]
        )
        joins.append(segment.join)
        dwells.append(0.0)
        here = there
    if not drawn:
        raise MotionError(f"program {program.name}: nothing moves; add a line, an arc, a spline or a turn")
    return Chain(*join(drawn, joins, frozen(dwells), machine.characteristic_length))


def _default_start(program: Program, machine: Machine) -> Pose:
    return RigidTransform.identity() if program.frame == "home" else machine.home


def _name(segment: Segment, number: int) -> str:
    line_number = f" (line {segment.line_number})" if segment.line_number else ""
    return f"segment {number}, {type(segment).__name__.lower()}{line_number}"


def _end(segment: Line | Arc | Spline | Turn, number: int, here: Pose) -> Pose:
    """The pose at a segment's end, in the program's frame."""
    match segment:
        case Turn():
            return RigidTransform.from_components(here.translation, segment.to)
        case Line():
            position = np.asarray(segment.to, float)
            if np.linalg.norm(position - here.translation) <= SAME:
                raise MotionError(
                    f"{_name(segment, number)}: it ends where it starts, at {_mm(position)}; "
                    "leave it out, or use turn to rotate on the spot"
                )
        case Arc():
            position = _arc_end(segment, number, here)
        case Spline():
            position = segment.through[-1]
            if np.linalg.norm(segment.through[0] - here.translation) <= SAME:
                raise MotionError(
                    f"{_name(segment, number)}: point 1 is where the path stands already, at {_mm(here.translation)}; "
                    "leave it out: a spline starts there by itself"
                )
    rotation = here.rotation if segment.rotate is None else segment.rotate
    return RigidTransform.from_components(position, rotation if rotation.single else rotation[-1])


def _arc_end(segment: Arc, number: int, here: Pose) -> Array:
    centre, normal = np.asarray(segment.centre, float), _unit(segment.normal)
    u = here.translation - centre
    radius, height = float(np.linalg.norm(u)), float(u @ normal)
    if radius <= SAME:
        raise MotionError(
            f"{_name(segment, number)}: the path stands on the arc's centre {_mm(centre)}; "
            "the centre must lie beside it"
        )
    if abs(height) > IN_PLANE * radius + SAME:
        raise MotionError(
            f"{_name(segment, number)}: the path stands {abs(height) * 1e3:.4g} mm out of the plane "
            f"through the centre {_mm(centre)}, at {_mm(here.translation)}; "
            f"move the centre by {_mm(height * normal)} or correct the normal"
        )
    position: Array = centre + Rotation.from_rotvec(segment.angle * normal).apply(u) + segment.rise * normal
    return position


def _pieces(
    segment: Line | Arc | Spline | Turn, number: int, here: Pose, there: Pose, frame: Pose, characteristic: float
) -> list[Piece]:
    start, end = frame * here, frame * there
    match segment:
        case Turn():
            angle = turn_angle(start, end)
            if angle <= SAME:
                raise MotionError(f"{_name(segment, number)}: the orientation is reached already; leave it out")
            return [line(start, end, angle * characteristic, number)]
        case Line():
            length = float(np.linalg.norm(end.translation - start.translation))
            return [line(start, end, length, number)]
        case Arc():
            centre = frame.apply(np.asarray(segment.centre, float))
            normal = frame.rotation.apply(_unit(segment.normal))
            return [arc(start, centre, normal, segment.angle, end.rotation, number, segment.rise)]
        case Spline():
            turned = None if segment.rotate is None else frame.rotation * segment.rotate
            try:
                return spline(start, frame.apply(segment.through), turned, number)
            except MotionError as no:
                raise MotionError(f"{_name(segment, number)}: {no}") from None


def _unit(vector: object) -> Array:
    v = np.asarray(vector, float)
    return np.asarray(v / np.linalg.norm(v), float)


def _mm(point: Array) -> str:
    return "[" + ", ".join(f"{value * 1e3:.6g}" for value in point) + "] mm"
