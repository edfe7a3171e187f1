"""From a program to the pieces of its path: frames, tool, arcs from the current point, turns,
dwells, joins.

The tool sits on the platform; the platform's path takes it along its own.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from kinematics.foundation.arrays import MAX_TURNS, Array, freeze_array, most
from kinematics.foundation.errors import Fault, FileError, MotionError
from kinematics.foundation.rotations import turn_vector
from kinematics.machine.machine import Machine
from kinematics.machine.pose import IDENTITY, axis_angle, from_numbers, join_pose
from planner.path.arc_length import even_speed
from planner.path.curve import curve, ends
from planner.path.fit import fit_chains, is_plain
from planner.path.followed_angles import begin_turn, refuse_lost_turn
from planner.path.join_and_blend import ALWAYS_REST, PathStep, link, list_avoidable
from planner.path.outcome import Blended
from planner.path.overshoot import measure_overshoot
from planner.path.shape import (
    DEGREE,
    LINE,
    NO_TURN,
    Drawn,
    Fitted,
    Overshoot,
    Piece,
    arc,
    carry_tool,
    free_piece,
    line,
    measure_turns,
    turn,
    turn_angle,
)
from planner.path.spline import spline
from planner.path.synchronised import draw_synchronised
from planner.program.model import (
    MIN_MOVE,
    Arc,
    Curve,
    Dwell,
    Line,
    Program,
    Segment,
    Spline,
    Synchronised,
    Turn,
)
from planner.program.modifiers import STOP
from planner.program.validation import CAPS

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from kinematics.machine.pose import Pose

# An arc may start this share of its radius out of its plane.
IN_PLANE = 1e-6

Moving = Line | Arc | Spline | Curve | Turn | Synchronised


@dataclass(frozen=True, slots=True)
class Chain:
    """Pieces of the platform's path in the base frame; stops (P+1,), dwells (P+1,) s at their ends,
    as of MachinePath.

    blends: what became of every join that asks for one; fits: of every chain that was fitted
    avoidable: numbers, from 1, of the pieces that end in an avoidable stop
    overshoots: how far each spline leaves its polygon
    """

    pieces: tuple[Piece, ...]
    stops: np.ndarray
    dwells: Array
    blends: tuple[Blended, ...]
    fits: tuple[Fitted, ...]
    overshoots: tuple[Overshoot, ...]
    avoidable: frozenset[int] = frozenset()


def chain_pieces(program: Program, machine: Machine) -> Chain:
    """The program's path for a machine.

    Raises MotionError naming the segment that cannot be drawn.
    """
    steps = list(_link_segments(program, machine))
    pieces = tuple(step.piece for step in steps)
    stops = freeze_array([ALWAYS_REST, *(step.stop for step in steps)])
    rests = freeze_array([steps[0].wait, *(step.dwell for step in steps)])
    if any(piece.constant for piece in pieces):
        pieces, stops, rests = even_speed(pieces, stops, rests)
    if program.tool is not None:
        pieces = tuple(carry_tool(piece, program.tool) for piece in pieces)
    blends = tuple(step.blend for step in steps if step.blend is not None)
    fits = tuple(step.fitted for step in steps if step.fitted is not None)
    overshoots = tuple(step.overshoot for step in steps if step.overshoot is not None)
    return Chain(pieces, stops, rests, blends, fits, overshoots, list_avoidable(steps))


def walk_path(program: Program, machine: Machine) -> Iterator[PathStep]:
    """The same path step by step, as it is asked for: of constant speeds, for which it is drawn
    otherwise, not yet.
    """
    for step in _link_segments(program, machine):
        yield (
            step
            if program.tool is None
            else replace(step, piece=carry_tool(step.piece, program.tool))
        )


def _link_segments(program: Program, machine: Machine) -> Iterator[PathStep]:
    """With the path of the tool instead of the platform's."""
    characteristic = machine.characteristic_length
    return link(fit_chains(draw_segments(program, machine), characteristic), characteristic)


