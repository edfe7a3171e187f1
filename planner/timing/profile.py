"""A motion along one run: pieces of constant s⃛, and how a solver's answer becomes continuous."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.kernels import Floats1, Floats2, kernel
from planner.path.actuation import ActuatorPath
from planner.timing.problem import Problem
from planner.trajectory import Trajectory

# Bisections for the instant at which a motion passes a path length: down to rounding.
BISECTIONS_OF_INSTANT = 60
# Least duration of an interval as a share of an even one's. Rounding may leave nothing of an
# interval, and a duration of 0 would divide by zero.
MIN_DURATION_SHARE = 1e-6
# Newton steps that make a motion continuous: each leaves about the square of the residual before
# it, a solver's 1e-8 at first. None follows where the residual, relative to each unknown, is
# rounding.
NEWTON_STEPS, ROUNDING = 4, 1e-14
# ṡ may fall below zero inside an interval by this share of the largest ṡ: rounding.
MAX_BACKWARD_SHARE = 1e-10


@dataclass(frozen=True, slots=True)
class Profile:
    """Motion s(t) of M pieces of constant s⃛.

    s, v, a  (M,) s, ṡ, s̈ at the start of each piece
    j        (M,) s⃛
    h        (M,) durations
    piece    (M,) piece of the path
    """

    s: Array
    v: Array
    a: Array
    j: Array
    h: Array
    piece: np.ndarray

    @classmethod
    def joined(cls, profiles: "Sequence[Profile]") -> "Profile":
        """Return several motions one after the other."""
        columns = ([getattr(each, part.name) for each in profiles] for part in fields(cls))
        return cls(*map(np.concatenate, columns))

    def numbers(self) -> Array:
        """Return (6, M): all fields in their order."""
        return np.stack([getattr(self, part.name) for part in fields(self)]).astype(float)

    def columns(self) -> Array:
        """Return (4, M) of ṡ, s̈, s⃛, h: the unknowns of an order-3 problem on the same grid."""
        return np.stack([self.v, self.a, self.j, self.h])

    def along(self, path: ActuatorPath) -> Trajectory:
        """Return the motion as a trajectory along its path, from t = 0."""
        knots = np.concatenate([[0.0], np.cumsum(self.h)])
        return Trajectory(path, knots, self.s, self.v, self.a, self.j, self.piece)

    @property
    def duration(self) -> float:
        """Duration in s."""
        return float(self.h.sum())

    @property
    def last_speed(self) -> float:
        """ṡ at the end."""
        h = self.h[-1]
        return float(self.v[-1] + h * (self.a[-1] + h * self.j[-1] / 2))

    @property
    def last_acceleration(self) -> float:
        """s̈ at the end."""
        return float(self.a[-1] + self.h[-1] * self.j[-1])

    def slowed(self, k: float) -> "Profile":
        """Return the motion that takes k times as long: dᵐs/dtᵐ falls by kᵐ."""
        return replace(self, v=self.v / k, a=self.a / k**2, j=self.j / k**3, h=self.h * k)

    def at(self, k: np.ndarray, tau: Array) -> tuple[Array, Array, Array, Array]:
        """Return s, ṡ, s̈, s⃛ at times tau (N,) after the starts of pieces k (N,)."""
        v = self.v[k]
        a = self.a[k]
        j = self.j[k]
        s = self.s[k] + tau * (v + tau * (a / 2 + tau * j / 6))
        return s, v + tau * (a + tau * j / 2), a + tau * j, j

    def stretch(self, breaks: Array, first: int, duration: float) -> "Profile":
        """Stretch a motion of unit length and duration over path pieces `first` …, cut at
        breaks.
        """
        length = breaks[-1] - breaks[0]
        unit_breaks = (breaks - breaks[0]) / length
        cut = self.cut(unit_breaks, first)
        return Profile(
            breaks[0] + length * cut.s,
            cut.v * length / duration,
            cut.a * length / duration**2,
            cut.j * length / duration**3,
            cut.h * duration,
            cut.piece,
        )

    def cut(self, breaks: Array, first: int) -> "Profile":
        """Cut the motion at the inner breaks (P+1,) of path pieces `first` …."""
        inner = breaks[1:-1]
        passed, instants = self._find_passage(inner)
        owner = np.append(np.arange(len(self.h)), passed)
        tau = np.append(np.zeros(len(self.h)), instants)
        order = np.lexsort((tau, owner))
        owner = owner[order]
        tau = tau[order]
        s, v, a, j = self.at(owner, tau)
        last_of_owner = np.append(np.diff(owner) > 0, True)
        h = np.where(last_of_owner, self.h[owner], np.append(tau[1:], 0.0)) - tau
        middle = s + h * (v / 2 + h * (a / 8 + h * j / 48))
        piece = first + np.searchsorted(inner, middle, side="right")
        lasting = h > 0
        return Profile(
            s[lasting],
            v[lasting],
            a[lasting],
            j[lasting],
            h[lasting],
            piece[lasting],
        )

    def on(self, s: Array) -> Array:
        """Return (4, N) of ṡ, s̈, s⃛, h on a grid s (N+1,) over the same way.

        s⃛ is the average over each interval; in the last one it ends with s̈ = 0.
        """
        k, tau = self._find_passage(s[1:-1])
        begin = np.concatenate([[0.0], np.cumsum(self.h)])
        t = np.concatenate([[0.0], begin[k] + tau, [self.duration]])
        _, v, a, _ = self.at(np.append(0, k), np.append(0.0, tau))
        h = np.maximum(np.diff(t), MIN_DURATION_SHARE * self.duration / len(s))
        return np.stack([v, a, np.diff(a, append=0.0) / h, h])

    def _find_passage(self, s: Array) -> tuple[np.ndarray, Array]:
        """Return the pieces (K,) in which the motion passes s (K,), and when after their starts."""
        k = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, None)
        return k, find_instants(np.stack([self.s[k], *self.columns()[:, k]]), s)


@kernel
def find_instants(pieces: Floats2, wanted: Floats1) -> Array:
    """Return when (K,) pieces, each s, ṡ, s̈, s⃛ and h of (5, K), pass the wanted s (K,)."""
    instants = np.empty(len(wanted))
    for k in range(len(wanted)):
        s, v, a, j, h = pieces[:, k]
        low = 0.0
        high = h
        for _ in range(BISECTIONS_OF_INSTANT):
            tau = (low + high) / 2
            if s + tau * (v + tau * (a / 2 + tau * j / 6)) < wanted[k]:
                low = tau
            else:
                high = tau
        instants[k] = low
    return instants


def close_profile(problem: Problem, columns: Array) -> Profile | MotionError:
    """Return the continuous motion nearest to a solver's ṡ, s̈, s⃛, h, (4, N), on its grid.

    Each interval must end where the next one starts, in s, ṡ and s̈: 3N equations in 4N − 2
    unknowns; a free s̈ at an end is one unknown more or one equation less. Newton steps of least
    length, each unknown counted in its own size, solve them and stay local. Integrating from the
    start instead would let a rounding error in s̈ grow with the square of time.

    Returns MotionError where no such motion is near, or where it would back up.
    """
    s = problem.s
    start, end = problem.ends
    first = start.jerk_limited_speed
    last = end.jerk_limited_speed
    columns = columns.copy()
    columns[0, 0] = first
    if not start.free_acceleration:
        columns[1, 0] = start.acceleration
    step = np.diff(s)
    h = columns[3]
    most = np.abs(columns).max(1)
    size = np.stack(
        [
            step / h,
            np.minimum(step / h**2, most[1]),
            np.minimum(step / h**3, most[2]),
            h.copy(),
        ]
    )
    unit = np.stack([step, size[0], size[1]])
    for _ in range(NEWTON_STEPS):
        v, a, j, h = columns
        ends = np.stack([h * (v + h * (a / 2 + h * j / 6)), v + h * (a + h * j / 2), a + h * j])
        starts = np.stack([step, np.append(v[1:], last), np.append(a[1:], end.acceleration)])
        residual = (ends - starts) / unit
        if end.free_acceleration:
            residual[2, -1] = 0.0
        if np.abs(residual).max() <= ROUNDING:
            break
        change = _smallest_change(problem, columns, ends, residual, size)
        if isinstance(change, MotionError):
            return change
        columns = columns + size * change
    if not (np.isfinite(columns).all() and (columns[3] > 0).all()):
        return MotionError("the motion that the solver found cannot be made continuous")
    v, a, j, h = columns
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = (j > 0) & (a < 0) & (-a < j * h)
        least = np.where(turns, v - a**2 / (2 * j), 0.0)
    if least.min() < -MAX_BACKWARD_SHARE * v.max():
        return MotionError("the motion that the solver found backs up between two grid points")
    return Profile(s[:-1], v, a, j, h, problem.piece)


def _smallest_change(
    problem: Problem,
    columns: Array,
    ends: Array,
    residual: Array,
    size: Array,
) -> Array | MotionError:
    """Return the shortest change (4, N), in units of `size`, that removes the residual (3, N).

    residual  of s, ṡ and s̈, in units of the step and of their `size`

    −Gᵀ (G Gᵀ)⁻¹ r, where G holds the derivatives of an interval's equations by its own columns
    and by those of the next interval. G Gᵀ is banded: each interval meets only its neighbours.
    """
    from scipy.linalg import LinAlgError, solve_banded

    start, end = problem.ends
    count = problem.intervals
    _, _, j, h = columns
    one = np.ones(count)
    zero = np.zeros(count)
    unit = np.stack([np.diff(problem.s), size[0], size[1]])
    jacobian = np.array(
        [
            [h, h**2 / 2, h**3 / 6, ends[1]],
            [one, h, h**2 / 2, ends[2]],
            [zero, one, h, j],
        ]
    )
    jacobian = np.moveaxis(jacobian * size / unit[:, None], 2, 0)
    jacobian[0, :, 0] = 0.0  # the first ṡ is given
    if not start.free_acceleration:
        jacobian[0, :, 1] = 0.0
    if end.free_acceleration:
        jacobian[-1, 2] = 0.0
    following = np.zeros((count, 3, 4))
    following[:-1, 1, 0] = -size[0, 1:] / size[0, :-1]
    following[:-1, 2, 1] = -size[1, 1:] / size[1, :-1]
    diagonal = jacobian @ jacobian.mT + following @ following.mT
    if end.free_acceleration:
        diagonal[-1, 2, 2] = 1.0
    upper = following[:-1] @ jacobian[1:].mT
    band = np.zeros((11, 3 * count))
    for p in range(3):
        for q in range(3):
            band[5 + p - q, q::3] = diagonal[:, p, q]
            band[2 + p - q, 3 + q :: 3] = upper[:, p, q]
            band[8 + q - p, p : 3 * count - 3 : 3] = upper[:, p, q]
    right = -residual.T.ravel()
    try:
        weights = solve_banded((5, 5), band, right, check_finite=False).reshape(count, 3)
    except LinAlgError as failure:
        return MotionError(f"the motion that the solver found cannot be made continuous: {failure}")
    change = (jacobian.mT @ weights[:, :, None])[:, :, 0]
    change[1:] += (following[:-1].mT @ weights[:-1, :, None])[:, :, 0]
    return np.asarray(change.T)
