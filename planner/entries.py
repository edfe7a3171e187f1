"""The schema of a program's TOML: what each [[segment]] may say, and the segment that it describes."""

from itertools import pairwise
from math import dist
from typing import Annotated, Any, ClassVar, Self

from pydantic import AfterValidator, Field, model_validator
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.array import frozen
from kinematics.pose import Pose
from kinematics.schema import Direction, File, Table, chosen, either, not_zero, unit_of, wrong
from kinematics.units import Unit
from planner.curve_entry import CurveEntry
from planner.entry import AngularSpeed, Drawn, Entry, ToolAcceleration, ToolSpeed
from planner.program import SAME, Arc, Dwell, Frame, Line, Segment, Spline, Synchronised, Turn
from planner.wanted import MOST_REPEATS, repeats


def _rotation(angles: tuple[float, float, float] | None) -> Rotation | None:
    """Rx(θx) · Ry(θy) · Rz(θz): about the moving axes in turn."""
    return None if angles is None else Rotation.from_euler("XYZ", angles)


def _not_empty(segments: tuple[Any, ...]) -> tuple[Any, ...]:
    if not segments:
        raise wrong(f"empty: {_SOME_SEGMENT}")
    return segments


def _distinct(points: tuple[tuple[float, float, float], ...]) -> tuple[Any, ...]:
    if not points:
        raise wrong("empty: give a spline at least one point")
    for n, (one, other) in enumerate(pairwise(points), 1):
        if dist(one, other) <= SAME:
            raise wrong(repeats(n))
    return points


def _start_type(value: object) -> Any:
    if isinstance(value, tuple) and len(value) not in (3, 6):
        raise wrong(f"{len(value)} entries: give 3 (x, y, z) or 6 (x, y, z, θx, θy, θz)")
    return PositionAndAngles if isinstance(value, tuple) and len(value) == 6 else Position


_SOME_SEGMENT = "a program needs at least one [[segment]]"

Coordinate = Annotated[float, Unit("m", plain="length")]
PlainAngle = Annotated[float, Unit("rad", plain="angle")]
EndSpeed = Annotated[float, Unit("m/s", least=0)]
Position = tuple[Coordinate, Coordinate, Coordinate]
Orientation = tuple[PlainAngle, PlainAngle, PlainAngle]
PositionAndAngles = tuple[Coordinate, Coordinate, Coordinate, PlainAngle, PlainAngle, PlainAngle]


class PoseTable(Table):
    """A frame in another: moved by `to`, then turned by `rotate`.

    to      moved by
    rotate  then turned by θx, θy, θz about the moving axes in turn
    """

    to: Position = (0.0, 0.0, 0.0)
    rotate: Orientation = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> Pose:
        return RigidTransform.from_components(self.to, Rotation.from_euler("XYZ", self.rotate))


class LineTable(Table):
    """A straight line.

    to      where it ends
    rotate  orientation at its end, θx, θy, θz about the moving axes in turn; kept if not stated
    """

    to: Position
    rotate: Orientation | None = None


class ArcTable(Table):
    """A circular arc from where the path stands.

    centre  of the circle
    normal  of its plane
    angle   signed, right hand about the normal; any number of turns
    rise    along the normal in all: a helix
    rotate  orientation at its end; kept if not stated
    """

    centre: Position
    normal: Direction
    angle: Annotated[PlainAngle, AfterValidator(not_zero)]
    rise: Coordinate = 0.0
    rotate: Orientation | None = None


class SplineTable(Table):
    """A smooth curve through points.

    through  the points, from where the path stands
    rotate   an orientation for each point; kept if not stated
    """

    through: Annotated[tuple[Position, ...], AfterValidator(_distinct)]
    rotate: tuple[Orientation, ...] | None = None

    @model_validator(mode="after")
    def _one_for_each(self) -> Self:
        if self.rotate is not None and len(self.rotate) != len(self.through):
            given, points = len(self.rotate), len(self.through)
            raise wrong(f"{given} orientations in rotate for {points} points in through: give one for each, or none")
        return self


