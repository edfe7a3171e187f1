"""Splines: curves through points with three continuous derivatives by their length, which stay near
the polygon.

The curve is drawn over the square roots of its chords, u (centripetal; E. Lee, Choosing nodes in
parametric curve interpolation, 1989). There the natural cubic spline leaves no chord by more than
three quarters of its length: its second derivative is nowhere above 6, so that a span h = √d leaves
its chord by 6 h²/8 at most (M. Floater, On the deviation of a parametric cubic spline interpolant
from its data polygon, 2008). The natural quintic spline is fairer but has no such bound; each knot
takes its derivatives as far as they are near the cubic's.
"""

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from planner.path.shape import Piece, Shape, measure_turns

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from kinematics.machine.pose import Pose

# Degree of curves that are fitted to chains.
DEGREE = 5
# Degree of curves through points: a value and three derivatives are given at both ends of each
# piece.
HERMITE_DEGREE = 7
# Places of a span at which its speed is sampled.
SPAN_POINTS = 201
# Least |dp/du|, as a share of its mean over the shortest chord nearby: less is a cusp.
MIN_SPEED = 0.05
# Least product of two unit quaternions that follow each other: 120°.
MIN_QUATERNION_PRODUCT = 0.5
# Two points are near-duplicates if their chord is within this share of the shorter neighbouring
# chord, or of the longest chord.
DUPLICATE_SHARES = 1e-4, 1e-6
# How far the quintic may be from the cubic, as a share of the chord; and of the angle, for
# orientations. A change of slope counts over the whole span, so that the curve itself moves by
# about a sixth of it.
FAIRNESS, TURNING_FAIRNESS = 0.05, 0.5
# Weights of changes of the first three derivatives: each moves the curve by about as much.
DERIVATIVE_WEIGHTS = np.array([1.0, 1 / 8, 1 / 48])
# A piece by length may leave the curve by this share of its chord, and its speed may differ from 1
# by so much.
LENGTH_TOLERANCE, SPEED_TOLERANCE = 1e-3, 0.02
# Halvings of a span at most, where it bends too sharply for one piece.
MAX_HALVINGS = 16

# Third and fourth derivative of a quintic at its start and its end, by v, a, w, b there: factors,
# and powers of h.
_START = np.array([[-36.0, -9, -24, 3], [192, 36, 168, -24]])
_END = np.array([[-24.0, -3, -36, 9], [-168, -24, -192, 36]])
_SCALES = np.array([[-2.0, -1, -2, -1], [-3, -2, -3, -2]])
# The same by d, at the start; at the end both are positive.
_JUMP, _SIDES = np.array([[60.0], [-360]]), np.array([[-3.0], [-4]])


def _motion(s: ca.SX, parameters: ca.SX, degree: int) -> tuple[ca.SX, ca.SX]:
    """p and q are polynomials;  R = the rotation of the quaternion q = (x, y, z, w), of any length."""
    value = _evaluate_symbols(ca.reshape(parameters, 7, degree + 1), s)
    vector, w = value[3:6], value[6]
    square = ca.dot(vector, vector)
    cross = ca.skew(vector)
    turned = ca.SX.eye(3) + (2 * w * cross + 2 * (cross @ cross)) / (square + w * w)
    return value[:3], turned


