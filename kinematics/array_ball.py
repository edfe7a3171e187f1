"""Balls |x − mid| ≤ rad of arrays, entry by entry: the arithmetic of the coefficients of `kinematics.series`."""

import numpy as np

from kinematics.array import Array

# Twice the unit roundoff: covers the rounding of the operation itself and of the radius that bounds it.
EPS = 2.0**-52

Ball = tuple[Array, Array]


def times(a: Ball, b: Ball) -> Ball:
    mid = a[0] * b[0]
    rad = np.abs(a[0]) * b[1] + a[1] * (np.abs(b[0]) + b[1])
    with np.errstate(invalid="ignore"):
        rad = np.where(np.isnan(rad), np.inf, rad)  # 0 · ∞: the ball of an undefined quotient stays unbounded
    return mid, rad * (1 + 4 * EPS) + EPS * np.abs(mid)


def minus(a: Ball, b: Ball) -> Ball:
    mid = a[0] - b[0]
    return mid, (a[1] + b[1]) * (1 + EPS) + EPS * np.abs(mid)


def inverse(mid: Array, rad: Array) -> Ball:
    """1/ball; radius ∞ where the ball contains zero."""
    near, far = np.abs(mid) - rad, np.abs(mid) + rad
    safe = near > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        high, low = 1 / np.where(safe, near, 1.0), 1 / np.where(safe, far, 1.0)
    middle = np.sign(mid) * (high + low) / 2
    return np.where(safe, middle, 0.0), np.where(safe, (high - low) / 2 * (1 + 4 * EPS) + 4 * EPS * high, np.inf)
