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
    sides = np.cumprod(np.concatenate([[1.0], np.where(nearness < 0, -1.0, 1.0)]))
    return np.asarray(found * sides[:, None])


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
