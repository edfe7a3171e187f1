"""The program model: what the tool is asked to do, segment by segment, in SI units and in the program's own frame."""

from dataclasses import dataclass, field
from math import isfinite
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.pose import Pose


@dataclass(frozen=True, slots=True)
class Stop:
    """The join at which the motion comes to rest."""


@dataclass(frozen=True, slots=True)
class Blend:
    """The join that is rounded, leaving the programmed corner by at most `tolerance` (m)."""

    tolerance: float

    def __post_init__(self) -> None:
        _positive("blend", "tolerance", self.tolerance, "m")


Join = Stop | Blend


@dataclass(frozen=True, slots=True)
class Trigger:
    """An event at a position: named, at a share of its segment's path length (1: at its end)."""

    name: str
    at: float = 1.0

    def __post_init__(self) -> None:
        if not self.name:
            raise MotionError("trigger: its name is empty; give the output line or the event that it stands for")
        if not 0 <= self.at <= 1:
            raise MotionError(f"trigger {self.name}: at {self.at} must be a share of its segment, from 0 to 1")


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A straight line to a position.

    to           (3,) m
    rotate       orientation at its end, reached by the shortest turn in proportion to the path; None: kept
    speed        cap of the tool speed, m/s; None: as fast as the machine can
    speed_constant  exactly this speed, outside the shortest ramps at its ends
    join         to the next segment
    trigger      an event along it
    line_number  where it stands in its file, for messages
    """

    to: Array
    rotate: Rotation | None = None
    speed: float | None = None
    join: Join = Stop()
    speed_constant: bool = field(default=False, kw_only=True)
    trigger: Trigger | None = field(default=None, kw_only=True)
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "to", _vector("line", "to", self.to))
        _speed("line", self.speed, self.speed_constant)


@dataclass(frozen=True, slots=True, eq=False)
class Arc:
    """A circular arc from where the path stands, by a signed angle: right hand about `normal`, any number of turns.

    centre  (3,) m;  normal  (3,) of any length, kept as a unit vector;  angle  rad
    rotate, speed, join, speed_constant, trigger, line_number  as of a line
    """

    centre: Array
    normal: Array
    angle: float
    rotate: Rotation | None = None
    speed: float | None = None
    join: Join = Stop()
    speed_constant: bool = field(default=False, kw_only=True)
    trigger: Trigger | None = field(default=None, kw_only=True)
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", _vector("arc", "centre", self.centre))
        normal = _vector("arc", "normal", self.normal)
        largest = np.abs(normal).max()
        if largest == 0:
            raise MotionError("arc: normal is zero; give the direction about which the arc turns, e.g. [0, 0, 1]")
        scaled = normal / largest  # the norm of very large or very small vectors would overflow
        object.__setattr__(self, "normal", frozen(scaled / np.linalg.norm(scaled)))
        if not isfinite(self.angle) or self.angle == 0:
            raise MotionError(f"arc: angle {self.angle} rad must be finite and not zero")
        _speed("arc", self.speed, self.speed_constant)


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A rotation on the spot to the orientation `to`, the shorter way."""

    to: Rotation
    join: Join = Stop()
    trigger: Trigger | None = field(default=None, kw_only=True)
    line_number: int | None = field(default=None, kw_only=True)


@dataclass(frozen=True, slots=True)
class Dwell:
    """A rest of `duration` (s)."""

    duration: float
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        _positive("dwell", "duration", self.duration, "s")


Segment = Line | Arc | Turn | Dwell
Frame = Literal["home", "base"]


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """A program of segments, run one after the other; coordinates are absolute in its frame.

    frame    "home": relative to the machine's home pose, or "base": in the machine's base frame
    start    first pose, in the program's frame; None: where the machine's home pose has it
    machine  name or path of the machine it is meant for, if it says so
    tool     the tool's frame in the platform's: coordinates say where it goes, speeds are its own; None: the platform's
    work     the frame, in the program's, in which coordinates are given; None: the program's frame itself
    repeat   how often the segments are run, one time after the other, each from where the path stands
    start_speed, end_speed  tool speed (m/s) with which the motion begins and ends; 0: at rest
    Raises MotionError for an empty program, an unknown frame, a count or a speed that is none.
    """

    segments: tuple[Segment, ...]
    frame: Frame = "home"
    start: Pose | None = None
    machine: str | None = None
    name: str = "program"
    tool: Pose | None = field(default=None, kw_only=True)
    work: Pose | None = field(default=None, kw_only=True)
    repeat: int = field(default=1, kw_only=True)
    start_speed: float = field(default=0.0, kw_only=True)
    end_speed: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", tuple(self.segments))
        if not self.segments:
            raise MotionError(f"program {self.name} is empty: give it at least one line, arc, turn or dwell")
        if self.frame not in ("home", "base"):
            raise MotionError(f'program {self.name}: frame "{self.frame}" is neither "home" nor "base"')
        if isinstance(self.repeat, bool) or not isinstance(self.repeat, int) or self.repeat < 1:
            raise MotionError(f"program {self.name}: repeat {self.repeat} must be a whole number from 1 on")
        for end, speed in (("start_speed", self.start_speed), ("end_speed", self.end_speed)):
            if not (isfinite(speed) and speed >= 0):
                raise MotionError(f"program {self.name}: {end} {speed} m/s must be finite and not negative")


def _vector(segment: str, name: str, value: ArrayLike) -> Array:
    try:
        vector = frozen(value, float)
    except (TypeError, ValueError):
        vector = frozen([])
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise MotionError(f"{segment}: {name} must be three finite numbers, not {value!r}")
    return vector


def _speed(segment: str, speed: float | None, constant: bool) -> None:
    _positive(segment, "speed", speed, "m/s")
    if constant and speed is None:
        raise MotionError(f"{segment}: speed_constant asks for a speed: give speed as well")


def _positive(segment: str, name: str, value: float | None, unit: str) -> None:
    if value is not None and not (isfinite(value) and value > 0):
        raise MotionError(f"{segment}: {name} {value} {unit} must be positive and finite")
