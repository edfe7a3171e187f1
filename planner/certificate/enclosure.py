"""A motion over cells of time, with guaranteed error: Taylor series in time of the actuators and of the pose.

s(t) is put into the path's own expression, so no chain rule of a solver takes part; q̇, q̈, q⃛ follow by
differentiating the series. Remainder: Taylor's theorem with Lagrange's form, the last coefficient taken over the whole
cell.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from math import comb

import numpy as np

from kinematics.analysis.clearance import Bodies
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.taylor_model import EPS, Series
from planner.path.actuation import ActuatorPath, check_rate
from planner.trajectory import Trajectory

# Places at which a polynomial's value is worked out: a parabola of height h is then over-estimated by h/4096.
POINTS = 65
# Columns worked out together: few enough for a linear algebra library to leave its threads alone, which for products as
# narrow as these take twice the processor time and no less of ours.
COLUMN_BATCH = 1024
PLACE_ROUNDING = 4 * EPS
"""Share of a path's length: what is proved of a motion holds for all whose places are that near to its own.

A motion is copied to equal pieces elsewhere on the path, whose breaks are rounded differently: by less than 2 EPS.
"""


@dataclass(frozen=True, slots=True)
class Cells:
    """Parts of time pieces k, from lo to hi after the piece's start."""

    k: np.ndarray
    lo: Array
    hi: Array

    def parts(self, count: int) -> "Cells":
        """Each cell in equal parts."""
        share = np.arange(1, count)[:, None] / count
        cuts = np.concatenate([self.lo[None], self.lo + (self.hi - self.lo) * share, self.hi[None]])
        return Cells(np.tile(self.k, count), cuts[:-1].ravel(), cuts[1:].ravel())

    def __getitem__(self, chosen: np.ndarray) -> "Cells":
        return Cells(self.k[chosen], self.lo[chosen], self.hi[chosen])


@dataclass(frozen=True)
class Enclosure:
    """The motion over N cells, in τ ∈ [−1, 1]: the first N rows about each centre, the last N over the whole cell.

    s (order+1, 2N); rate (2N, 1) 1/s, by which τ runs. What no limit looks at is not worked out.
    """

    path: ActuatorPath
    s: Series
    rate: Array
    piece: np.ndarray

    @cached_property
    def q(self) -> Series:
        return self.path.enclose(self.s, np.tile(self.piece, 2))

    @cached_property
    def pose(self) -> Series:
        found = self.path.enclose_pose(self.s, np.tile(self.piece, 2))
        assert found is not None  # only machines have limits on their pose
        return found

    def _differentiate(self, series: Series, times: int) -> Series:
        return series.differentiate(times, self.rate)

    @property
    def qd(self) -> Series:
        return self._differentiate(self.q, 1)

    @property
    def qdd(self) -> Series:
        return self._differentiate(self.q, 2)

    @property
    def qddd(self) -> Series:
        return self._differentiate(self.q, 3)

    def pose_rate(self, times: int) -> Series:
        return self._differentiate(self.pose, check_rate(times))

    def distances(self, bodies: Bodies) -> Series:
        """Between those at either end of a cell, less what they can fall below both: see `Bodies`.

        τ goes by 2 from end to end, so d ≥ (d₀ + d₁)/2 − V of change V, and d ≥ min(d₀, d₁) − K/2 of bend K.
        """
        cells = len(self.piece)
        first, second = self.pose.derivative(), self.pose.derivative().derivative()
        rates = [_norms(np.maximum(*np.abs(bound_series(each, cells)))) for each in (first, second)]
        x, error = _ends(self.pose, cells)
        start, end = np.split(bodies.distances(x.reshape(-1, 12)), 2)
        (pace, swing), (shift, twist) = rates[0], _norms(error)
        spin = swing / np.sqrt(2)
        far = 2 * pace + shift, 2 * spin + twist
        # what rounding leaves of a rotation is none: twice for what that changes
        off = bodies.change(x[0], 2 * shift, 2 * twist) + 64 * EPS * (1 + np.abs(x[0]).max(1))[:, None]
        change = bodies.change(x[0], *far) / 2
        middle, least = (start + end) / 2, np.minimum(start, end)
        bend = bodies.bend(x[0], *far, middle - change - off, (pace, spin), rates[1])
        low = np.maximum(middle - change, least - bend / 2) - off
        high = middle + change + off
        mid, rad = np.zeros((2, 2, 2 * cells, low.shape[1]))
        mid[0] = np.tile((low + high) / 2, (2, 1))
        rad[0] = np.tile((high - low) / 2 * (1 + 64 * EPS) + 4 * EPS * np.abs(high), (2, 1))
        return Series(mid, rad, 1)

    def tool_rate(self, times: int) -> Series:
        rate, tool = self.pose_rate(times), self.path.tool
        return rate if tool is None else self.evaluate(tool, rate)

    def evaluate(self, expression: Expression, *inputs: Series) -> Series:
        return expression.enclose_columns(*inputs)


