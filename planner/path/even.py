"""Curves by their own length: the same poses at the same places, with |dp/ds| = 1, as a constant speed needs it."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import chain

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from planner.path.shape import Piece, Shape, turning
from planner.path.way import way

# By how much |dp/ds| may differ from 1: a tenth of what the certificate allows a constant speed.
EVEN = 1e-10
# Degree of the polynomials, points at which they are held against EVEN, and halvings of a piece at most.
DEGREE, LOOKED, HALVINGS = 15, 65, 10
# Least |dp/ds| of a curve that can be run at a constant speed: less is a tool that all but stands still.
SLOWEST = 0.01
# Degree of the derivatives that are met at both ends: curves stay as smooth at their joins as they were.
SMOOTH = 3


def evened(pieces: Sequence[Piece], stops: np.ndarray, dwells: Array) -> tuple[tuple[Piece, ...], np.ndarray, Array]:
    """A path whose parameter is the tool's way wherever a constant speed is asked for.

    pieces, stops (P+1,), dwells (P+1,): as MachinePath has them, of the tool. Where a piece at constant speed has
    another parameter, as splines and blends have, it is drawn anew, and so are all such pieces that follow each other
    about it without a stop: their derivatives have to meet. Raises MotionError where the tool all but stands still.
    """
    uneven = np.array([np.abs(_slope(piece, _spread(piece)) - 1).max() > EVEN for piece in pieces])
    constant = np.array([piece.constant for piece in pieces])
    apart = np.concatenate([[True], ~uneven[1:] | ~uneven[:-1] | (stops[1:-1] == 1)])
    group = np.cumsum(apart) - 1
    chosen = uneven & (np.bincount(group, constant) > 0)[group]
    parts = [_parts(piece, HALVINGS) if redrawn else [piece] for piece, redrawn in zip(pieces, chosen, strict=True)]
    ends = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
    rests = [np.zeros(ends[-1] + 1, values.dtype) for values in (stops, dwells)]
    for rest, values in zip(rests, (stops, dwells), strict=True):
        rest[ends] = values
    return tuple(chain(*parts)), frozen(rests[0], rests[0].dtype), frozen(rests[1])


def _spread(piece: Piece) -> Array:
    return piece.start + piece.length * np.linspace(0.0, 1.0, LOOKED)


def _slope(piece: Piece, s: Array) -> Array:
    """|dp/ds| (N,)."""
    return np.asarray(np.linalg.norm(piece.derivatives(s)[1][:, :3], axis=1))


def _parts(piece: Piece, halvings: int) -> list[Piece]:
    """The piece by its own length, in as many parts as its polynomials need."""
    if _slope(piece, _spread(piece)).min() < SLOWEST or halvings == 0:
        raise MotionError(
            f"segment {piece.segment}: the tool all but stands still there, where a constant speed is asked for or "
            'joined without a stop: write join = "stop" between them'
        )
    drawn = _drawn(piece)
    if np.abs(_slope(drawn, _spread(drawn)) - 1).max() <= EVEN:
        return [replace(drawn, turn=turning(drawn))]
    return [part for half in piece.cut(2) for part in _parts(half, halvings - 1)]


def _drawn(piece: Piece) -> Piece:
    """The piece at the parameter u(s) of which ds = |dp/du| du, as a polynomial.

    It meets u and its derivatives up to the third at both ends, and u at points between.
    """
    ends = np.array([piece.start, piece.start + piece.length])
    along = way(lambda u: _slope(piece, u), *ends.tolist())
    half = along.length / 2
    matrix, inner = _conditions()
    met = np.stack([ends, *_rates(piece, ends)]) * half ** np.arange(SMOOTH + 1)[:, None]
    powers = chebyshev.cheb2poly(
        np.linalg.solve(matrix, np.concatenate([met.ravel(), along.place((inner + 1) * half)]))
    )
    parameters = np.concatenate([piece.parameters, [half], powers])
    return replace(piece, shape=_even(piece.shape), parameters=frozen(parameters), length=along.length, start=0.0)


@cache
def _even(shape: Shape) -> Shape:
    """u(s) = Σ c_k (s/h − 1)^k: the half length h and the coefficients are further parameters."""

    def motion(s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
        own, half, powers = ca.vertsplit(parameters, [0, shape.size, shape.size + 1, shape.size + 2 + DEGREE])
        x = s / half - 1
        u = powers[DEGREE]
        for k in reversed(range(DEGREE)):
            u = u * x + powers[k]
        return shape.motion(u, own)

    return Shape(f"{shape.name}_even", shape.size + 2 + DEGREE, motion)


@cache
def _conditions() -> tuple[Array, Array]:
    """What coefficients of Chebyshev polynomials make of derivatives 0 … SMOOTH at −1 and 1, and of values between."""
    inner = np.cos(np.pi * np.arange(1, DEGREE - 2 * SMOOTH) / (DEGREE - 2 * SMOOTH))
    rows = []
    for times in range(SMOOTH + 1):
        differentiated = chebyshev.chebder(np.eye(DEGREE + 1), times)
        rows.append(chebyshev.chebvander(np.array([-1.0, 1.0]), DEGREE - times) @ differentiated)
    return frozen(np.concatenate([*rows, chebyshev.chebvander(inner, DEGREE)])), frozen(inner)


def _rates(piece: Piece, u: Array) -> tuple[Array, Array, Array]:
    """du/ds, d²u/ds², d³u/ds³ (N,) of ds = f du, f = |p′|: 1/f, −f′/f³, 3 f′²/f⁵ − f″/f⁴."""
    _, p1, p2, p3 = (values[:, :3] for values in piece.derivatives(u))
    f = np.linalg.norm(p1, axis=1)
    f1 = (p1 * p2).sum(1) / f
    f2 = ((p2 * p2).sum(1) + (p1 * p3).sum(1) - f1**2) / f
    return 1 / f, -f1 / f**3, 3 * f1**2 / f**5 - f2 / f**4
