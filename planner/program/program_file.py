"""Program files: the schema of their TOML, what each [[segment]] may say, and the program that one
describes.
"""

from collections.abc import Mapping
from itertools import pairwise
from math import dist
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from pydantic import AfterValidator, Field, model_validator

from kinematics.files.keys import Chosen, key
from kinematics.files.schema import (
    NAME,
    Direction,
    File,
    Name,
    TableSchema,
    build,
    one_of_tables,
    read_declared_units,
    require_nonzero,
    unit_validator,
)
from kinematics.files.toml_document import Document, read
from kinematics.foundation.arrays import freeze_array
from kinematics.foundation.errors import Fault, FileError, validation_error
from kinematics.foundation.names import count_noun, find, presets
from kinematics.foundation.units import Unit
from planner.program.model import (
    MIN_MOVE,
    Arc,
    Dwell,
    Frame,
    Line,
    Program,
    Segment,
    Spline,
    Synchronised,
    Turn,
)
from planner.program.segment_tables import (
    ACCELERATION,
    JERK,
    SPEED,
    AngularSpeed,
    CurveEntry,
    DwellTriggerEntry,
    MovingEntry,
    PathEntry,
    ToolAcceleration,
    ToolJerk,
    ToolSpeed,
    read_trigger,
)
from planner.program.validation import MAX_REPEATS, repeats

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from kinematics.machine.pose import Pose


def _rotation(angles: tuple[Any, ...] | None) -> "Rotation | None":
    """Rx(θx) · Ry(θy) · Rz(θz): about the moving axes in turn, of one orientation or of several."""
    if angles is None:
        return None
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("XYZ", angles)


def _pose(start: tuple[float, ...] | None) -> "Pose | None":
    if start is None:
        return None
    from kinematics.machine.pose import make_pose

    return make_pose(start[:3], start[3:] or (0.0, 0.0, 0.0))


def _check_not_empty(segments: tuple[Any, ...]) -> tuple[Any, ...]:
    if not segments:
        raise validation_error(f"empty: {_SOME_SEGMENT}")
    return segments


def _check_distinct(points: tuple[tuple[float, float, float], ...]) -> tuple[Any, ...]:
    if not points:
        raise validation_error("empty: give a spline at least one point")
    for n, (one, other) in enumerate(pairwise(points), 1):
        if dist(one, other) <= MIN_MOVE:
            raise validation_error(repeats(n))
    return points


def _start_type(value: object) -> Any:
    if isinstance(value, tuple) and len(value) not in (3, 6):
        raise validation_error(
            f"{count_noun(len(value), 'entry')}: give 3 (x, y, z) or 6 (x, y, z, θx, θy, θz)"
        )
    return PositionAndAngles if isinstance(value, tuple) and len(value) == 6 else Position


_TURNED = "rotate: orientation at the end, unchanged if not stated"
_SOME_SEGMENT = "a program needs at least one [[segment]]"

Coordinate = Annotated[float, Unit("m", plain="length")]
PlainAngle = Annotated[float, Unit("rad", plain="angle")]
EndSpeed = Annotated[float, Unit("m/s", least=0)]
Position = tuple[Coordinate, Coordinate, Coordinate]
Orientation = tuple[PlainAngle, PlainAngle, PlainAngle]
PositionAndAngles = tuple[Coordinate, Coordinate, Coordinate, PlainAngle, PlainAngle, PlainAngle]


class PoseTable(TableSchema):
    """A frame in another: moved by `to`, then turned by `rotate`."""

    to: Position = key("translation", default=(0.0, 0.0, 0.0))
    rotate: Orientation = key(
        "rotation: θx, θy, θz about the moving axes in turn", default=(0.0, 0.0, 0.0)
    )

    @property
    def pose(self) -> "Pose | None":
        return _pose(self.to + self.rotate)


class LineTable(TableSchema):
    """A straight line."""

    to: Position = key("end position")
    rotate: Orientation | None = key(
        "orientation at the end: θx, θy, θz about the moving axes in turn; unchanged if not stated",
        default=None,
    )