def _steady_motion(s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    """p is a polynomial; R stays as it is."""
    powers, rotation = ca.vertsplit(parameters, [0, 3 * (DEGREE + 1), 3 * (DEGREE + 1) + 9])
    return _evaluate_symbols(ca.reshape(powers, 3, DEGREE + 1), s), ca.reshape(rotation, 3, 3).T


def _evaluate_symbols(powers: ca.SX, s: ca.SX) -> ca.SX:
    """Return the values of polynomials by their coefficients (k, degree + 1)."""
    value: ca.SX = powers[:, -1]
    for k in reversed(range(powers.size2() - 1)):
        value = value * s + powers[:, k]
    return value


STEADY_SPLINE = Shape("steady_spline", 3 * (DEGREE + 1) + 9, _steady_motion)
"""SPLINE at one orientation: a tenth of the work for its derivatives."""
SPLINE = Shape("spline", 7 * (DEGREE + 1), partial(_motion, degree=DEGREE))
HERMITE = Shape("hermite", 7 * (HERMITE_DEGREE + 1), partial(_motion, degree=HERMITE_DEGREE))


def spline(start: "Pose", through: Array, rotate: "Rotation | None", segment: int) -> list[Piece]:
    """Draw the curve from start through points (N, 3), in orientations `rotate` (N) there.

    The pieces' parameter is the curve's length, to SPEED_TOLERANCE. A span is one piece; it is
    halved where the curve bends too sharply for that. Both ends are straight: no second derivative
    by u there. The orientation follows the unit quaternions in the same way; it turns alike in
    every frame. Raises MotionError where two points are near-duplicates, where the curve turns back
    on the spot, or where an orientation is more than 120° from the one before.
    """
    points = np.concatenate([start.translation[None], through])
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    _refuse_duplicates(chords)
    spans = np.sqrt(chords)
    curve = _draw_spans(points, spans, _find_derivatives(points, spans))
    _refuse_cusps(curve, spans)
    parts = _draw_by_length(curve, spans, chords)
    quaternions = _quaternions(start, rotate, len(through))
    lengths = np.asarray(np.bincount(parts.span, parts.lengths), float)
    turning = _draw_spans(quaternions, lengths, _find_turning(quaternions, lengths))
    powers = np.concatenate([parts.powers, _cut_spans(turning, parts)], 2)
    pieces = [
        Piece(HERMITE, freeze_array(coefficients.ravel()), length, segment)
        for coefficients, length in zip(powers, parts.lengths.tolist(), strict=True)
    ]
    return measure_turns(pieces)


def _name(point: int) -> str:
    return f"point {point}" if point else "its start"


def _refuse_duplicates(chords: Array) -> None:
    """Raise MotionError for two points too near to each other to give the curve a direction."""
    if len(chords) == 1:
        return
    neighbours = np.full(len(chords) + 2, np.inf)
    neighbours[1:-1] = chords
    shorter = np.minimum(neighbours[:-2], neighbours[2:])
    share, of_longest = DUPLICATE_SHARES
    near = (chords <= share * shorter) | (chords <= of_longest * chords.max())
    if near.any():
        k = int(np.argmax(near))
        raise MotionError(
            f"{_name(k)} and {_name(k + 1)} are {chords[k] * 1e3:.4g} mm apart, where the chords beside them have "
            f"{min(shorter[k], chords.max()) * 1e3:.4g} mm: points so near to each other give the curve no direction; "
            "omit one of them"
        )


def _refuse_cusps(curve: Array, spans: Array) -> None:
    speed = _span_speeds(curve, spans)
    around = np.concatenate([spans[:1], spans, spans[-1:]])
    least = np.minimum(np.minimum(around[:-2], around[2:]), spans)
    share = speed.min(1) / least
    slowest = int(np.argmin(share))
    if share[slowest] < MIN_SPEED:
        raise _cusp_error(slowest)


def _cusp_error(span: int) -> MotionError:
    return MotionError(
        f"the curve turns back between {_name(span)} and {_name(span + 1)}; "
        "add points around the reversal, or end the spline there and start another"
    )


def _quaternions(start: "Pose", rotate: "Rotation | None", count: int) -> Array:
    """(N+1, 4) unit quaternions x, y, z, w, each on the side of the one before it."""
    first = start.rotation.as_quat()[None]
    if rotate is None:
        return np.repeat(first, count + 1, 0)
    quaternions = np.concatenate([first, rotate.as_quat()])
    nearness = (quaternions[1:] * quaternions[:-1]).sum(1)
    far = int(np.argmin(np.abs(nearness)))
    if abs(nearness[far]) < MIN_QUATERNION_PRODUCT:
        raise MotionError(
            f"{_name(far + 1)} turns by {np.degrees(2 * np.arccos(abs(nearness[far]))):.4g}° from {_name(far)}; "
            f"at most {np.degrees(2 * np.arccos(MIN_QUATERNION_PRODUCT)):.4g}° lie between two points: add some"
        )
    return align_signs(quaternions)


def align_signs(quaternions: Array) -> Array:
    """Return quaternions (N, 4), each on the side of the one before it."""
    nearness = (quaternions[1:] * quaternions[:-1]).sum(1)
    sides = np.cumprod(np.concatenate([[1.0], np.where(nearness < 0, -1.0, 1.0)]))
    return np.asarray(quaternions * sides[:, None])


def sample_splines(points: Array, share: Array) -> tuple[Array, Array]:
    """Points (…, N, k, 3) of splines through points (…, N+1, 3), at k shares of every span; and
    slopes by its chords.

    Splines of as many points each are worked out all at once, which is many times faster than one
    by one. Pieces by length leave these points by LENGTH_TOLERANCE of a chord at most.
    """
    chords = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    spans = np.sqrt(chords)
    k = np.arange(HERMITE_DEGREE + 1)
    powers = (
        _draw_spans(points, spans, _find_derivatives(points, spans))
        * (spans[..., None] ** k)[..., None]
    )
    slopes = (k[1:] * share[:, None] ** k[:-1]) @ powers[..., 1:, :]
    return share[:, None] ** k @ powers, slopes / chords[..., None, None]


def draw_through(points: Array) -> tuple[Array, np.ndarray]:
    """Places (M, K, 3) of the pieces of the spline through points (N+1, 3), and the span (M,) of
    each piece.

    Unlike those of `sample_splines` they lie on the pieces as they are run. Raises MotionError as
    `spline`.
    """
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    spans = np.sqrt(chords)
    curve = _draw_spans(points, spans, _find_derivatives(points, spans))
    parts = _draw_by_length(curve, spans, chords)
    return _evaluate_powers(parts.powers, parts.lengths[:, None] * _PART_SHARES, 0), parts.span


def _find_derivatives(points: Array, spans: Array) -> Array:
    """(…, N+1, 3, k) p′, p″, p‴ by u at points (…, N+1, k): the quintic's, as far as they are near
    the cubic's.

    The quintic may move the curve in proportion to the shorter of the two chords at each point.
    """
    base = _cubic_derivatives(points, spans)
    fair = _quintic_derivatives(points, spans)
    chords = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    padded = np.concatenate([chords[..., :1], chords, chords[..., -1:]], -1)
    shorter = np.minimum(padded[..., :-1], padded[..., 1:])
    # an end has one chord only: the next point's other chord counts there too
    shorter[..., [0, -1]] = np.minimum(shorter[..., [0, -1]], shorter[..., [1, -2]])
    return _limit_change(base, fair, spans, FAIRNESS * shorter)


def _find_turning(quaternions: Array, spans: Array) -> Array:
    """Find derivatives (N+1, 3, 4) of quaternions, whose steps need not be in proportion to the
    chords.

    A mean of the slopes on both sides replaces the cubic's slope. It is at most twice the smaller
    one, so each span turns in proportion to its own angle. The quintic may add a share of the
    larger of the two angles.
    """
    steps = np.diff(quaternions, axis=0)
    slopes = steps / spans[:, None]
    rates = np.linalg.norm(slopes, axis=1)
    base = np.zeros((len(quaternions), 3, 4))
    base[1:-1, 0] = _divide(
        rates[1:, None] * slopes[:-1] + rates[:-1, None] * slopes[1:],
        (rates[:-1] + rates[1:])[:, None],
    )
    base[[0, -1], 0] = slopes[[0, -1]]
    angles = np.linalg.norm(steps, axis=1)
    padded = np.concatenate([angles[:1], angles, angles[-1:]])
    larger = np.maximum(padded[:-1], padded[1:])
    return _limit_change(
        base, _quintic_derivatives(quaternions, spans), spans, TURNING_FAIRNESS * larger
    )


def _limit_change(base: Array, fair: Array, spans: Array, most: Array) -> Array:
    """Move derivatives (…, N+1, 3, k) from `base` towards `fair` while no span moves by more than
    `most`.

    most (…, N+1): largest change of a span at either side of each knot.
    """
    change = fair - base
    longer = np.maximum(
        np.concatenate([spans[..., :1], spans], -1),
        np.concatenate([spans, spans[..., -1:]], -1),
    )
    effect = longer[..., None] ** np.arange(1, 4) * DERIVATIVE_WEIGHTS
    moved = (np.linalg.norm(change, axis=-1) * effect).max(-1)
    share = np.where(moved > most, _divide(most, moved), 1.0)
    return np.asarray(base + change * share[..., None, None])


def _divide(values: Array, by: Array) -> Array:
    """values / by, and 0 where that is 0 / 0."""
    by = np.broadcast_to(by, values.shape)
    return np.divide(values, by, out=np.zeros_like(values), where=by > 0)


def _cubic_derivatives(values: Array, spans: Array) -> Array:
    """(…, N+1, 3, k) of the natural cubic spline; its third derivative jumps, and the knots have a
    mean of both sides.

    The second derivatives a solve  h₋ a₋ + 2 (h₋ + h₊) a + h₊ a₊ = 6 (d₊/h₊ − d₋/h₋),  with a = 0
                                    at both ends.
    Splines of a batch are blocks of one such system.
    """
    from scipy.linalg import solve_banded

    count, width = spans.shape[-1], values.shape[-1]
    unit = spans.mean()
    h = spans.reshape(-1, count) / unit
    slopes = np.diff(values, axis=-2).reshape(-1, count, width) / h[..., None]
    bands = np.zeros((3, len(h), count + 1))  # above, on and below the diagonal, by column
    bands[1] = 1.0
    bands[1, :, 1:-1] = 2 * (h[:, :-1] + h[:, 1:])
    bands[0, :, 2:] = h[:, 1:]
    bands[2, :, :-2] = h[:, :-1]
    right = np.zeros((len(h), count + 1, width))
    right[:, 1:-1] = 6 * np.diff(slopes, axis=1)
    a = solve_banded((1, 1), bands.reshape(3, -1), right.reshape(-1, width)).reshape(right.shape)
    third = np.diff(a, axis=1) / h[..., None]
    knots = np.empty((len(h), count + 1, 3, width))
    knots[:, :-1, 0] = slopes - h[..., None] * (2 * a[:, :-1] + a[:, 1:]) / 6
    knots[:, -1, 0] = slopes[:, -1] + h[:, -1:] * (a[:, -2] + 2 * a[:, -1]) / 6
    knots[:, :, 1] = a
    knots[:, [0, -1], 2] = third[:, [0, -1]]
    before, after = h[:, :-1, None], h[:, 1:, None]
    knots[:, 1:-1, 2] = (before * third[:, :-1] + after * third[:, 1:]) / (before + after)
    return np.asarray(
        knots.reshape(*values.shape[:-1], 3, width) / unit ** np.arange(1, 4)[:, None]
    )


def _quintic_derivatives(values: Array, spans: Array) -> Array:
    """(…, N+1, 3, k) of the natural quintic spline, which has four continuous derivatives.

    A span h from p to q = p + d, with first derivatives v, w and second ones a, b at its ends, is
    the quintic of these; its third and fourth derivatives at its start are

        (60 d − (36 v + 24 w) h − (9 a − 3 b) h²)/h³,   (−360 d + (192 v + 168 w) h + (36 a − 24 b)
                                                        h²)/h⁴

    and at its end the same, looked at from there. They agree at every knot, and a = 0 and the
    fourth is 0 at both ends: linear in v and a of the knots, with three bands above and below.
    Splines of a batch are blocks of one such system.
    """
    from scipy.linalg.lapack import dgbsv

    count, width = spans.shape[-1], values.shape[-1]
    unit = spans.mean()
    h = spans.reshape(-1, count) / unit
    d = np.diff(values, axis=-2).reshape(-1, count, width)
    knots = np.zeros(
        (len(h), count + 1, 2, 6)
    )  # rows of a knot by v, a of the one before, of itself, of the next
    right = np.zeros((len(h), count + 1, 2, width))
    scales = h[..., None, None] ** _SCALES
    knots[:, :-1, :, 2:] += _START * scales
    knots[:, 1:, :, :4] -= _END * scales
    sides = h[..., None, None] ** _SIDES * d[..., None, :]
    right[:, :-1] -= sides * _JUMP
    right[:, 1:] += sides * abs(_JUMP)
    knots[:, (0, -1), 0] = [0, 0, 0, 1, 0, 0]
    right[:, (0, -1), 0] = 0
    rows = knots.reshape(-1, 2, 6)
    bands = np.zeros((10, 2 * len(rows)))  # the upper three are LAPACK's own
    for row in (0, 1):
        for k in range(6):  # column 2 i − 2 + k of row 2 i + row
            to, own = bands[8 + row - k, k % 2 :: 2], rows[:, row, k]
            if k < 2:
                to[:-1] = own[1:]
            elif k < 4:
                to[:] = own
            else:
                to[1:] = own[:-1]
    solution = dgbsv(3, 3, bands, right.reshape(-1, width), overwrite_ab=True, overwrite_b=True)[2]
    solution = solution.reshape(len(h), count + 1, 2, width)
    both = np.empty((len(h), count + 1, 3, width))
    both[:, :, :2] = solution
    v, w = solution[:, :-1, 0] * h[..., None], solution[:, 1:, 0] * h[..., None]
    a, b = solution[:, :-1, 1] * h[..., None] ** 2, solution[:, 1:, 1] * h[..., None] ** 2
    cube = h[..., None] ** 3
    both[:, :-1, 2] = (60 * d - 36 * v - 24 * w - 9 * a + 3 * b) / cube
    both[:, -1, 2] = ((60 * d - 24 * v - 36 * w + 3 * a - 9 * b) / cube)[:, -1]
    return np.asarray(both.reshape(*values.shape[:-1], 3, width) / unit ** np.arange(1, 4)[:, None])


def _draw_spans(values: Array, spans: Array, derivatives: Array) -> Array:
    """(…, N, 8, k) coefficients of every span by powers of u from its start, for derivatives (…,
    N+1, 3, k) there.
    """
    known = np.concatenate([values[..., None, :], derivatives], -2)
    return _hermite_powers(known[..., :-1, :, :], known[..., 1:, :, :], spans)


# Coefficients c₄ … c₇ of the polynomial of degree 7 on [0, 1] whose value and derivatives at 1
# exceed those of its first four terms by given ones.
_UPPER = np.linalg.inv(
    np.array([[1.0, 1, 1, 1], [4, 5, 6, 7], [12, 20, 30, 42], [24, 60, 120, 210]])
)
_TAYLOR = np.array([1.0, 1, 1 / 2, 1 / 6])
# Rows: what c₀ … c₃ give value and derivatives at 1.
_LOWER = np.array([[1.0, 1, 1, 1], [0, 1, 2, 3], [0, 0, 2, 6], [0, 0, 0, 6]])


def _hermite_powers(first: Array, last: Array, length: Array) -> Array:
    """(…, 8, k) powers of the polynomial with given values and three derivatives (…, 4, k) at 0 and
    length (…).
    """
    scale = length[..., None] ** np.arange(4)
    low = first * (scale * _TAYLOR)[..., None]
    high = _UPPER @ (last * scale[..., None] - _LOWER @ low)
    powers = np.concatenate([low, high], -2)
    return np.asarray(powers / (length[..., None] ** np.arange(HERMITE_DEGREE + 1))[..., None])


class _Parts(NamedTuple):
    """Parts of the spans of a curve, in order: the span (M,) of each, powers (M, 8, 3) by length,
    and lengths (M,).
    """

    span: np.ndarray
    powers: Array
    lengths: Array


def _draw_by_length(curve: Array, spans: Array, chords: Array) -> _Parts:
    """Parts by their own length of a curve whose spans (N, 8, 3) are polynomials of u.

    A part has the derivatives of the curve by its length at both ends, so the parts meet with three
    continuous derivatives; between, it is the polynomial of these, within LENGTH_TOLERANCE of the
    curve.
    """
    span = np.arange(len(spans))
    low, high = np.zeros(len(spans)), spans.copy()
    drawn: list[tuple[np.ndarray, Array, Array, Array]] = []
    for halving in range(MAX_HALVINGS + 1):
        powers, lengths, good = _draw_parts(curve[span], low, high, chords[span])
        drawn.append((span[good], low[good], powers[good], lengths[good]))
        if good.all():
            break
        if halving == MAX_HALVINGS:
            raise _cusp_error(int(span[np.argmin(good)]))
        span, low, high = span[~good], low[~good], high[~good]
        middle = (low + high) / 2
        span, low, high = (
            np.tile(span, 2),
            np.concatenate([low, middle]),
            np.concatenate([middle, high]),
        )
    span, begin, powers, lengths = (np.concatenate(part) for part in zip(*drawn, strict=True))
    order = np.lexsort((begin, span))
    return _Parts(span[order], powers[order], lengths[order])


def _cut_spans(turning: Array, parts: _Parts) -> Array:
    """(M, 8, k) of each part, from the polynomials (N, 8, k) of whole spans by their length."""
    before = np.cumsum(parts.lengths) - parts.lengths
    first = np.searchsorted(parts.span, parts.span)
    low = before - before[first]
    ends = np.stack([low, low + parts.lengths], 1)
    known = np.stack([_evaluate_powers(turning[parts.span], ends, k) for k in range(4)], 2)
    return _hermite_powers(known[:, 0], known[:, 1], parts.lengths)


# Places of a part at which it is held against the curve.
_PART_SHARES = np.linspace(0.0, 1.0, 17)


def _draw_parts(
    powers: Array, low: Array, high: Array, chords: Array
) -> tuple[Array, Array, np.ndarray]:
    """Parts (M, 8, 3) from u = low to high (M,) of their spans, their lengths, and whether each is
    near the curve.
    """
    nodes, weights = np.polynomial.legendre.leggauss(16)
    middle, half = (low + high)[:, None] / 2, (high - low)[:, None] / 2
    speed = np.linalg.norm(_evaluate_powers(powers, middle + half * nodes, 1), axis=-1)
    lengths = (speed @ weights) * half[:, 0]
    ends = np.stack([low, high], 1)
    by_u = np.stack([_evaluate_powers(powers, ends, k) for k in range(4)], 2)  # (M, 2, 4, 3)
    by_length = _change_to_length(by_u)
    part = _hermite_powers(by_length[:, 0], by_length[:, 1], lengths)
    s = lengths[:, None] * _PART_SHARES
    slope = np.linalg.norm(_evaluate_powers(part, s, 1), axis=-1)
    # the place of the curve that corresponds to the piece's middle is looked for near it
    x = _evaluate_powers(part, s, 0)
    u = low[:, None] + (high - low)[:, None] * _PART_SHARES
    for _ in range(4):
        away = x - _evaluate_powers(powers, u, 0)
        tangent = _evaluate_powers(powers, u, 1)
        square = np.maximum((tangent**2).sum(-1), np.finfo(float).tiny)
        u = np.clip(u + (away * tangent).sum(-1) / square, low[:, None], high[:, None])
    away = np.linalg.norm(x - _evaluate_powers(powers, u, 0), axis=-1)
    near = (away <= LENGTH_TOLERANCE * chords[:, None]).all(1)
    even = (np.abs(slope - 1) <= SPEED_TOLERANCE).all(1)
    return part, lengths, near & even


def _evaluate_powers(powers: Array, u: Array, order: int) -> Array:
    """(M, K, k) the derivative of an order of polynomials (M, degree + 1, k) at places (M, K)."""
    coefficients = powers
    for _ in range(order):
        coefficients = coefficients[:, 1:] * np.arange(1, coefficients.shape[1])[:, None]
    value = np.zeros((*u.shape, powers.shape[2]))
    for k in reversed(range(coefficients.shape[1])):
        value = value * u[..., None] + coefficients[:, None, k]
    return value


def _change_to_length(by_u: Array) -> Array:
    """A position and its derivatives (…, 4, 3) by the curve's length instead of u.

    With ds = f du, f = |p′|:  u′ = 1/f,  u″ = −f′/f³,  u‴ = 3 f′²/f⁵ − f″/f⁴.
    """
    x, p1, p2, p3 = (by_u[..., k, :] for k in range(4))
    f = np.linalg.norm(p1, axis=-1)
    f1 = (p1 * p2).sum(-1) / f
    f2 = ((p2 * p2).sum(-1) + (p1 * p3).sum(-1) - f1**2) / f
    u1, u2, u3 = (each[..., None] for each in (1 / f, -f1 / f**3, 3 * f1**2 / f**5 - f2 / f**4))
    return np.stack([x, p1 * u1, p2 * u1**2 + p1 * u2, p3 * u1**3 + 3 * p2 * u1 * u2 + p1 * u3], -2)


def _span_speeds(curve: Array, spans: Array) -> Array:
    """|dp/du| (N, SPAN_POINTS) over every span."""
    return np.asarray(
        np.linalg.norm(
            _evaluate_powers(curve, spans[:, None] * np.linspace(0.0, 1.0, SPAN_POINTS), 1), axis=2
        )
    )


# Of a spline that smooths: shorter than this share of a span, what bends is noise.
NOISE_SHARE = 0.1
# Quadrature on [−1, 1] for ∫|p‴|² of a span: p‴ is of degree 2.
GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)
# The pairs of B-splines that overlap at a place.
BASIS_ROW, BASIS_COLUMN = np.triu_indices(DEGREE + 1)