def enclose(trajectory: Trajectory, cells: Cells, order: int) -> Enclosure:
    """The motion over cells, as series in τ up to τ^order, with t = centre + τ · half width."""
    mid, rad, half = expand_motion(trajectory, cells)
    # over the whole cell every coefficient moves by what the higher ones can add: c_k(x) = Σ_j C(j, k) c_j x^(j−k)
    size = np.abs(mid) + rad
    spread = np.stack([sum((comb(j, n) * size[j] for j in range(n + 1, 4)), np.zeros_like(half)) for n in range(4)])
    s = Series(np.concatenate([mid, mid], 1), np.concatenate([rad, (rad + spread) * (1 + 8 * EPS)], 1), order)
    return Enclosure(trajectory.path, s, np.concatenate([1 / half, 1 / half])[:, None], trajectory.piece[cells.k])


def expand_motion(trajectory: Trajectory, cells: Cells) -> tuple[Array, Array, Array]:
    """Coefficients of s in τ about each cell's centre, their errors, (4, N) each, and the cells' half widths (N,)."""
    k, centre = cells.k, (cells.lo + cells.hi) / 2
    half = (cells.hi - cells.lo) / 2 * (1 + 2 * EPS) + 2 * EPS * np.abs(cells.hi)
    powers = np.stack([np.ones_like(half), half, half * half, half * half * half])

    def shift(s: Array, v: Array, a: Array, j: Array) -> Array:
        first, second = v + centre * (a + centre * j / 2), a / 2 + centre * j / 2
        about = [s + centre * (v + centre * (a / 2 + centre * j / 6)), first, second, j / 6]
        return np.stack(about) * powers

    motion = trajectory.s[k], trajectory.v[k], trajectory.a[k], trajectory.j[k]
    # fewer roundings than 32 of each term, whatever the signs
    error = 32 * EPS * shift(*map(np.abs, motion))
    error[0] += PLACE_ROUNDING * np.abs(trajectory.path.breaks[[0, -1]]).max()
    return shift(*motion), error, half


@cache
def _powers_at(points: int, powers: int) -> Array:
    """(points, powers): τ^k at places evenly over [−1, 1]."""
    return freeze_array(np.linspace(-1, 1, points)[:, None] ** np.arange(powers))


def bound_series(series: Series, cells: int) -> tuple[Array, Array]:
    """Bounds low and high (cells, m) of a series over each cell."""
    full = series.pad(series.order)
    polynomial, error = full.mid[:-1, :cells], full.rad[:-1, :cells].sum(0)
    remainder = np.abs(full.mid[-1, cells:]) + full.rad[-1, cells:]
    low, high = bound_polynomials(polynomial)
    slack = (error + remainder) * (1 + 32 * EPS) + 32 * EPS * np.abs(polynomial).sum(0)
    slack = np.where(np.isfinite(slack), slack, np.inf)
    return low - slack, high + slack


def _norms(numbers: Array) -> tuple[Array, Array]:
    """Of a pose's numbers (N, 12): of the origin, and Frobenius' of the rotation, (N,) each, no rounding below."""
    return tuple(np.linalg.norm(part, axis=1) * (1 + 16 * EPS) for part in (numbers[:, :3], numbers[:, 3:]))


def _ends(series: Series, cells: int) -> tuple[Array, Array]:
    """Values (2, cells, m) at τ = −1 and 1, and their error (cells, m)."""
    full = series.pad(series.order)
    polynomial = full.mid[:-1, :cells]
    even, odd = polynomial[::2].sum(0), polynomial[1::2].sum(0)
    error = full.rad[:-1, :cells].sum(0) + np.abs(full.mid[-1, cells:]) + full.rad[-1, cells:]
    return np.stack([even - odd, even + odd]), (error + np.abs(polynomial).sum(0) * 32 * EPS) * (1 + 32 * EPS)


def find_extremes(series: Series, cells: int, channel: np.ndarray) -> tuple[Array, Array]:
    """Where in each cell one channel (cells,) is about largest and least, −1 to 1, and what all are there.

    Places (2, cells), values (2, cells, m).
    """
    polynomial = series.pad(series.order).mid[:-1, :cells]
    own = polynomial[:, np.arange(cells), channel]
    values = _powers_at(POINTS, len(own)) @ own
    places = np.linspace(-1, 1, POINTS)[np.stack([values.argmax(0), values.argmin(0)])]
    found = np.zeros((2, *polynomial.shape[1:]))
    for power in polynomial[::-1]:
        found = found * places[..., None] + power
    return places, found


def bound_polynomials(polynomial: Array) -> tuple[Array, Array]:
    """Bound each polynomial (powers, …) on [−1, 1] by its values at places h apart.

    Beyond two neighbours it goes by h²/8 times the largest second derivative at most, Σ k (k − 1) |c_k|.
    """
    columns = polynomial.reshape(len(polynomial), -1)
    low, high = np.empty((2, columns.shape[1]))
    k = np.arange(len(columns))
    beyond = (k * (k - 1)) @ np.abs(columns) * (1 / (POINTS - 1) ** 2 / 2)
    for first in range(0, columns.shape[1], COLUMN_BATCH):
        some = slice(first, first + COLUMN_BATCH)
        values = _powers_at(POINTS, len(columns)) @ columns[:, some]
        low[some], high[some] = values.min(0), values.max(0)
    return (low - beyond).reshape(polynomial.shape[1:]), (high + beyond).reshape(polynomial.shape[1:])
