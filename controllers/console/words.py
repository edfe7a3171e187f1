"""The words of the two languages, the operator's and the remote line's, as values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from kinematics.array import Array, frozen

Mode = Literal["MAN", "REM", "TEST"]


@dataclass(frozen=True, slots=True)
class Jog:
    """One axis slowly, clockwise (+1) or counterclockwise (−1) of its motor, until it is stopped or at its end."""

    axis: int
    sign: int


@dataclass(frozen=True, slots=True)
class Position:
    """Axes by signed steps, clockwise positive, all starting together: (axis, steps) each."""

    steps: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Move:
    """The tool to a pose relative to home: x y z in m, turns about x y z in rad, Rx·Ry·Rz; along a straight line.

    synchronised  from point to point instead: every axis straight to its place, all together
    """

    pose: Array
    synchronised: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen(self.pose, float))


@dataclass(frozen=True, slots=True)
class Home:
    """Axes whose registers become zero where they stand, and what that says of their slides. Nothing moves.

    places  (axis, quantity) each: the slide stands there in its travel, as "24 in". None says nothing of one whose
            place is known; one whose place is not known then stands at its switch, where travel is 0
    """

    places: tuple[tuple[int, str | None], ...]


@dataclass(frozen=True, slots=True)
class Accept:
    """The last known registers, which a restart offers, hold. Nothing moves."""


@dataclass(frozen=True, slots=True)
class Switch:
    """Another mode."""

    mode: Mode


@dataclass(frozen=True, slots=True)
class Stop:
    """All axes ramp down, and what waits is dropped."""


@dataclass(frozen=True, slots=True)
class Where:
    """The registers, asked for."""


@dataclass(frozen=True, slots=True)
class Help:
    """The commands, asked for."""


Words = Jog | Position | Move | Home | Accept | Switch | Stop | Where | Help
