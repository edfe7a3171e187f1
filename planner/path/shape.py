"""What a smooth piece of path is: a shape (one expression of path length and parameters) and its numbers."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np

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

    Path length is the path's parameter: the way of the platform's origin on lines and arcs, the length of the chords
    on splines, never less than the way on blends, and angle times a length on turns. Where a constant speed is asked
    for it is the way on all of them (planner.path.even).

    turn        rad by which its direction or the platform turns in all: how finely it must be looked at
    tool_speed, tool_acceleration  caps of the tool, m/s and m/s² (None: none, or it does not move)
    angular_speed  cap on the platform's turning, rad/s
    constant    the tool has exactly that speed, outside the ramps at the ends of the segment
    repetition  of the program, from 1; None: it runs once
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
    constant: bool = False
    repetition: int | None = None

    def cut(self, count: int) -> "list[Piece]":
        """The same curve in equal parts."""
        length, turn = self.length / count, self.turn / count
        return [replace(self, length=length, turn=turn, start=self.start + k * length) for k in range(count)]

    def trimmed(self, before: float, after: float) -> "Piece":
        """The same curve without its first and its last lengths."""
        length = self.length - before - after
        return replace(self, length=length, turn=self.turn * length / self.length, start=self.start + before)

    def poses(self, s: Array) -> Array:
        """The pose's twelve numbers (N, 12) at the shape's own s (N,)."""
        return pose_map(self.shape)(self._inputs(s))

    def derivatives(self, s: Array) -> tuple[Array, Array, Array, Array]:
        """The same and their first three derivatives by s, each (N, 12)."""
        x, x1, x2, x3 = np.split(_pose_derivatives(self.shape)(self._inputs(s)), 4, axis=1)
        return x, x1, x2, x3

    def _inputs(self, s: Array) -> Array:
        return np.column_stack([s, np.broadcast_to(self.parameters, (len(s), self.shape.size))])


@cache
def pose_map(shape: Shape) -> Expression:
    """(s, parameters) -> the twelve pose numbers."""
    s, parameters = ca.SX.sym("s"), ca.SX.sym("parameters", shape.size)
    return Expression(f"{shape.name}_pose", ca.vertcat(s, parameters), column(*shape.motion(s, parameters)))


@cache
def _pose_derivatives(shape: Shape) -> Expression:
    s, parameters = ca.SX.sym("s"), ca.SX.sym("parameters", shape.size)
    return differentiated(f"{shape.name}_moved", column(*shape.motion(s, parameters)), s, ca.vertcat(s, parameters))


def differentiated(name: str, values: ca.SX, s: ca.SX, inputs: ca.SX, highest: int = 3) -> Expression:
    """Inputs -> values and their derivatives by s, one after the other."""
    orders = [values]
    for _ in range(highest):
        orders.append(ca.jacobian(orders[-1], s))
    return Expression(name, inputs, ca.vertcat(*orders))


def turning(piece: Piece, points: int = 33) -> float:
    """rad by which the direction of a piece and the platform turn in all, as `points` points show it."""
    x, x1, _, _ = piece.derivatives(piece.start + np.linspace(0.0, piece.length, points))
    speed = np.linalg.norm(x1[:, :3], axis=1, keepdims=True)
    turned = np.linalg.norm(np.diff(x[:, 3:], axis=0), axis=1) / np.sqrt(2)
    direction = np.diff(x1[:, :3] / np.where(speed > 0, speed, 1.0), axis=0)
    bent = np.linalg.norm(direction, axis=1) * (speed[1:, 0] > 0) * (speed[:-1, 0] > 0)
    return float((turned + bent).sum())
