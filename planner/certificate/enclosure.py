"""Enclosure of a motion over cells of time, at two levels of accuracy, with one interface.

Limits see a `MotionEnclosure`: the quantities of a motion as Taylor models, and a method that
bounds values computed from them. The coarse level (`planner.certificate.path_enclosure`) gives
intervals and is fast. The fine level below gives series in τ whose error falls with a high power of
the cell: s(t) is put into the path's own expression, and q̇, q̈, q⃛ follow by differentiating the
series. No chain rule of a solver takes part. Remainder: Taylor's theorem in Lagrange's form, the
last coefficient taken over the whole cell.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from math import comb

import numpy as np

from kinematics.analysis.clearance import Bodies
from kinematics.foundation.arrays import (
    Array,
    freeze_array,
    largest_in_rows,
)
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.taylor_model import EPS, Series
from planner.certificate.cells import Cells
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath, check_rate
from planner.trajectory import Trajectory

# Points at which a polynomial is sampled: a parabola of height h is then over-estimated by h/4096.
POINTS = 65
# Columns sampled together. Products this narrow are faster on one thread of the linear algebra
# library.
COLUMN_BATCH = 1024
PLACE_ROUNDING = 4 * EPS
"""Share of the path's length by which the enclosure of s is widened.

A proof then also holds for a copy of the motion on an equal piece elsewhere on the path, whose
breaks are rounded differently, by less than 2 EPS.
"""


class MotionEnclosure(ABC):
    """A motion over N cells: a `LimitState` of Taylor models."""

    path: ActuatorPath
    piece: np.ndarray

    @abstractmethod
    def axis_rate(self, times: int) -> Series:
        """Return a derivative of q by time, of order 0 to 3."""

    @abstractmethod
    def pose_rate(self, times: int) -> Series:
        """Return a derivative of the pose's numbers by time, of order 0 to 3."""

    @abstractmethod
    def distances(self, bodies: Bodies) -> Series:
        """Return the distances between the axes of bodies."""

    @abstractmethod
    def bound(self, values: Series) -> tuple[Array, Array]:
        """Return bounds low and high (N, m) of values computed from this motion."""

    @property
    def q(self) -> Series:
        return self.axis_rate(0)

    @property
    def qd(self) -> Series:
        return self.axis_rate(1)

    @property
    def qdd(self) -> Series:
        return self.axis_rate(2)

    @property
    def qddd(self) -> Series:
        return self.axis_rate(3)

    def tool_rate(self, times: int) -> Series:
        rate = self.pose_rate(times)
        if self.path.tool is None:
            return rate
        return self.evaluate(self.path.tool, rate)

    def evaluate(self, expression: Expression, *inputs: Series) -> Series:
        return expression.enclose_columns(*inputs)

    def bound_use(self, limit: Limit) -> Array:
        """Return an upper bound (N,) of the share of a limit that is used over each cell."""
        low, high = self.bound(limit.value(self))
        use = largest_in_rows(limit.use(low, high, self.piece))
        return np.where(np.isnan(use), np.inf, use)


@dataclass(frozen=True)
class Enclosure(MotionEnclosure):
    """Taylor series in τ ∈ [−1, 1]: N rows about each centre, then N over each whole cell.

    s     (order+1, 2N) path length
    rate  (2N, 1) dτ/dt, 1/s

    The series of axes and pose are computed when a limit asks for them.
    """

    path: ActuatorPath
    s: Series
    rate: Array
    piece: np.ndarray

    @cached_property
    def _axes(self) -> Series:
        """q (order+1, 2N, n)."""
        return self.path.enclose(self.s, np.tile(self.piece, 2))

    @cached_property
    def pose(self) -> Series:
        """The pose's numbers (order+1, 2N, 12)."""
        pose = self.path.enclose_pose(self.s, np.tile(self.piece, 2))
        assert pose is not None  # only machines have limits on their pose
        return pose

    def axis_rate(self, times: int) -> Series:
        return self._axes.differentiate(times, self.rate)

    def pose_rate(self, times: int) -> Series:
        return self.pose.differentiate(check_rate(times), self.rate)

    def distances(self, bodies: Bodies) -> Series:
        first = self.pose.derivative()
        derivatives = (first, first.derivative())
        rates = [np.abs(self.bound(each)).max(0) for each in derivatives]
        ends, error = _evaluate_at_ends(self.pose, len(self.piece))
        low, high = bound_distances(bodies, ends, error, rates)
        middle, radius = make_ball(np.tile(low, (2, 1)), np.tile(high, (2, 1)))
        return Series(middle[None], radius[None], 1)

    def bound(self, values: Series) -> tuple[Array, Array]:
        return bound_series(values, len(self.piece))


