"""The program model: what the tool is asked to do, segment by segment, in SI units and in the
program's own frame.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from math import isfinite
from typing import TYPE_CHECKING, Literal, overload

import numpy as np
from casadi import SX

from kinematics.foundation.arrays import Array, is_within_limit, most
from kinematics.foundation.errors import Fault, FileError, MotionError
from kinematics.foundation.formula import check_names, formula
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import check_fields, fits
from kinematics.foundation.result import Result
from kinematics.foundation.short_repr import short_repr
from kinematics.foundation.table import Column, Table
from kinematics.foundation.units import (
    Acceleration,
    Angle,
    AngularSpeed,
    Duration,
    Jerk,
    Length,
    Speed,
)
from planner.program.modifiers import STOP, Free, Join, Trigger
from planner.program.validation import (
    MOST_SEGMENTS,
    check_angle,
    check_caps,
    check_frame,
    check_place,
    check_points,
    check_positive,
    check_rotation,
    legible,
    read_constants,
    repeats,
    unit_direction,
)

if TYPE_CHECKING:  # SciPy's rotations take half a second to load, and few programs have any
    from scipy.spatial.transform import Rotation

    from kinematics.machine.pose import Pose

MIN_MOVE = 1e-9  # points nearer than this are the same (m), angles likewise (rad)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MovingSegment:
    """What every segment that moves the tool may state, besides where to.

    acceleration, angular_speed  caps of the tool's acceleration, m/s², and of the platform's
                                 turning, rad/s
    max_tool_jerk  cap of the tool's jerk, m/s³
    speed_constant  exactly this speed, outside the shortest ramps where it is begun from rest or
                    left to rest
                (planner.timing.goals.constant_speed: where the ramps lie at other joins)
    trigger      an event along it
    free         what of its orientation is left free, for `planner.orientation.orient` to choose
    line_number  where it stands in its file, for messages
    """

    acceleration: Acceleration | None = None
    angular_speed: AngularSpeed | None = None
    max_tool_jerk: Jerk | None = None
    speed_constant: bool = False
    trigger: Trigger | None = None
    free: Free | None = None
    line_number: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Line(MovingSegment):
    """A straight line to a position.

    to           (3,) m
    rotate       orientation at its end, reached by the shortest turn in proportion to the path;
                 None: kept
    speed        cap of the tool speed, m/s; None: as fast as the machine can
    join         to the next segment; and what `MovingSegment` has, as all that move the tool
    """

    __repr__ = short_repr
    to: Array
    rotate: "Rotation | None" = None
    speed: Speed | None = None
    join: Join = STOP

    def __post_init__(self) -> None:
        check_caps(self, "line", "to", "rotate")
        object.__setattr__(self, "to", check_place("line", "to", self.to))
        check_rotation(self, "line", "rotate")


@dataclass(frozen=True, slots=True, eq=False)
class Arc(MovingSegment):
    """A circular arc from the current point, by a signed angle: right hand about `normal`, any
    number of turns.

    centre  (3,) m;  normal  (3,) of any length, kept as a unit vector;  angle  rad
    rise    m by which it moves along the normal in all: a helix
    rotate, speed, join  as of a line
    """

    __repr__ = short_repr
    centre: Array
    normal: Array
    angle: Angle
    rotate: "Rotation | None" = None
    speed: Speed | None = None
    join: Join = STOP
    rise: Length = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        check_caps(self, "arc", "centre", "normal", "rotate")
        object.__setattr__(self, "centre", check_place("arc", "centre", self.centre))
        object.__setattr__(self, "normal", unit_direction("arc", "normal", self.normal))
        check_angle("arc", self.angle)
        check_rotation(self, "arc", "rotate")
        if not is_within_limit(self.rise, "m"):
            raise MotionError(
                f"arc: rise {self.rise} m must be finite, and at most {most('m'):g} m either way"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Spline(MovingSegment):
    """A smooth curve from the current point through points, three times continuously
    differentiable, without stops.

    through  (N, 3) m, no two neighbours the same (the path's shape: planner.path.spline)
    rotate   N orientations, one at each point; None: kept
    speed, join  as of a line
    """

    __repr__ = short_repr
    through: Array
    rotate: "Rotation | None" = None
    speed: Speed | None = None
    join: Join = STOP

    def __post_init__(self) -> None:
        check_caps(self, "spline", "through", "rotate")
        through = check_points("spline", "through", self.through)
        object.__setattr__(self, "through", through)
        repeated = np.flatnonzero(np.linalg.norm(np.diff(through, axis=0), axis=1) <= MIN_MOVE)
        if len(repeated):
            raise MotionError(f"spline: {repeats(int(repeated[0]) + 1)}")
        check_rotation(self, "spline", "rotate", len(through))
        if self.rotate is not None and (self.rotate.single or len(self.rotate) != len(through)):
            given = 1 if self.rotate.single else len(self.rotate)
            few = f"{count_noun(given, 'orientation')} for {count_noun(len(through), 'point')}"
            raise MotionError(f"spline: {few}; give one for each, or none")


@dataclass(frozen=True, slots=True, eq=False)
class Curve(MovingSegment):
    """A curve by equations x(t), y(t), z(t), and optional angles, for t from begin to end.

    position     three formulas (kinematics.foundation.formula) that give `length` m each 1
    begin, end   of t, also downwards
    rotate       three formulas of θx, θy, θz, `angle` rad each 1, as Rx · Ry · Rz; None: the
                 orientation is kept
    constants    names that stand for numbers in them, and the numbers
    It begins where the path stands, and must be smooth and not stand still (planner.path.curve).
    speed, join  as of a line
    """

    __repr__ = short_repr
    position: tuple[str, str, str]
    begin: float
    end: float
    rotate: tuple[str, str, str] | None = None
    speed: Speed | None = None
    join: Join = STOP
    constants: tuple[tuple[str, float], ...] = field(default=(), kw_only=True)
    length: Length = field(default=1.0, kw_only=True)
    angle: Angle = field(default=1.0, kw_only=True)

    def __post_init__(self) -> None:
        check_caps(self, "curve", "position", "rotate", "constants")
        object.__setattr__(self, "constants", read_constants(self.constants))
        check_names(dict(self.constants))
        check_positive("curve", "length", self.length, "m")
        check_positive("curve", "angle", self.angle, "rad")
        if not (isfinite(self.begin) and isfinite(self.end)) or self.begin == self.end:
            raise MotionError(
                f"curve: t from {self.begin} to {self.end} must be finite, and differ"
            )
        for name, texts in (("position", self.position), ("rotate", self.rotate)):
            if texts is not None and (not fits(texts, Sequence[str]) or len(texts) != 3):
                raise MotionError(
                    f"curve: {name} takes three formulas, each a text, not {texts!r:.60}"
                )
            for text in texts or ():
                formula(text, dict(self.constants), SX.sym("t"))


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A rotation on the spot: to the orientation `to`, the shorter way, or by any signed angle.

    about, angle  (3,) axis, right hand, kept as a unit vector, and rad: any number of turns
    angular_speed, trigger, line_number  as of what moves the tool;  join  as of a line
    """

    __repr__ = short_repr
    to: "Rotation | None" = None
    join: Join = STOP
    angular_speed: AngularSpeed | None = field(default=None, kw_only=True)
    trigger: Trigger | None = field(default=None, kw_only=True)
    about: Array | None = field(default=None, kw_only=True)
    angle: Angle = field(default=0.0, kw_only=True)
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        check_caps(self, "turn", "to", "about")
        if (self.to is None) == (self.about is None):
            raise MotionError(
                "turn: give the orientation `to`, or `about` and `angle`; exactly one of the two"
            )
        check_rotation(self, "turn", "to")
        if self.about is not None:
            object.__setattr__(self, "about", unit_direction("turn", "about", self.about))
            check_angle("turn", self.angle)


@dataclass(frozen=True, slots=True, eq=False)
class Synchronised:
    """A point-to-point move [Sahbaz 2007, 5.2.3]: all axes move straight to their targets, and
    start and stop together.

    Where the tool goes between is what the machine makes of it. All axes have the speed of the
    slowest one, scaled. The printed program departs from this where an axis has fewer pulses than
    its ramps: it then runs a triangle of two ramps of half the move's time. Its ends are the same;
    its course between them is not followed here.
    to      (3,) m, and the orientation there: None: kept
    speed, acceleration, angular_speed, max_tool_jerk, trigger, join, line_number  as of a line
    """

    __repr__ = short_repr
    to: Array
    rotate: "Rotation | None" = None
    speed: Speed | None = None
    join: Join = STOP
    acceleration: Acceleration | None = field(default=None, kw_only=True)
    angular_speed: AngularSpeed | None = field(default=None, kw_only=True)
    max_tool_jerk: Jerk | None = field(default=None, kw_only=True)
    trigger: Trigger | None = field(default=None, kw_only=True)
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        check_caps(self, "synchronised", "to", "rotate")
        object.__setattr__(self, "to", check_place("synchronised", "to", self.to))
        check_rotation(self, "synchronised", "rotate")


@dataclass(frozen=True, slots=True)
class Dwell:
    """A dwell of `duration` (s). A trigger of it is at a share of that time."""

    duration: Duration
    trigger: Trigger | None = field(default=None, kw_only=True)
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        check_fields(self)
        check_positive("dwell", "duration", self.duration, "s")
        if self.trigger is not None and self.trigger.after_rest:
            name = self.trigger.name
            raise MotionError(
                f"dwell: trigger {name}: after_rest is of what moves; leave it out: at = 1 is the end"
            )


Segment = Line | Arc | Spline | Curve | Turn | Synchronised | Dwell
Frame = Literal["home", "base"]


@dataclass(frozen=True, slots=True, eq=False)
class SegmentStream(Sequence[Segment]):
    """Segments of a file that are not held: whoever goes through them reads it anew.

    read   begins with the first; total: how many there are. None of them has an orientation left
           free.
    marked  whether any of them has a trigger
    """

    read: Callable[[], Iterator[Segment]]
    total: int
    marked: bool = False

    def __iter__(self) -> Iterator[Segment]:
        return self.read()

    def __len__(self) -> int:
        return self.total

    @overload
    def __getitem__(self, index: int) -> Segment: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Segment, ...]: ...
    def __getitem__(self, index: int | slice) -> Segment | tuple[Segment, ...]:
        chosen = range(self.total)[index]
        if isinstance(chosen, int):
            return next(islice(self.read(), chosen, None))
        first, after = (min(chosen), max(chosen) + 1) if chosen else (0, 0)
        some = tuple(islice(self.read(), first, after))
        return tuple(some[k - first] for k in chosen)


