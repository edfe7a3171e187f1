"""What a smooth piece of path is: a shape (one expression of path length and parameters) and its
numbers.

Straight lines and turns on the spot, each with its own meaning of path length; circular arcs in any
plane, by any signed angle, and helices, which rise along their normal; and orientation left free
along a segment: a turn about the tool's own axis, and a tilt of that axis within a cone. The
platform's path takes a tool along the tool's own.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby
from math import comb
from typing import TYPE_CHECKING, Annotated

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.errors import MotionError
from kinematics.foundation.facts import Fact
from kinematics.machine.pose import (
    STRAIGHT_SIZE,
    axis_angle,
    column,
    rotate_about,
    split_pose_symbols,
    straight_parameters,
    straight_pose,
    to_numbers,
)
from planner.program.modifiers import Join

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose


@dataclass(frozen=True, slots=True)
class Shape:
    """A family of curves in SE(3): motion(s, parameters) -> (position, rotation) for s from 0, with
    `size` parameters.

    Adding a shape is one file with one such function; derivatives, bounds and kinematics follow
    from it.
    """

    name: str
    size: int
    motion: Callable[[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]


@dataclass(frozen=True, slots=True)
class Derived:
    """The motion of a shape that is made of others, of a number or of formulas: rule(*of, s,
    parameters).

    Its values compare equal in other processes too, so each process builds the maps of a shape
    once. A function that is defined inside another one cannot be sent to a process.
    """

    rule: Callable[..., tuple[ca.SX, ca.SX]]
    of: tuple[Hashable, ...]

    def __call__(self, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
        return self.rule(*self.of, s, parameters)


@dataclass(frozen=True, slots=True)
class Piece:
    """A curve of a shape over a path length (m), from the shape's own s = start, of the program's
    segment `segment`.

    Path length is the path's parameter: the way of the platform's origin on lines and arcs, nearly
    so on splines, never less than the way on blends, and angle times a length on turns. Where a
    constant speed is asked for it is the way on all of them (planner.path.arc_length).

    turn        rad by which its direction or the platform turns in all: how finely it must be
                looked at
    tool_speed, tool_acceleration, tool_jerk  caps of the tool, m/s, m/s², m/s³ (None: none, or it
                                              does not move)
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
    tool_jerk: float | None = None

    @property
    def content(self) -> Hashable:
        """All that decides its geometry and its caps: every field but the numbers of segment and
        repetition.
        """
        caps = (
            self.tool_speed,
            self.tool_acceleration,
            self.tool_jerk,
            self.angular_speed,
            self.constant,
        )
        return self.shape, self.parameters.tobytes(), self.length, self.start, self.turn, caps

    def cut(self, count: int) -> "list[Piece]":
        """The same curve in equal parts."""
        length, turn = self.length / count, self.turn / count
        return [
            replace(self, length=length, turn=turn, start=self.start + k * length)
            for k in range(count)
        ]

    def trim(self, before: float, after: float) -> "Piece":
        """The same curve without its first and its last lengths."""
        length = self.length - before - after
        return replace(
            self, length=length, turn=self.turn * length / self.length, start=self.start + before
        )

    def poses(self, s: Array) -> Array:
        """The pose's twelve numbers (N, 12) at the shape's own s (N,)."""
        return pose_map(self.shape)(self._inputs(s))

    def derivatives(self, s: Array) -> tuple[Array, Array, Array, Array]:
        """The same and their first three derivatives by s, each (N, 12)."""
        return split_derivatives(pose_derivatives_map(self.shape)(self._inputs(s)))

    def _inputs(self, s: Array) -> Array:
        return np.column_stack([s, np.broadcast_to(self.parameters, (len(s), self.shape.size))])


@dataclass(frozen=True, slots=True)
class Fitted:
    """A curve instead of some pieces: how many, and how many it has; by how much it leaves them at
    most, proved.

    tolerance, angle   m and rad
    deviation, turned  m and rad; head, tail: likewise, near its start and near its end
    s, segment         m, where it deviates most: along the curve as it is made, along the whole
                       path as it is linked; and the segment there
    """

    tolerance: float
    angle: float
    before: int
    after: int
    deviation: float
    turned: float
    head: tuple[float, float]
    tail: tuple[float, float]
    s: float
    segment: int