class ArcTable(TableSchema):
    """A circular arc from where the path stands."""

    centre: Position = key("centre of the circle")
    normal: Direction = key("normal of the plane of the circle")
    angle: Annotated[PlainAngle, AfterValidator(require_nonzero)] = key(
        "signed angle, right hand about the normal; may exceed a full turn"
    )
    rise: Coordinate = key("total rise along the normal, which makes a helix", default=0.0)
    rotate: Orientation | None = key(
        "orientation at the end; unchanged if not stated", default=None
    )


class SplineTable(TableSchema):
    """A smooth curve through points."""

    through: Annotated[tuple[Position, ...], AfterValidator(_check_distinct)] = key(
        "points after the end of the previous segment"
    )
    rotate: tuple[Orientation, ...] | None = key(
        "orientation at each point; unchanged if not stated", default=None
    )

    @model_validator(mode="after")
    def _one_for_each(self) -> Self:
        if self.rotate is not None and len(self.rotate) != len(self.through):
            given, points = len(self.rotate), len(self.through)
            raise validation_error(
                f"{count_noun(given, 'orientation')} in rotate for {count_noun(points, 'point')} in "
                "through: give one for each, or none"
            )
        return self


class TurnTo(TableSchema):
    """A rotation on the spot."""

    to: Orientation = key(
        "end orientation: θx, θy, θz about the moving axes in turn; the shorter way"
    )


class TurnBy(TableSchema):
    """A rotation on the spot."""

    about: Direction = key("axis of the rotation")
    angle: Annotated[PlainAngle, AfterValidator(require_nonzero)] = key(
        "signed angle, right hand about the axis; may exceed a full turn"
    )


class SynchronisedTable(TableSchema):
    """A joint move: all axes start and stop together; the tool does not follow a line."""

    to: Position = key("end position")
    rotate: Orientation | None = key(
        "orientation at the end: θx, θy, θz about the moving axes in turn; unchanged if not stated",
        default=None,
    )


class LineEntry(PathEntry):
    line: LineTable = key(
        f"straight line; {_TURNED}",
        '{ to = ["10 mm", "0 mm", "25 mm"], rotate = ["0 deg", "0 deg", "3 deg"] }',
    )

    def segment(self, line_number: int | None) -> Segment:
        return Line(
            freeze_array(self.line.to),
            _rotation(self.line.rotate),
            **self.modifiers,
            line_number=line_number,
        )


class ArcEntry(PathEntry):
    arc: ArcTable = key(
        f"circular arc, right hand about the normal; rise: total rise along the normal; {_TURNED}",
        '{ centre = ["0 mm", "0 mm", "25 mm"], normal = [0, 0, 1], angle = "360 deg", rise = "5 mm" }',
    )

    def segment(self, line_number: int | None) -> Segment:
        centre, normal, turned = (
            freeze_array(self.arc.centre),
            freeze_array(self.arc.normal),
            _rotation(self.arc.rotate),
        )
        return Arc(
            centre,
            normal,
            self.arc.angle,
            turned,
            **self.modifiers,
            rise=self.arc.rise,
            line_number=line_number,
        )


class SplineEntry(PathEntry):
    spline: SplineTable = key(
        "smooth curve through points; rotate: orientation at each, unchanged if not stated",
        '{ through = [["10 mm", "5 mm", "25 mm"], ["0 mm", "10 mm", "25 mm"]] }',
    )

    def segment(self, line_number: int | None) -> Segment:
        points, turned = freeze_array(self.spline.through), _rotation(self.spline.rotate)
        return Spline(points, turned, **self.modifiers, line_number=line_number)