def smooth_spline(
    knots: Array, s: Array, values: Array, weights: Array, ends: tuple[Array, Array]
) -> Array:
    """(K, 6, k) coefficients of the spans between knots (K+1,), by powers of s from each: near
    values (N, k) at s (N,).

    Σ w |p(sᵢ) − valuesᵢ|² + Σ (NOISE_SHARE h)⁶ ∫|p‴|² over spans h is least, among the quintic
    splines with four continuous derivatives that have given ones at their ends: (m, k) the values
    and their first m − 1 derivatives.
    """
    from scipy.interpolate import BSpline
    from scipy.linalg import solveh_banded

    t = np.concatenate([np.full(DEGREE, knots[0]), knots, np.full(DEGREE, knots[-1])])
    count = len(t) - DEGREE - 1
    data, first = _basis(s, t, DEGREE)
    h = np.diff(knots)
    places = (knots[:-1, None] + h[:, None] * (GAUSS_NODES + 1) / 2).ravel()
    rough = ((NOISE_SHARE * h) ** 6 * h / 2)[:, None] * GAUSS_WEIGHTS
    third, begin = _basis(places, t[3:-3], DEGREE - 3)
    slopes = _third_differences(t, count)
    bends = np.zeros((len(places), DEGREE + 1))
    for k in range(DEGREE - 2):
        for j in range(4):
            bends[:, k + j] += third[:, k] * slopes[begin + k, j]
    fixed = [_end_coefficients(t, ends[0]), _end_coefficients(-t[::-1], _mirror(ends[1]))[::-1]]
    known = np.zeros((count, values.shape[1]))
    known[: len(fixed[0])], known[count - len(fixed[1]) :] = fixed
    # Bᵀ W B in its lower bands, and Bᵀ W v: v is what the known coefficients leave of the values.
    bands = np.zeros((DEGREE + 1, count))
    right = np.zeros((values.shape[1], count))
    for basis, at, weight, wanted in (
        (data.T, first, weights, values - _combine(data, first, known)),
        (bends.T, begin, rough.ravel(), -_combine(bends, begin, known)),
    ):
        place = at + np.arange(DEGREE + 1)[:, None]
        weighted = weight * basis
        entry = (BASIS_COLUMN - BASIS_ROW)[:, None] * count + place[BASIS_ROW]
        product = weighted[BASIS_ROW] * basis[BASIS_COLUMN]
        # flat: numpy's fast loop takes indices of one dimension only
        np.add.at(bands.reshape(-1), entry.ravel(), product.ravel())
        for sums, target in zip(right, wanted.T, strict=True):
            np.add.at(sums, place.ravel(), (weighted * target).ravel())
    free = slice(len(fixed[0]), count - len(fixed[1]))
    if free.start < free.stop:
        known[free] = solveh_banded(bands[:, free], right.T[free], lower=True)
    spline = BSpline(t, known, DEGREE)
    powers = np.empty((len(h), DEGREE + 1, values.shape[1]))
    factorial = 1.0
    for k in range(DEGREE + 1):
        factorial *= max(k, 1)
        powers[:, k] = spline(knots[:-1], nu=k) / factorial
    return powers


