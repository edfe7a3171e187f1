"""The program model: what the tool is asked to do, segment by segment, in SI units and in the program's own frame."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from casadi import SX
from scipy.spatial.transform import Rotation

from kinematics.array import Array
from kinematics.errors import MotionError
from kinematics.pose import Pose
from kinematics.result import Result
from kinematics.table import Column, Table
from planner.formula import check_names, formula
from planner.modifiers import STOP
from planner.modifiers import Blend as Blend
from planner.modifiers import Free as Free
from planner.modifiers import Join as Join
from planner.modifiers import Stop as Stop
from planner.modifiers import Through as Through
from planner.modifiers import Trigger as Trigger
from planner.wanted import capped, direction, point, points, positive, repeats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SAME = 1e-9
"""Points nearer than this are the same (m), angles likewise (rad)."""


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A straight line to a position.

    to           (3,) m
    rotate       orientation at its end, reached by the shortest turn in proportion to the path; None: kept
    speed        cap of the tool speed, m/s; None: as fast as the machine can
    join         to the next segment
    acceleration, angular_speed  caps of the tool's acceleration, m/s², and of the platform's turning, rad/s
    speed_constant  exactly this speed, outside the shortest ramps where it is begun from rest or left to rest
                (planner.parted: where the ramps lie at other joins)
    trigger      an event along it
    free         what of its orientation is left free, for `planner.orientation` to choose
    line_number  where it stands in its file, for messages
    """

    to: Array
    rotate: Rotation | None = None
    speed: float | None = None
    join: Join = STOP
    acceleration: float | None = field(default=None, kw_only=True)
    angular_speed: float | None = field(default=None, kw_only=True)
    speed_constant: bool = field(default=False, kw_only=True)
    trigger: Trigger | None = field(default=None, kw_only=True)
    free: Free | None = field(default=None, kw_only=True)
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "to", point("line", "to", self.to))
        capped(self, "line")


@dataclass(frozen=True, slots=True, eq=False)
class Arc:
    """A circular arc from where the path stands, by a signed angle: right hand about `normal`, any number of turns.

    centre  (3,) m;  normal  (3,) of any length, kept as a unit vector;  angle  rad
    rise    m by which it moves along the normal in all: a helix
    rotate, speed, join, acceleration, angular_speed, speed_constant, trigger, free, line_number  as of a line
    """

    centre: Array
    normal: Array
    angle: float
    rotate: Rotation | None = None
    speed: float | None = None
    join: Join = STOP
    rise: float = field(default=0.0, kw_only=True)
    acceleration: float | None = field(default=None, kw_only=True)
    angular_speed: float | None = field(default=None, kw_only=True)
    speed_constant: bool = field(default=False, kw_only=True)
    trigger: Trigger | None = field(default=None, kw_only=True)
    free: Free | None = field(default=None, kw_only=True)
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", point("arc", "centre", self.centre))
        object.__setattr__(self, "normal", direction("arc", "normal", self.normal))
        if not isfinite(self.angle) or self.angle == 0:
            raise MotionError(f"arc: angle {self.angle} rad must be finite and not zero")
        if not isfinite(self.rise):
            raise MotionError(f"arc: rise {self.rise} m must be finite")
        capped(self, "arc")


