"""Orientation left free along a segment: a turn about the tool's own axis, and a tilt of that axis within a cone."""

from dataclasses import replace
from functools import cache, partial
from math import comb

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from planner.path.shape import Piece, Shape

DEGREE = 7
"""Of the polynomials that say what a segment does with its freedom."""
CONTROL_COUNT = 3 * (DEGREE + 1)
CONTROL_SLICE = slice(2, 2 + CONTROL_COUNT)
"""Where they stand among the parameters of a freed shape, and of what is made of it."""


def free_piece(piece: Piece, controls: Array, offset: float, length: float) -> Piece:
    """The piece with its frame turned in itself by Rx(α) Ry(β) Rz(ψ); its origin and its path length stay.

    controls        (3, DEGREE + 1) rad: Bernstein coefficients of α, β, ψ over the segment's path length, 0 to 1
    offset, length  m: where the piece begins in its segment, and the segment's length
    """
    numbers = np.concatenate([[offset - piece.start, length], controls.ravel(), piece.parameters])
    return replace(piece, shape=_freed_shape(piece.shape), parameters=freeze_array(numbers))


@cache
def _freed_shape(shape: Shape) -> Shape:
    """R = R_0(s) Rx(α(u)) Ry(β(u)) Rz(ψ(u)) with u = (s + offset)/length."""
    return Shape(f"{shape.name}_freed", 2 + CONTROL_COUNT + shape.size, partial(_motion, shape))


def _motion(shape: Shape, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    offset, length, controls, own = ca.vertsplit(
        parameters, [0, 1, 2, 2 + CONTROL_COUNT, 2 + CONTROL_COUNT + shape.size]
    )
    position, rotation = shape.motion(s, own)
    alpha, beta, psi = ca.vertsplit(ca.reshape(controls, DEGREE + 1, 3).T @ bernstein_weights((s + offset) / length))
    return position, rotation @ _axis_rotation(0, alpha) @ _axis_rotation(1, beta) @ _axis_rotation(2, psi)


def bernstein_weights(u: ca.SX) -> ca.SX:
    """(DEGREE + 1,) the polynomials that are weights of the coefficients at u."""
    n = DEGREE
    polynomials: ca.SX = ca.vertcat(*(comb(n, k) * u**k * (1 - u) ** (n - k) for k in range(n + 1)))
    return polynomials


def _axis_rotation(axis: int, angle: ca.SX) -> ca.SX:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = ca.SX.eye(3)
    turn[i, i] = turn[j, j] = ca.cos(angle)
    turn[i, j], turn[j, i] = -ca.sin(angle), ca.sin(angle)
    return turn
