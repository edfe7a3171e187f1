"""A motion along one run, and what solving the run came to: the values that solvers return.

What a solver leaves open is closed: the motion is on a grid, continuous to rounding. What it uses of every limit is
looked at closely: cheap, and no proof.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import reduce
from typing import Literal

import numpy as np

from kinematics.foundation.arrays import Array, largest_in_rows
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Limit, order_of
from planner.path.actuation import ActuatorPath
from planner.place import Infeasible
from planner.timing.problem import EXACT_AIM, SOLVER_AIM, Problem
from planner.trajectory import Trajectory

# How often the instant at which a profile comes by a break is enclosed more narrowly.
BISECTIONS_OF_INSTANT = 60
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

    def numbers(self) -> Array:
        """(6, M): all of them, in that order."""
        return np.stack([getattr(self, part.name) for part in fields(self)]).astype(float)

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

    @property
    def last_acceleration(self) -> float:
        """s̈ at its end."""
        return float(self.a[-1] + self.h[-1] * self.j[-1])

    def slowed(self, k: float) -> "Profile":
        """The same motion, k times as long: a quantity with sⁿ/tᵐ falls by kᵐ, so every limit on time falls."""
        return replace(self, v=self.v / k, a=self.a / k**2, j=self.j / k**3, h=self.h * k)

    def at(self, k: np.ndarray, tau: Array) -> tuple[Array, Array, Array, Array]:
        """s, ṡ, s̈, s⃛ at tau (N,) after the start of pieces k (N,)."""
        v, a, j = self.v[k], self.a[k], self.j[k]
        return self.s[k] + tau * (v + tau * (a / 2 + tau * j / 6)), v + tau * (a + tau * j / 2), a + tau * j, j

    def stretch(self, breaks: Array, first: int, duration: float) -> "Profile":
        """A profile of unit length and duration, stretched over path pieces `first` … between breaks, and cut there."""
        inner = (breaks[1:-1] - breaks[0]) / (breaks[-1] - breaks[0])
        k, low = self._find_passage(inner)
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
        by, when = self._find_passage(inner)
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
        k, tau = self._find_passage(s[1:-1])
        t = np.concatenate([[0.0], np.concatenate([[0.0], np.cumsum(self.h)])[k] + tau, [self.duration]])
        _, v, a, _ = self.at(np.append(0, k), np.append(0.0, tau))
        h = np.maximum(np.diff(t), MIN_DURATION_SHARE * self.duration / len(s))
        return np.stack([v, a, np.diff(a, append=0.0) / h, h])

    def _find_passage(self, s: Array) -> tuple[np.ndarray, Array]:
        """The pieces (K,) in which it comes by s (K,), and how long after their starts."""
        k = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, None)
        low, high = np.zeros(len(s)), self.h[k]
        for _ in range(BISECTIONS_OF_INSTANT):
            tau = (low + high) / 2
            early = self.at(k, tau)[0] < s
            low, high = np.where(early, tau, low), np.where(early, high, tau)
        return k, low

    def columns(self) -> Array:
        """(4, M) of ṡ, s̈, s⃛, h: a start for another solve on the same grid."""
        return np.stack([self.v, self.a, self.j, self.h])


class TooFast(MotionError):
    """A run's start or end speed ṡ for which the limits leave no room; largest: what can be; both: only
    beside a rest at the other end, whose speed is too high as well.

    Solvers return it; `planner.timing.run.solve_run`, which knows the path, says where that is.
    """

    def __init__(self, end: int, speed: float, largest: float, both: bool = False) -> None:
        self.end, self.speed, self.largest, self.both = end, speed, largest, both
        super().__init__(
            f"the {self.name} {speed:.6g} is beyond {largest:.6g}, the largest from which the run can be made"
        )

    @property
    def name(self) -> str:
        return ("start speed", "end speed")[self.end]


Status = Literal["solved", "too fast", "infeasible", "stopped"]
"""Solved; a speed at an end that cannot be; a limit that no motion keeps there; a solver without an answer."""
STRAIGHT, AVERAGED, BRIEF_RAMPS = "straight", "averaged", "brief ramps"
"""Makers of a motion other than solvers: a closed form, an averaged start, and the order-2 motion
with brief ramps of s̈."""
MADE_CONSTANT_SPEED, CRUISE = "constant speed", "cruise"
"""Makers of a motion at constant speed: one that the program asks for, and the capped tool speed."""
WITH_RESTS, IN_PARTS, FEED_LIMITED = "with rests", "in parts", "feed-limited"
"""Makers of a motion that is joined of several: with a rest between each two; constant speeds that
the program asks for and what lies between; cruises at the capped tool speed and their ramps."""
# Up to here slowness is told as what it is: the last touch of a motion, not its maker.
MAX_UNTOLD_SLOWNESS = 1 + 1e-4
TOLD_SLOWNESS = {MAX_UNTOLD_SLOWNESS: " by less than 0.01 %", 1 + 1e-3: " by less than 0.1 %"}
_NOTHING = np.zeros(0)
NO_MOTION = Profile(_NOTHING, _NOTHING, _NOTHING, _NOTHING, _NOTHING, np.zeros(0, int))


@dataclass(frozen=True, slots=True)
class RunSolution:
    """What solving a run, or a part of it, came to: a motion on its way to one that holds, or why there is none.

    bound     s, an estimate of the least time that the run can take; 0 from who has none
    maker     the solver that gave the motion, or what else did
    problem   that it answers, where it is solved for as the fastest or the smoothest
    seen      what it was seen to use of each limit that may bind, in each time piece, if its solver looked
    tries     how often it was solved. The peaks between grid points heed the room only in part: each try takes off more
    slowness  how many times as long as the answer the motion is, where it was slowed as a whole
    parts     of which it is joined, one after the other
    fallback  of a stated duration: the motion that holds whatever else does not
    refusal   why there is no motion: what `planner.timing.certified_solve` raises, if nothing else helps
    """

    status: Status
    profile: Profile
    bound: float = 0.0
    maker: str = ""
    problem: Problem | None = field(default=None, repr=False)
    seen: Mapping[str, Array] | None = field(default=None, repr=False)
    tries: int = 1
    slowness: float = 1.0
    parts: "tuple[RunSolution, ...]" = ()
    fallback: Profile | None = None
    refusal: MotionError | None = None

    @classmethod
    def refused(cls, refusal: MotionError) -> "RunSolution":
        """No motion, and why."""
        status: Status = "infeasible" if isinstance(refusal, Infeasible) else "stopped"
        return cls("too fast" if isinstance(refusal, TooFast) else status, NO_MOTION, refusal=refusal)

    @classmethod
    def joined(cls, parts: "Sequence[RunSolution]", maker: str) -> "RunSolution":
        """One after the other; of which one is refused, that refusal."""
        lost = next((part for part in parts if not part.solved), None)
        if lost is not None or len(parts) == 1:
            return parts[0] if lost is None else lost
        profile = Profile.joined([part.profile for part in parts])
        return cls("solved", profile, sum(part.bound for part in parts), maker, parts=tuple(parts))

    @property
    def solved(self) -> bool:
        return self.status == "solved"

    @property
    def duration(self) -> float:
        return self.profile.duration

    def require_profile(self) -> Profile:
        """The motion. Raises the refusal where there is none."""
        if self.refusal is not None:
            raise self.refusal
        return self.profile

    @property
    def method(self) -> str:
        """What gave the motion, whether it was slowed, and whether it rests where the path does not ask for it."""
        if self.maker == IN_PARTS:  # that of the first part which was solved for
            return next((part.method for part in self.parts if part.maker != MADE_CONSTANT_SPEED), MADE_CONSTANT_SPEED)
        if self.parts:
            return ", ".join([*dict.fromkeys(part.method for part in self.parts), self.maker])
        if self.slowness == 1:
            return self.maker
        less = next((words for most, words in TOLD_SLOWNESS.items() if self.slowness <= most), "")
        return f"{self.maker}, slowed{less}"

    @property
    def fastest(self) -> bool:
        """Whether it was solved for as the fastest motion of its run."""
        if self.parts:
            return self.maker in (WITH_RESTS, FEED_LIMITED)
        return self.problem is not None and self.fallback is None

    @property
    def has_end_speed(self) -> bool:
        """Whether it begins or ends at a speed: such a motion cannot be slowed."""
        return any(part.has_end_speed for part in self.parts) or (
            self.problem is not None and max(self.problem.speeds) > 0
        )

    def slowed(self, slowness: float) -> "RunSolution":
        """The same motion, so many times as long: of one from rest to rest."""
        parts = tuple(part.slowed(slowness) for part in self.parts)
        profile = self.profile.slowed(slowness)
        return replace(self, profile=profile, seen=None, slowness=self.slowness * slowness, parts=parts)

    def bare(self) -> "RunSolution":
        """The motion and what is told of it, without what it could be solved again from."""
        return replace(self, maker=self.method, slowness=1.0, problem=None, seen=None, parts=(), fallback=None)

    def aimed(self, use: Mapping[str, Array]) -> dict[str, Array]:
        """Shares of the limits as shares of what it aims at; of all of them where it begins or ends at a speed.

        Such a speed is given, and may be one of a motion that was found in closed form.
        """
        aims = np.full(len(self.profile.h), EXACT_AIM if self.maker in (STRAIGHT, CRUISE) else SOLVER_AIM)
        if self.has_end_speed:
            aims[[0, -1]] = EXACT_AIM
        return {name: values / aims for name, values in use.items()}


# Newton steps: the first leaves the square of a solver's 1e-8 or so, the others its own rounding.
NEWTON_STEPS = 4
# Share of the largest ṡ by which it may fall below zero inside an interval: rounding.
MAX_BACKWARD_SHARE = 1e-10


def close_profile(problem: Problem, columns: Array) -> Profile | MotionError:
    """The motion nearest to `columns` (4, N) of ṡ, s̈, s⃛, h that is continuous, on the problem's grid, between its ends.

    Each interval must end where the next one starts, in s, ṡ and s̈: 3N equations in 4N − 2 unknowns, or one equation
    less and one unknown more where an end is free. Newton steps of least length, every unknown counted in its own size,
    solve them. They stay local: integrated from the start instead, an error of rounding in s̈ would grow with the square
    of time. Where no such motion is near, or where it backs up: why not.
    """
    s, columns = problem.s, columns.copy()
    start, end = problem.ends
    first, last = start.jerk_limited_speed, end.jerk_limited_speed
    free = problem.free_accelerations
    columns[0, 0] = first
    if not free[0]:
        columns[1, 0] = start.acceleration
    step, h = np.diff(s), columns[3]
    most = np.abs(columns).max(1)
    size = np.stack([step / h, np.minimum(step / h**2, most[1]), np.minimum(step / h**3, most[2]), h.copy()])
    for _ in range(NEWTON_STEPS):
        v, a, j, h = columns
        ends = np.stack([h * (v + h * (a / 2 + h * j / 6)), v + h * (a + h * j / 2), a + h * j])
        miss = ends - np.stack([step, np.append(v[1:], last), np.append(a[1:], end.acceleration)])
        if free[1]:
            miss[2, -1] = 0.0
        change = _smallest_change(columns, ends, miss, step, size, free)
        if isinstance(change, MotionError):
            return change
        columns = columns + size * change
    if not (np.isfinite(columns).all() and (columns[3] > 0).all()):
        return MotionError("the motion that the solver found cannot be made continuous")
    v, a, j, h = columns
    with np.errstate(divide="ignore", invalid="ignore"):
        turning = np.where((j > 0) & (a < 0) & (-a < j * h), v - a**2 / (2 * j), 0.0)
    if turning.min() < -MAX_BACKWARD_SHARE * v.max():
        return MotionError("the motion that the solver found backs up between two grid points")
    return Profile(s[:-1], v, a, j, h, problem.piece)


def _smallest_change(
    columns: Array, ends: Array, miss: Array, step: Array, size: Array, free: tuple[bool, bool]
) -> Array | MotionError:
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
        return MotionError(f"the motion that the solver found cannot be made continuous: {failure}")
    change = (own.mT @ weights[:, :, None])[:, :, 0]
    change[1:] += (following[:-1].mT @ weights[:-1, :, None])[:, :, 0]
    return np.asarray(change.T)


# Instants of each time piece that are looked at: a parabola through each three of them tells its own peak exactly, and
# so misses what a piece's fourth derivative adds, 1/PIECE_INSTANTS⁴ and less of it. Without jerk, pieces are more and
# shorter.
PIECE_INSTANTS, NO_JERK_INSTANTS = 5, 3
# What uses less of a limit is not looked at again while a run is solved: its proof looks at every limit.
MIN_WATCHED_USE = 0.5
# Time pieces that are looked at at a time: what is held of them stays small, however long a run is.
PIECES_AT_ONCE = 2000


Looked = tuple[Profile, Mapping[str, Array]]
"""A motion, and what it was seen to use of limits in each time piece."""


def sample_limit_use(
    path: ActuatorPath, limits: Sequence[Limit], profile: Profile, looked: Looked | None = None
) -> dict[str, Array]:
    """The largest share (M,) of each limit on time that is met in each time piece; looked: the last, if any.

    Pieces that are as they were then are not looked at again.
    """
    motion, pieces, every = profile.along(path), len(profile.h), [limit for limit in limits if not limit.geometric]
    share = np.linspace(0.0, 1.0, PIECE_INSTANTS if profile.j.any() else NO_JERK_INSTANTS)
    if looked is None or not _are_alike(looked, profile, every):
        found, rest = {limit.name: np.empty(pieces) for limit in every}, np.arange(pieces)
    else:
        found = {limit.name: np.array(looked[1][limit.name]) for limit in every}
        rest = np.flatnonzero(np.any([getattr(profile, name) != getattr(looked[0], name) for name in "svah"], axis=0))
    for first in range(0, len(rest), PIECES_AT_ONCE):
        own = rest[first : first + PIECES_AT_ONCE]
        tau = (profile.h[own, None] * share).ravel()
        state = motion.within(np.repeat(own, len(share)), tau, jerk=order_of(limits) == 3)
        for limit in every:
            low, high = _parabola_ranges(limit.value(state).reshape(len(own), len(share), -1))
            found[limit.name][own] = largest_in_rows(limit.use(low, high, profile.piece[own]))
    return found


def _are_alike(looked: Looked, profile: Profile, limits: Sequence[Limit]) -> bool:
    """Whether a motion has the same pieces of path as one that was looked at, both without jerk, for these limits."""
    before, use = looked
    same = np.array_equal(before.piece, profile.piece) and not (before.j.any() or profile.j.any())
    return same and all(limit.name in use for limit in limits)


def _parabola_ranges(values: Array) -> tuple[Array, Array]:
    """The least and the largest (M, m) of (M, 2n + 1, m) values: of parabolas through each three of them."""
    first, middle, last = values[:, :-2:2], values[:, 1::2], values[:, 2::2]
    bend = first - 2 * middle + last
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (first - last) / (2 * bend)  # of the peak from the middle, in steps
        peak = np.where(np.abs(at) < 1, middle - bend * at**2 / 2, middle)
    met = [*np.moveaxis(values, 1, 0), *np.moveaxis(peak, 1, 0)]
    return reduce(np.minimum, met), reduce(np.maximum, met)