class TurnTo(Table):
    """A rotation on the spot.

    to  orientation, θx, θy, θz about the moving axes in turn, the shorter way
    """

    to: Orientation


class TurnBy(Table):
    """A rotation on the spot.

    about  axis
    angle  signed, right hand about it; any number of turns
    """

    about: Direction
    angle: Annotated[PlainAngle, AfterValidator(not_zero)]


class SynchronisedTable(Table):
    """A move from pose to pose, every axis straight to its place, all together; the tool's way is no line.

    to      where it ends
    rotate  orientation at its end, θx, θy, θz about the moving axes in turn; kept if not stated
    """

    to: Position
    rotate: Orientation | None = None


class LineEntry(Drawn):
    line: LineTable

    def segment(self, line_number: int | None) -> Segment:
        return Line(frozen(self.line.to), _rotation(self.line.rotate), **self.said, line_number=line_number)


class ArcEntry(Drawn):
    arc: ArcTable

    def segment(self, line_number: int | None) -> Segment:
        centre, normal, turned = frozen(self.arc.centre), frozen(self.arc.normal), _rotation(self.arc.rotate)
        return Arc(centre, normal, self.arc.angle, turned, **self.said, rise=self.arc.rise, line_number=line_number)


class SplineEntry(Drawn):
    spline: SplineTable

    def segment(self, line_number: int | None) -> Segment:
        turned = None if self.spline.rotate is None else Rotation.from_euler("XYZ", self.spline.rotate)
        return Spline(frozen(self.spline.through), turned, **self.said, line_number=line_number)


class TurnEntry(Entry):
    turn: Annotated[TurnTo | TurnBy, either(TurnTo, TurnBy)]

    def segment(self, line_number: int | None) -> Segment:
        said: dict[str, Any] = {"angular_speed": self.angular_speed, "trigger": self.event, "line_number": line_number}
        if isinstance(self.turn, TurnBy):
            return Turn(None, self.after, about=frozen(self.turn.about), angle=self.turn.angle, **said)
        return Turn(Rotation.from_euler("XYZ", self.turn.to), self.after, **said)


class SynchronisedEntry(Entry):
    """What it has beside it.

    speed         cap of the tool's speed
    acceleration  cap of the tool's acceleration
    """

    synchronised: SynchronisedTable
    speed: ToolSpeed | None = None
    acceleration: ToolAcceleration | None = None

    def segment(self, line_number: int | None) -> Segment:
        to, turned = frozen(self.synchronised.to), _rotation(self.synchronised.rotate)
        said: dict[str, Any] = {"acceleration": self.acceleration, "angular_speed": self.angular_speed}
        return Synchronised(to, turned, self.speed, self.after, **said, trigger=self.event, line_number=line_number)


class DwellEntry(Table):
    dwell: Annotated[float, Unit("s", above=0)]

    def segment(self, line_number: int | None) -> Segment:
        return Dwell(self.dwell, line_number=line_number)


SegmentEntry = Annotated[
    LineEntry | ArcEntry | SplineEntry | CurveEntry | TurnEntry | SynchronisedEntry | DwellEntry,
    either(LineEntry, ArcEntry, SplineEntry, CurveEntry, TurnEntry, SynchronisedEntry, DwellEntry),
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
    length: Annotated[str, unit_of("m")] | None = None
    angle: Annotated[str, unit_of("rad")] | None = None
    frame: Frame = "home"
    duration: Annotated[float, Unit("s", above=0)] | None = None
    start: Annotated[tuple[float, ...], chosen(_start_type)] | None = None
    speed: ToolSpeed | None = None
    acceleration: ToolAcceleration | None = None
    angular_speed: AngularSpeed | None = None
    tool: PoseTable | None = None
    work: PoseTable | None = None
    repeat: Annotated[int, Field(ge=1, le=MOST_REPEATS)] = 1
    start_speed: EndSpeed = 0.0
    end_speed: EndSpeed = 0.0
    segment: Annotated[tuple[SegmentEntry, ...], Field(description=_SOME_SEGMENT), AfterValidator(_not_empty)]
