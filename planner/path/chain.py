"""From a program to the pieces of its path: frames, arcs through where the path stands, turns, dwells, stops."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.machine import Machine
from kinematics.pose import Pose
from planner.path.arc import arc
from planner.path.line import line, turn_angle
from planner.path.shape import Piece
from planner.program import CAPS, Arc, Blend, Dwell, Line, Program, Segment, Turn

# Points nearer than this are the same (m), angles likewise (rad); an arc may start this share of its radius out of its
# plane.
SAME, IN_PLANE = 1e-9, 1e-6


@dataclass(frozen=True, slots=True)
class Chain:
    """Pieces of a path in the machine's base frame; stops (P+1,) bool and dwells (P+1,) s at their ends."""

    pieces: tuple[Piece, ...]
    stops: np.ndarray
    dwells: Array


def chain(program: Program, machine: Machine) -> Chain:
    """The program's path for a machine. Raises MotionError naming the segment that cannot be drawn."""
    here = program.start if program.start is not None else _default_start(program, machine)
    frame = machine.home if program.frame == "home" else RigidTransform.identity()
    pieces: list[Piece] = []
    dwells = [0.0]
    for number, segment in enumerate(program.segments, 1):
        if isinstance(segment, Dwell):
            dwells[-1] += segment.duration
            continue
        if isinstance(segment.join, Blend) and number < len(program.segments):
            raise MotionError(f'{_name(segment, number)}: blends are not built yet; join = "stop" stops there')
        there = _end(segment, number, here)
        piece = _piece(segment, number, here, there, frame, machine.characteristic_length)
        speed, acceleration, angular = (program.cap(segment, name) for name in CAPS)
        pieces.append(replace(piece, tool_speed=speed, tool_acceleration=acceleration, angular_speed=angular))
        dwells.append(0.0)
        here = there
    if not pieces:
        raise MotionError(f"program {program.name}: nothing moves; add a line, an arc or a turn")
    return Chain(tuple(pieces), frozen(np.ones(len(dwells), bool)), frozen(dwells))


def _default_start(program: Program, machine: Machine) -> Pose:
    return RigidTransform.identity() if program.frame == "home" else machine.home


def _name(segment: Segment, number: int) -> str:
    line_number = f" (line {segment.line_number})" if segment.line_number else ""
    return f"segment {number}, {type(segment).__name__.lower()}{line_number}"


def _end(segment: Line | Arc | Turn, number: int, here: Pose) -> Pose:
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
    rotation = here.rotation if segment.rotate is None else segment.rotate
    return RigidTransform.from_components(position, rotation)


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
    position: Array = centre + Rotation.from_rotvec(segment.angle * normal).apply(u)
    return position


def _piece(
    segment: Line | Arc | Turn, number: int, here: Pose, there: Pose, frame: Pose, characteristic: float
) -> Piece:
    start, end = frame * here, frame * there
    match segment:
        case Turn():
            angle = turn_angle(start, end)
            if angle <= SAME:
                raise MotionError(f"{_name(segment, number)}: the orientation is reached already; leave it out")
            return line(start, end, angle * characteristic, number)
        case Line():
            return line(start, end, float(np.linalg.norm(end.translation - start.translation)), number)
        case Arc():
            centre = frame.apply(np.asarray(segment.centre, float))
            normal = frame.rotation.apply(_unit(segment.normal))
            return arc(start, centre, normal, segment.angle, end.rotation, number)


def _unit(vector: object) -> Array:
    v = np.asarray(vector, float)
    return np.asarray(v / np.linalg.norm(v), float)


def _mm(point: Array) -> str:
    return "[" + ", ".join(f"{value * 1e3:.6g}" for value in point) + "] mm"