class TurnEntry(MovingEntry):
    turn: Annotated[TurnTo | TurnBy, one_of_tables(TurnTo, TurnBy)] = key(
        "rotation on the spot to an orientation; or { about = [0, 0, 1], angle = 90 }",
        '{ to = ["5 deg", "0 deg", "0 deg"] }',
    )

    def segment(self, line_number: int | None) -> Segment:
        said: dict[str, Any] = {
            "angular_speed": self.angular_speed,
            "trigger": self.event,
            "line_number": line_number,
        }
        if isinstance(self.turn, TurnBy):
            return Turn(
                None,
                self.next_join,
                about=freeze_array(self.turn.about),
                angle=self.turn.angle,
                **said,
            )
        return Turn(_rotation(self.turn.to), self.next_join, **said)


class SynchronisedEntry(MovingEntry):
    synchronised: SynchronisedTable = key(
        f"joint move: all axes start and stop together, the tool does not follow a line; {_TURNED}",
        '{ to = ["10 mm", "0 mm", "25 mm"], rotate = ["0 deg", "0 deg", "3 deg"] }',
    )
    speed: ToolSpeed | None = SPEED
    acceleration: ToolAcceleration | None = ACCELERATION
    max_tool_jerk: ToolJerk | None = JERK

    def segment(self, line_number: int | None) -> Segment:
        to, turned = freeze_array(self.synchronised.to), _rotation(self.synchronised.rotate)
        caps: dict[str, Any] = {
            "acceleration": self.acceleration,
            "angular_speed": self.angular_speed,
            "max_tool_jerk": self.max_tool_jerk,
        }
        return Synchronised(
            to,
            turned,
            self.speed,
            self.next_join,
            **caps,
            trigger=self.event,
            line_number=line_number,
        )


class DwellEntry(TableSchema):
    dwell: Annotated[float, Unit("s", above=0)] = key("rest of this duration", '"0.2 s"')
    trigger: DwellTriggerEntry = key(
        "event; at: share of the rest, 1 (the end) if not stated",
        '{ name = "camera", at = 0.5 }',
        None,
    )

    def segment(self, line_number: int | None) -> Segment:
        return Dwell(self.dwell, trigger=read_trigger(self.trigger), line_number=line_number)


SEGMENTS = (LineEntry, ArcEntry, SplineEntry, CurveEntry, TurnEntry, SynchronisedEntry, DwellEntry)
"""What a [[segment]] is: one of these."""
SegmentEntry = Annotated[
    LineEntry | ArcEntry | SplineEntry | CurveEntry | TurnEntry | SynchronisedEntry | DwellEntry,
    one_of_tables(*SEGMENTS),
]


class ProgramFile(File):
    """A program's TOML, key by key."""

    what: ClassVar[str] = "program"
    places: ClassVar[Mapping[str, str]] = dict.fromkeys(PathEntry.model_fields, "[[segment]]")
    name: Name | None = NAME
    machine: str | None = key(
        "name of a bundled machine, or path from the folder of this file; --machine overrides it",
        default=None,
    )
    length: Annotated[str, unit_validator("m")] | None = key(
        "unit of positions that are plain numbers", default=None
    )
    angle: Annotated[str, unit_validator("rad")] | None = key(
        "unit of angles that are plain numbers", default=None
    )
    frame: Frame = key(
        'frame of positions: "home" (home pose of the machine) or "base" (base frame)',
        '"home"',
        default="home",
    )
    start: Annotated[tuple[float, ...], Chosen(_start_type)] | None = key(
        "first pose, home if not stated: x, y, z, or x, y, z, θx, θy, θz", "[0, 0, 0]", None
    )
    repeat: Annotated[int, Field(ge=1, le=MAX_REPEATS)] = key(
        "number of times that the segments run", "2", 1
    )
    duration: Annotated[float, Unit("s", above=0)] | None = key(
        "duration of the whole motion, as smooth as possible; as fast as possible if not stated",
        '"60 s"',
        None,
    )
    speed: ToolSpeed | None = key(
        "limit of the tool speed, for segments that state none", '"100 mm/s"', None
    )
    acceleration: ToolAcceleration | None = key(
        "limit of the tool acceleration, for segments that state none", '"1000 mm/s^2"', None
    )
    angular_speed: AngularSpeed | None = key(
        "limit of the tool's angular speed, for segments that state none", '"30 deg/s"', None
    )
    max_tool_jerk: ToolJerk | None = key(
        "limit of the tool jerk, for segments that state none; makes the plan limit jerk",
        '"50 m/s^3"',
        None,
    )
    tool: PoseTable | None = key(
        "pose of the tool tip in the platform's frame",
        '{ to = ["0 mm", "0 mm", "10 mm"], rotate = ["0 deg", "0 deg", "0 deg"] }',
        None,
    )
    work: PoseTable | None = key(
        "pose of the workpiece in `frame`: origin of all positions",
        '{ to = ["0 mm", "0 mm", "0 mm"], rotate = ["0 deg", "0 deg", "0 deg"] }',
        None,
    )
    start_speed: EndSpeed = key("tool speed at the start; 0 if not stated", '"5 mm/s"', 0.0)
    end_speed: EndSpeed = key("tool speed at the end; 0 if not stated", '"5 mm/s"', 0.0)
    segment: Annotated[tuple[SegmentEntry, ...], AfterValidator(_check_not_empty)] = key(
        "segments, in their order", remedy=_SOME_SEGMENT
    )


