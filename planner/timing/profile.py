"""A motion along one run, as the solvers return it.

What a solver leaves open, closed: a motion on a grid, continuous to rounding.

What a profile uses of every limit, looked at closely: cheap, and no proof.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.actuation import ActuatorPath
from planner.limits.limit import Limit, order_of
from planner.timing.problem import Problem
from planner.trajectory import Trajectory

# How often the instant at which a profile comes by a break is enclosed more narrowly.
HALVINGS = 60
# Least duration of an interval, as a share of an even one's: of one that rounding leaves nothing of.
MIN_DURATION_SHARE = 1e-6


@dataclass(frozen=True, slots=True)
class Profile:
    """Pieces of constant s⃛: s, ṡ, s̈ at each start, s⃛, duration h, all (M,), and the path piece of each."""

    s: Array
    v: Array
    a: Array
    j: Array
    h: Array
    piece: np.ndarray

    @classmethod
    def joined(cls, profiles: "Sequence[Profile]") -> "Profile":
        """One after the other."""
        return cls(*(np.concatenate([getattr(one, part.name) for one in profiles]) for part in fields(cls)))

    def along(self, path: ActuatorPath) -> Trajectory:
        knots = np.concatenate([[0.0], np.cumsum(self.h)])
        return Trajectory(path, knots, self.s, self.v, self.a, self.j, self.piece)

    @property
    def duration(self) -> float:
        return float(self.h.sum())

    @property
    def last_speed(self) -> float:
        """ṡ at its end."""
        return float(self.v[-1] + self.h[-1] * (self.a[-1] + self.h[-1] * self.j[-1] / 2))

    def slowed(self, k: float) -> "Profile":
        """The same motion, k times as long: a quantity with sⁿ/tᵐ falls by kᵐ, so every limit on time falls."""
        return replace(self, v=self.v / k, a=self.a / k**2, j=self.j / k**3, h=self.h * k)

    def at(self, k: np.ndarray, tau: Array) -> tuple[Array, Array, Array, Array]:
        """s, ṡ, s̈, s⃛ at tau (N,) after the start of pieces k (N,)."""
        v, a, j = self.v[k], self.a[k], self.j[k]
        return self.s[k] + tau * (v + tau * (a / 2 + tau * j / 6)), v + tau * (a + tau * j / 2), a + tau * j, j

    def over(self, breaks: Array, first: int, duration: float) -> "Profile":
        """A profile of unit length and duration, stretched over path pieces `first` … between breaks, and cut there."""
        inner = (breaks[1:-1] - breaks[0]) / (breaks[-1] - breaks[0])
        k, low = self._passing(inner)
        begin = np.concatenate([[0.0], np.cumsum(self.h)])[:-1]
        starts = np.concatenate([begin, begin[k] + low])
        order = np.argsort(starts, kind="stable")
        owner, tau = np.concatenate([np.arange(len(self.h)), k])[order], np.concatenate([0 * begin, low])[order]
        h = np.diff(np.append(starts[order], self.duration))
        _, v, a, j = self.at(owner, tau)
        s = np.concatenate([self.s, inner])[order]
        length = breaks[-1] - breaks[0]
        piece = first + np.searchsorted(inner, s, side="right")
        v, a, j = v * length / duration, a * length / duration**2, j * length / duration**3
        return Profile(breaks[0] + length * s, v, a, j, h * duration, piece)

    def cut(self, breaks: Array, first: int) -> "Profile":
        """Cut where it comes by the inner breaks (P+1,) of path pieces `first` …, each part on its own piece."""
        inner = breaks[1:-1]
        by, when = self._passing(inner)
        owner, tau = np.append(np.arange(len(self.h)), by), np.append(np.zeros(len(self.h)), when)
        order = np.lexsort((tau, owner))
        owner, tau = owner[order], tau[order]
        s, v, a, j = self.at(owner, tau)
        last = np.append(np.diff(owner) > 0, True)
        h = np.where(last, self.h[owner], np.append(tau[1:], 0.0)) - tau
        piece = first + np.searchsorted(inner, s + h * (v / 2 + h * (a / 8 + h * j / 48)), side="right")
        kept = h > 0
        return Profile(s[kept], v[kept], a[kept], j[kept], h[kept], piece[kept])

    def on(self, s: Array) -> Array:
        """(4, N) of ṡ, s̈, s⃛, h on a grid s (N+1,) over the same way, s⃛ averaged over each interval."""
        k, tau = self._passing(s[1:-1])
        t = np.concatenate([[0.0], np.concatenate([[0.0], np.cumsum(self.h)])[k] + tau, [self.duration]])
        _, v, a, _ = self.at(np.append(0, k), np.append(0.0, tau))
        h = np.maximum(np.diff(t), MIN_DURATION_SHARE * self.duration / len(s))
        return np.stack([v, a, np.diff(a, append=0.0) / h, h])

    def _passing(self, s: Array) -> tuple[np.ndarray, Array]:
        """The pieces (K,) in which it comes by s (K,), and how long after their starts."""
        k = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, None)
        low, high = np.zeros(len(s)), self.h[k]
        for _ in range(HALVINGS):
            tau = (low + high) / 2
            early = self.at(k, tau)[0] < s
            low, high = np.where(early, tau, low), np.where(early, high, tau)
        return k, low

    def columns(self) -> Array:
        """(4, M) of ṡ, s̈, s⃛, h: a start for another solve on the same grid."""
        return np.stack([self.v, self.a, self.j, self.h])


# Newton steps: the first leaves the square of a solver's 1e-8 or so, the others its own rounding.
NEWTON_STEPS = 4
# Share of the largest ṡ by which it may fall below zero inside an interval: rounding.
MAX_BACKWARD_SHARE = 1e-10


def close_profile(problem: Problem, columns: Array) -> Profile:
    """The motion nearest to `columns` (4, N) of ṡ, s̈, s⃛, h that is continuous, on the problem's grid, between its ends.

    Each interval must end where the next one starts, in s, ṡ and s̈: 3N equations in 4N − 2 unknowns, or one equation
    less and one unknown more where an end is free. Newton steps of least length, every unknown counted in its own size,
    solve them. They stay local: integrated from the start instead, an error of rounding in s̈ would grow with the square
    of time. Raises MotionError where no such motion is near, or where it backs up.
    """
    s, columns = problem.s, columns.copy()
    columns[0, 0] = problem.speeds[0]
    if not problem.free[0]:
        columns[1, 0] = 0.0
    step, h = np.diff(s), columns[3]
    most = np.abs(columns).max(1)
    size = np.stack([step / h, np.minimum(step / h**2, most[1]), np.minimum(step / h**3, most[2]), h.copy()])
    for _ in range(NEWTON_STEPS):
        v, a, j, h = columns
        ends = np.stack([h * (v + h * (a / 2 + h * j / 6)), v + h * (a + h * j / 2), a + h * j])
        miss = ends - np.stack([step, np.append(v[1:], problem.speeds[1]), np.append(a[1:], 0.0)])
        if problem.free[1]:
            miss[2, -1] = 0.0
        columns = columns + size * _smallest_change(columns, ends, miss, step, size, problem.free)
    if not (np.isfinite(columns).all() and (columns[3] > 0).all()):
        raise MotionError("the motion that the solver found cannot be made continuous")
    v, a, j, h = columns
    with np.errstate(divide="ignore", invalid="ignore"):
        turning = np.where((j > 0) & (a < 0) & (-a < j * h), v - a**2 / (2 * j), 0.0)
    if turning.min() < -MAX_BACKWARD_SHARE * v.max():
        raise MotionError("the motion that the solver found backs up between two grid points")
    return Profile(s[:-1], v, a, j, h, problem.piece)


def _smallest_change(
    columns: Array, ends: Array, miss: Array, step: Array, size: Array, free: tuple[bool, bool]
) -> Array:
    """The shortest change (4, N), counted in `size`, that takes the miss (3, N) off to first order.

    −Gᵀ (G Gᵀ)⁻¹ miss, where G holds what an interval's own columns do to its equations, and the next one's.
    """
    from scipy.linalg import LinAlgError, solve_banded

    (_, _, j, h), n, (one, none) = columns, len(step), (np.ones_like(step), np.zeros_like(step))
    rows = np.stack([step, size[0], size[1]])
    own = np.array([[h, h**2 / 2, h**3 / 6, ends[1]], [one, h, h**2 / 2, ends[2]], [none, one, h, j]])
    own = np.moveaxis(own * size / rows[:, None], 2, 0)
    own[0, :, : 1 if free[0] else 2] = 0.0  # the first ṡ is given, and s̈ where it is not free
    if free[1]:
        own[-1, 2] = 0.0  # nothing is asked of the last s̈
    following = np.zeros((n, 3, 4))  # interval i's equations by the columns of i + 1
    following[:-1, 1, 0], following[:-1, 2, 1] = -size[0, 1:] / size[0, :-1], -size[1, 1:] / size[1, :-1]
    diagonal = own @ own.mT + following @ following.mT
    if free[1]:
        diagonal[-1, 2, 2] = 1.0
    beside = following[:-1] @ own[1:].mT
    band = np.zeros((11, 3 * n))
    for p in range(3):
        for q in range(3):
            band[5 + p - q, q::3] = diagonal[:, p, q]
            band[2 + p - q, 3 + q :: 3] = beside[:, p, q]
            band[8 + q - p, p : 3 * n - 3 : 3] = beside[:, p, q]
    try:
        weights = solve_banded((5, 5), band, -(miss / rows).T.ravel(), check_finite=False).reshape(n, 3)
    except LinAlgError as failure:
        raise MotionError(f"the motion that the solver found cannot be made continuous: {failure}") from failure
    change = (own.mT @ weights[:, :, None])[:, :, 0]
    change[1:] += (following[:-1].mT @ weights[:-1, :, None])[:, :, 0]
    return np.asarray(change.T)


# Instants of each time piece that are looked at: a parabola through each three of them tells its own peak exactly, and
# so misses what a piece's fourth derivative adds, 1/LOOKED⁴ and less of it. Without jerk, pieces are more and shorter.
PIECE_INSTANTS, NO_JERK_INSTANTS = 9, 3


def sample_limit_use(path: ActuatorPath, limits: Sequence[Limit], profile: Profile) -> dict[str, Array]:
    """The largest share (M,) of each limit on time that is met in each time piece."""
    motion, pieces = profile.along(path), len(profile.h)
    share = np.linspace(0.0, 1.0, PIECE_INSTANTS if profile.j.any() else NO_JERK_INSTANTS)
    state = motion.within(
        np.repeat(np.arange(pieces), len(share)), (profile.h[:, None] * share).ravel(), jerk=order_of(limits) == 3
    )
    found = {}
    for limit in limits:
        if not limit.geometric:
            low, high = _parabola_ranges(limit.value(state).reshape(pieces, len(share), -1))
            found[limit.name] = limit.use(low, high, profile.piece).max(1)
    return found


def _parabola_ranges(values: Array) -> tuple[Array, Array]:
    """The least and the largest (M, m) of (M, 2n + 1, m) values: of parabolas through each three of them."""
    first, middle, last = values[:, :-2:2], values[:, 1::2], values[:, 2::2]
    bend = first - 2 * middle + last
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (first - last) / (2 * bend)  # of the peak from the middle, in steps
        peak = np.where(np.abs(at) < 1, middle - bend * at**2 / 2, middle)
    return np.minimum(values.min(1), peak.min(1)), np.maximum(values.max(1), peak.max(1))
