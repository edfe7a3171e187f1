"""Curves by their own length: the same poses at the same places, with |dp/ds| = 1, as a constant speed needs it."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import chain

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev, polynomial

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from planner.path.shape import Piece, Shape
from planner.path.way import way

# By how much |dp/ds| may differ from 1: a tenth of what the certificate allows a constant speed.
EVEN = 1e-10
# Degree of the polynomials (rounding leaves 1e-11 at it), points at which they are looked at, and halvings at most.
DEGREE, LOOKED, HALVINGS = 19, 65, 10
# Least |dp/ds| of a curve that can be run at a constant speed: less is a tool that all but stands still.
SLOWEST = 0.01
# Degree of the derivatives that are met at both ends: curves stay as smooth at their joins as they were.
SMOOTH = 3
# Lengths that a change from one parameter to the other may have, between what the two would give it.
LENGTHS = 33
# Parts in which a piece without a constant speed may be drawn anew, on the way to one that has it.
FEW = 4


def evened(pieces: Sequence[Piece], stops: np.ndarray, dwells: Array) -> tuple[tuple[Piece, ...], np.ndarray, Array]:
    """A path whose parameter is the tool's way wherever a constant speed is asked for.

    pieces, stops (P+1,), dwells (P+1,): as MachinePath has them, of the tool. Where a piece at constant speed has
    another parameter, as splines and blends have, it is drawn anew, and so is what is joined to it without a stop if
    that takes FEW parts, as the other half of a blend does. The next piece changes over to its own parameter. Raises
    MotionError where the tool all but stands still.
    """
    joined = stops[1:-1] != 1
    drawn = [_parts(piece, HALVINGS) if piece.constant and uneven(piece) else [] for piece in pieces]
    for k in np.flatnonzero(np.logical_or(*_beside(drawn, joined))).tolist():
        if not pieces[k].constant and uneven(pieces[k]):
            drawn[k] = _few(pieces[k])
    parts = [
        anew or ([piece] if piece.constant else _changing(piece, start, end))
        for piece, anew, start, end in zip(pieces, drawn, *_beside(drawn, joined), strict=True)
    ]
    ends = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
    rests = [np.zeros(ends[-1] + 1, values.dtype) for values in (stops, dwells)]
    for rest, values in zip(rests, (stops, dwells), strict=True):
        rest[ends] = values
    return tuple(chain(*parts)), frozen(rests[0], rests[0].dtype), frozen(rests[1])


def _beside(drawn: Sequence[Sequence[Piece]], joined: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether each piece is joined to one that is drawn anew, before it and after it."""
    anew = np.array([len(each) > 0 for each in drawn])
    return np.append(False, anew[:-1] & joined), np.append(anew[1:] & joined, False)


def uneven(piece: Piece) -> bool:
    """Whether its parameter is not its length."""
    return not np.abs(_slope(piece, _spread(piece)) - 1).max() <= EVEN  # nor is nan even


def _spread(piece: Piece) -> Array:
    return piece.start + piece.length * np.linspace(0.0, 1.0, LOOKED)


def _slope(piece: Piece, s: Array) -> Array:
    """|dp/ds| (N,)."""
    return np.asarray(np.linalg.norm(piece.derivatives(s)[1][:, :3], axis=1))


def _parts(piece: Piece, halvings: int) -> list[Piece]:
    """The piece by its own length, in as many parts as its polynomials need."""
    if _slope(piece, _spread(piece)).min() < SLOWEST or halvings == 0:
        raise _still(piece)
    drawn = drawn_by_length(piece)
    if not uneven(drawn):
        return [drawn]
    return [part for half in piece.cut(2) for part in _parts(half, halvings - 1)]


def _few(piece: Piece) -> list[Piece]:
    """The piece by its own length, nothing where that takes more than FEW parts or the tool stands still."""
    try:
        parts = _parts(piece, FEW)
    except MotionError:
        return []
    return parts if len(parts) <= FEW else []


def _still(piece: Piece) -> MotionError:
    return MotionError(
        f"segment {piece.segment}: the tool all but stands still on it, or in the blend at its end, where a constant "
        'speed is asked for or met: write join = "stop" there, or take speed_constant away'
    )


def drawn_by_length(piece: Piece) -> Piece:
    """The piece at the parameter u(s) of which ds = |dp/du| du, as a polynomial.

    It meets u and its derivatives up to the third at both ends, and u at points between.
    """
    ends = np.array([piece.start, piece.start + piece.length])
    along = way(partial(_slope, piece), *ends.tolist())
    inner = np.cos(np.pi * np.arange(1, DEGREE - 2 * SMOOTH) / (DEGREE - 2 * SMOOTH))
    between = along.place((inner + 1) * along.length / 2)
    return _reparametrised(piece, along.length, _met(ends, _rates(piece, ends), along.length), inner, between)


