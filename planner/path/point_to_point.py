"""A program as the thesis' control runs one: from pose to pose by synchronised moves, with a rest
at each.

Such moves are straight in the axes alone; how far the tool leaves the straight line is measured.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Annotated

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError, locate_errors
from kinematics.foundation.facts import Fact, tabulate
from kinematics.foundation.options import check_arguments
from kinematics.foundation.table import Table
from kinematics.machine.machine_file import MachineSource, load_machine
from kinematics.machine.pose import from_numbers, join_pose
from planner.path.actuation import MachinePath
from planner.path.chain import Moving, default_start, segment_end
from planner.path.synchronised import NAME
from planner.place import Place
from planner.program.model import MIN_MOVE, Dwell, Program, Segment, Spline, Synchronised
from planner.program.modifiers import Trigger
from planner.program.program_file import ProgramSource, load_program

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from kinematics.machine.pose import Pose


@check_arguments()
def synchronise(program: ProgramSource, machine: MachineSource) -> tuple[Program, tuple[int, ...]]:
    """Replace every segment and spline point of a program by a synchronised move to its end.

    Caps, triggers and dwells stay; blends, constant speeds and free orientations are dropped.

    Parameters
    ----------
    program, machine
        Each as it is, by its name, or by the path of its file.

    Returns
    -------
    Program, tuple
        The program of moves, and the numbers of segments that end where they start: they have no
        move and are left out.

    Raises
    ------
    MotionError
        An end is not known, a trigger is on such a segment or inside a spline, or nothing moves at
        all.
    """
    program, machine = load_program(program), load_machine(machine)
    here = default_start(program, machine) if program.start is None else program.start
    segments: list[Segment] = []
    left_out: list[int] = []
    for number, segment in enumerate(program.segments, 1):
        if isinstance(segment, Dwell):
            segments.append(segment)
            continue
        with locate_errors(f"segment {number}, {type(segment).__name__.lower()}"):
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
    changed = {name: getattr(program, name) for name in program.__dataclass_fields__} | {
        "segments": tuple(segments)
    }
    return Program(**changed), tuple(left_out)


def _segment_poses(segment: Moving, here: "Pose") -> "Iterator[Pose]":
    """The poses that a segment leads to: those of all its points, of a spline."""
    if not isinstance(segment, Spline):
        yield segment_end(segment, here)
        return
    for k, point in enumerate(segment.through):
        yield join_pose(point, here.rotation if segment.rotate is None else segment.rotate[k])


def _is_elsewhere(one: "Pose", other: "Pose") -> bool:
    away = float(np.linalg.norm(other.translation - one.translation))
    return away > MIN_MOVE or _has_turned(one.rotation, other.rotation)


def _has_turned(one: "Rotation", other: "Rotation") -> bool:
    return float((one.inv() * other).magnitude()) > MIN_MOVE


def _refuse_trigger(trigger: Trigger | None, number: int, moves: int) -> None:
    """An event along a way that is not run any more."""
    if trigger is not None and moves != 1 and not (moves > 1 and trigger.at == 1):
        what = (
            "ends where it starts, so no move passes"
            if not moves
            else "becomes several moves, which part"
        )
        raise MotionError(
            f"segment {number}: it {what} its trigger {trigger.name}; put that on another segment"
        ).in_segment(number)


def _move(segment: Moving, start: "Pose", end: "Pose", last: bool) -> Synchronised:
    return Synchronised(
        freeze_array(end.translation),
        end.rotation if _has_turned(start.rotation, end.rotation) else None,
        getattr(segment, "speed", None),
        acceleration=getattr(segment, "acceleration", None),
        angular_speed=segment.angular_speed,
        max_tool_jerk=getattr(segment, "max_tool_jerk", None),
        trigger=segment.trigger if last else None,
        line_number=segment.line_number,
    )


MOVE_POINTS = 513
"""Places of a move at which it is looked at; both differences are smooth."""


@dataclass(frozen=True, slots=True)
class Departure:
    """Of one synchronised move, as its pieces have it (blends take its ends).

    distance  m, the farthest that the tool is from the straight line between the move's ends, and
              where
    turned    rad, the farthest that its orientation is from the one that turns the shorter way in
              proportion to the path; 0 where the machine does not control it
    uneven    pulses, the farthest that any axis is from its own straight way, in proportion to the
              path
    """

    where: Annotated[Place, Fact("where")]
    distance: Annotated[float, Fact("off_the_line_m", "off the line", "m", "human", ".4g")]
    turned: Annotated[float, Fact("turned_off_rad", "turned off", "rad", "human", ".4g")]
    uneven: Annotated[float, Fact("axes_uneven_pulses", "axes uneven", "pulses", "", ".2g")]


def departures(path: MachinePath) -> tuple[Departure, ...]:
    """Of every synchronised move of a path, in turn, at MOVE_POINTS places of each."""
    names = [piece.shape.name for piece in path.pieces]
    mine = [k for k, name in enumerate(names) if name.split("_")[0] == NAME]
    moves = groupby(mine, lambda k: (path.pieces[k].repetition, path.pieces[k].segment))
    return tuple(_measure_departure(path, list(group)) for _, group in moves)


def describe_departures(departures: "Sequence[Departure]") -> str:
    """Return the largest deviation of the moves from the straight line; "" without such moves."""
    if not departures:
        return ""
    worst = max(departures, key=lambda one: one.distance)
    angle = np.rad2deg(max(one.turned for one in departures))
    off = f"up to {1e3 * worst.distance:.4g} mm off the straight line, at {worst.where}"
    return f"{len(departures)}, straight in the axes: {off}; up to {angle:.4g}° in angle"


def departure_tables(departures: "Sequence[Departure]") -> tuple[Table, ...]:
    """Return a table of the distance of each synchronised move from the straight line, if there are
    any.
    """
    return tabulate("synchronised moves: straight in the axes, not in space", departures)


def _measure_departure(path: MachinePath, pieces: Sequence[int]) -> Departure:
    low, high = float(path.breaks[pieces[0]]), float(path.breaks[pieces[-1] + 1])
    share = np.linspace(0.0, 1.0, MOVE_POINTS)
    s = low + share * (high - low)
    piece = np.clip(np.searchsorted(path.breaks, s, side="right") - 1, pieces[0], pieces[-1])
    numbers = path.pose_numbers(s, piece)
    pose = from_numbers(numbers if path.tool is None else path.tool(numbers))
    off = _chord_distance(pose.translation)
    turned = (
        _rotation_departure(pose, share)
        if any(name.startswith("r") for name in path.machine.freedom)
        else np.zeros(MOVE_POINTS)
    )
    q = path.derivatives(s, piece, 0)[0]
    uneven = np.abs(q - (q[0] + share[:, None] * (q[-1] - q[0]))) / [
        axis.pulse for axis in path.machine.axes
    ]
    k = int(np.argmax(off if off.max() > 0 else turned))
    where = path.place(float(s[k]), int(piece[k]))
    return Departure(where, float(off.max()), float(turned.max()), float(uneven.max()))


def _chord_distance(points: Array) -> Array:
    """(N,) distance from the line between the first and the last."""
    way = points[-1] - points[0]
    length = float(np.linalg.norm(way))
    along = (points - points[0]) @ way / length**2 if length > 0 else np.zeros(len(points))
    return np.asarray(np.linalg.norm(points - points[0] - along.clip(0, 1)[:, None] * way, axis=1))


def _rotation_departure(pose: "Pose", share: Array) -> Array:
    from scipy.spatial.transform import Slerp

    ends = pose.rotation[[0, -1]]
    return np.asarray((Slerp([0.0, 1.0], ends)(share).inv() * pose.rotation).magnitude())
