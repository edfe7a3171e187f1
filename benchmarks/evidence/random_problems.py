"""Random paths with limits, each from its seed alone.

They are feasible by construction: limits are positive, paths are continuous, motions go from rest
to rest and stop at corners. The slower a motion is, the smaller is its share of every limit.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import Akima1DInterpolator, BSpline, CubicSpline, PPoly

from kinematics.foundation.arrays import Array
from planner import Solution, time_optimal
from planner.time_optimal import polynomials

SIZES = (1, 2, 3, 5, 10, 40)
"""Numbers of pieces of a random spline."""


@dataclass(frozen=True, slots=True)
class RandomProblem:
    """A path and limits (n,) on speed, acceleration and, at order 3, jerk."""

    name: str
    path: PPoly
    speed: Array
    acceleration: Array
    jerk: Array | None

    def solve(self, length: float = 1.0, time: float = 1.0) -> Solution:
        """Return the fastest motion, with all lengths and all times multiplied."""
        return time_optimal(
            PPoly(self.path.c * length, self.path.x),
            max_speed=self.speed * length / time,
            max_acceleration=self.acceleration * length / time**2,
            max_jerk=None if self.jerk is None else self.jerk * length / time**3,
        )


def random_problem(seed: int, order: int) -> RandomProblem:
    """Draw two to ten waypoints of one to seven axes, of sizes over nine decades.

    Times differ by seven decades. Some waypoints are repeated, and some axes do not move. The path
    is a spline or a polyline.
    """
    rng = np.random.default_rng([seed, order])
    count = int(rng.integers(2, 11))
    axes = int(rng.integers(1, 8))
    size = 10.0 ** rng.uniform(-7, 2)
    points = size * rng.normal(size=(count, axes)) * 10.0 ** rng.uniform(-1, 1, axes)
    if axes > 1 and rng.random() < 0.15:
        points[:, rng.integers(axes)] = size
    if count > 2 and rng.random() < 0.2:
        repeated = int(rng.integers(1, count))
        points[repeated] = points[repeated - 1]
    knots = np.append(0.0, np.cumsum(10.0 ** rng.uniform(-0.5, 0.5, count - 1)))
    kind = str(rng.choice(["natural", "clamped", "not-a-knot", "akima", "polyline"]))
    time = 10.0 ** rng.uniform(-4, 3)
    spread = 10.0 ** rng.uniform(-1, 1, (3, axes))
    speed, acceleration, jerk = (size / time**k * spread[k - 1] ** k for k in (1, 2, 3))
    name = f"seed {seed}: {count} waypoints, {axes} axes, {kind}"
    path = interpolate(kind, knots, points)
    return RandomProblem(name, path, speed, acceleration, jerk if order == 3 else None)


def interpolate(kind: Any, knots: Array, points: Array) -> Any:
    """Return the path of a kind through points."""
    if kind == "polyline":
        slopes = np.diff(points, axis=0) / np.diff(knots)[:, None]
        return PPoly(np.stack([slopes, points[:-1]]), knots)
    if kind == "akima" and len(points) > 2:
        return Akima1DInterpolator(knots, points)
    return CubicSpline(knots, points, bc_type="natural" if kind == "akima" else kind)


def random_spline(seed: int) -> RandomProblem:
    """Draw a spline of degree 1 to 9 over twelve decades of length and of limits.

    Six of ten are of order 2.     Some have jumps of q′ between two pieces, from 1e-14 of q′ on.
    """
    rng = np.random.default_rng([seed, 7])
    axes = int(rng.integers(1, 4))
    degree = int(rng.integers(1, 10))
    kind = str(rng.choice(["jumps", "b", "cubic"]))
    mixed = rng.random() < 0.4
    size = 10.0 ** rng.uniform(-6, 6, axes) if mixed else np.full(axes, 10.0 ** rng.uniform(-3, 3))
    pieces = int(rng.choice(SIZES))
    uneven = rng.random() < 0.5
    knots = np.cumsum(10.0 ** rng.uniform(-2, 2, pieces + 1) if uneven else np.ones(pieces + 1))
    path: PPoly
    if kind == "cubic":
        points = rng.normal(size=(pieces + 1, axes)) * size
        path = CubicSpline(knots, points, bc_type="natural")
    else:
        repeated = np.pad(knots, degree, mode="edge")
        controls = rng.normal(size=(pieces + degree, axes)) * size
        path = polynomials(BSpline(repeated, controls, degree))
        path = add_jumps(path, rng, 10.0 ** rng.uniform(-14, -3) if kind == "jumps" else 0.0)
    wide = rng.random() < 0.5
    bounds = 10.0 ** (rng.uniform(-6, 6, 3) if wide else rng.uniform(-2, 2, 3))
    speed, acceleration, jerk = (np.full(axes, bound) for bound in bounds)
    name = f"seed {seed}: {kind}, degree {degree}, {pieces} pieces, {axes} axes"
    return RandomProblem(name, path, speed, acceleration, jerk if rng.random() < 0.4 else None)


def add_jumps(path: PPoly, rng: np.random.Generator, jump: float) -> PPoly:
    """Return the pieces of a path, each with a slope that is off by a share, without gaps."""
    real = np.diff(path.x) > 0
    c = path.c[:, real]
    x = np.append(path.x[:-1][real], path.x[-1])
    for p in range(1, c.shape[1] if jump else 0):
        slope = jump * np.abs(c[-2, p]).max() * rng.normal(size=c.shape[2])
        c[-2, p] += slope
        c[-1, p + 1 :] += slope * (x[p + 1] - x[p])
    return PPoly(c, x)
