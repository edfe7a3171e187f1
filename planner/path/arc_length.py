"""Curves by their own length: the same poses at the same places, with |dp/ds| = 1, as a constant
speed needs it.

The length is found by quadrature, and the place at which a length is reached by solving for it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import chain

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev, polynomial

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from planner.path.shape import Derived, Piece, Shape

# Points of a panel (exact to degree 31), panels at first and at most, and how well twice as many
# must agree with them.
PANEL_POINTS, FIRST_PANELS, MAX_PANELS, LENGTH_AGREEMENT = 16, 4, 2**12, 1e-14
# Steps after which nothing of a bracket is left to floats: each at least halves it.
MAX_BRACKET_STEPS = 64


@dataclass(frozen=True, slots=True)
class LengthTable:
    """The length ∫ speed ds from the first of some edges (K+1,) on; lengths (K+1,) there.

    speed  |dp/ds| (N,) at s (N,), positive
    """

    speed: Callable[[Array], Array]
    edges: Array
    lengths: Array

    @property
    def length(self) -> float:
        return float(self.lengths[-1])

    def place(self, lengths: Array) -> Array:
        """s (N,) at which lengths (N,) are reached, to rounding: Newton's steps inside a bracket
        that closes.
        """
        k = np.clip(
            np.searchsorted(self.lengths, lengths, side="right") - 1, 0, len(self.edges) - 2
        )
        low, high, start = self.edges[k], self.edges[k + 1], self.edges[k]
        s = low + (high - low) * (lengths - self.lengths[k]) / (
            self.lengths[k + 1] - self.lengths[k]
        )
        for _ in range(MAX_BRACKET_STEPS):
            missing = lengths - self.lengths[k] - _integrals(self.speed, start, s)
            low, high = np.where(missing > 0, s, low), np.where(missing > 0, high, s)
            step = s + missing / self.speed(s)
            before, s = s, np.where((low <= step) & (step <= high), step, (low + high) / 2)
            if (np.abs(s - before) <= 2 * np.spacing(np.abs(s))).all():
                break
        return s


def measure_length(speed: Callable[[Array], Array], low: float, high: float) -> LengthTable:
    """The way from s = low to high: panels of Gauss and Legendre, as many as agree with half of
    them.
    """
    panels, before = FIRST_PANELS, np.inf
    while True:
        edges = np.linspace(low, high, panels + 1)
        lengths = np.concatenate([[0.0], np.cumsum(_integrals(speed, edges[:-1], edges[1:]))])
        if abs(lengths[-1] - before) <= LENGTH_AGREEMENT * lengths[-1] or panels >= MAX_PANELS:
            return LengthTable(speed, freeze_array(edges), freeze_array(lengths))
        panels, before = 2 * panels, lengths[-1]


# |dp/ds| at an end of a piece below which a turn in place is part of it, whose angle counts as the parameter has it.
MIN_WAY = 0.5


def measure_travel(pieces: Sequence[Piece]) -> float:
    """m, ∫ |dp/ds| ds of the tool's tip, or the platform's origin; turns in place count as their
    parameter does.
    """
    return sum(_measure_piece(piece) for piece in pieces)


def find_travel_rates(pieces: Sequence[Piece]) -> Array:
    """(P,) of each piece the way per metre of its parameter: below 1 where a curve cuts a corner;
    for tables.

    Turns in place count as in `measure_travel`; one look at each piece, which is quick for
    thousands.
    """
    x, weight = np.polynomial.legendre.leggauss(PANEL_POINTS)
    panels = (np.arange(FIRST_PANELS)[:, None] + (x + 1) / 2).ravel() / FIRST_PANELS
    shares, weights = (
        np.concatenate([panels, [0.0, 1.0]]),
        np.tile(weight / 2, FIRST_PANELS) / FIRST_PANELS,
    )
    rates = np.ones(len(pieces))
    for k, piece in enumerate(pieces):
        speed = _path_speed(piece, piece.start + shares * piece.length)
        rates[k] = 1.0 if speed[-2:].min() < MIN_WAY else speed[:-2] @ weights
    return rates


def _measure_piece(piece: Piece) -> float:
    ends = piece.start + np.array([0.0, piece.length])
    speed = partial(_path_speed, piece)
    return (
        piece.length
        if speed(ends).min() < MIN_WAY
        else measure_length(speed, *ends.tolist()).length
    )


def _integrals(speed: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """∫ speed from low (N,) to high (N,)."""
    x, weight = np.polynomial.legendre.leggauss(PANEL_POINTS)
    s = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * x
    return np.asarray((speed(s.ravel()).reshape(s.shape) * weight).sum(1) * (high - low) / 2)


# By how much |dp/ds| may differ from 1: a tenth of what the certificate allows a constant speed.
SPEED_TOLERANCE = 1e-10
# Degree of the polynomials (rounding leaves 1e-11 at it), points at which they are looked at, and
# halvings at most.
DEGREE, PIECE_POINTS, MAX_HALVINGS = 19, 65, 10
# Least |dp/ds| of a curve that can be run at a constant speed: less is a tool that all but stands
# still.
MIN_SPEED_SHARE = 0.01
# Degree of the derivatives that are met at both ends: curves stay as smooth at their joins as they
# were.
MATCHED_DERIVATIVES = 3
# Lengths that a change from one parameter to the other may have, between what the two would give
# it.
LENGTH_TRIALS = 33
# Parts in which a piece without a constant speed may be drawn anew, on the way to one that has it.
MAX_PARTS = 4


def even_speed(
    pieces: Sequence[Piece], stops: np.ndarray, dwells: Array
) -> tuple[tuple[Piece, ...], np.ndarray, Array]:
    """A path whose parameter is the tool's way wherever a constant speed is asked for.

    pieces, stops (P+1,), dwells (P+1,): as MachinePath has them, of the tool. Where a piece at
    constant speed has another parameter, as splines and blends have, it is drawn anew, and so is
    what is joined to it without a stop if that takes FEW parts, as the other half of a blend does.
    The next piece changes over to its own parameter. Raises MotionError where the tool all but
    stands still.
    """
    joined = stops[1:-1] != 1
    drawn: list[list[Piece]] = [[] for _ in pieces]
    for k, piece in enumerate(pieces):
        if piece.constant and is_uneven(piece):
            drawn[k] = _draw_parts(piece, MAX_HALVINGS)
            if not drawn[k]:
                raise _standstill_error(piece)
    for k in np.flatnonzero(np.logical_or(*_find_redrawn_neighbours(drawn, joined))).tolist():
        if not pieces[k].constant and is_uneven(pieces[k]):
            few = _draw_parts(pieces[k], MAX_PARTS)
            drawn[k] = few if len(few) <= MAX_PARTS else []
    parts = [
        anew or ([piece] if piece.constant else _change_parameter(piece, start, end))
        for piece, anew, start, end in zip(
            pieces, drawn, *_find_redrawn_neighbours(drawn, joined), strict=True
        )
    ]
    ends = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
    rests = [np.zeros(ends[-1] + 1, values.dtype) for values in (stops, dwells)]
    for rest, values in zip(rests, (stops, dwells), strict=True):
        rest[ends] = values
    return tuple(chain(*parts)), freeze_array(rests[0], rests[0].dtype), freeze_array(rests[1])


def _find_redrawn_neighbours(
    drawn: Sequence[Sequence[Piece]], joined: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whether each piece is joined to one that is drawn anew, before it and after it."""
    anew = np.array([len(each) > 0 for each in drawn])
    return np.append(False, anew[:-1] & joined), np.append(anew[1:] & joined, False)


