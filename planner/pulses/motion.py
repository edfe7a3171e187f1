"""What a pulse schedule is made from and checked against: a motion that can be sampled."""

from typing import Protocol, runtime_checkable

from kinematics.array import Array


class MotionState(Protocol):
    """The motion at instants t (N,): path length s (N,); q (m or rad), q̇, q̈, q⃛ (N, axes)."""

    @property
    def s(self) -> Array: ...
    @property
    def q(self) -> Array: ...
    @property
    def qd(self) -> Array: ...
    @property
    def qdd(self) -> Array: ...
    @property
    def qddd(self) -> Array: ...


class Motion(Protocol):
    """Axis positions over time; `planner.trajectory.Trajectory` is one.

    knots     (M+1,) s, never decreasing, from 0 to the duration: q(t) is smooth inside an interval, q and q̇ are
              continuous across a knot, and a state asked at a knot belongs to the interval on its right
    duration  s
    """

    @property
    def knots(self) -> Array: ...
    @property
    def duration(self) -> float: ...
    def at(self, t: Array, /) -> MotionState: ...


@runtime_checkable
class AxisMotion(Motion, Protocol):
    """A motion that tells of one axis in a fraction of the time: a state whose q, q̇, q̈, q⃛ are (N, 1)."""

    def axis_at(self, t: Array, axis: int, /) -> MotionState: ...


@runtime_checkable
class MotorMotion(Motion, Protocol):
    """What motors do so that behind play and screws their axes do what is planned; planned: of the axes."""

    @property
    def planned(self) -> Motion: ...
