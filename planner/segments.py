"""The segments of a program: what the tool is asked to do next, in SI units and in the program's own frame."""

from dataclasses import dataclass, field
from math import isfinite

import numpy as np
from casadi import SX
from scipy.spatial.transform import Rotation

from kinematics.array import Array
from kinematics.errors import MotionError
from kinematics.magnitudes import most, within
from planner.formula import check_names, formula
from planner.modifiers import STOP, Free, Join, Trigger
from planner.wanted import capped, direction, place, points, positive, repeats, turned

SAME = 1e-9
"""Points nearer than this are the same (m), angles likewise (rad)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Moved:
    """What every segment that moves the tool may state, besides where to.

    acceleration, angular_speed  caps of the tool's acceleration, m/s², and of the platform's turning, rad/s
    speed_constant  exactly this speed, outside the shortest ramps where it is begun from rest or left to rest
                (planner.parted: where the ramps lie at other joins)
    trigger      an event along it
    free         what of its orientation is left free, for `planner.orientation` to choose
    line_number  where it stands in its file, for messages
    """

    acceleration: float | None = None
    angular_speed: float | None = None
    speed_constant: bool = False
    trigger: Trigger | None = None
    free: Free | None = None
    line_number: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Line(Moved):
    """A straight line to a position.

    to           (3,) m
    rotate       orientation at its end, reached by the shortest turn in proportion to the path; None: kept
    speed        cap of the tool speed, m/s; None: as fast as the machine can
    join         to the next segment
    and what `Moved` has, as all that move the tool
    """

    to: Array
    rotate: Rotation | None = None
    speed: float | None = None
    join: Join = STOP

    def __post_init__(self) -> None:
        object.__setattr__(self, "to", place("line", "to", self.to))
        capped(self, "line")


@dataclass(frozen=True, slots=True, eq=False)
class Arc(Moved):
    """A circular arc from where the path stands, by a signed angle: right hand about `normal`, any number of turns.

    centre  (3,) m;  normal  (3,) of any length, kept as a unit vector;  angle  rad
    rise    m by which it moves along the normal in all: a helix
    rotate, speed, join  as of a line
    """

    centre: Array
    normal: Array
    angle: float
    rotate: Rotation | None = None
    speed: float | None = None
    join: Join = STOP
    rise: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", place("arc", "centre", self.centre))
        object.__setattr__(self, "normal", direction("arc", "normal", self.normal))
        turned("arc", self.angle)
        if not within(self.rise, "m"):
            raise MotionError(f"arc: rise {self.rise} m must be finite, and at most {most('m'):g} m either way")
        capped(self, "arc")


@dataclass(frozen=True, slots=True, eq=False)
class Spline(Moved):
    """A smooth curve from where the path stands through points, with four continuous derivatives and no stop inside.

    through  (N, 3) m, no two neighbours the same (the path's shape: planner.path.spline)
    rotate   N orientations, one at each point; None: kept
    speed, join  as of a line
    """

    through: Array
    rotate: Rotation | None = None
    speed: float | None = None
    join: Join = STOP

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
class Curve(Moved):
    """A curve by equations: x(t), y(t), z(t), and angles if it turns the tool, for t from begin to end.

    position     three formulas (planner.formula) that give `length` m each 1;  begin, end  of t, also downwards
    rotate       three formulas of θx, θy, θz, `angle` rad each 1, as Rx · Ry · Rz; None: the orientation is kept
    constants    names that stand for numbers in them, and the numbers
    It begins where the path stands, and must be smooth and not stand still (planner.path.curve).
    speed, join  as of a line
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
    angular_speed, trigger, line_number  as of what moves the tool;  join  as of a line
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
            turned("turn", self.angle)
        capped(self, "turn")


@dataclass(frozen=True, slots=True, eq=False)
class Synchronised:
    """A move from pose to pose in which every axis goes straight to its place, all starting and ending together.

    The point-to-point move of [Sahbaz 2007, 5.2.3]; where the tool goes between is what the machine makes of it.

    to      (3,) m, and the orientation there: None: kept
    speed, acceleration, angular_speed, trigger, join, line_number  as of a line
    """

    to: Array
    rotate: Rotation | None = None
    speed: float | None = None
    join: Join = STOP
    acceleration: float | None = field(default=None, kw_only=True)
    angular_speed: float | None = field(default=None, kw_only=True)
    trigger: Trigger | None = field(default=None, kw_only=True)
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "to", place("synchronised", "to", self.to))
        capped(self, "synchronised")


@dataclass(frozen=True, slots=True)
class Dwell:
    """A rest of `duration` (s)."""

    duration: float
    line_number: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        positive("dwell", "duration", self.duration, "s")


Segment = Line | Arc | Spline | Curve | Turn | Synchronised | Dwell