class _Stand:
    """The current point of a path, in the program's frame.

    Lines are drawn in a few numbers: composing poses takes ten times as long, and files have
    millions of lines. As long as nothing is turned, no pose is made at all, since SciPy's take 0.2
    s to load: `_frame` and `_rotation` are None then.
    """

    def __init__(self, program: Program, machine: Machine) -> None:
        home = machine.home_numbers[0]
        is_stated = (
            program.start is not None or program.tool is not None or program.work is not None
        )
        self._frame: Pose | None = None
        self._rotation: Rotation | None = None
        self._turned: Array = np.eye(3)
        self._moved: Array
        self._position: Array
        self._rest = np.concatenate([IDENTITY[3:], NO_TURN])
        if not is_stated and np.array_equal(home[3:], IDENTITY[3:]):
            origin = np.zeros(3)
            self._moved, self._position = (
                (home[:3], origin) if program.frame == "home" else (origin, home[:3])
            )
            return
        self._frame = machine.home if program.frame == "home" else from_numbers(IDENTITY)
        if program.work is not None:
            self._frame = self._frame * program.work
        self._turned, self._moved = self._frame.rotation.as_matrix(), self._frame.translation
        self.move(default_start(program, machine) if program.start is None else program.start)

    def move(self, pose: "Pose") -> None:
        self._position, self._rotation = pose.translation, pose.rotation
        rows = (self.frame.rotation * self._rotation).as_matrix().ravel()
        self._rest = np.concatenate([rows, NO_TURN])

    @property
    def frame(self) -> "Pose":
        if self._frame is None:
            self._frame = from_numbers(np.concatenate([self._moved, IDENTITY[3:]]))
        return self._frame

    @property
    def pose(self) -> "Pose":
        if self._rotation is None:
            return from_numbers(np.concatenate([self._position, IDENTITY[3:]]))
        return join_pose(self._position, self._rotation)

    @property
    def place(self) -> Array:
        """(3,) m in the base frame."""
        return self._move_to_base(self._position)

    def _move_to_base(self, point: Array) -> Array:
        return np.asarray(self._turned @ point + self._moved)

    def draw_line(self, to: Array, number: int) -> Piece | None:
        """Return the piece to a position, the current point from then on; None if the path is there
        already.
        """
        start, end = self.place, self._move_to_base(to)
        length = float(np.linalg.norm(end - start))
        if length <= MIN_MOVE:
            return None
        self._position = to
        return Piece(
            LINE,
            freeze_array(np.concatenate([start, (end - start) / length, self._rest])),
            length,
            number,
        )

    def draw_arc(self, segment: Arc, number: int) -> Piece | None:
        """Return the piece of an arc, the current point at its end from then on; None if anything
        is turned.
        """
        if segment.rotate is not None or self._frame is not None or self._rotation is not None:
            return None
        start = np.concatenate([self.place, IDENTITY[3:]])
        end = _arc_end(segment, self._position)
        centre = self._move_to_base(np.asarray(segment.centre, float))
        self._position = end
        return arc(
            start, centre, _unit(segment.normal), segment.angle, NO_TURN, number, segment.rise
        )