@dataclass(frozen=True, slots=True, eq=False)
class Program(Result):
    """A program of segments, run in order; coordinates are absolute in its frame.

    frame    "home": relative to the machine's home pose, or "base": in the machine's base frame
    start    first pose, in the program's frame; None: where the machine's home pose has it
    machine  name or path of the machine it is meant for, if it says so
    speed, acceleration, angular_speed, max_tool_jerk  caps of every segment that moves and states
                                                       none of its own
    tool     the tool's frame in the platform's: coordinates say where it goes, speeds are its own;
             None: the platform's
    work     the frame, in the program's, in which coordinates are given; None: the program's frame
             itself
    repeat   how often the segments are run, one time after the other, each from where the path
             stands
    duration  s that the whole is to take, as smoothly as it can; None: as little as it can
    start_speed, end_speed  tool speed (m/s) with which the motion begins and ends; 0: at rest
    file     what it was read from, for messages; empty: it was not
    join_word  what in a file asks for its path as it is, whatever options say, as G61; empty:
               nothing
    Raises MotionError for an empty program, an unknown frame, a machine by no name, a count or a
    speed that is none.
    """

    segments: Sequence[Segment]
    frame: Frame = "home"
    start: "Pose | None" = None
    machine: str | None = None
    name: str = "program"
    duration: Duration | None = field(default=None, kw_only=True)
    speed: Speed | None = field(default=None, kw_only=True)
    acceleration: Acceleration | None = field(default=None, kw_only=True)
    angular_speed: AngularSpeed | None = field(default=None, kw_only=True)
    max_tool_jerk: Jerk | None = field(default=None, kw_only=True)
    tool: "Pose | None" = field(default=None, kw_only=True)
    work: "Pose | None" = field(default=None, kw_only=True)
    repeat: int = field(default=1, kw_only=True)
    start_speed: Speed = field(default=0.0, kw_only=True)
    end_speed: Speed = field(default=0.0, kw_only=True)
    file: str = field(default="", kw_only=True)
    join_word: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        check_caps(self, f"program {self.name}", "segments", "repeat", "start", "tool", "work")
        told, given = (
            "give it a line, arc, spline, curve, turn, synchronised move or dwell",
            self.segments,
        )
        if not isinstance(given, SegmentStream):
            object.__setattr__(
                self, "segments", tuple(given) if fits(given, Iterable[object]) else (given,)
            )
            if odd := [one for one in self.segments if not isinstance(one, Segment)]:
                raise MotionError(f"program {self.name}: {odd[0]!r:.60} is no segment: {told}")
        for frame in ("start", "tool", "work"):
            if (pose := getattr(self, frame)) is not None:
                object.__setattr__(self, frame, check_frame(f"program {self.name}: {frame}", pose))
        if not self.segments:
            raise MotionError(f"program {self.name} is empty: {told}")
        if isinstance(self.repeat, bool) or not isinstance(self.repeat, int) or self.repeat < 1:
            raise MotionError(
                f"program {self.name}: repeat {self.repeat} must be a whole number from 1 on"
            )
        held = self.repeat > 1 or not isinstance(
            self.segments, SegmentStream
        )  # what is read once may go on for ever
        if held and self.repeat * len(self.segments) > MOST_SEGMENTS:
            told = f"repeat {self.repeat} of {count_noun(len(given), 'segment')} is more than {MOST_SEGMENTS} in all"
            lines = [segment.line_number for segment in self.segments if segment.line_number]
            if self.file:
                raise FileError(
                    self.file, [Fault("repeat", f"{told}; run parts of it", min(lines, default=1))]
                )
            raise MotionError(f"program {self.name}: {told}; run parts of it")
        for end, speed in (("start_speed", self.start_speed), ("end_speed", self.end_speed)):
            if not (is_within_limit(speed, "m/s") and speed >= 0):
                limit = f"not negative, and at most {most('m/s'):g} m/s"
                raise MotionError(f"program {self.name}: {end} {speed} m/s must be finite, {limit}")
        legible(f"program {self.name}", "machine", self.machine)
        check_positive(f"program {self.name}", "duration", self.duration, "s")

    def __repr__(self) -> str:
        return (
            f"<Program {self.name}: {count_noun(len(self.segments), 'segment')}, from {self.frame}>"
        )

    def tables(self) -> tuple[Table, ...]:
        """Its segments, one a row: where each leads as far as it says so itself, its caps, join and
        trigger.
        """
        segments = self.segments
        ends = [_end(segment) for segment in segments]
        caps = (
            ("speed", "m/s"),
            ("acceleration", "m/s^2"),
            ("angular_speed", "rad/s"),
            ("max_tool_jerk", "m/s^3"),
        )
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
        told = tuple(
            column for column in columns if any(value is not None for value in column.values)
        )
        again = "" if self.repeat == 1 else f", {self.repeat} times"
        return (
            Table(
                f"{self.name}: {count_noun(len(segments), 'segment')}{again}, from {self.frame}",
                told,
            ),
        )

    @property
    def caps_jerk(self) -> bool:
        """True if the program or a segment caps the tool's jerk; segments of a stream do not
        count.
        """
        if self.max_tool_jerk is not None:
            return True
        known = () if isinstance(self.segments, SegmentStream) else self.segments
        return any(getattr(segment, "max_tool_jerk", None) is not None for segment in known)

    def cap(self, segment: Segment, name: str) -> float | None:
        """A segment's own cap, or the program's; None where neither says one, or the segment cannot
        have it.
        """
        own: float | None = getattr(segment, name, None)
        return getattr(self, name) if own is None and hasattr(segment, name) else own


def _end(segment: Segment) -> Array | None:
    """(3,) m where a segment leads, if it says so itself."""
    if isinstance(segment, Line | Synchronised):
        return segment.to
    return segment.through[-1] if isinstance(segment, Spline) else None