@dataclass(frozen=True, slots=True)
class Overshoot:
    """How far a spline leaves the polygon of its points.

    distance, s    m, the largest distance, and where: along the spline as it is drawn, along the
                   path as it is linked
    point          number of the point at the end of the span with the largest distance per chord
                   nearby
    beyond, chord  m, the largest distance there, and the shortest of that span's chord and its
                   neighbours'
    """

    segment: Annotated[int, Fact("segment", "segment")]
    distance: Annotated[float, Fact("off_the_polygon_m", "off the polygon", "m", "human", ".4g")]
    s: Annotated[float, Fact("at_m", "at", "m", "human", ".3f")]
    point: Annotated[int, Fact("worst_span_to_point", "worst span, to point")]
    beyond: Annotated[float, Fact("worst_span_off_m", "worst span off", "m", "human", ".4g")]
    chord: Annotated[
        float, Fact("shortest_chord_nearby_m", "shortest chord nearby", "m", "human", ".4g")
    ]


@dataclass(frozen=True, slots=True)
class Drawn:
    """A segment as it is drawn: its pieces, smooth inside; the join at its end, and s of rest
    there.

    pieces  none: a rest before the path begins
    plain   whether it may become part of a curve (planner.path.fit)
    fitted  what was fitted there, if it is a curve
    marks   the shares of the segment at which it has a trigger
    overshoot  how far it leaves its polygon, if it is a spline
    """

    pieces: Sequence[Piece]
    join: Join
    dwell: float = 0.0
    plain: bool = False
    fitted: Fitted | None = None
    marks: tuple[float, ...] = ()
    overshoot: Overshoot | None = None


@cache
def pose_map(shape: Shape) -> Expression:
    """(s, parameters) -> the twelve pose numbers."""
    s, parameters = ca.SX.sym("s"), ca.SX.sym("parameters", shape.size)
    return Expression(
        f"{shape.name}_pose", ca.vertcat(s, parameters), column(*shape.motion(s, parameters))
    )


@cache
def pose_derivatives_map(shape: Shape) -> Expression:
    s, parameters = ca.SX.sym("s"), ca.SX.sym("parameters", shape.size)
    return differentiate(
        f"{shape.name}_moved", column(*shape.motion(s, parameters)), s, ca.vertcat(s, parameters)
    )


@cache
def position_map(shape: Shape) -> Expression:
    """(s, parameters) -> the position and its first two derivatives (9,): a tenth of the work for
    all numbers.
    """
    return pose_derivatives_map(shape).select_rows([0, 1, 2, 12, 13, 14, 24, 25, 26])


@cache
def _first_derivative_map(shape: Shape) -> Expression:
    """(s, parameters) -> the pose's numbers and their first derivative (24,)."""
    return pose_derivatives_map(shape).select_rows(range(24))


def split_derivatives(values: Array) -> tuple[Array, Array, Array, Array]:
    """Return views of x, x′, x″, x‴, each (N, 12), in the values (N, 48) of a
    `pose_derivatives_map`.
    """
    x, x1, x2, x3 = values.reshape(-1, 4, 12).swapaxes(0, 1)
    return x, x1, x2, x3


def differentiate(
    name: str, values: ca.SX, s: ca.SX, inputs: ca.SX, highest: int = 3
) -> Expression:
    """Inputs -> values and their derivatives by s, one after the other."""
    orders = [values]
    for _ in range(highest):
        orders.append(ca.jacobian(orders[-1], s))
    return Expression(name, inputs, ca.vertcat(*orders))


# Pieces whose turning is measured together: 64 of 33 points have values of 1 MB.
PIECES_AT_ONCE = 64


def measure_turns(pieces: Sequence[Piece]) -> list[Piece]:
    """Return pieces, each with the angle by which it turns in all."""
    measured: list[Piece] = []
    for _, group in groupby(pieces, lambda piece: piece.shape):
        alike = list(group)
        for first in range(0, len(alike), PIECES_AT_ONCE):
            batch = alike[first : first + PIECES_AT_ONCE]
            angles = turning_angles(batch).tolist()
            measured += [
                replace(piece, turn=angle) for piece, angle in zip(batch, angles, strict=True)
            ]
    return measured


