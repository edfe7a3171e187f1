"""Program files, read: the program that one describes (its schema: planner.program.program_file).

The schema of a program's TOML: what each [[segment]] may say, and the segment that it describes.
"""

from itertools import pairwise
from math import dist
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from pydantic import AfterValidator, Field, model_validator
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.files.schema import (
    Direction,
    File,
    TableSchema,
    build,
    chosen,
    one_of_tables,
    read_declared_units,
    require_nonzero,
    unit_validator,
)
from kinematics.files.toml_document import read
from kinematics.foundation.arrays import freeze_array
from kinematics.foundation.errors import Fault, FileError, MotionError, validation_error
from kinematics.foundation.names import find, presets
from kinematics.foundation.units import Unit
from kinematics.machine.pose import Pose
from planner.program.model import SAME, Arc, Dwell, Frame, Line, Program, Segment, Spline, Synchronised, Turn
from planner.program.segment_tables import AngularSpeed, CurveEntry, MovingEntry, PathEntry, ToolAcceleration, ToolSpeed
from planner.program.validation import MAX_REPEATS, repeats


def _rotation(angles: tuple[float, float, float] | None) -> Rotation | None:
    """Rx(θx) · Ry(θy) · Rz(θz): about the moving axes in turn."""
    return None if angles is None else Rotation.from_euler("XYZ", angles)


def _check_not_empty(segments: tuple[Any, ...]) -> tuple[Any, ...]:
    if not segments:
        raise validation_error(f"empty: {_SOME_SEGMENT}")
    return segments


def _check_distinct(points: tuple[tuple[float, float, float], ...]) -> tuple[Any, ...]:
    if not points:
        raise validation_error("empty: give a spline at least one point")
    for n, (one, other) in enumerate(pairwise(points), 1):
        if dist(one, other) <= SAME:
            raise validation_error(repeats(n))
    return points


def _start_type(value: object) -> Any:
    if isinstance(value, tuple) and len(value) not in (3, 6):
        raise validation_error(f"{len(value)} entries: give 3 (x, y, z) or 6 (x, y, z, θx, θy, θz)")
    return PositionAndAngles if isinstance(value, tuple) and len(value) == 6 else Position


_SOME_SEGMENT = "a program needs at least one [[segment]]"

Coordinate = Annotated[float, Unit("m", plain="length")]
PlainAngle = Annotated[float, Unit("rad", plain="angle")]
EndSpeed = Annotated[float, Unit("m/s", least=0)]
Position = tuple[Coordinate, Coordinate, Coordinate]
Orientation = tuple[PlainAngle, PlainAngle, PlainAngle]
PositionAndAngles = tuple[Coordinate, Coordinate, Coordinate, PlainAngle, PlainAngle, PlainAngle]


class PoseTable(TableSchema):
    """A frame in another: moved by `to`, then turned by `rotate`.

    to      moved by
    rotate  then turned by θx, θy, θz about the moving axes in turn
    """

    to: Position = (0.0, 0.0, 0.0)
    rotate: Orientation = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> Pose:
        return RigidTransform.from_components(self.to, Rotation.from_euler("XYZ", self.rotate))


class LineTable(TableSchema):
    """A straight line.

    to      where it ends
    rotate  orientation at its end, θx, θy, θz about the moving axes in turn; kept if not stated
    """

    to: Position
    rotate: Orientation | None = None


class ArcTable(TableSchema):
    """A circular arc from where the path stands.

    centre  of the circle
    normal  of its plane
    angle   signed, right hand about the normal; any number of turns
    rise    along the normal in all: a helix
    rotate  orientation at its end; kept if not stated
    """

    centre: Position
    normal: Direction
    angle: Annotated[PlainAngle, AfterValidator(require_nonzero)]
    rise: Coordinate = 0.0
    rotate: Orientation | None = None


class SplineTable(TableSchema):
    """A smooth curve through points.

    through  the points, from where the path stands
    rotate   an orientation for each point; kept if not stated
    """

    through: Annotated[tuple[Position, ...], AfterValidator(_check_distinct)]
    rotate: tuple[Orientation, ...] | None = None

    @model_validator(mode="after")
    def _one_for_each(self) -> Self:
        if self.rotate is not None and len(self.rotate) != len(self.through):
            given, points = len(self.rotate), len(self.through)
            raise validation_error(
                f"{given} orientations in rotate for {points} points in through: give one for each, or none"
            )
        return self


class TurnTo(TableSchema):
    """A rotation on the spot.

    to  orientation, θx, θy, θz about the moving axes in turn, the shorter way
    """

    to: Orientation


class TurnBy(TableSchema):
    """A rotation on the spot.

    about  axis
    angle  signed, right hand about it; any number of turns
    """

    about: Direction
    angle: Annotated[PlainAngle, AfterValidator(require_nonzero)]


class SynchronisedTable(TableSchema):
    """A move from pose to pose, every axis straight to its place, all together; the tool's way is no line.

    to      where it ends
    rotate  orientation at its end, θx, θy, θz about the moving axes in turn; kept if not stated
    """

    to: Position
    rotate: Orientation | None = None


class LineEntry(PathEntry):
    line: LineTable

    def segment(self, line_number: int | None) -> Segment:
        return Line(freeze_array(self.line.to), _rotation(self.line.rotate), **self.said, line_number=line_number)


class ArcEntry(PathEntry):
    arc: ArcTable

    def segment(self, line_number: int | None) -> Segment:
        centre, normal, turned = (
            freeze_array(self.arc.centre),
            freeze_array(self.arc.normal),
            _rotation(self.arc.rotate),
        )
        return Arc(centre, normal, self.arc.angle, turned, **self.said, rise=self.arc.rise, line_number=line_number)


