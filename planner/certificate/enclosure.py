"""A motion over cells of time, with guaranteed error: Taylor series in time of the actuators and of the pose.

s(t) is put into the path's own expression, so no chain rule of a solver takes part; q̇, q̈, q⃛ follow by
differentiating the series. Remainder: Taylor's theorem with Lagrange's form, the last coefficient taken over the whole
cell. Bernstein form: Farouki, Computer Aided Geometric Design 29 (2012), 379.
"""

from dataclasses import dataclass
from functools import cache
from math import comb

import numpy as np

from kinematics.analysis.clearance import Bodies
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.taylor_model import EPS, Series
from planner.trajectory import Trajectory

# Degree to which Bernstein forms are raised: a parabola of height h is then over-estimated by h/15 at most.
BERNSTEIN_DEGREE = 16
# Columns raised together: few enough for a linear algebra library to leave its threads alone, which for products as
# narrow as these take twice the processor time and no less of ours.
COLUMN_BATCH = 1024


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


@dataclass(frozen=True, slots=True)
class Enclosure:
    """The motion over N cells, in τ ∈ [−1, 1]: the first N rows about each centre, the last N over the whole cell."""

    q: Series
    pose: Series | None
    rate: Array
    piece: np.ndarray
    tool: Expression | None

    def _differentiate(self, series: Series, times: int) -> Series:
        for _ in range(times):
            series = series.derivative() * self.rate
        return series

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
        assert self.pose is not None  # only machines have limits on their pose
        return self._differentiate(self.pose, times)

    def distances(self, bodies: Bodies) -> Series:
        """Those at the centres, and how far they can change from there: τ goes by 1 to either end of a cell."""
        assert self.pose is not None
        cells = len(self.piece)
        going = np.maximum(*np.abs(bound_series(self.pose.derivative(), cells)))
        x, error = self.pose.mid[0, :cells], self.pose.rad[0, :cells]
        way, turn = (np.linalg.norm(part, axis=1) for part in ((going + error)[:, :3], (going + error)[:, 3:]))
        value = bodies.distances(x)
        change = bodies.change(x, way, turn / np.sqrt(2)) * (1 + 64 * EPS) + 64 * EPS * np.abs(x).max(1, keepdims=True)
        mid, rad = np.zeros((2, 2, 2 * cells, value.shape[1]))
        mid[0], rad[0] = np.tile(value, (2, 1)), np.tile(change, (2, 1))
        return Series(mid, rad, 1)

    def tool_rate(self, times: int) -> Series:
        rate = self.pose_rate(times)
        return rate if self.tool is None else self.evaluate(self.tool, rate)

    def evaluate(self, expression: Expression, *inputs: Series) -> Series:
        found = Series.stack(expression.enclose([column for each in inputs for column in each.columns()]))
        shape = (found.degree + 1, inputs[0].mid.shape[1], found.mid.shape[2])  # what is constant is so on every cell
        return Series(np.broadcast_to(found.mid, shape), np.broadcast_to(found.rad, shape), found.order)


def enclose(trajectory: Trajectory, cells: Cells, order: int) -> Enclosure:
    """The motion over cells, as series in τ up to τ^order, with t = centre + τ · half width."""
    k, centre, half = cells.k, (cells.lo + cells.hi) / 2, (cells.hi - cells.lo) / 2
    piece = trajectory.piece[k]
    powers = [trajectory.s[k], trajectory.v[k], trajectory.a[k] / 2, trajectory.j[k] / 6]
    # s about the centre (a Taylor shift, in balls), then scaled to τ
    at = Series(np.stack([centre, np.ones_like(centre)]), np.zeros((2, len(centre))), 3)
    shifted = Series.zeros(3, (len(centre),))
    for power in reversed(powers):
        shifted = shifted * at + power
    scale = half ** np.arange(4)[:, None]
    mid, rad = shifted.mid * scale, shifted.rad * scale + 8 * EPS * np.abs(shifted.mid * scale)
    # over the whole cell every coefficient moves by what the higher ones can add: c_k(x) = Σ_j C(j, k) c_j x^(j−k)
    size = np.abs(mid) + rad
    spread = np.stack([sum((comb(j, n) * size[j] for j in range(n + 1, 4)), np.zeros_like(centre)) for n in range(4)])
    s = Series(np.concatenate([mid, mid], 1), np.concatenate([rad, (rad + spread) * (1 + 8 * EPS)], 1), order)
    both = np.concatenate([piece, piece])
    q, pose = trajectory.path.enclose(s, both)
    return Enclosure(q, pose, np.concatenate([1 / half, 1 / half])[:, None], piece, trajectory.path.tool)


@cache
def _bernstein_matrix(powers: int) -> Array:
    """(n+1, powers): τ^k on [−1, 1] has coefficients Σ_i (−1)^{k−i} C(j, i) C(n−j, k−i) / C(n, k) of degree n."""
    n = BERNSTEIN_DEGREE
    return freeze_array(
        [
            [
                sum((-1) ** (k - i) * comb(j, i) * comb(n - j, k - i) for i in range(max(0, k - n + j), min(j, k) + 1))
                / comb(n, k)
                for k in range(powers)
            ]
            for j in range(n + 1)
        ]
    )


def bound_series(series: Series, cells: int) -> tuple[Array, Array]:
    """Bounds low and high (cells, m) of a series over each cell."""
    full = series.pad(series.order)
    polynomial, error = full.mid[:-1, :cells], full.rad[:-1, :cells].sum(0)
    remainder = np.abs(full.mid[-1, cells:]) + full.rad[-1, cells:]
    low, high = _coefficient_range(polynomial)
    slack = (error + remainder) * (1 + 32 * EPS) + 32 * EPS * np.abs(polynomial).sum(0)
    slack = np.where(np.isfinite(slack), slack, np.inf)
    return low - slack, high + slack


def _coefficient_range(polynomial: Array) -> tuple[Array, Array]:
    """The least and the largest Bernstein coefficient of each polynomial (powers, …) on [−1, 1]."""
    columns = polynomial.reshape(len(polynomial), -1)
    low, high = np.empty((2, columns.shape[1]))
    for first in range(0, columns.shape[1], COLUMN_BATCH):
        some = slice(first, first + COLUMN_BATCH)
        control = _bernstein_matrix(len(columns)) @ columns[:, some]
        low[some], high[some] = control.min(0), control.max(0)
    return low.reshape(polynomial.shape[1:]), high.reshape(polynomial.shape[1:])