PLAIN_UNITS = {"length": "m", "angle": "rad"}
"""The declarations that give plain numbers their unit, and the SI unit of each."""


ProgramSource = Program | str | PathLike[str]
"""A program, or what `load_program` loads one from."""


def load_program(name_or_path: ProgramSource) -> Program:
    """Load a program.

    Parameters
    ----------
    name_or_path
        Name of a bundled program, or path of a TOML file. A program stays as it is.

    Returns
    -------
    Program
        Named as its file says, or after the file; in SI units.

    Raises
    ------
    FileError
        The file has faults; all of them are told, with their lines.
    MotionError
        The name is unknown; the nearest and all known ones are told.
    """
    return (
        name_or_path
        if isinstance(name_or_path, Program)
        else make_program(*read_program_file(name_or_path))
    )


def read_program_file(name_or_path: str | PathLike[str]) -> tuple[Document, ProgramFile]:
    """A program's file and what it says. Raises FileError with every fault that its keys show."""
    source = find("planner", "program", name_or_path)
    try:
        document = read(source)
    except FileError as error:
        raise _suggest_import(Path(source.name), error) from None
    return document, build(
        document, ProgramFile, plain=read_declared_units(document.data, PLAIN_UNITS)
    )


def make_program(document: Document, model: ProgramFile) -> Program:
    """The program that a file describes. Raises MotionError for what only its segments show."""
    segments = [
        entry.segment(document.line(("segment", n))) for n, entry in enumerate(model.segment)
    ]
    return Program(
        tuple(segments),
        model.frame,
        _pose(model.start),
        model.machine,
        model.name or Path(document.file).stem,
        duration=model.duration,
        speed=model.speed,
        acceleration=model.acceleration,
        angular_speed=model.angular_speed,
        max_tool_jerk=model.max_tool_jerk,
        tool=None if model.tool is None else model.tool.pose,
        work=None if model.work is None else model.work.pose,
        repeat=model.repeat,
        start_speed=model.start_speed,
        end_speed=model.end_speed,
        file=document.file,
    )


def _suggest_import(path: Path, error: FileError) -> FileError:
    """The error, with what to do where the file's suffix is that of a format that programs are
    imported from.
    """
    from planner.sources.source import suffix_formats

    name = suffix_formats().get(path.suffix.lower())
    if name is None:
        return error
    told = f"by its suffix it is {name}: plan it with pulsepath plan, or convert it with pulsepath import"
    return FileError(error.file, [*error.faults, Fault("", told, error.faults[-1].line)])


def program_names() -> tuple[str, ...]:
    """Names of the bundled programs."""
    return tuple(presets("planner"))
