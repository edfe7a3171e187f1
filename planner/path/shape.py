"""What a smooth piece of path is: a shape (one expression of path length and parameters) and its numbers."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import casadi as ca

from kinematics.array import Array
from kinematics.expression import Expression
from kinematics.pose import column


@dataclass(frozen=True, slots=True)
class Shape:
    """A family of curves in SE(3): motion(s, parameters) -> (position, rotation) for s from 0, with `size` parameters.

    Adding a shape is one file with one such function; derivatives, bounds and kinematics follow from it.
    """

    name: str
    size: int
    motion: Callable[[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]


@dataclass(frozen=True, slots=True)
class Piece:
    """A curve of a shape over a path length (m), from the shape's own s = start, of the program's segment `segment`.

    turn        rad by which its direction or the platform turns in all: how finely it must be looked at
    tool_speed, tool_acceleration  caps of the platform's origin, m/s and m/s² (None: none, or it does not move)
    angular_speed  cap on the platform's turning, rad/s
    """

    shape: Shape
    parameters: Array
    length: float
    segment: int
    tool_speed: float | None = None
    start: float = 0.0
    turn: float = 0.0
    tool_acceleration: float | None = None
    angular_speed: float | None = None

    def cut(self, count: int) -> "list[Piece]":
        """The same curve in equal parts."""
        length, turn = self.length / count, self.turn / count
        return [replace(self, length=length, turn=turn, start=self.start + k * length) for k in range(count)]


@cache
def pose_map(shape: Shape) -> Expression:
    """(s, parameters) -> the twelve pose numbers."""
    s, parameters = ca.SX.sym("s"), ca.SX.sym("parameters", shape.size)
    return Expression(f"{shape.name}_pose", ca.vertcat(s, parameters), column(*shape.motion(s, parameters)))