def enclose(trajectory: Trajectory, cells: Cells, order: int) -> Enclosure:
    """Return the motion over cells as series up to τ^order, with t = centre + τ · half width."""
    mid, rad, half = expand_motion(trajectory, cells)
    s = Series(
        np.concatenate([mid, mid], 1),
        np.concatenate([rad, widen(mid, rad)], 1),
        order,
    )
    return Enclosure(
        trajectory.path,
        s,
        np.tile(1 / half, 2)[:, None],
        trajectory.piece[cells.k],
    )


def widen(mid: Array, rad: Array) -> Array:
    """Return radii of a polynomial's coefficients about any centre in the cell.

    About the centre x, c_k(x) = Σ_j C(j, k) c_j x^(j−k): it differs from c_k by at most the sum
    over j > k of the sizes.
    """
    size = np.abs(mid) + rad
    count = len(size)
    spread = np.zeros_like(size)
    for k in range(count):
        for j in range(k + 1, count):
            spread[k] += comb(j, k) * size[j]
    return np.asarray((rad + spread) * (1 + 8 * EPS))


def expand_motion(
    trajectory: Trajectory,
    cells: Cells,
) -> tuple[Array, Array, Array]:
    """Return coefficients (4, N) of s in τ about each cell's centre, their errors, and half
    widths.
    """
    columns = (trajectory.s, trajectory.v, trajectory.a, trajectory.j)
    motion = np.stack([column[cells.k] for column in columns])
    centre = (cells.lo + cells.hi) / 2
    half = cells.lengths / 2 * (1 + 2 * EPS) + 2 * EPS * np.abs(cells.hi)
    powers = np.stack([np.ones_like(half), half, half**2, half**3])
    # no term is rounded 32 times, whatever the signs
    error = 32 * EPS * shift_motion(np.abs(motion), centre) * powers
    error[0] += PLACE_ROUNDING * np.abs(trajectory.path.breaks[[0, -1]]).max()
    return shift_motion(motion, centre) * powers, error, half


def shift_motion(motion: Array, t: Array) -> Array:
    """Return the coefficients (4, N) of s + v t + a t²/2 + j t³/6 about t."""
    s, v, a, j = motion
    return np.stack(
        [
            s + t * (v + t * (a / 2 + t * j / 6)),
            v + t * (a + t * j / 2),
            a / 2 + t * j / 2,
            j / 6,
        ]
    )


@cache
def _powers_at(points: int, powers: int) -> Array:
    """Powers (points, powers) of evenly spaced τ in [−1, 1]."""
    places = np.linspace(-1, 1, points)
    return freeze_array(places[:, None] ** np.arange(powers))


def bound_series(series: Series, cells: int) -> tuple[Array, Array]:
    """Return bounds low and high (cells, m) of a series over each cell."""
    polynomial, errors = split_series(series, cells)
    low, high = bound_polynomials(polynomial)
    rounding = 32 * EPS * np.abs(polynomial).sum(0)
    slack = errors.sum(0) * (1 + 32 * EPS) + rounding
    slack = np.where(np.isfinite(slack), slack, np.inf)
    return low - slack, high + slack


def split_series(series: Series, cells: int) -> tuple[Array, Array]:
    """Return the polynomials (order, cells, m) about the centres, and errors (order+1, cells, m).

    Errors are of their coefficients; the last is the remainder over the whole cell.
    """
    full = series.pad(series.order)
    errors = full.rad[:, :cells].copy()
    errors[-1] = np.abs(full.mid[-1, cells:]) + full.rad[-1, cells:]
    return full.mid[:-1, :cells], errors


def make_ball(low: Array, high: Array) -> tuple[Array, Array]:
    """Return middle and radius of intervals."""
    largest = np.maximum(np.abs(low), np.abs(high))
    radius = (high - low) / 2 * (1 + 64 * EPS) + 64 * EPS * largest
    return (low + high) / 2, radius


def cover_places(centre: Array, half: Array, order: int) -> Series:
    """Return s (order+1, 2N) over N cells: about each centre, then about any place in the cell."""
    mid = np.tile(np.stack([centre, half]), 2)
    rad = np.zeros_like(mid)
    rad[0, len(half) :] = half * (1 + 16 * EPS)
    return Series(mid, rad, order)