def turning_angles(pieces: Sequence[Piece], points: int = 33) -> Array:
    """Return the angles (P,), rad, by which directions and platform turn along pieces of one shape.

    points: places of each piece that show it
    """
    start = np.array([piece.start for piece in pieces])
    length = np.array([piece.length for piece in pieces])
    s = start[:, None] + np.linspace(0.0, length, points, axis=1)
    parameters = np.repeat([piece.parameters for piece in pieces], points, axis=0)
    numbers = _first_derivative_map(pieces[0].shape)(np.column_stack([s.ravel(), parameters]))
    x, x1 = np.split(numbers.reshape(len(pieces), points, 24), 2, axis=2)

    speed = np.linalg.norm(x1[..., :3], axis=2)
    turned = np.linalg.norm(np.diff(x[..., 3:], axis=1), axis=2) / np.sqrt(2)
    direction = x1[..., :3] / np.where(speed > 0, speed, 1.0)[..., None]
    bent = np.linalg.norm(np.diff(direction, axis=1), axis=2)
    moving = (speed[:, 1:] > 0) & (speed[:, :-1] > 0)
    return np.asarray((turned + bent * moving).sum(1))


# A turn so near (rad) to half a turn goes one way or the other by rounding: that of numbers with
# eight digits.
HALF_TURN_ROUNDING = 1e-7


def refuse_half_turn(angle: float) -> None:
    """Raise MotionError where an angle (rad) of the shorter way between two orientations leaves its
    direction open.
    """
    if angle >= np.pi - HALF_TURN_ROUNDING:
        raise MotionError(
            f"it turns by half a turn, {np.degrees(angle):.9g}°, which both directions do alike: lead it through an "
            "orientation in between, or turn on the spot by a signed angle, with turn = { about = …, angle = 180 }"
        )


LINE = Shape("line", STRAIGHT_SIZE, straight_pose)


def line(start: "Pose", end: "Pose", length: float, segment: int) -> Piece:
    """The straight motion from start to end over a length, turning the shorter way in proportion to
    the path.
    """
    turn = turn_angle(start, end)
    refuse_half_turn(turn)
    return Piece(
        LINE, freeze_array(straight_parameters(start, end, length)[0]), length, segment, turn=turn
    )


def turn_angle(start: "Pose", end: "Pose") -> float:
    """Angle of the shorter turn from start to end, rad."""
    return float(axis_angle(start.rotation, end.rotation)[1][0])


def turn(start: "Pose", axis: Array, angle: float, characteristic: float, segment: int) -> Piece:
    """On the spot about a unit axis of the moving frame, by a signed angle; `characteristic` m of
    path for a radian.
    """
    place, rows = np.split(to_numbers(start)[0], [3])
    rate = np.sign(angle) / characteristic
    length = abs(angle) * characteristic
    return Piece(
        LINE,
        freeze_array(np.concatenate([place, np.zeros(3), rows, axis, [rate]])),
        length,
        segment,
        turn=abs(angle),
    )


