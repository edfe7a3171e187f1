"""A program as the thesis' control runs one: from pose to pose by synchronised moves, with a rest at each."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.foundation.arrays import freeze_array
from kinematics.foundation.errors import MotionError, located
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose
from planner.path.chain import Moving, default_start, segment_end
from planner.program.model import SAME, Dwell, Program, Segment, Spline, Synchronised
from planner.program.modifiers import Trigger


def synchronise(program: Program, machine: Machine) -> tuple[Program, tuple[int, ...]]:
    """Replace every segment and spline point of a program by a synchronised move to its end.

    Caps, triggers and dwells stay; blends, constant speeds and free orientations have no place in it. Also the numbers
    of segments that end where they start, for which there is nothing to move: they are left out. Raises MotionError
    for an end that cannot be told, a trigger on such a segment or inside a spline, or where nothing moves at all.
    """
    here = default_start(program, machine) if program.start is None else program.start
    segments: list[Segment] = []
    left_out: list[int] = []
    for number, segment in enumerate(program.segments, 1):
        if isinstance(segment, Dwell):
            segments.append(segment)
            continue
        with located(f"segment {number}, {type(segment).__name__.lower()}"):
            ends = list(_segment_poses(segment, here))
        moves = [(a, b) for a, b in zip([here, *ends], ends, strict=False) if _is_elsewhere(a, b)]
        _refuse_trigger(segment.trigger, number, len(moves))
        segments += [_move(segment, a, b, b is ends[-1]) for a, b in moves]
        left_out += [] if moves else [number]
        here = ends[-1]
    if all(isinstance(part, Dwell) for part in segments):
        raise MotionError(
            f"program {program.name}: every segment ends where it starts, so synchronised moves would not move at all; "
            "split it where it should stop, or omit --motion"
        )
    changed = {name: getattr(program, name) for name in program.__dataclass_fields__} | {"segments": tuple(segments)}
    return Program(**changed), tuple(left_out)


def _segment_poses(segment: Moving, here: Pose) -> Iterator[Pose]:
    """The poses that a segment leads to: those of all its points, of a spline."""
    if not isinstance(segment, Spline):
        yield segment_end(segment, here)
        return
    for k, point in enumerate(segment.through):
        yield RigidTransform.from_components(point, here.rotation if segment.rotate is None else segment.rotate[k])


def _is_elsewhere(one: Pose, other: Pose) -> bool:
    away = float(np.linalg.norm(other.translation - one.translation))
    return away > SAME or _has_turned(one.rotation, other.rotation)


def _has_turned(one: Rotation, other: Rotation) -> bool:
    return float((one.inv() * other).magnitude()) > SAME


def _refuse_trigger(trigger: Trigger | None, number: int, moves: int) -> None:
    """An event along a way that is not run any more."""
    if trigger is not None and moves != 1 and not (moves > 1 and trigger.at == 1):
        what = "ends where it starts, so no move passes" if not moves else "becomes several moves, which part"
        raise MotionError(f"segment {number}: it {what} its trigger {trigger.name}; put that on another segment")


def _move(segment: Moving, start: Pose, end: Pose, last: bool) -> Synchronised:
    return Synchronised(
        freeze_array(end.translation),
        end.rotation if _has_turned(start.rotation, end.rotation) else None,
        getattr(segment, "speed", None),
        acceleration=getattr(segment, "acceleration", None),
        angular_speed=segment.angular_speed,
        trigger=segment.trigger if last else None,
        line_number=segment.line_number,
    )