def draw_segments(program: Program, machine: Machine) -> Iterator[Drawn]:
    """The tool's way along every segment that moves, repetition after repetition, each as it is
    asked for.

    Raises MotionError naming the segments that cannot be drawn, of a program from a file FileError
    with their lines: all up to the first that does not say itself where it ends. After the first
    nothing more is drawn.
    """
    _refuse_lever(program, machine)
    if program.start_speed:
        _refuse_end_speed("start_speed", program.start_speed, program.segments[0], 1)
    if program.end_speed:
        _refuse_end_speed(
            "end_speed", program.end_speed, program.segments[-1], len(program.segments)
        )
    stand = _Stand(program, machine)
    faults: list[tuple[int, Moving, MotionError]] = []
    pending, moves, turned = Drawn([], STOP), False, 0.0
    for repetition in range(1, program.repeat + 1):
        for number, segment in enumerate(program.segments, 1):
            if isinstance(segment, Dwell):
                pending = replace(pending, dwell=pending.dwell + segment.duration)
                continue
            begin = stand.place if isinstance(segment, Spline) else None
            try:
                own = _draw(segment, number, stand, machine, program.tool)
                turned += sum(piece.turn for piece in own)
                _refuse_turns(turned)
            except MotionError as wrong:
                faults.append(
                    (
                        number,
                        segment,
                        _repetition_error(wrong, repetition) if repetition > 1 else wrong,
                    )
                )
                onward = _end_of_undrawn(segment, stand.pose)
                if onward is None or repetition > 1:
                    raise _segments_error(program, faults) from None
                stand.move(onward)
                continue
            if not faults and (pending.pieces or pending.dwell):
                yield pending
            pieces = [
                _cap_piece(piece, segment, program, repetition)
                for piece in _free_pieces(own, segment)
            ]
            marks = () if segment.trigger is None else (segment.trigger.at,)
            overshoot = None
            if begin is not None and isinstance(segment, Spline):
                polygon = np.concatenate([begin[None], stand.frame.apply(segment.through)])
                overshoot = measure_overshoot(polygon, own)
            plain = not marks and is_plain(pieces)
            pending = Drawn(pieces, segment.join, plain=plain, marks=marks, overshoot=overshoot)
            moves = True
        if faults:
            raise _segments_error(program, faults)
    if not moves:
        told = f"program {program.name}: nothing moves; add a line, an arc, a spline, a turn or a synchronised move"
        raise (
            FileError(program.file, [Fault("segment", told, 1)])
            if program.file
            else MotionError(told)
        )
    yield pending


def _draw(
    segment: Moving, number: int, stand: _Stand, machine: Machine, tool: "Pose | None"
) -> list[Piece]:
    """The pieces of a segment from where the path stands, which is its end then."""
    if (
        isinstance(segment, Line)
        and segment.rotate is None
        and (made := stand.draw_line(segment.to, number))
    ):
        return [made]
    if isinstance(segment, Arc) and (made := stand.draw_arc(segment, number)):
        return [made]
    here = stand.pose
    there = segment_end(segment, here)
    own = _pieces(segment, number, here, there, stand.frame, machine, tool)
    stand.move(there)
    return own


def default_start(program: Program, machine: Machine) -> "Pose":
    """Where the machine's home pose has the tool, in the work frame."""
    from scipy.spatial.transform import RigidTransform

    start = RigidTransform.identity() if program.frame == "home" else machine.home
    if program.tool is not None:
        start = start * program.tool
    return start if program.work is None else program.work.inv() * start


def _end_of_undrawn(segment: Moving, here: "Pose") -> "Pose | None":
    """Where the path goes on behind a segment that cannot be drawn, as far as it says that
    itself.
    """
    match segment:
        case Line() | Synchronised():
            position, turned = np.asarray(segment.to, float), segment.rotate
        case Spline():
            position, turned = (
                segment.through[-1],
                None if segment.rotate is None else segment.rotate[-1],
            )
        case Turn() if segment.to is not None:
            position, turned = here.translation, segment.to
        case _:
            return None
    return join_pose(position, here.rotation if turned is None else turned)


def _segments_error(
    program: Program, faults: Sequence[tuple[int, Moving, MotionError]]
) -> MotionError:
    """Everything that is wrong with the segments of a program: of its file, if it is from one."""
    if not program.file:
        lines = [f"{_name(segment, number)}: {error}" for number, segment, error in faults]
        return MotionError("\n".join(lines)).in_segment(faults[0][0])
    return FileError(
        program.file,
        [
            Fault(
                f"segment[{number}].{type(segment).__name__.lower()}", str(no), segment.line_number
            )
            for number, segment, no in faults
        ],
    )


def _repetition_error(wrong: MotionError, repetition: int) -> MotionError:
    return MotionError(
        f"repetition {repetition}: {wrong}; put the approach to the first repetition into start"
    )


def _free_pieces(pieces: list[Piece], segment: Moving) -> list[Piece]:
    """The pieces of a segment that leaves orientation free, turned as was chosen: not at all if
    nothing was.
    """
    if isinstance(segment, Turn | Synchronised) or segment.free is None:
        return pieces
    controls = np.zeros((3, DEGREE + 1)) if segment.free.controls is None else segment.free.controls
    ends = np.concatenate([[0.0], np.cumsum([piece.length for piece in pieces])])
    return measure_turns(
        [
            free_piece(piece, controls, start, ends[-1])
            for piece, start in zip(pieces, ends[:-1], strict=True)
        ],
    )