def _motion(s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    """p = c + u cos(ks) + v sin(ks) + h s, R = R0 exp(s · rate · axis×).

    u is the start's radius vector, v = normal × u, k the angle and h (along the normal) the rise by
    path length.
    """
    centre, u, v, angle_rate, rise_rate, r0, axis, rate = ca.vertsplit(
        parameters, [0, 3, 6, 9, 10, 13, 22, 25, 26]
    )
    turn = angle_rate * s
    position = centre + u * ca.cos(turn) + v * ca.sin(turn) + rise_rate * s
    return position, rotate_about(ca.reshape(r0, 3, 3).T, axis, rate * s)


ARC = Shape("arc", 26, _motion)


# Axis (3,) and angle of a motion that does not turn.
NO_TURN = freeze_array(np.array([0.0, 0.0, 1.0, 0.0]))


def arc(
    start: Array,
    centre: Array,
    normal: Array,
    angle: float,
    turning: Array,
    segment: int,
    rise: float = 0.0,
) -> Piece:
    """Return the arc from a pose about `centre` by the signed angle, right hand about the unit
    normal.

    start    numbers of the pose (12,)
    turning  unit axis in the moving frame and angle (rad), by which the pose turns up to the end
             (4,)
    rise     m, along the normal: makes it a helix, of length √((radius · angle)² + rise²)
    """
    position, rows = np.split(start, [3])
    centre = (
        centre + ((position - centre) @ normal) * normal
    )  # in the start's own plane, to the last digit
    u = position - centre
    length = float(np.hypot(np.linalg.norm(u) * angle, rise))
    axis, turn = turning[:3], float(turning[3])
    refuse_half_turn(turn)
    numbers = [
        centre,
        u,
        np.cross(normal, u),
        np.array([angle / length]),
        normal * (rise / length),
        rows,
        axis,
        np.array([turn / length]),
    ]
    whole = abs(angle) + turn
    return Piece(ARC, freeze_array(np.concatenate(numbers)), length, segment, turn=whole)


DEGREE = 7
"""Of the polynomials that say what a segment does with its freedom."""
CONTROL_COUNT = 3 * (DEGREE + 1)
CONTROL_SLICE = slice(2, 2 + CONTROL_COUNT)
"""Where they stand among the parameters of a freed shape, and of what is made of it."""


def free_piece(piece: Piece, controls: Array, offset: float, length: float) -> Piece:
    """The piece with its frame turned in itself by Rx(α) Ry(β) Rz(ψ); its origin and its path
    length stay.

    controls        (3, DEGREE + 1) rad: Bernstein coefficients of α, β, ψ over the segment's path
                    length, 0 to 1
    offset, length  m: where the piece begins in its segment, and the segment's length
    """
    numbers = np.concatenate([[offset - piece.start, length], controls.ravel(), piece.parameters])
    return replace(piece, shape=_freed_shape(piece.shape), parameters=freeze_array(numbers))


@cache
def _freed_shape(shape: Shape) -> Shape:
    """R = R_0(s) Rx(α(u)) Ry(β(u)) Rz(ψ(u)) with u = (s + offset)/length."""
    return Shape(
        f"{shape.name}_freed", 2 + CONTROL_COUNT + shape.size, Derived(_freed_motion, (shape,))
    )


def _freed_motion(shape: Shape, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    offset, length, controls, own = ca.vertsplit(
        parameters, [0, 1, 2, 2 + CONTROL_COUNT, 2 + CONTROL_COUNT + shape.size]
    )
    position, rotation = shape.motion(s, own)
    alpha, beta, psi = ca.vertsplit(
        ca.reshape(controls, DEGREE + 1, 3).T @ bernstein_weights((s + offset) / length)
    )
    return position, rotation @ axis_rotation(0, alpha) @ axis_rotation(1, beta) @ axis_rotation(
        2, psi
    )


def bernstein_weights(u: ca.SX) -> ca.SX:
    """(DEGREE + 1,) the polynomials that are weights of the coefficients at u."""
    n = DEGREE
    polynomials: ca.SX = ca.vertcat(*(comb(n, k) * u**k * (1 - u) ** (n - k) for k in range(n + 1)))
    return polynomials


def axis_rotation(axis: int, angle: ca.SX) -> ca.SX:
    """(3, 3) rotation about a coordinate axis, 0 to 2, by an angle in rad."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = ca.SX.eye(3)
    turn[i, i] = turn[j, j] = ca.cos(angle)
    turn[i, j], turn[j, i] = -ca.sin(angle), ca.sin(angle)
    return turn


def carry_tool(piece: Piece, tool: "Pose") -> Piece:
    """The platform's way P(s) = T(s) · tool⁻¹ under the tool's way T(s); path length stays the
    tool's own.
    """
    parameters = np.concatenate([piece.parameters, to_numbers(tool.inv())[0]])
    return replace(piece, shape=_carried_shape(piece.shape), parameters=freeze_array(parameters))


@cache
def _carried_shape(shape: Shape) -> Shape:
    """The tool's inverse is twelve more parameters, so that all tools share one expression."""
    return Shape(f"{shape.name}_by_tool", shape.size + 12, Derived(_carried_motion, (shape,)))


def _carried_motion(shape: Shape, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    own, back = ca.vertsplit(parameters, [0, shape.size, shape.size + 12])
    position, rotation = shape.motion(s, own)
    offset, turn = split_pose_symbols(back)
    return position + rotation @ offset, rotation @ turn


def tool_map(tool: "Pose") -> Expression:
    """The platform's twelve numbers -> the tool's, P · tool.

    It is linear, so it maps their derivatives too.
    """
    x, constant = ca.SX.sym("x", 12), ca.SX(to_numbers(tool)[0])
    (position, rotation), (offset, turn) = split_pose_symbols(x), split_pose_symbols(constant)
    return Expression("tool", x, column(position + rotation @ offset, rotation @ turn))
