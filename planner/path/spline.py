"""Splines through points: quintic in position and orientation, with four continuous derivatives, one piece per span."""

from dataclasses import replace
from math import factorial
from typing import Any

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.pose import Pose
from planner.path.shape import Piece, Shape, turning

DEGREE = 5
# Places of a span at which its speed is looked at.
LOOKED = 201
# Least |dp/ds|, which is about 1: less is a cusp.
SLOWEST = 0.05
# Least product of two unit quaternions that follow each other: 120°.
NEAREST = 0.5


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
    numbers = _interpolated(values, spans)
    speed = _speeds(numbers, spans)
    slowest = int(np.argmin(speed.min(1)))
    if speed[slowest].min() < SLOWEST:
        raise MotionError(
            f"the curve turns back between {_name(slowest)} and {_name(slowest + 1)}; "
            "add points that lead it round, or end the spline there and start another"
        )
    pieces = [Piece(SPLINE, own, length, segment) for own, length in zip(numbers, spans.tolist(), strict=True)]
    return [replace(piece, turn=turning(piece)) for piece in pieces]


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
    if abs(nearness[far]) < NEAREST:
        raise MotionError(
            f"{_name(far + 1)} turns by {np.degrees(2 * np.arccos(abs(nearness[far]))):.4g}° from {_name(far)}; "
            f"at most {np.degrees(2 * np.arccos(NEAREST)):.4g}° lie between two points: add some"
        )
    sides = np.cumprod(np.concatenate([[1.0], np.where(nearness < 0, -1.0, 1.0)]))
    return np.asarray(found * sides[:, None])


def along(points: Array, share: Array) -> tuple[Array, Array]:
    """Points (N, k, 3) of the spline through points (N+1, 3), at k shares of every span; and slopes by its chords."""
    spans = np.linalg.norm(np.diff(points, axis=0), axis=1)
    powers = _interpolated(points, spans).reshape(len(spans), DEGREE + 1, 3)
    s, k = (spans[:, None] * share)[..., None], np.arange(DEGREE + 1)
    slopes = np.einsum("nkx,nsk->nsx", powers[:, 1:], k[1:] * s ** k[:-1])
    return np.einsum("nkx,nsk->nsx", powers, s**k), slopes


def _interpolated(values: Array, spans: Array) -> Array:
    """(N, 6 k) coefficients of every span through k values (N+1, k), by powers of s from its start."""
    from scipy.interpolate import make_interp_spline

    knots = np.concatenate([[0.0], np.cumsum(spans)])
    nothing = np.zeros(values.shape[1])
    ends: Any = [(2, nothing), (4, nothing)]  # SciPy's stubs know one name only
    # counted from the first, what does not change is exactly constant
    curve = make_interp_spline(knots, values - values[0], k=DEGREE, bc_type=(ends, ends))
    powers = np.stack([curve(knots[:-1], nu=k) / factorial(k) for k in range(DEGREE + 1)], 1)
    powers[:, 0] = values[:-1]
    return frozen(powers.reshape(len(spans), -1))


def _speeds(numbers: Array, spans: Array) -> Array:
    """|dp/ds| (N, LOOKED) over every span."""
    s = spans[:, None] * np.linspace(0.0, 1.0, LOOKED)
    powers = numbers.reshape(len(spans), DEGREE + 1, 7)[:, None, :, :3]
    slope = sum(k * powers[:, :, k] * s[..., None] ** (k - 1) for k in range(1, DEGREE + 1))
    return np.asarray(np.linalg.norm(slope, axis=2))
