"""Paths with axis limits, which we and our peers solve, and how far motions use the limits."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from kinematics import load_machine
from kinematics.foundation.arrays import Array
from kinematics.machine.axis import Axis, directional_bounds
from planner import load_program
from planner.limits import limits_of
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath, actuate
from planner.path.polynomial import PolynomialPath
from planner.time_optimal import polynomials

SHARES = np.linspace(0.0, 1.0, 41)
"""Places in each piece or interval of a motion at which it is sampled."""
QUANTITIES = ("speed", "acceleration", "jerk")


@dataclass(frozen=True, slots=True)
class Motion:
    """Duration (s), and q, q̇, q̈, q⃛ (N, n) at many instants: q⃛ is infinite where q̈ jumps."""

    duration: float
    q: Array
    qd: Array
    qdd: Array
    qddd: Array

    def uses(self, bounds: Array) -> list[float]:
        """Return the largest value/bound of speed, acceleration and jerk; bounds (3, 2, n)."""
        uses = []
        for rate, (below, above) in zip((self.qd, self.qdd, self.qddd), bounds, strict=True):
            uses.append(float(np.maximum(rate / above, -rate / below).max()))
        return uses


Solve = Callable[[], Callable[[], Motion]]
"""Solves a problem and returns what samples the motion: only the first is timed."""


def slow_to_hold(duration: float, uses: Sequence[float]) -> float:
    """Return the duration of a motion that is slowed until no use, from speed on, is above 1."""
    return duration * max(1.0, *(float(use ** (1 / power)) for power, use in enumerate(uses, 1)))


@dataclass(frozen=True, slots=True)
class PathProblem:
    """A path from rest to rest, and axes with speed, acceleration and jerk limits."""

    name: str
    path: ActuatorPath
    axes: tuple[Axis, ...]

    @property
    def bounds(self) -> Array:
        """Largest speed, acceleration and jerk (3, 2, n), towards smaller and greater values."""
        bounds = []
        for name in QUANTITIES:
            bounds.append([directional_bounds(getattr(axis, f"max_{name}")) for axis in self.axes])
        return np.array(bounds).transpose(0, 2, 1)

    @property
    def length(self) -> float:
        """Range of the path's parameter."""
        return float(self.path.breaks[-1] - self.path.breaks[0])

    def limits(self, order: int) -> tuple[Limit, ...]:
        """Return the limits on speed, acceleration and jerk: no peer knows travel, tilt or
        force.
        """
        limits = limits_of(self.path, self.axes, order)
        return tuple(limit for limit in limits if limit.name in QUANTITIES)

    def piece(self, s: Array) -> np.ndarray:
        """Return the piece of the path at path lengths s (N,)."""
        breaks = self.path.breaks
        return np.clip(np.searchsorted(breaks, s, side="right") - 1, 0, len(breaks) - 2)

    def derivatives(self, s: Array) -> tuple[Array, ...]:
        """Return q, q′, q″, q‴ (N, n) at path lengths s (N,)."""
        return self.path.derivatives(s, self.piece(s))

    def motion(self, duration: float, s: Array, rates: tuple[Array, Array, Array]) -> Motion:
        """Return the motion with path lengths s (N,) and rates ṡ, s̈, s⃛ at many instants."""
        q, q1, q2, q3 = self.derivatives(s)
        v, a, j = (rate[:, None] for rate in rates)
        jerk = np.full_like(q, np.inf)
        if np.isfinite(j).all():
            jerk = q1 * j + 3 * q2 * v * a + q3 * v**3
        return Motion(duration, q, q1 * v, q1 * a + q2 * v**2, jerk)


def circle() -> PathProblem:
    """Return the circle of 15 mm radius on the hexapod."""
    machine = load_machine("hexapod")
    path = actuate(load_program("bare-circle"), machine)
    return PathProblem("hexapod, circle", path, machine.axes)


def spline(seed: int = 0, count: int = 50, axes: int = 6) -> PathProblem:
    """Return a quintic, smooth enough for a jerk limit, through random waypoints."""
    points = np.random.default_rng(seed).uniform(-1, 1, (count, axes))
    curve = make_interp_spline(np.arange(float(count)), points, k=5)
    bounds = np.ones((3, 2, axes)) * np.array([1.0, 2.0, 20.0])[:, None, None]
    return spline_problem(f"spline, {count} waypoints", curve, bounds)


def straight(length: float = 0.0508) -> PathProblem:
    """Return the hexapod's stroke along one axis."""
    axis = replace(load_machine("hexapod").axes[0], name="x")
    path = PolynomialPath(np.array([0.0, length]), np.array([[[1.0]], [[0.0]]]), ["x"])
    return PathProblem("straight, one axis", path, (axis,))


def rest_spline(points: Array) -> Any:
    """Return the quintic over [0, 1] through points (N, n), with q′ = q″ = 0 at both ends."""
    rest: Any = [(order, np.zeros(points.shape[1])) for order in (1, 2)]
    return make_interp_spline(np.linspace(0, 1, len(points)), points, k=5, bc_type=(rest, rest))


def spline_problem(name: str, curve: Any, bounds: Array) -> PathProblem:
    """Return the problem of a B-spline under bounds as `PathProblem` has them."""
    drawn = polynomials(curve)
    real = np.diff(drawn.x) > 0  # pieces between knots that are not repeated
    breaks = np.append(drawn.x[:-1][real], drawn.x[-1])
    limits = [[tuple(pair) for pair in quantity.T.tolist()] for quantity in bounds]
    axes = tuple(
        Axis(f"axis{k + 1}", max_speed=speed, max_acceleration=acceleration, max_jerk=jerk)
        for k, (speed, acceleration, jerk) in enumerate(zip(*limits, strict=True))
    )
    path = PolynomialPath(breaks, drawn.c[:, real], [axis.name for axis in axes])
    return PathProblem(name, path, axes)