def _cap_piece(piece: Piece, segment: Moving, program: Program, repetition: int) -> Piece:
    """The piece with what every kind of segment may say."""
    speed, acceleration, angular, jerk = (program.cap(segment, name) for name in CAPS)
    return replace(
        piece,
        tool_speed=speed,
        tool_acceleration=acceleration,
        angular_speed=angular,
        tool_jerk=jerk,
        constant=not isinstance(segment, Turn | Synchronised) and segment.speed_constant,
        repetition=repetition if program.repeat > 1 else None,
    )


def _refuse_turns(turned: float) -> None:
    """A path that bends and turns more often than grids along it can follow."""
    if not turned <= most("rad"):
        turns = f"{turned / (2 * np.pi):.6g} turns"
        raise MotionError(
            f"up to its end the path bends and turns by {turns}, at most {MAX_TURNS}; run it in parts"
        )


def _refuse_lever(program: Program, machine: Machine) -> None:
    """Where the orientation follows, a tool beside the platform's origin goes where nothing that is
    asked for says.
    """
    turning = [name for name in machine.follows if name in ("rx", "ry", "rz")]
    if program.tool is not None and turning and np.linalg.norm(program.tool.translation) > 0:
        raise MotionError(
            f"program {program.name}: machine {machine.name} does not control {', '.join(turning)}, so it cannot place "
            f"a tool {_mm(program.tool.translation)} off the platform's origin; leave tool.to out"
        )


def _refuse_end_speed(end: str, speed: float, segment: Segment, number: int) -> None:
    """A speed of the tool at an end of the program, whose segment there does not move it, or not so
    fast.
    """
    if speed == 0:
        return
    if isinstance(segment, Turn | Dwell):
        raise MotionError(
            f"{_name(segment, number)}: it does not move the tool, so {end} cannot be kept; set it to 0"
        ).in_segment(number)
    if segment.speed is not None and speed > segment.speed:
        raise MotionError(
            f"{_name(segment, number)}: {end} {speed * 1e3:.6g} mm/s is above its speed {segment.speed * 1e3:.6g} mm/s"
        ).in_segment(number)


def _name(segment: Segment, number: int) -> str:
    line_number = f" (line {segment.line_number})" if segment.line_number else ""
    return f"segment {number}, {type(segment).__name__.lower()}{line_number}"


def segment_end(segment: Moving, here: "Pose") -> "Pose":
    """The pose at a segment's end, in the program's frame."""
    match segment:
        case Turn():
            if segment.to is not None:
                return join_pose(here.translation, segment.to)
            from scipy.spatial.transform import Rotation

            turned = Rotation.from_rotvec(segment.angle * np.asarray(segment.about)) * here.rotation
            return join_pose(here.translation, turned)
        case Line():
            position = np.asarray(segment.to, float)
            if np.linalg.norm(position - here.translation) <= MIN_MOVE:
                raise MotionError(
                    f"it ends where it starts, at {_mm(position)}; omit it, or use turn to rotate on the spot"
                )
        case Synchronised():
            position = np.asarray(segment.to, float)
            turned = here.rotation if segment.rotate is None else segment.rotate
            angle = float((here.rotation.inv() * turned).magnitude())
            if np.linalg.norm(position - here.translation) <= MIN_MOVE and angle <= MIN_MOVE:
                raise MotionError(f"it ends where it starts, at {_mm(position)}; leave it out")
        case Arc():
            position = _arc_end(segment, here.translation)
        case Spline():
            position = segment.through[-1]
            if np.linalg.norm(segment.through[0] - here.translation) <= MIN_MOVE:
                raise MotionError(
                    f"point 1 is the current point of the path, {_mm(here.translation)}; "
                    "omit it: a spline starts there anyway"
                )
        case Curve():
            return _curve_end(segment, here)
    rotation = here.rotation if segment.rotate is None else segment.rotate
    return join_pose(position, rotation if rotation.single else rotation[-1])


