"""Synchronised moves: every axis goes straight from its place to that of a pose, and the tool's way
is what follows.

The point-to-point move of [Sahbaz 2007, 5.2.3]. In space it is a curve, the forward map of a
straight line in the axes' coordinates; no machine states that map as an expression, so it is drawn
by a polynomial of pose through exact forward solutions, and it is measured how straight the axes
then are.
"""

from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev

from kinematics.analysis.forward import RESIDUAL_TOLERANCE, iterate_newton
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.machine.machine import Machine
from kinematics.machine.pose import from_numbers, join_pose, to_numbers
from planner.path.shape import (
    Derived,
    Piece,
    Shape,
    line,
    measure_turns,
    refuse_half_turn,
    turn_angle,
)
from planner.path.spline import align_signs

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose

NAME, DEGREES = "synchronised", (8, 16, 24)
"""Of the polynomial: the least that does, since each costs whenever the path is looked at."""
FORWARD_NODES = 72
"""Forward solutions through which it goes, in the mean: more than coefficients, so that their
rounding averages out.
"""
STRAIGHTNESS_SHARE = 1e-12
"""By which coordinates may leave the straight line, as a share of the largest of them (or 1 m, 1
rad).
"""
MAX_HALVINGS = 4
"""How often a move is halved, for a polynomial each, until they are that straight."""
CHECK_POINTS = 129


@cache
def _shape(degree: int) -> Shape:
    return Shape(f"{NAME}_{degree}", 1 + 7 * (degree + 1), Derived(_motion, (degree,)))


def _motion(degree: int, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    """p and q polynomials of x = rate · s − 1;  R = the rotation of the quaternion q = (x, y, z,
    w), of any length.
    """
    rate, rows = parameters[0], ca.reshape(parameters[1:], 7, degree + 1)
    x = rate * s - 1
    value: ca.SX = rows[:, degree]
    for k in reversed(range(degree)):
        value = value * x + rows[:, k]
    vector, w = value[3:6], value[6]
    cross = ca.skew(vector)
    turned = ca.SX.eye(3) + (2 * w * cross + 2 * (cross @ cross)) / (ca.dot(vector, vector) + w * w)
    return value[:3], turned


def draw_synchronised(
    machine: Machine,
    start: "Pose",
    end: "Pose",
    tool: "Pose | None",
    segment: int,
) -> list[Piece]:
    """The tool's way from start to end (base frame) on which all axes' coordinates go straight, in
    proportion.

    Its parameter goes with the coordinates, so q′ is constant; the length is that of the tool's
    chord, or of its turn by the machine's characteristic length, whichever is more. To an end that
    no coordinates reach it is a line. Raises MotionError where no smooth way was found between.
    """
    from scipy.spatial.transform import RigidTransform

    back = RigidTransform.identity() if tool is None else tool.inv()
    chord = float(np.linalg.norm(end.translation - start.translation))
    angle = turn_angle(start, end)
    refuse_half_turn(angle)
    length = max(chord, angle * machine.characteristic_length)
    try:
        first = machine.inverse(start * back, machine.home_q)
        last = machine.inverse(end * back, first)
    except OutOfReach:  # whoever looks at the limits says so, as of a line
        return [line(start, end, length, segment)]
    for count in 2 ** np.arange(MAX_HALVINGS + 1):
        made = _pieces(
            machine,
            (first, last),
            (start * back, end * back),
            back.inv(),
            length,
            int(count),
            segment,
        )
        for pieces in made:
            return measure_turns(pieces)
    raise MotionError(
        "the axes lead straight to its end through no smooth way of the platform: they pass a singular pose; "
        "part the move, or use a line"
    )


def _pieces(
    machine: Machine,
    axes: tuple[Array, Array],
    ends: "tuple[Pose, Pose]",
    tool: "Pose",
    length: float,
    count: int,
    segment: int,
) -> Iterator[list[Piece]]:
    """In so many parts, between coordinates and poses of the platform: of every degree that is
    straight enough.
    """
    (first, last), (start, end) = axes, ends
    angle = np.pi * (np.arange(FORWARD_NODES) + 0.5) / FORWARD_NODES
    x = np.concatenate([[-1.0], -np.cos(angle), [1.0]])
    shares = (np.arange(count)[:, None] + (x + 1) / 2) / count
    poses = _follow_poses(machine, first, last, start, end, shares.ravel())
    if poses is None:
        return
    moved = poses * tool
    values = np.concatenate([moved.translation, align_signs(moved.rotation.as_quat())], 1).reshape(
        count, len(x), 7
    )
    allowed = STRAIGHTNESS_SHARE * max(1.0, float(np.abs(axes).max()))
    for degree in DEGREES:
        pieces = []
        for own in values:
            parameters = np.concatenate([[2 * count / length], _polynomial(x, own, degree).ravel()])
            pieces.append(Piece(_shape(degree), freeze_array(parameters), length / count, segment))
        if straightness(machine, pieces, tool, first, last) <= allowed:
            yield pieces


def straightness(
    machine: Machine, pieces: list[Piece], tool: "Pose", first: Array, last: Array
) -> float:
    """By how much coordinates leave the straight line along pieces of equal lengths at most, m or
    rad.
    """
    worst, back = 0.0, tool.inv()
    for n, piece in enumerate(pieces):
        share = np.linspace(0.0, 1.0, CHECK_POINTS)
        x = to_numbers(from_numbers(piece.poses(piece.length * share)) * back)
        wanted = first + ((n + share) / len(pieces))[:, None] * (last - first)
        found = machine.inverse_map(machine.inputs(x, wanted))
        worst = (
            max(worst, float(np.abs(found - wanted).max())) if np.isfinite(found).all() else np.inf
        )
    return worst


def _follow_poses(
    machine: Machine,
    first: Array,
    last: Array,
    start: "Pose",
    end: "Pose",
    shares: Array,
) -> "Pose | None":
    """The platform's poses at shares of the way, sought from the straight motion in space; None
    where one is not found.

    One that belongs to another assembly of the legs shows as a way that no polynomial follows.
    """
    from scipy.spatial.transform import Rotation

    turn = (start.rotation.inv() * end.rotation).as_rotvec()
    place = start.translation + shares[:, None] * (end.translation - start.translation)
    near = join_pose(place, start.rotation * Rotation.from_rotvec(shares[:, None] * turn))
    found, residual = iterate_newton(
        machine, first + shares[:, None] * (last - first), to_numbers(near)
    )
    return from_numbers(found) if (residual <= RESIDUAL_TOLERANCE).all() else None


def _polynomial(x: Array, values: Array, degree: int) -> Array:
    """(degree + 1, k) coefficients by powers of x in [−1, 1]: exact at both ends, least squares
    between.
    """
    share = ((x + 1) / 2)[:, None]
    chord = (1 - share) * values[0] + share * values[-1]
    inner = x[1:-1]
    # what is left is 0 at both ends: (1 − x²) times a polynomial
    basis = (1 - inner**2)[:, None] * chebyshev.chebvander(inner, degree - 2)
    found = np.linalg.lstsq(basis, (values - chord)[1:-1], rcond=None)[0]
    powers = np.zeros((degree + 1, values.shape[1]))
    for k in range(values.shape[1]):
        inside = chebyshev.cheb2poly(found[:, k])
        powers[: len(inside), k] += inside
        powers[2 : 2 + len(inside), k] -= inside
    powers[0] += (values[0] + values[-1]) / 2
    powers[1] += (values[-1] - values[0]) / 2
    return powers
