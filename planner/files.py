"""Program files: the schema of their TOML, and the program that one describes."""

from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.array import frozen
from kinematics.document import read
from kinematics.pose import Pose
from kinematics.registry import find, presets
from kinematics.schema import Direction, File, Table, build, chosen, declared, either, not_zero, unit_of, wrong
from kinematics.units import Unit, shown
from planner.program import Arc, Blend, Dwell, Frame, Join, Line, Program, Segment, Stop, Turn

PLAIN_UNITS = {"length": "m", "angle": "rad"}
"""The declarations that give plain numbers their unit, and the SI unit of each."""


def load_program(name_or_path: str | PathLike[str]) -> Program:
    """The program of a preset's name or of a TOML file.

    Raises FileError with every fault of the file; MotionError for an unknown name, with the nearest and all known ones.
    """
    source = find("planner", "program", name_or_path)
    document = read(source)
    model = build(document, ProgramFile, plain=declared(document.data, PLAIN_UNITS))
    segments = [entry.segment(document.line(("segment", n))) for n, entry in enumerate(model.segment)]
    return Program(
        tuple(segments), model.frame, _pose(model.start), model.machine, Path(source.name).stem, model.duration
    )


def program_names() -> tuple[str, ...]:
    """Names of the bundled programs."""
    return tuple(presets("planner"))


def _pose(start: tuple[float, ...] | None) -> Pose | None:
    if start is None:
        return None
    angles = start[3:] or (0.0, 0.0, 0.0)
    return RigidTransform.from_components(start[:3], Rotation.from_euler("XYZ", angles))


def _rotation(angles: tuple[float, float, float] | None) -> Rotation | None:
    """Rx(θx) · Ry(θy) · Rz(θz): about the moving axes in turn."""
    return None if angles is None else Rotation.from_euler("XYZ", angles)


def _not_empty(segments: tuple[Any, ...]) -> tuple[Any, ...]:
    if not segments:
        raise wrong(f"empty: {_SOME_SEGMENT}")
    return segments


def _join_type(value: object) -> Any:
    if isinstance(value, dict):
        return BlendTable
    if value != "stop":
        raise wrong(f'{shown(value)} is not a join: write "stop" or {{ blend = "0.05 mm" }}')
    return Literal["stop"]


def _start_type(value: object) -> Any:
    if isinstance(value, tuple) and len(value) not in (3, 6):
        raise wrong(f"{len(value)} entries: give 3 (x, y, z) or 6 (x, y, z, θx, θy, θz)")
    return PositionAndAngles if isinstance(value, tuple) and len(value) == 6 else Position


_SOME_SEGMENT = "a program needs at least one [[segment]]"

Coordinate = Annotated[float, Unit("m", plain="length")]
PlainAngle = Annotated[float, Unit("rad", plain="angle")]
ToolSpeed = Annotated[float, Unit("m/s", above=0)]
Position = tuple[Coordinate, Coordinate, Coordinate]
Orientation = tuple[PlainAngle, PlainAngle, PlainAngle]
PositionAndAngles = tuple[Coordinate, Coordinate, Coordinate, PlainAngle, PlainAngle, PlainAngle]


class BlendTable(Table):
    blend: Annotated[float, Unit("m", above=0, plain="length")]


JoinEntry = Annotated[Literal["stop"] | BlendTable, chosen(_join_type)]


class LineTable(Table):
    to: Position
    rotate: Orientation | None = None


class ArcTable(Table):
    centre: Position
    normal: Direction
    angle: Annotated[PlainAngle, AfterValidator(not_zero)]
    rotate: Orientation | None = None


class TurnTable(Table):
    to: Orientation


class Entry(Table):
    """What every segment that moves has."""

    join: JoinEntry = "stop"

    @property
    def after(self) -> Join:
        return Stop() if self.join == "stop" else Blend(self.join.blend)


class LineEntry(Entry):
    line: LineTable
    speed: ToolSpeed | None = None

    def segment(self, line_number: int | None) -> Segment:
        return Line(frozen(self.line.to), _rotation(self.line.rotate), self.speed, self.after, line_number=line_number)


class ArcEntry(Entry):
    arc: ArcTable
    speed: ToolSpeed | None = None

    def segment(self, line_number: int | None) -> Segment:
        centre, normal, turned = frozen(self.arc.centre), frozen(self.arc.normal), _rotation(self.arc.rotate)
        return Arc(centre, normal, self.arc.angle, turned, self.speed, self.after, line_number=line_number)


class TurnEntry(Entry):
    turn: TurnTable

    def segment(self, line_number: int | None) -> Segment:
        return Turn(Rotation.from_euler("XYZ", self.turn.to), self.after, line_number=line_number)


class DwellEntry(Table):
    dwell: Annotated[float, Unit("s", above=0)]

    def segment(self, line_number: int | None) -> Segment:
        return Dwell(self.dwell, line_number=line_number)


SegmentEntry = Annotated[
    LineEntry | ArcEntry | TurnEntry | DwellEntry, either(LineEntry, ArcEntry, TurnEntry, DwellEntry)
]


class ProgramFile(File):
    """A program's TOML, key by key."""

    machine: str | None = None
    length: Annotated[str, unit_of("m")] | None = None
    angle: Annotated[str, unit_of("rad")] | None = None
    frame: Frame = "home"
    duration: Annotated[float, Unit("s", above=0)] | None = None
    start: Annotated[tuple[float, ...], chosen(_start_type)] | None = None
    segment: Annotated[tuple[SegmentEntry, ...], Field(description=_SOME_SEGMENT), AfterValidator(_not_empty)]
