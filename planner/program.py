"""The program model: what the tool is asked to do, segment by segment, in SI units and in the program's own frame."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from kinematics.array import Array
from kinematics.errors import Fault, FileError, MotionError
from kinematics.magnitudes import most, within
from kinematics.pose import Pose
from kinematics.result import Result
from kinematics.table import Column, Table
from planner.modifiers import Blend as Blend
from planner.modifiers import Free as Free
from planner.modifiers import Join as Join
from planner.modifiers import Stop as Stop
from planner.modifiers import Through as Through
from planner.modifiers import Trigger as Trigger
from planner.segments import SAME as SAME
from planner.segments import Arc as Arc
from planner.segments import Curve as Curve
from planner.segments import Dwell as Dwell
from planner.segments import Line as Line
from planner.segments import Segment as Segment
from planner.segments import Spline as Spline
from planner.segments import Synchronised as Synchronised
from planner.segments import Turn as Turn
from planner.wanted import MOST_SEGMENTS, capped, legible, positive

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Frame = Literal["home", "base"]


@dataclass(frozen=True, slots=True, eq=False)
class Program(Result):
    """A program of segments, run one after the other; coordinates are absolute in its frame.

    frame    "home": relative to the machine's home pose, or "base": in the machine's base frame
    start    first pose, in the program's frame; None: where the machine's home pose has it
    machine  name or path of the machine it is meant for, if it says so
    speed, acceleration, angular_speed  caps of every segment that moves and states none of its own
    tool     the tool's frame in the platform's: coordinates say where it goes, speeds are its own; None: the platform's
    work     the frame, in the program's, in which coordinates are given; None: the program's frame itself
    repeat   how often the segments are run, one time after the other, each from where the path stands
    duration  s that the whole is to take, as smoothly as it can; None: as little as it can
    start_speed, end_speed  tool speed (m/s) with which the motion begins and ends; 0: at rest
    file     what it was read from, for messages; empty: it was not
    Raises MotionError for an empty program, an unknown frame, a machine by no name, a count or a speed that is none.
    """

    segments: tuple[Segment, ...]
    frame: Frame = "home"
    start: Pose | None = None
    machine: str | None = None
    name: str = "program"
    duration: float | None = field(default=None, kw_only=True)
    speed: float | None = field(default=None, kw_only=True)
    acceleration: float | None = field(default=None, kw_only=True)
    angular_speed: float | None = field(default=None, kw_only=True)
    tool: Pose | None = field(default=None, kw_only=True)
    work: Pose | None = field(default=None, kw_only=True)
    repeat: int = field(default=1, kw_only=True)
    start_speed: float = field(default=0.0, kw_only=True)
    end_speed: float = field(default=0.0, kw_only=True)
    file: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", tuple(self.segments))
        if not self.segments:
            raise MotionError(
                f"program {self.name} is empty: give it a line, arc, spline, curve, turn, synchronised move or dwell"
            )
        if self.frame not in ("home", "base"):
            raise MotionError(f'program {self.name}: frame "{self.frame}" is neither "home" nor "base"')
        if isinstance(self.repeat, bool) or not isinstance(self.repeat, int) or self.repeat < 1:
            raise MotionError(f"program {self.name}: repeat {self.repeat} must be a whole number from 1 on")
        if self.repeat * len(self.segments) > MOST_SEGMENTS:
            told = f"repeat {self.repeat} of {len(self.segments)} segments is more than {MOST_SEGMENTS} segments in all"
            lines = [segment.line_number for segment in self.segments if segment.line_number]
            if self.file:
                raise FileError(self.file, [Fault("repeat", f"{told}; run parts of it", min(lines, default=1))])
            raise MotionError(f"program {self.name}: {told}; run parts of it")
        for end, speed in (("start_speed", self.start_speed), ("end_speed", self.end_speed)):
            if not (within(speed, "m/s") and speed >= 0):
                limit = f"not negative, and at most {most('m/s'):g} m/s"
                raise MotionError(f"program {self.name}: {end} {speed} m/s must be finite, {limit}")
        legible(f"program {self.name}", "machine", self.machine)
        positive(f"program {self.name}", "duration", self.duration, "s")
        capped(self, f"program {self.name}")

    def tables(self) -> tuple[Table, ...]:
        """Its segments, one a row: where each leads as far as it says so itself, its caps, join and trigger."""
        segments = self.segments
        ends = [_end(segment) for segment in segments]
        caps = (("speed", "m/s"), ("acceleration", "m/s^2"), ("angular_speed", "rad/s"))
        columns = (
            Column("segment", range(1, len(segments) + 1)),
            Column("kind", [type(segment).__name__.lower() for segment in segments]),
            *(
                Column(name, [None if end is None else float(end[k]) for end in ends], "m", "human")
                for k, name in enumerate("xyz")
            ),
            *(
                Column(name.replace("_", " "), [self.cap(segment, name) for segment in segments], unit, "human")
                for name, unit in caps
            ),
            Column("rest", [segment.duration if isinstance(segment, Dwell) else None for segment in segments], "s"),
            Column("join", [type(getattr(segment, "join", None)).__name__.lower() for segment in segments],
                   words={"nonetype": ""}),
            Column("trigger", [getattr(getattr(segment, "trigger", None), "name", None) for segment in segments]),
        )  # fmt: skip
        told = tuple(column for column in columns if any(value is not None for value in column.values))
        again = "" if self.repeat == 1 else f", {self.repeat} times"
        return (Table(f"{self.name}: {len(segments)} segments{again}, from {self.frame}", told),)

    def files(self) -> Mapping[str, Callable[[Path], None]]:
        """.toml: a file that `load_program` reads; .csv and .json: the table."""
        from planner.program_writer import program_toml

        return {
            ".toml": lambda path: path.write_bytes(program_toml(self).encode()),
            ".csv": self._csv,
            ".json": self._json,
        }

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """The tool's way in the program's coordinates."""
        from planner.sources.outline import outline
        from planner.sources.plots import path

        return path(outline(self), ax, self.name)

    def cap(self, segment: Segment, name: str) -> float | None:
        """A segment's own cap, or the program's; None where neither says one, or the segment cannot have it."""
        own: float | None = getattr(segment, name, None)
        return getattr(self, name) if own is None and hasattr(segment, name) else own


def _end(segment: Segment) -> Array | None:
    """(3,) m where a segment leads, if it says so itself."""
    if isinstance(segment, Line | Synchronised):
        return segment.to
    return segment.through[-1] if isinstance(segment, Spline) else None


def stopping(program: Program) -> Program:
    """The same program with a stop at every join: what a control without blends would run."""
    stopped = (part if isinstance(part, Dwell) else replace(part, join=Stop()) for part in program.segments)
    return replace(program, segments=tuple(stopped))