def _basis(s: Array, t: Array, degree: int) -> tuple[Array, np.ndarray]:
    """(N, degree+1) values of the B-splines that are not nothing at s (N,), and the number (N,) of
    the first.
    """
    from scipy.interpolate import BSpline

    made = BSpline.design_matrix(s, t, degree)
    return made.data.reshape(len(s), degree + 1), made.indices.reshape(len(s), degree + 1)[:, 0]


def _combine(basis: Array, first: np.ndarray, coefficients: Array) -> Array:
    """(N, k) values of splines whose B-splines are those."""
    near = coefficients[first[:, None] + np.arange(basis.shape[1])]
    return np.asarray((basis[..., None] * near).sum(1))


def _third_differences(t: Array, count: int) -> Array:
    """(count − 3, 4) what makes of coefficients those of the third derivative, on the knots
    t[3:-3].
    """
    rows = np.zeros((count, 4))
    rows[:, 0] = 1.0
    for degree in (DEGREE, DEGREE - 1, DEGREE - 2):
        inner = t[DEGREE - degree : len(t) - (DEGREE - degree)]
        n = len(rows) - 1
        rate = degree / (inner[degree + 1 : degree + 1 + n] - inner[1 : 1 + n])
        after = np.zeros((n, 4))
        after[:, 1:] = rows[1:, :3]
        rows = rate[:, None] * (after - rows[:-1])
    return rows


def _end_coefficients(t: Array, derivatives: Array) -> Array:
    """The first m coefficients of a spline that has m values and derivatives (m, k) at its
    start.
    """
    order = len(derivatives)
    if order == 0:
        return derivatives
    rows, maps = np.eye(order), [np.eye(order)[0]]
    for k in range(1, order):
        degree = DEGREE - k + 1
        inner = t[k - 1 :]
        rate = degree / (inner[degree + 1 : degree + len(rows)] - inner[1 : len(rows)])
        rows = rate[:, None] * np.diff(rows, axis=0)
        maps.append(rows[0])
    return np.asarray(np.linalg.solve(np.stack(maps), derivatives))


def _mirror(derivatives: Array) -> Array:
    """The same looked at from the other side."""
    return derivatives * ((-1.0) ** np.arange(len(derivatives)))[:, None]
