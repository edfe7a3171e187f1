"""Orientation left free along a segment: a turn about the tool's own axis, and a tilt of that axis within a cone."""

from dataclasses import replace
from functools import cache, partial
from math import comb

import casadi as ca
import numpy as np

from kinematics.array import Array, frozen
from planner.path.shape import Piece, Shape

DEGREE = 7
"""Of the polynomials that say what a segment does with its freedom."""
NUMBERS = 3 * (DEGREE + 1)
CONTROLS = slice(2, 2 + NUMBERS)
"""Where they stand among the parameters of a freed shape, and of what is made of it."""


def freed(piece: Piece, controls: Array, offset: float, length: float) -> Piece:
    """The piece with its frame turned in itself by Rx(α) Ry(β) Rz(ψ); its origin and its path length stay.

    controls        (3, DEGREE + 1) rad: Bernstein coefficients of α, β, ψ over the segment's path length, 0 to 1
    offset, length  m: where the piece begins in its segment, and the segment's length
    """
    numbers = np.concatenate([[offset - piece.start, length], controls.ravel(), piece.parameters])
    return replace(piece, shape=_freed(piece.shape), parameters=frozen(numbers))


@cache
def _freed(shape: Shape) -> Shape:
    """R = R_0(s) Rx(α(u)) Ry(β(u)) Rz(ψ(u)) with u = (s + offset)/length."""
    return Shape(f"{shape.name}_freed", 2 + NUMBERS + shape.size, partial(_motion, shape))


def _motion(shape: Shape, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    offset, length, controls, own = ca.vertsplit(parameters, [0, 1, 2, 2 + NUMBERS, 2 + NUMBERS + shape.size])
    position, rotation = shape.motion(s, own)
    alpha, beta, psi = ca.vertsplit(ca.reshape(controls, DEGREE + 1, 3).T @ bernstein((s + offset) / length))
    return position, rotation @ _about(0, alpha) @ _about(1, beta) @ _about(2, psi)


def bernstein(u: ca.SX) -> ca.SX:
    """(DEGREE + 1,) the polynomials that are weights of the coefficients at u."""
    n = DEGREE
    polynomials: ca.SX = ca.vertcat(*(comb(n, k) * u**k * (1 - u) ** (n - k) for k in range(n + 1)))
    return polynomials


def _about(axis: int, angle: ca.SX) -> ca.SX:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = ca.SX.eye(3)
    turn[i, i] = turn[j, j] = ca.cos(angle)
    turn[i, j], turn[j, i] = -ca.sin(angle), ca.sin(angle)
    return turn