@dataclass(frozen=True, slots=True, eq=False)
class Spline:
    """A smooth curve from where the path stands through points, with four continuous derivatives and no stop inside.

    through  (N, 3) m, no two neighbours the same (the path's shape: planner.path.spline)
    rotate   N orientations, one at each point; None: kept
    speed, join, acceleration, angular_speed, speed_constant, trigger, free, line_number  as of a line
    """

    through: Array
    rotate: Rotation | None = None
    speed: float | None = None
    join: Join = STOP
    acceleration: float | None = field(default=None, kw_only=True)
    angular_speed: float | None = field(default=None, kw_only=True)
    speed_constant: bool = field(default=False, kw_only=True)
    trigger: Trigger | None = field(default=None, kw_only=True)
    free: Free | None = field(default=None, kw_only=True)
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        through = points("spline", "through", self.through)
        object.__setattr__(self, "through", through)
        repeated = np.flatnonzero(np.linalg.norm(np.diff(through, axis=0), axis=1) <= SAME)
        if len(repeated):
            raise MotionError(f"spline: {repeats(int(repeated[0]) + 1)}")
        if self.rotate is not None and (self.rotate.single or len(self.rotate) != len(through)):
            given = 1 if self.rotate.single else len(self.rotate)
            raise MotionError(f"spline: {given} orientations for {len(through)} points; give one for each, or none")
        capped(self, "spline")


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A curve by equations: x(t), y(t), z(t), and angles if it turns the tool, for t from begin to end.

    position     three formulas (planner.formula) that give `length` m each 1;  begin, end  of t, also downwards
    rotate       three formulas of θx, θy, θz, `angle` rad each 1, as Rx · Ry · Rz; None: the orientation is kept
    constants    names that stand for numbers in them, and the numbers
    It begins where the path stands, and must be smooth and not stand still (planner.path.curve).
    speed, join, acceleration, angular_speed, speed_constant, trigger, free, line_number  as of a line
    """

    position: tuple[str, str, str]
    begin: float
    end: float
    rotate: tuple[str, str, str] | None = None
    speed: float | None = None
    join: Join = STOP
    constants: tuple[tuple[str, float], ...] = field(default=(), kw_only=True)
    length: float = field(default=1.0, kw_only=True)
    angle: float = field(default=1.0, kw_only=True)
    acceleration: float | None = field(default=None, kw_only=True)
    angular_speed: float | None = field(default=None, kw_only=True)
    speed_constant: bool = field(default=False, kw_only=True)
    trigger: Trigger | None = field(default=None, kw_only=True)
    free: Free | None = field(default=None, kw_only=True)
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "constants", tuple(dict(self.constants).items()))
        check_names(dict(self.constants))
        positive("curve", "length", self.length, "m")
        positive("curve", "angle", self.angle, "rad")
        if not (isfinite(self.begin) and isfinite(self.end)) or self.begin == self.end:
            raise MotionError(f"curve: t from {self.begin} to {self.end} must be finite, and the two not the same")
        for name, texts in (("position", self.position), ("rotate", self.rotate)):
            if texts is not None and len(texts) != 3:
                raise MotionError(f"curve: {name} takes three formulas, not {len(texts)}")
            for text in texts or ():
                formula(text, dict(self.constants), SX.sym("t"))
        capped(self, "curve")


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A rotation on the spot: to the orientation `to`, the shorter way, or by any signed angle.

    about, angle  (3,) axis, right hand, kept as a unit vector, and rad: any number of turns
    angular_speed, join, trigger, line_number  as of a line
    """

    to: Rotation | None = None
    join: Join = STOP
    angular_speed: float | None = field(default=None, kw_only=True)
    trigger: Trigger | None = field(default=None, kw_only=True)
    about: Array | None = field(default=None, kw_only=True)
    angle: float = field(default=0.0, kw_only=True)
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if (self.to is None) == (self.about is None):
            raise MotionError("turn: give the orientation `to`, or `about` and `angle`; exactly one of the two")
        if self.about is not None:
            object.__setattr__(self, "about", direction("turn", "about", self.about))
            if not isfinite(self.angle) or self.angle == 0:
                raise MotionError(f"turn: angle {self.angle} rad must be finite and not zero")
        capped(self, "turn")


@dataclass(frozen=True, slots=True)
class Dwell:
    """A rest of `duration` (s)."""

    duration: float
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        positive("dwell", "duration", self.duration, "s")


Segment = Line | Arc | Spline | Curve | Turn | Dwell
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
    Raises MotionError for an empty program, an unknown frame, a count or a speed that is none.
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
                f"program {self.name} is empty: give it at least one line, arc, spline, curve, turn or dwell"
            )
        if self.frame not in ("home", "base"):
            raise MotionError(f'program {self.name}: frame "{self.frame}" is neither "home" nor "base"')
        if isinstance(self.repeat, bool) or not isinstance(self.repeat, int) or self.repeat < 1:
            raise MotionError(f"program {self.name}: repeat {self.repeat} must be a whole number from 1 on")
        for end, speed in (("start_speed", self.start_speed), ("end_speed", self.end_speed)):
            if not (isfinite(speed) and speed >= 0):
                raise MotionError(f"program {self.name}: {end} {speed} m/s must be finite and not negative")
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
    if isinstance(segment, Line):
        return segment.to
    return segment.through[-1] if isinstance(segment, Spline) else None


def stopping(program: Program) -> Program:
    """The same program with a stop at every join: what a control without blends would run."""
    stopped = (part if isinstance(part, Dwell) else replace(part, join=Stop()) for part in program.segments)
    return replace(program, segments=tuple(stopped))
