"""Points on a curve, dense enough that the spline through them stays within a tolerance of it."""

from collections.abc import Callable

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.path.spline import along

BEGIN, ROUNDS, MOST = 17, 40, 20_000
"""Points to begin with, how often spans are halved, and points at most."""
INSIDE = np.arange(1, 8) / 8
"""Places of a span at which it is held against the curve."""
NEWTON = 2
"""Steps towards the nearest point of the curve: what they leave makes a distance larger, never smaller."""

Curve = Callable[[Array], tuple[Array, Array]]
"""Points (N, 3) and their first derivatives at parameters (N,)."""


def fitted(curve: Curve, low: float, high: float, tolerance: float) -> tuple[Array, float]:
    """Points (N, 3) from low to high, and by how much (m) the program's spline through them leaves the curve.

    Spans that leave it by more than the tolerance are halved, and so are their neighbours. Measured at seven places of
    each span, against the nearest point of the curve. Raises MotionError where the curve does not let itself be fitted.
    """
    t = np.linspace(low, high, BEGIN)
    for _ in range(ROUNDS):
        points = curve(t)[0]
        spans = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if not np.isfinite(points).all() or spans.min() == 0 or len(t) > MOST:
            break
        off = _off(curve, t, points)
        bad = off > tolerance
        if not bad.any():
            return points, float(off.max())
        bad[1:] |= bad[:-1].copy()
        bad[:-1] |= bad[1:].copy()
        t = np.sort(np.concatenate([t, (t[:-1] + t[1:])[bad] / 2]))
    raise MotionError(f"no smooth curve follows it within {tolerance * 1e3:g} mm; explode it into lines and arcs")


def _off(curve: Curve, t: Array, points: Array) -> Array:
    """m, the largest distance of each span from the curve."""
    x = along(points, INSIDE)[0].reshape(-1, 3)
    near = (t[:-1, None] + np.diff(t)[:, None] * INSIDE).ravel()
    for _ in range(NEWTON):
        p, slope = curve(near)
        steep = np.maximum((slope**2).sum(1), np.finfo(float).tiny)
        near = np.clip(near + ((x - p) * slope).sum(1) / steep, t[0], t[-1])
    return np.asarray(np.linalg.norm(x - curve(near)[0], axis=1).reshape(len(t) - 1, -1).max(1))