def _evaluate_at_ends(series: Series, cells: int) -> tuple[Array, Array]:
    """Return values (2, cells, m) at τ = −1 and 1, and their error (cells, m)."""
    polynomial, errors = split_series(series, cells)
    even = polynomial[::2].sum(0)
    odd = polynomial[1::2].sum(0)
    rounding = 32 * EPS * np.abs(polynomial).sum(0)
    error = (errors.sum(0) + rounding) * (1 + 32 * EPS)
    return np.stack([even - odd, even + odd]), error


def find_extremes(
    series: Series,
    cells: int,
    channel: np.ndarray,
) -> tuple[Array, Array]:
    """Return about where in each cell one channel (cells,) is largest and least.

    Places τ (2, cells), and all values there (2, cells, m). They prove nothing: a state is
    evaluated there.
    """
    polynomial, _ = split_series(series, cells)
    chosen = polynomial[:, np.arange(cells), channel]
    samples = _powers_at(POINTS, len(chosen)) @ chosen
    extremes = np.stack([samples.argmax(0), samples.argmin(0)])
    places = np.linspace(-1, 1, POINTS)[extremes]
    values = np.zeros((2, *polynomial.shape[1:]))
    for coefficient in polynomial[::-1]:
        values = values * places[..., None] + coefficient
    return places, values


def bound_polynomials(polynomial: Array) -> tuple[Array, Array]:
    """Bound each polynomial (powers, …) on [−1, 1] by its values at places h apart.

    Between two of them it exceeds both by at most h²/8 times the largest second derivative, which
    is at most Σ k (k − 1) |c_k|.
    """
    columns = polynomial.reshape(len(polynomial), -1)
    k = np.arange(len(columns))
    spacing = 2 / (POINTS - 1)
    curvature = (k * (k - 1)) @ np.abs(columns)
    beyond = curvature * (spacing**2 / 8)
    low, high = np.empty((2, columns.shape[1]))
    for first in range(0, columns.shape[1], COLUMN_BATCH):
        batch = slice(first, first + COLUMN_BATCH)
        samples = _powers_at(POINTS, len(columns)) @ columns[:, batch]
        low[batch] = samples.min(0)
        high[batch] = samples.max(0)
    shape = polynomial.shape[1:]
    return (low - beyond).reshape(shape), (high + beyond).reshape(shape)


def bound_distances(
    bodies: Bodies,
    ends: Array,
    error: Array,
    rates: Sequence[Array],
) -> tuple[Array, Array]:
    """Return bounds low and high (N, k) of distances d over cells τ ∈ [−1, 1].

    With the largest change V over a cell and the largest bend K (see `Bodies`):

        (d₀ + d₁)/2 − V ≤ d ≤ (d₀ + d₁)/2 + V,   d ≥ min(d₀, d₁) − K/2.

    ends   (2, N, 12) numbers of the pose at τ = −1 and 1; error (N, 12) of them
    rates  bounds (N, 12) of their first and second derivatives by τ
    """
    start, end = np.split(bodies.distances(ends.reshape(-1, 12)), 2)
    speed, swing = _norms(rates[0])
    shift, twist = _norms(error)
    spin = swing / np.sqrt(2)
    farthest = 2 * speed + shift, 2 * spin + twist
    # a rounded rotation matrix is not quite a rotation: twice the change allows for that
    size = 1 + np.abs(ends[0]).max(1, keepdims=True)
    rounding = bodies.change(ends[0], 2 * shift, 2 * twist) + 64 * EPS * size
    change = bodies.change(ends[0], *farthest) / 2
    middle = (start + end) / 2
    nearest = middle - change - rounding
    bend = bodies.bend(ends[0], *farthest, nearest, (speed, spin), _norms(rates[1]))
    low = np.maximum(middle - change, np.minimum(start, end) - bend / 2)
    return low - rounding, middle + change + rounding


def _norms(numbers: Array) -> tuple[Array, Array]:
    """Return upper bounds (N,) of the norms of the origin and of the rotation (Frobenius)."""
    origin = np.linalg.norm(numbers[:, :3], axis=1)
    rotation = np.linalg.norm(numbers[:, 3:], axis=1)
    return origin * (1 + 16 * EPS), rotation * (1 + 16 * EPS)
