"""Where a motion and its derivatives lie over cells of time, from series of the path: cheap, and near enough for most.

q(σ), a Taylor series with guaranteed error over a stretch of path, serves all cells of time in that stretch: with the
cubic σ(τ) put into it, q is a polynomial in τ ∈ [−1, 1]. Every product of these sums is carried twice more, with the
sizes of its factors, and with those enlarged by their errors: the one bounds rounding, and the difference of the two
what errors can change, since |∏(x + e) − ∏x| ≤ ∏(|x| + |e|) − ∏|x|; higher powers than are kept are part of it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinematics.analysis.clearance import Bodies
from kinematics.foundation.arrays import Array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.errors import MotionError
from kinematics.foundation.kernels import kernel
from kinematics.foundation.taylor_model import EPS, Series
from planner.certificate.enclosure import Cells
from planner.path.actuation import ActuatorPath, MachinePath
from planner.trajectory import MIN_PARTS, PER_RADIAN, Trajectory

# Order of the series along the path, and how many stretches of it there are to one of `unit_speed_trajectory`.
PATH_ORDER, STRETCHES = 8, 2
# Powers of τ that are kept beyond the highest derivative.
MORE_POWERS = 4
# Roundings of any one product in the sums below: fewer.
ROUNDINGS = 64 * EPS


@dataclass(frozen=True)
class Ranges:
    """The motion over N cells, each quantity a ball (1, N, m) about the middle of where it lies.

    piece (N,) of path; find: of the axes, or of the pose where True, the balls of value and derivatives
    """

    path: ActuatorPath
    piece: np.ndarray
    find: Callable[[bool], tuple[Series, ...]]

    @cached_property
    def _axes(self) -> tuple[Series, ...]:
        return self.find(False)

    @cached_property
    def _pose(self) -> tuple[Series, ...]:
        return self.find(True)

    def __getitem__(self, rows: np.ndarray) -> "Ranges":
        """Of some cells."""
        return Ranges(
            self.path, self.piece[rows], lambda pose: tuple(each[rows] for each in (self._pose if pose else self._axes))
        )

    def merge(self, first: np.ndarray) -> "Ranges":
        """Of groups of cells, one after the other, from the `first` of each."""
        return Ranges(
            self.path,
            self.piece[first],
            lambda pose: tuple(_merge_balls(each, first) for each in (self._pose if pose else self._axes)),
        )

    @property
    def q(self) -> Series:
        return self._axes[0]

    @property
    def qd(self) -> Series:
        return self._axes[1]

    @property
    def qdd(self) -> Series:
        return self._axes[2]

    @property
    def qddd(self) -> Series:
        return self._axes[3]

    def pose_rate(self, times: int) -> Series:
        return self._pose[times]

    def tool_rate(self, times: int) -> Series:
        rate, tool = self.pose_rate(times), self.path.tool
        return rate if tool is None else self.evaluate(tool, rate)

    def evaluate(self, expression: Expression, *inputs: Series) -> Series:
        return expression.enclose_columns(*inputs)

    def distances(self, bodies: Bodies) -> Series:
        raise MotionError("distances are bounded along the path, not over time")


@dataclass(frozen=True, slots=True)
class _Stretches:
    """Which of G stretches of path N cells lie in, and how they run through it.

    stretch (N,); middle and half (G,) of stretches, of path pieces on_piece (G,)
    motion (4, N) σ's coefficients in τ, and error (4, N) of them; rate (N,) 1/s, by which τ runs
    highest  derivative of the axes
    """

    path: ActuatorPath
    stretch: np.ndarray
    middle: Array
    half: Array
    on_piece: np.ndarray
    motion: Array
    error: Array
    rate: Array
    highest: int

    def __call__(self, pose: bool) -> tuple[Series, ...]:
        """A function of path and its derivatives by time."""
        count, highest = len(self.middle), 2 if pose else self.highest
        mid, rad = np.zeros((2, PATH_ORDER + 1, 2 * count))
        # s over the stretches: about their middles, then anywhere
        mid[0], mid[1] = np.tile(self.middle, 2), np.tile(self.half, 2)
        rad[0, count:] = self.half
        enclose = self.path.enclose_pose if pose else self.path.enclose
        found = enclose(Series(mid, rad, PATH_ORDER), np.tile(self.on_piece, 2))
        assert found is not None  # only machines have limits on their pose
        full = found.pad(PATH_ORDER)
        mid, rad = np.array(full.mid[:, :count]), np.array(full.rad[:, :count])
        mid[-1], rad[-1] = 0.0, np.abs(full.mid[-1, count:]) + full.rad[-1, count:]
        balls = np.empty((2, highest + 1, len(self.stretch), mid.shape[2]))
        bound_motion(mid, rad, self.stretch, self.motion, self.error, self.rate, balls[0], balls[1])
        return tuple(Series(balls[0, n : n + 1], balls[1, n : n + 1], 0) for n in range(highest + 1))


def _merge_balls(balls: Series, first: np.ndarray) -> Series:
    low, high = bound_balls(balls)
    low, high = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)
    middle, good = (low + high) / 2, np.isfinite(low) & np.isfinite(high)
    rad = (high - low) / 2 * (1 + 4 * EPS) + 4 * EPS * np.maximum(np.abs(low), np.abs(high))
    return Series(np.where(good, middle, 0.0)[None], np.where(good, rad, np.inf)[None], 0)


def bound_balls(values: Series) -> tuple[Array, Array]:
    """Bounds low and high (N, m) of what is computed from ranges."""
    mid, rad = values.mid[0], values.rad[0]
    rad = np.where(np.isfinite(mid) & np.isfinite(rad), rad * (1 + 4 * EPS) + 4 * EPS * np.abs(mid), np.inf)
    return mid - rad, mid + rad


def bound_ranges(trajectory: Trajectory, cells: Cells, highest: int) -> Ranges:
    """The motion and its derivatives up to the `highest` over cells of time."""
    k, path = cells.k, trajectory.path
    piece, middle = trajectory.piece[k], (cells.lo + cells.hi) / 2
    half = (cells.hi - cells.lo) / 2 * (1 + 2 * EPS) + 2 * EPS * np.abs(cells.hi)
    s, v, a, j = (each[k] for each in (trajectory.s, trajectory.v, trajectory.a, trajectory.j))

    def shift(s: Array, v: Array, a: Array, j: Array) -> Array:
        """Coefficients in τ of s(t)."""
        first, second = v + middle * (a + middle * j / 2), a / 2 + middle * j / 2
        about = [s + middle * (v + middle * (a / 2 + middle * j / 6)), first, second, j / 6]
        return np.stack([part * half**n for n, part in enumerate(about)])

    way, size = shift(s, v, a, j), shift(*map(np.abs, (s, v, a, j)))
    reach = np.abs(way[1:]).sum(0) + 32 * EPS * size.sum(0)
    # polynomials are known exactly over a whole piece
    least = MIN_PARTS if isinstance(path, MachinePath) else 1
    parts = STRETCHES * np.maximum(least, np.ceil(PER_RADIAN * path.turns))
    width = np.diff(path.breaks) / parts
    share = np.clip((way[0] - path.breaks[piece]) / width[piece], 0, parts[piece] - 1)
    key = np.concatenate([[0], np.cumsum(parts)[:-1]])[piece] + np.floor(np.nan_to_num(share))
    _, first, stretch = np.unique(key, return_index=True, return_inverse=True)
    low, high = np.full(len(first), np.inf), np.full(len(first), -np.inf)
    np.minimum.at(low, stretch, way[0] - reach)
    np.maximum.at(high, stretch, way[0] + reach)
    centre = (low + high) / 2
    wide = (high - low) / 2 * (1 + 64 * EPS) + 64 * EPS * np.maximum(np.abs(low), np.abs(high))
    way[0] -= centre[stretch]
    size[0] += np.abs(centre[stretch])
    motion, error = way / wide[stretch], 32 * EPS * size / wide[stretch]
    return Ranges(path, piece, _Stretches(path, stretch, centre, wide, piece[first], motion, error, 1 / half, highest))


@kernel
def bound_motion(
    mid: Array,
    rad: Array,
    stretch: np.ndarray,
    motion: Array,
    error: Array,
    rate: Array,
    out_mid: Array,
    out_rad: Array,
) -> None:
    """Balls out (highest + 1, N, m) of a function and its derivatives by time.

    mid, rad (D + 1, G, m)   its coefficients over G stretches of path; the last, times σ^D, is what remains
    stretch (N,), motion, error (4, N), rate (N,)  as in `_Stretches`
    """
    degree, width, most = len(mid) - 1, mid.shape[2], len(out_mid) - 1
    powers = min(most + MORE_POWERS, degree - 1)
    # columns innermost: they are what the processor's vectors hold
    p, size = np.zeros((degree, width)), np.zeros((degree, width))
    a, large = np.zeros((powers + 1, width)), np.zeros((powers + 1, width))
    e, whole, slack = np.zeros((powers + 6, width)), np.zeros((4, width)), np.zeros(width)
    for n in range(len(stretch)):
        g = stretch[n]
        s0, s1, s2, s3 = motion[0, n], motion[1, n], motion[2, n], motion[3, n]
        t0, t1, t2, t3 = abs(s0), abs(s1), abs(s2), abs(s3)
        w1, w2, w3 = t1 + error[1, n], t2 + error[2, n], t3 + error[3, n]
        # how far σ reaches, and its derivatives by τ at the most
        reach = (t0 + error[0, n] + w1 + w2 + w3) * (1 + ROUNDINGS)
        z1, z2, z3 = w1 + 2 * w2 + 3 * w3, 2 * w2 + 6 * w3, 6 * w3
        for i in range(degree):
            for c in range(width):
                p[i, c], size[i, c] = mid[i, g, c], abs(mid[i, g, c])
        # about where the cell's middle lies
        for i in range(powers + 1):
            for k in range(degree - 2, i - 1, -1):
                for c in range(width):
                    p[k, c] += s0 * p[k + 1, c]
                    size[k, c] += t0 * size[k + 1, c]
        # p(s1 τ + s2 τ² + s3 τ³), Horner's scheme from the highest coefficient of τ down, in place
        for c in range(width):
            a[0, c], large[0, c] = p[powers, c], size[powers, c]
        for k in range(1, powers + 1):
            for c in range(width):
                a[k, c] = large[k, c] = 0.0
        for i in range(powers - 1, -1, -1):
            for k in range(min(powers, 3 * (powers - i)), 2, -1):
                for c in range(width):
                    a[k, c] = s1 * a[k - 1, c] + s2 * a[k - 2, c] + s3 * a[k - 3, c]
                    large[k, c] = t1 * large[k - 1, c] + t2 * large[k - 2, c] + t3 * large[k - 3, c]
            for c in range(width):
                a[2, c] = s1 * a[1, c] + s2 * a[0, c]
                large[2, c] = t1 * large[1, c] + t2 * large[0, c]
                a[1, c] = s1 * a[0, c]
                large[1, c] = t1 * large[0, c]
                a[0, c] = p[i, c]
                large[0, c] = size[i, c]
        # the same of sizes and errors together, with its derivatives by σ, at the end
        for k in range(4):
            for c in range(width):
                whole[k, c] = 0.0
        for i in range(degree, -1, -1):
            for c in range(width):
                whole[3, c] = whole[3, c] * reach + 3 * whole[2, c]
                whole[2, c] = whole[2, c] * reach + 2 * whole[1, c]
                whole[1, c] = whole[1, c] * reach + whole[0, c]
                whole[0, c] = whole[0, c] * reach + (abs(mid[i, g, c]) + rad[i, g, c])
        scale = 1.0
        for m in range(most + 1):
            for c in range(width):
                if m == 0:
                    slack[c] = whole[0, c]
                elif m == 1:
                    slack[c] = whole[1, c] * z1
                elif m == 2:
                    slack[c] = whole[2, c] * z1 * z1 + whole[1, c] * z2
                else:
                    slack[c] = whole[3, c] * z1 * z1 * z1 + 3 * whole[2, c] * z1 * z2 + whole[1, c] * z3
                slack[c] *= 1 + ROUNDINGS
            for k in range(m, powers + 1):
                factor = 1.0
                for i in range(m):
                    factor *= k - i
                for c in range(width):
                    e[k - m, c] = factor * a[k, c]
                    slack[c] -= factor * large[k, c] * (1 - 2 * ROUNDINGS)
            for k in range(powers - m + 1, powers + 6):
                for c in range(width):
                    e[k, c] = 0.0
            for c in range(width):
                # but for a little of the cubic and the quartic, a polynomial of degree two: Chebyshev's
                slack[c] += abs(e[3, c]) / 4 + abs(e[4, c]) / 8
            for k in range(5, powers - m + 1):
                for c in range(width):
                    slack[c] += abs(e[k, c])
            for c in range(width):
                e0, e1, e2 = e[0, c] - e[4, c] / 8, e[1, c] + 0.75 * e[3, c], e[2, c] + e[4, c]
                low, high = e0 + e2 - abs(e1), e0 + e2 + abs(e1)
                if abs(e1) < 2 * abs(e2):
                    top = e0 - e1 * e1 / (4 * e2)
                    low, high = min(low, top), max(high, top)
                low, high = low * scale, high * scale
                beyond = slack[c] * scale * (1 + ROUNDINGS)
                own = (high - low) / 2 * (1 + 4 * EPS) + 16 * EPS * max(abs(low), abs(high)) + beyond
                good = reach <= 1 and np.isfinite(own) and np.isfinite(low) and np.isfinite(high)
                out_mid[m, n, c] = (low + high) / 2 if good else 0.0
                out_rad[m, n, c] = own if good else np.inf
            scale *= rate[n]