def _changing(piece: Piece, start: bool, end: bool) -> list[Piece]:
    """The piece at a parameter that is the tool's way at its start, its end, or both, and its own elsewhere.

    Of the lengths that it could have, the one over which the parameter changes most evenly.
    """
    ends = np.array([piece.start, piece.start + piece.length])
    own, size = np.array([[1.0], [0.0], [0.0]]), piece.length ** np.arange(SMOOTH)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):  # it may stand still where nothing is met
        rates = np.where([start, end], _rates(piece, ends), own)
    if not rates[0].max() <= 1 / SLOWEST:
        raise _still(piece)
    if np.abs((rates - own) * size).max() <= EVEN:
        return [piece]
    longest, shortest = (piece.length / extreme for extreme in (rates[0].min(), rates[0].max()))
    x, nothing = np.linspace(-1.0, 1.0, LOOKED), np.zeros(0)
    best, found = 0.0, piece
    for length in np.geomspace(shortest, longest, LENGTHS).tolist():
        drawn = _reparametrised(piece, length, _met(ends, rates, length), nothing, nothing)
        slope = np.asarray(polynomial.polyval(x, polynomial.polyder(drawn.parameters[-DEGREE - 1 :])))
        if slope.min() / slope.max() > best:
            best, found = float(slope.min() / slope.max()), drawn
    if best > 0:
        return [found]
    first, last = piece.cut(2)  # over shorter lengths only the slopes count, and between two there is always a way
    return [*_changing(first, start, False), *_changing(last, False, end)]


def _met(ends: Array, rates: Array, length: float) -> Array:
    """u and its derivatives by x (SMOOTH+1, 2) at both ends of [−1, 1]."""
    return np.asarray(np.stack([ends, *rates]) * (length / 2) ** np.arange(SMOOTH + 1)[:, None])


def _reparametrised(piece: Piece, length: float, met: Array, inner: Array, between: Array) -> Piece:
    """The piece at u(x), x = 2s/length − 1, with derivatives met at both ends and values `between` at `inner` (N,)."""
    values = np.concatenate([met.ravel(), between])
    powers = np.zeros(DEGREE + 1)
    powers[: len(values)] = chebyshev.cheb2poly(np.linalg.solve(_conditions(inner), values))
    parameters = frozen(np.concatenate([piece.parameters, [length / 2], powers]))
    return replace(piece, shape=_even(piece.shape), parameters=parameters, length=length, start=0.0)


def _conditions(inner: Array) -> Array:
    """What coefficients of Chebyshev polynomials make of derivatives 0 … SMOOTH at −1 and 1, and of values inside."""
    degree, rows = 2 * SMOOTH + 1 + len(inner), []
    for times in range(SMOOTH + 1):
        differentiated = chebyshev.chebder(np.eye(degree + 1), times)
        rows.append(chebyshev.chebvander(np.array([-1.0, 1.0]), degree - times) @ differentiated)
    return frozen(np.concatenate([*rows, chebyshev.chebvander(inner, degree)]))


@cache
def _even(shape: Shape) -> Shape:
    """u(s) = Σ c_k (s/h − 1)^k: the half length h and the coefficients are further parameters."""
    return Shape(f"{shape.name}_even", shape.size + 2 + DEGREE, partial(_motion, shape))


def _motion(shape: Shape, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    own, half, powers = ca.vertsplit(parameters, [0, shape.size, shape.size + 1, shape.size + 2 + DEGREE])
    x = s / half - 1
    u = powers[DEGREE]
    for k in reversed(range(DEGREE)):
        u = u * x + powers[k]
    return shape.motion(u, own)


def _rates(piece: Piece, u: Array) -> Array:
    """du/ds, d²u/ds², d³u/ds³ (3, N) of ds = f du, f = |p′|: 1/f, −f′/f³, 3 f′²/f⁵ − f″/f⁴."""
    _, p1, p2, p3 = (values[:, :3] for values in piece.derivatives(u))
    f = np.linalg.norm(p1, axis=1)
    f1 = (p1 * p2).sum(1) / f
    f2 = ((p2 * p2).sum(1) + (p1 * p3).sum(1) - f1**2) / f
    return np.stack([1 / f, -f1 / f**3, 3 * f1**2 / f**5 - f2 / f**4])