class SplineEntry(PathEntry):
    spline: SplineTable

    def segment(self, line_number: int | None) -> Segment:
        turned = None if self.spline.rotate is None else Rotation.from_euler("XYZ", self.spline.rotate)
        return Spline(freeze_array(self.spline.through), turned, **self.said, line_number=line_number)


class TurnEntry(MovingEntry):
    turn: Annotated[TurnTo | TurnBy, one_of_tables(TurnTo, TurnBy)]

    def segment(self, line_number: int | None) -> Segment:
        said: dict[str, Any] = {"angular_speed": self.angular_speed, "trigger": self.event, "line_number": line_number}
        if isinstance(self.turn, TurnBy):
            return Turn(None, self.after, about=freeze_array(self.turn.about), angle=self.turn.angle, **said)
        return Turn(Rotation.from_euler("XYZ", self.turn.to), self.after, **said)


class SynchronisedEntry(MovingEntry):
    """What it has beside it.

    speed         cap of the tool's speed
    acceleration  cap of the tool's acceleration
    """

    synchronised: SynchronisedTable
    speed: ToolSpeed | None = None
    acceleration: ToolAcceleration | None = None

    def segment(self, line_number: int | None) -> Segment:
        to, turned = freeze_array(self.synchronised.to), _rotation(self.synchronised.rotate)
        said: dict[str, Any] = {"acceleration": self.acceleration, "angular_speed": self.angular_speed}
        return Synchronised(to, turned, self.speed, self.after, **said, trigger=self.event, line_number=line_number)


class DwellEntry(TableSchema):
    dwell: Annotated[float, Unit("s", above=0)]

    def segment(self, line_number: int | None) -> Segment:
        return Dwell(self.dwell, line_number=line_number)


SegmentEntry = Annotated[
    LineEntry | ArcEntry | SplineEntry | CurveEntry | TurnEntry | SynchronisedEntry | DwellEntry,
    one_of_tables(LineEntry, ArcEntry, SplineEntry, CurveEntry, TurnEntry, SynchronisedEntry, DwellEntry),
]


class ProgramFile(File):
    """A program's TOML, key by key.

    machine        that it is for, unless a command names another
    length         unit of plain numbers that are lengths
    angle          unit of plain numbers that are angles
    frame          what coordinates are relative to
    duration       that the whole is to take, as smoothly as it can; as little as it can if not stated
    start          first pose: x, y, z, or x, y, z, θx, θy, θz; home if not stated
    speed          cap of every segment that states none
    acceleration   cap of every segment that states none
    angular_speed  cap of every segment that states none
    tool           the tool's frame in the platform's: coordinates and speeds are the tool's then
    work           the frame in which coordinates are given
    repeat         how often the segments are run
    start_speed    tool speed at the beginning
    end_speed      tool speed at the end
    segment        the way, one after the other
    """

    what: ClassVar[str] = "program"
    machine: str | None = None
    length: Annotated[str, unit_validator("m")] | None = None
    angle: Annotated[str, unit_validator("rad")] | None = None
    frame: Frame = "home"
    duration: Annotated[float, Unit("s", above=0)] | None = None
    start: Annotated[tuple[float, ...], chosen(_start_type)] | None = None
    speed: ToolSpeed | None = None
    acceleration: ToolAcceleration | None = None
    angular_speed: AngularSpeed | None = None
    tool: PoseTable | None = None
    work: PoseTable | None = None
    repeat: Annotated[int, Field(ge=1, le=MAX_REPEATS)] = 1
    start_speed: EndSpeed = 0.0
    end_speed: EndSpeed = 0.0
    segment: Annotated[tuple[SegmentEntry, ...], Field(description=_SOME_SEGMENT), AfterValidator(_check_not_empty)]


PLAIN_UNITS = {"length": "m", "angle": "rad"}
"""The declarations that give plain numbers their unit, and the SI unit of each."""


def load_program(name_or_path: str | PathLike[str]) -> Program:
    """The program of a preset's name or of a TOML file.

    Raises FileError with every fault of the file; MotionError for an unknown name, with the nearest and all known ones.
    """
    source = find("planner", "program", name_or_path)
    try:
        document = read(source)
    except FileError as error:
        raise _suggest_import(Path(source.name), error) from None
    model = build(document, ProgramFile, plain=read_declared_units(document.data, PLAIN_UNITS))
    segments = [entry.segment(document.line(("segment", n))) for n, entry in enumerate(model.segment)]
    return Program(
        tuple(segments),
        model.frame,
        _pose(model.start),
        model.machine,
        Path(source.name).stem,
        duration=model.duration,
        speed=model.speed,
        acceleration=model.acceleration,
        angular_speed=model.angular_speed,
        tool=None if model.tool is None else model.tool.pose,
        work=None if model.work is None else model.work.pose,
        repeat=model.repeat,
        start_speed=model.start_speed,
        end_speed=model.end_speed,
        file=document.file,
    )


def _suggest_import(path: Path, error: FileError) -> FileError:
    """The error, with what to do where the file's suffix is that of a format that programs are imported from."""
    from planner.sources.source import source_name

    try:
        told = f"by its suffix it is {source_name(path)}: make a program of it by pulsepath import"
    except MotionError:
        return error
    return FileError(error.file, [*error.faults, Fault("", told, error.faults[-1].line)])


def program_names() -> tuple[str, ...]:
    """Names of the bundled programs."""
    return tuple(presets("planner"))


def _pose(start: tuple[float, ...] | None) -> Pose | None:
    if start is None:
        return None
    angles = start[3:] or (0.0, 0.0, 0.0)
    return RigidTransform.from_components(start[:3], Rotation.from_euler("XYZ", angles))
