"""Splines through points: quintic in position and orientation, with four continuous derivatives, one piece per span."""

from dataclasses import replace

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.machine.pose import Pose
from planner.path.shape import Piece, Shape, turning_angle

DEGREE = 5
# Places of a span at which its speed is looked at.
SPAN_POINTS = 201
# Least |dp/ds|, which is about 1: less is a cusp.
MIN_SPEED = 0.05
# Least product of two unit quaternions that follow each other: 120°.
MIN_QUATERNION_PRODUCT = 0.5
# Third and fourth derivative of a quintic at its start and its end, by v, a, w, b there: factors, and powers of h.
_START = np.array([[-36.0, -9, -24, 3], [192, 36, 168, -24]])
_END = np.array([[-24.0, -3, -36, 9], [-168, -24, -192, 36]])
_SCALES = np.array([[-2.0, -1, -2, -1], [-3, -2, -3, -2]])
# The same by d, at the start; at the end both are positive.
_JUMP, _SIDES = np.array([[60.0], [-360]]), np.array([[-3.0], [-4]])


def _motion(s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    """p and q polynomials of degree 5;  R = the rotation of the quaternion q = (x, y, z, w), of any length."""
    rows = ca.reshape(parameters, 7, DEGREE + 1)
    value: ca.SX = rows[:, DEGREE]
    for k in reversed(range(DEGREE)):
        value = value * s + rows[:, k]
    vector, w = value[3:6], value[6]
    square = ca.dot(vector, vector)
    cross = ca.skew(vector)
    turned = ca.SX.eye(3) + (2 * w * cross + 2 * (cross @ cross)) / (square + w * w)
    return value[:3], turned


SPLINE = Shape("spline", 7 * (DEGREE + 1), _motion)


def spline(start: Pose, through: Array, rotate: Rotation | None, segment: int) -> list[Piece]:
    """The curve from start through points (N, 3), in orientations `rotate` (N) there; one piece per span.

    The interpolating quintic spline over the length of its chords, straight at both ends (no second and fourth
    derivative there). So |dp/ds| is not quite 1: on a span that bends by θ evenly it is θ/2 / sin(θ/2), 1.001 for 10°.
    Orientation is the quaternion's own quintic spline, divided by its length: it turns alike in every frame. Raises
    MotionError where the curve turns back on the spot, or an orientation is more than 120° from the one before.
    """
    points = np.concatenate([start.translation[None], through])
    values = np.concatenate([points, _quaternions(start, rotate, len(through))], 1)
    spans = np.linalg.norm(np.diff(points, axis=0), axis=1)
    numbers = _span_coefficients(values, spans)
    speed = _span_speeds(numbers, spans)
    slowest = int(np.argmin(speed.min(1)))
    if speed[slowest].min() < MIN_SPEED:
        raise MotionError(
            f"the curve turns back between {_name(slowest)} and {_name(slowest + 1)}; "
            "add points around the reversal, or end the spline there and start another"
        )
    pieces = [Piece(SPLINE, own, length, segment) for own, length in zip(numbers, spans.tolist(), strict=True)]
    return [replace(piece, turn=turning_angle(piece)) for piece in pieces]


def _name(point: int) -> str:
    return f"point {point}" if point else "its start"


def _quaternions(start: Pose, rotate: Rotation | None, count: int) -> Array:
    """(N+1, 4) unit quaternions x, y, z, w, each on the side of the one before it."""
    first = start.rotation.as_quat()[None]
    if rotate is None:
        return np.repeat(first, count + 1, 0)
    found = np.concatenate([first, rotate.as_quat()])
    nearness = (found[1:] * found[:-1]).sum(1)
    far = int(np.argmin(np.abs(nearness)))
    if abs(nearness[far]) < MIN_QUATERNION_PRODUCT:
        raise MotionError(
            f"{_name(far + 1)} turns by {np.degrees(2 * np.arccos(abs(nearness[far]))):.4g}° from {_name(far)}; "
            f"at most {np.degrees(2 * np.arccos(MIN_QUATERNION_PRODUCT)):.4g}° lie between two points: add some"
        )
    return align_signs(found)


def align_signs(quaternions: Array) -> Array:
    """(N, 4) each on the side of the one before it."""
    nearness = (quaternions[1:] * quaternions[:-1]).sum(1)
    sides = np.cumprod(np.concatenate([[1.0], np.where(nearness < 0, -1.0, 1.0)]))
    return np.asarray(quaternions * sides[:, None])


def sample_splines(points: Array, share: Array) -> tuple[Array, Array]:
    """Points (…, N, k, 3) of splines through points (…, N+1, 3), at k shares of every span; and slopes by its chords.

    Splines of as many points each are worked out all at once, which is many times faster than one by one.
    """
    spans = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    k = np.arange(DEGREE + 1)
    powers = _span_powers(points, spans) * (spans[..., None] ** k)[..., None]
    slopes = (k[1:] * share[:, None] ** k[:-1]) @ powers[..., 1:, :]
    return share[:, None] ** k @ powers, slopes / spans[..., None, None]


def _span_coefficients(values: Array, spans: Array) -> Array:
    """(N, 6 k) coefficients of every span through k values (N+1, k), by powers of s from its start."""
    return freeze_array(_span_powers(values, spans).reshape(len(spans), -1))


def _span_powers(values: Array, spans: Array) -> Array:
    """(…, N, 6, k) coefficients of every span through values (…, N+1, k), by powers of s from its start.

    A span h from p to q = p + d, with first derivatives v, w and second ones a, b at its ends, is the quintic of these;
    its third and fourth derivatives at its start are

        (60 d − (36 v + 24 w) h − (9 a − 3 b) h²)/h³,   (−360 d + (192 v + 168 w) h + (36 a − 24 b) h²)/h⁴

    and at its end the same, looked at from there. They agree at every knot, and a = 0 and the fourth is 0 at both ends:
    linear in v and a of the knots, with three bands above and below. Splines of a batch are blocks of one such system.
    """
    from scipy.linalg.lapack import dgbsv

    count, width = spans.shape[-1], values.shape[-1]
    h = spans.reshape(-1, count) / spans.mean()
    d = np.diff(values, axis=-2).reshape(-1, count, width)
    knots = np.zeros((len(h), count + 1, 2, 6))  # rows of a knot by v, a of the one before, of itself, of the next
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
    found = dgbsv(3, 3, bands, right.reshape(-1, width), overwrite_ab=True, overwrite_b=True)[2]
    found = found.reshape(len(h), count + 1, 2, width)
    v, w = found[:, :-1, 0] * h[..., None], found[:, 1:, 0] * h[..., None]
    a, b = found[:, :-1, 1] * h[..., None] ** 2, found[:, 1:, 1] * h[..., None] ** 2
    powers = np.empty((len(h), count, DEGREE + 1, width))
    powers[:, :, 0] = values[..., :-1, :].reshape(d.shape)
    powers[:, :, 1] = v
    powers[:, :, 2] = a / 2
    powers[:, :, 3] = 10 * d - 6 * v - 4 * w - (3 * a - b) / 2
    powers[:, :, 4] = -15 * d + 8 * v + 7 * w + (3 * a - 2 * b) / 2
    powers[:, :, 5] = 6 * d - 3 * (v + w) - (a - b) / 2
    powers = powers.reshape(*spans.shape, DEGREE + 1, width)
    powers /= (spans[..., None] ** np.arange(DEGREE + 1))[..., None]
    return np.asarray(powers)


def _span_speeds(numbers: Array, spans: Array) -> Array:
    """|dp/ds| (N, SPAN_POINTS) over every span."""
    s = spans[:, None] * np.linspace(0.0, 1.0, SPAN_POINTS)
    powers = numbers.reshape(len(spans), DEGREE + 1, 7)[:, None, :, :3]
    slope = sum(k * powers[:, :, k] * s[..., None] ** (k - 1) for k in range(1, DEGREE + 1))
    return np.asarray(np.linalg.norm(slope, axis=2))


# Of a spline that smooths: shorter than this share of a span, what bends is noise. Points of a span for its ∫|p‴|².
NOISE_SHARE, GAUSS_POINTS = 0.1, 3


def smooth_spline(knots: Array, s: Array, values: Array, weights: Array, ends: tuple[Array, Array]) -> Array:
    """(K, 6, k) coefficients of the spans between knots (K+1,), by powers of s from each: near values (N, k) at s (N,).

    Σ w |p(sᵢ) − valuesᵢ|² + Σ (NOISE_SHARE h)⁶ ∫|p‴|² over spans h is least, among the quintic splines with four
    continuous derivatives that have given ones at their ends: (m, k) the values and their first m − 1 derivatives.
    """
    from scipy.interpolate import BSpline
    from scipy.linalg import solveh_banded

    t = np.concatenate([np.full(DEGREE, knots[0]), knots, np.full(DEGREE, knots[-1])])
    count = len(t) - DEGREE - 1
    data, first = _basis(s, t, DEGREE)
    nodes, shares = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    h = np.diff(knots)
    places = (knots[:-1, None] + h[:, None] * (nodes + 1) / 2).ravel()
    rough = ((NOISE_SHARE * h) ** 6 * h / 2)[:, None] * shares
    third, begin = _basis(places, t[3:-3], DEGREE - 3)
    slopes = _third_differences(t, count)
    bends = np.zeros((len(places), DEGREE + 1))
    for k in range(DEGREE - 2):
        for j in range(4):
            bends[:, k + j] += third[:, k] * slopes[begin + k, j]
    fixed = [_end_coefficients(t, ends[0]), _end_coefficients(-t[::-1], _mirror(ends[1]))[::-1]]
    known = np.zeros((count, values.shape[1]))
    known[: len(fixed[0])], known[count - len(fixed[1]) :] = fixed
    bands, right = np.zeros((DEGREE + 1, count)), np.zeros((count, values.shape[1]))
    for basis, at, weight, wanted in (
        (data, first, weights, values - _combine(data, first, known)),
        (bends, begin, rough.ravel(), -_combine(bends, begin, known)),
    ):
        for k in range(DEGREE + 1):
            np.add.at(right, at + k, (weight * basis[:, k])[:, None] * wanted)
            for more in range(DEGREE + 1 - k):
                np.add.at(bands[more], at + k, weight * basis[:, k] * basis[:, k + more])
    free = slice(len(fixed[0]), count - len(fixed[1]))
    if free.start < free.stop:
        known[free] = solveh_banded(bands[:, free], right[free], lower=True)
    spline = BSpline(t, known, DEGREE)
    powers = np.empty((len(h), DEGREE + 1, values.shape[1]))
    factorial = 1.0
    for k in range(DEGREE + 1):
        factorial *= max(k, 1)
        powers[:, k] = spline(knots[:-1], nu=k) / factorial
    return powers


def _basis(s: Array, t: Array, degree: int) -> tuple[Array, np.ndarray]:
    """(N, degree+1) values of the B-splines that are not nothing at s (N,), and the number (N,) of the first."""
    from scipy.interpolate import BSpline

    made = BSpline.design_matrix(s, t, degree)
    return made.data.reshape(len(s), degree + 1), made.indices.reshape(len(s), degree + 1)[:, 0]


def _combine(basis: Array, first: np.ndarray, coefficients: Array) -> Array:
    """(N, k) values of splines whose B-splines are those."""
    return np.asarray(sum(basis[:, k, None] * coefficients[first + k] for k in range(basis.shape[1])))


def _third_differences(t: Array, count: int) -> Array:
    """(count − 3, 4) what makes of coefficients those of the third derivative, on the knots t[3:-3]."""
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
    """The first m coefficients of a spline that has m values and derivatives (m, k) at its start."""
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