def _curve_end(segment: Curve, here: "Pose") -> "Pose":
    """Where its equations end, which must begin where the path stands."""
    first, last = ends(segment)
    away = first.translation - here.translation
    if np.linalg.norm(away) > MIN_MOVE:
        raise MotionError(
            f"its equations begin at {_mm(first.translation)}, "
            f"{np.linalg.norm(away) * 1e3:.6g} mm from the current point of the path, {_mm(here.translation)}; "
            "add a line to it first"
        )
    rotation = here.rotation
    if segment.rotate is not None:
        angle = float((first.rotation.inv() * here.rotation).magnitude())
        if angle > MIN_MOVE:
            wanted = ", ".join(
                f"{each:.6g}" for each in first.rotation.as_euler("XYZ", degrees=True)
            )
            raise MotionError(
                f"its equations begin turned [{wanted}]°, {np.degrees(angle):.6g}° from the "
                "current orientation; add a turn before it"
            )
        rotation = last.rotation * first.rotation.inv() * here.rotation
    return join_pose(here.translation + (last.translation - first.translation), rotation)


def _arc_end(segment: Arc, here: Array) -> Array:
    """Return the end (3,) of an arc from a position (3,)."""
    centre, normal = np.asarray(segment.centre, float), _unit(segment.normal)
    u = here - centre
    radius, height = float(np.linalg.norm(u)), float(u @ normal)
    if radius <= MIN_MOVE:
        raise MotionError(
            f"the arc's centre is the current point of the path {_mm(centre)}; give another centre"
        )
    if abs(height) > IN_PLANE * radius + MIN_MOVE:
        raise MotionError(
            f"the path stands {abs(height) * 1e3:.4g} mm out of the plane "
            f"through the centre {_mm(centre)}, at {_mm(here)}; "
            f"move the centre by {_mm(height * normal)} or correct the normal"
        )
    return np.asarray(centre + turn_vector(u, segment.angle * normal) + segment.rise * normal)


def _pieces(
    segment: Moving,
    number: int,
    here: "Pose",
    there: "Pose",
    frame: "Pose",
    machine: Machine,
    tool: "Pose | None",
) -> list[Piece]:
    start, end, characteristic = frame * here, frame * there, machine.characteristic_length
    match segment:
        case Synchronised():
            return draw_synchronised(machine, start, end, tool, number)
        case Turn():
            if machine.follows:
                before, after = start.rotation, end.rotation
                if segment.about is not None:
                    axis = frame.rotation.apply(np.array(segment.about))
                    after = begin_turn(segment.angle, axis) * before
                if tool is not None:
                    before, after = (rotation * tool.rotation.inv() for rotation in (before, after))
                refuse_lost_turn(before, after, machine)
            if segment.about is not None:
                axis = start.rotation.inv().apply(frame.rotation.apply(np.array(segment.about)))
                return [turn(start, axis, segment.angle, characteristic, number)]
            angle = turn_angle(start, end)
            if angle <= MIN_MOVE:
                raise MotionError("it already has that orientation; omit it")
            return [line(start, end, angle * characteristic, number)]
        case Line():
            length = float(np.linalg.norm(end.translation - start.translation))
            return [line(start, end, length, number)]
        case Arc():
            centre = frame.apply(np.asarray(segment.centre, float))
            normal = frame.rotation.apply(_unit(segment.normal))
            numbers = np.concatenate([start.translation, start.rotation.as_matrix().ravel()])
            (axis,), (angle,) = axis_angle(start.rotation, end.rotation)
            return [
                arc(
                    numbers,
                    centre,
                    normal,
                    segment.angle,
                    np.append(axis, angle),
                    number,
                    segment.rise,
                )
            ]
        case Curve():
            return curve(start, segment, frame, number)
        case Spline():
            turned = None if segment.rotate is None else frame.rotation * segment.rotate
            return spline(start, frame.apply(segment.through), turned, number)


def _unit(vector: object) -> Array:
    v = np.asarray(vector, float)
    return np.asarray(v / np.linalg.norm(v), float)


def _mm(point: Array) -> str:
    return "[" + ", ".join(f"{value * 1e3:.6g}" for value in point) + "] mm"
