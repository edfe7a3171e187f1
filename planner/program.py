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


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A straight line to a position.

    to           (3,) m
    rotate       orientation at its end, reached by the shortest turn in proportion to the path; None: kept
    speed        cap of the tool speed, m/s; None: as fast as the machine can
    join         to the next segment
    line_number  where it stands in its file, for messages
    """

    to: Array
    rotate: Rotation | None = None
    speed: float | None = None
    join: Join = Stop()
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "to", _vector("line", "to", self.to))
        _positive("line", "speed", self.speed, "m/s")


@dataclass(frozen=True, slots=True, eq=False)
class Arc:
    """A circular arc from where the path stands, by a signed angle: right hand about `normal`, any number of turns.

    centre  (3,) m;  normal  (3,) of any length, kept as a unit vector;  angle  rad
    rotate, speed, join, line_number  as of a line
    """

    centre: Array
    normal: Array
    angle: float
    rotate: Rotation | None = None
    speed: float | None = None
    join: Join = Stop()
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
        _positive("arc", "speed", self.speed, "m/s")


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A rotation on the spot to the orientation `to`, the shorter way."""

    to: Rotation
    join: Join = Stop()
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
    start    first pose, in the program's frame; None: the machine's home pose
    machine  name or path of the machine it is meant for, if it says so
    duration  s that the whole is to take, as smoothly as it can; None: as little as it can
    Raises MotionError for an empty program or an unknown frame.
    """

    segments: tuple[Segment, ...]
    frame: Frame = "home"
    start: Pose | None = None
    machine: str | None = None
    name: str = "program"
    duration: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", tuple(self.segments))
        if not self.segments:
            raise MotionError(f"program {self.name} is empty: give it at least one line, arc, turn or dwell")
        if self.frame not in ("home", "base"):
            raise MotionError(f'program {self.name}: frame "{self.frame}" is neither "home" nor "base"')
        _positive(f"program {self.name}", "duration", self.duration, "s")


def _vector(segment: str, name: str, value: ArrayLike) -> Array:
    try:
        vector = frozen(value, float)
    except (TypeError, ValueError):
        vector = frozen([])
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise MotionError(f"{segment}: {name} must be three finite numbers, not {value!r}")
    return vector


def _positive(segment: str, name: str, value: float | None, unit: str) -> None:
    if value is not None and not (isfinite(value) and value > 0):
        raise MotionError(f"{segment}: {name} {value} {unit} must be positive and finite")