def is_uneven(piece: Piece) -> bool:
    """Whether its parameter is not its length."""
    return (
        not np.abs(_path_speed(piece, _sample_places(piece)) - 1).max() <= SPEED_TOLERANCE
    )  # nor is nan even


def _sample_places(piece: Piece) -> Array:
    return piece.start + piece.length * np.linspace(0.0, 1.0, PIECE_POINTS)


def _path_speed(piece: Piece, s: Array) -> Array:
    """|dp/ds| (N,)."""
    return np.asarray(np.linalg.norm(piece.derivatives(s)[1][:, :3], axis=1))


def _draw_parts(piece: Piece, halvings: int) -> list[Piece]:
    """The piece by its own length, in as many parts as its polynomials need; none where the tool
    stands still.
    """
    if _path_speed(piece, _sample_places(piece)).min() < MIN_SPEED_SHARE or halvings == 0:
        return []
    drawn = draw_by_length(piece)
    if not is_uneven(drawn):
        return [drawn]
    halves = [_draw_parts(half, halvings - 1) for half in piece.cut(2)]
    return [part for half in halves for part in half] if all(halves) else []


def _standstill_error(piece: Piece) -> MotionError:
    return MotionError(
        f"segment {piece.segment}: the tool nearly stops on it, or in the blend at its end, where the speed must be "
        'constant: write join = "stop" there, or remove speed_constant'
    ).in_segment(piece.segment)


def draw_by_length(piece: Piece) -> Piece:
    """The piece at the parameter u(s) of which ds = |dp/du| du, as a polynomial.

    It meets u and its derivatives up to the third at both ends, and u at points between.
    """
    ends = np.array([piece.start, piece.start + piece.length])
    along = measure_length(partial(_path_speed, piece), *ends.tolist())
    inner = np.cos(
        np.pi * np.arange(1, DEGREE - 2 * MATCHED_DERIVATIVES) / (DEGREE - 2 * MATCHED_DERIVATIVES)
    )
    between = along.place((inner + 1) * along.length / 2)
    return _reparametrize(
        piece,
        along.length,
        _scale_derivatives(ends, _rates(piece, ends), along.length),
        inner,
        between,
    )


def _change_parameter(piece: Piece, start: bool, end: bool) -> list[Piece]:
    """The piece at a parameter that is the tool's way at its start, its end, or both, and its own
    elsewhere.

    Of the lengths that it could have, the one over which the parameter changes most evenly.
    """
    ends = np.array([piece.start, piece.start + piece.length])
    own, size = (
        np.array([[1.0], [0.0], [0.0]]),
        piece.length ** np.arange(MATCHED_DERIVATIVES)[:, None],
    )
    with np.errstate(divide="ignore", invalid="ignore"):  # it may stand still where nothing is met
        rates = np.where([start, end], _rates(piece, ends), own)
    if not rates[0].max() <= 1 / MIN_SPEED_SHARE:
        raise _standstill_error(piece)
    if np.abs((rates - own) * size).max() <= SPEED_TOLERANCE:
        return [piece]
    longest, shortest = (piece.length / extreme for extreme in (rates[0].min(), rates[0].max()))
    x, nothing = np.linspace(-1.0, 1.0, PIECE_POINTS), np.zeros(0)
    best, found = 0.0, piece
    for length in np.geomspace(shortest, longest, LENGTH_TRIALS).tolist():
        drawn = _reparametrize(
            piece, length, _scale_derivatives(ends, rates, length), nothing, nothing
        )
        slope = np.asarray(
            polynomial.polyval(x, polynomial.polyder(drawn.parameters[-DEGREE - 1 :]))
        )
        if slope.min() / slope.max() > best:
            best, found = float(slope.min() / slope.max()), drawn
    if best > 0:
        return [found]
    first, last = piece.cut(
        2
    )  # over shorter lengths only the slopes count, and between two there is always a way
    return [*_change_parameter(first, start, False), *_change_parameter(last, False, end)]


def _scale_derivatives(ends: Array, rates: Array, length: float) -> Array:
    """u and its derivatives by x (MATCHED_DERIVATIVES+1, 2) at both ends of [−1, 1]."""
    return np.asarray(
        np.stack([ends, *rates]) * (length / 2) ** np.arange(MATCHED_DERIVATIVES + 1)[:, None]
    )


def _reparametrize(piece: Piece, length: float, met: Array, inner: Array, between: Array) -> Piece:
    """The piece at u(x), x = 2s/length − 1, with derivatives met at both ends and values `between`
    at `inner` (N,).
    """
    values = np.concatenate([met.ravel(), between])
    powers = np.zeros(DEGREE + 1)
    powers[: len(values)] = chebyshev.cheb2poly(np.linalg.solve(_condition_matrix(inner), values))
    parameters = freeze_array(np.concatenate([piece.parameters, [length / 2], powers]))
    return replace(
        piece, shape=_even_shape(piece.shape), parameters=parameters, length=length, start=0.0
    )


def _condition_matrix(inner: Array) -> Array:
    """What coefficients of Chebyshev polynomials make of derivatives 0 … MATCHED_DERIVATIVES at −1
    and 1, and of values inside.
    """
    degree, rows = 2 * MATCHED_DERIVATIVES + 1 + len(inner), []
    for times in range(MATCHED_DERIVATIVES + 1):
        differentiated = chebyshev.chebder(np.eye(degree + 1), times)
        rows.append(chebyshev.chebvander(np.array([-1.0, 1.0]), degree - times) @ differentiated)
    return freeze_array(np.concatenate([*rows, chebyshev.chebvander(inner, degree)]))


@cache
def _even_shape(shape: Shape) -> Shape:
    """u(s) = Σ c_k (s/h − 1)^k: the half length h and the coefficients are further parameters."""
    return Shape(f"{shape.name}_even", shape.size + 2 + DEGREE, Derived(_motion, (shape,)))


def _motion(shape: Shape, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    own, half, powers = ca.vertsplit(
        parameters, [0, shape.size, shape.size + 1, shape.size + 2 + DEGREE]
    )
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
