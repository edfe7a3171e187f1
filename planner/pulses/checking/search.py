"""What the check of one axis has found so far, and how it asks its motion, sampled in pulses.

Between its pulses, too, an axis has to stay within its sides of the count.
"""

from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass, field, fields
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array
from planner.pulses.checking.rolling_motion import RollingMotion
from planner.pulses.checking.verdict import PulseFault
from planner.pulses.motion import AxesMotion, MotionState, SingleAxisMotion
from planner.pulses.schedule import AxisPulses, PulseSchedule, Signs, Ticks

# what rounding to a whole tick may take, and a thousandth for the arithmetic of both sides
HALF_TICK = 0.501
X_ROUNDING = 64 * np.finfo(float).eps


@dataclass(frozen=True, slots=True)
class Samples:
    """x and its three derivatives (pulses, s) at instants t (N,); the count from t on, and the way
    of the last pulse.

    way  +1 or -1, 0 before the first pulse
    """

    t: Array
    x: Array
    v: Array
    a: Array
    j: Array
    count: Array
    way: Array

    def __getitem__(self, which: slice | NDArray[Any]) -> "Samples":
        return Samples(*(getattr(self, part.name)[which] for part in fields(self)))

    def followed_by(self, other: "Samples") -> "Samples":
        return Samples(
            *(np.concatenate((getattr(self, p.name), getattr(other, p.name))) for p in fields(self))
        )

    def travel(self, time: float) -> Array:
        """(N,) pulses that x runs in so long (s)."""
        return np.asarray(abs(self.v) * time + abs(self.a) * time**2 / 2)


SLOPE_INSTANTS = 4097  # instants between which dx/ds is seen
PART_INSTANTS = 65  # of a part of a motion, at least
MIN_WAY_SHARE = 1e-9  # share of the path over which it is more than rounding
DRIFT_ROUNDING = 8 * np.finfo(float).eps  # of s·dx/ds
MAX_LISTED_FAULTS = 20  # faults of one kind listed per axis


class Standard(ABC):
    """What pulses are held to: how far x may be from the count, and when each is due."""

    __slots__ = ()

    @property
    def exact(self) -> bool:
        """Each pulse has its one right tick."""
        return True

    @property
    def wait(self) -> float:
        """Ticks that a pulse may wait for its own, while x runs on."""
        return 2 * HALF_TICK

    @property
    def begins(self) -> tuple[float, float]:
        """Pulses by which x may be below and above the count that it starts with: any, if not
        exact.
        """
        return (0.5, 0.5) if self.exact else (np.inf, np.inf)

    def sides(self, search: "Search", s: Samples) -> tuple[Array, Array]:
        """(N,) pulses by which x may be below and above the count from each instant on."""
        bound = np.full(len(s.t), search.axis.bound)
        return bound, bound

    @abstractmethod
    def judge(self, search: "Search", ticks: Ticks, sign: Array, s: Samples, first: int) -> None:
        """The next pulses (N,), sampled when they fire, the first of them the first-th of the axis;
        report faults.
        """

    def conclude(self, search: "Search") -> None:  # noqa: B027  most have told it by then
        """The motion has ended: report what is missing."""


@dataclass(slots=True)
class Search:
    """One axis of a schedule, its motion, and what has been found so far: pulses, the latest, the
    closest two (ticks).

    back, begun (ticks): the closest two of which the second goes back; the first pulse. interval:
    the last so far.

    grid (s): what is still to be looked at; count, way: after the pulses so far; last: the last
    sample (1,). drift: pulses, the largest s·dx/ds, as which rounding of s shows in x; found once.
    moved: pulses found where their drive's timing moved them to, at least and at most.
    """

    schedule: PulseSchedule
    k: int
    motion: AxesMotion
    grid: Array
    count: int
    standard: Standard
    way: int = 0
    pulses: int = 0
    seen: int = 0
    latest: int | None = None
    interval: float = np.inf
    closest: float = np.inf
    back: float = np.inf
    begun: float = np.inf
    last: Samples | None = None
    time_error: float = 0.0
    position_error: float = 0.0
    moved: tuple[int, int] = (0, 0)
    drift: float = 0.0
    kinds: Counter[str] = field(default_factory=Counter)
    faults: list[PulseFault] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not isinstance(self.motion, RollingMotion):
            self.note_drift(self.motion)

    def note_drift(self, motion: AxesMotion) -> None:
        """Look how rounding of s shows in x: on the motion, or on a part of it."""
        share = motion.duration / self.motion.duration if self.motion.duration > 0 else 1.0
        t = np.linspace(
            0.0, motion.duration, max(PART_INSTANTS, ceil(SLOPE_INSTANTS * min(share, 1.0)))
        )
        state, k = _ask(motion, t, self.k)
        way, change = abs(np.diff(state.s)), abs(np.diff(state.q[:, k])) / self.axis.pulse
        far = float(abs(state.s).max())
        seen = way > MIN_WAY_SHARE * far
        self.drift = max(self.drift, far * float((change[seen] / way[seen]).max(initial=0.0)))

    @property
    def axis(self) -> AxisPulses:
        return self.schedule.axes[self.k]

    @property
    def tick(self) -> float:
        return 1 / self.schedule.clock_hz

    @property
    def is_ordered(self) -> bool:
        """Without an order there is nothing to measure against the motion."""
        return not any(self.kinds[kind] for kind in ("order", "outside", "direction"))

    def sample(self, t: Array, count: Array, way: Array) -> Samples:
        state, k = _ask(self.motion, t, self.k)
        v, a, j = (values[:, k] / self.axis.pulse for values in (state.qd, state.qdd, state.qddd))
        return Samples(t, (state.q[:, k] - self.axis.home) / self.axis.pulse, v, a, j, count, way)

    def at(self, t: Array) -> Samples:
        """Samples of the motion alone."""
        return self.sample(t, np.zeros(len(t)), np.zeros(len(t)))

    def noise(self, s: Samples) -> Array:
        """(N,) pulses: what rounding may have done to x."""
        own = X_ROUNDING * (abs(s.x) + 2 * abs(self.axis.home) / self.axis.pulse + abs(s.v * s.t))
        return np.maximum(own, DRIFT_ROUNDING * self.drift)

    def excess(self, s: Samples) -> Array:
        """(N,) pulses by which x is farther from the count than its sides, waiting and rounding not
        allowed for.
        """
        below, above = self.standard.sides(self, s)
        return np.asarray(np.maximum(s.x - s.count - above, s.count - below - s.x))

    def report(self, kind: str, ticks: NDArray[Any], text: str, values: NDArray[Any]) -> None:
        """Note a fault of one kind at each of the ticks (N,); `text` takes the value (N,) there."""
        room = max(0, MAX_LISTED_FAULTS - self.kinds[kind])
        self.kinds[kind] += len(ticks)
        for tick, value in zip(ticks[:room], values[:room], strict=True):
            self.faults.append(
                PulseFault(self.axis.name, int(tick), f"{kind}: {text.format(value)}")
            )

    def due(self, ticks: Ticks, error: Array, tolerance: Array, near: NDArray[np.bool_]) -> None:
        """Report pulses further from where they are due (error, ticks) than a tolerance, but for
        those that were moved.

        near (N,): the motion is at the pulse's level within the largest shift that is stated.
        """
        error = np.where(np.isnan(error), np.inf, error)
        moves = [one for one in self.schedule.moves if one.axis == self.axis.name]
        stated = sum(one.pulses for one in moves)
        off = abs(error) > tolerance
        moved = off & near & (stated > 0)
        found, possible = self.moved
        self.moved = (
            found + int(moved.sum()),
            possible + int((abs(error) > tolerance - 0.002).sum()),
        )
        self.time_error = max(self.time_error, float(abs(error[~moved]).max(initial=0.0)))
        late = off & ~moved
        self.report("off its crossing", ticks[late], "{:+.4g} ticks", error[late])

    @property
    def shift(self) -> int:
        """Ticks by which the drive's timing moved a pulse at most."""
        times = [one.time for one in self.schedule.moves if one.axis == self.axis.name]
        return round(max(times, default=0.0) * self.schedule.clock_hz)

    @property
    def extra_bound(self) -> float:
        """Pulses by which that widened the bound."""
        return sum(one.error for one in self.schedule.moves if one.axis == self.axis.name)


def _ask(motion: AxesMotion, t: Array, axis: int) -> tuple[MotionState, int]:
    """What the motion says, and where in it the axis is."""
    return (
        (motion.axis_at(t, axis), 0)
        if isinstance(motion, SingleAxisMotion)
        else (motion.at(t), axis)
    )


def find_reversals(sign: Array | Signs, way: int) -> NDArray[np.bool_]:
    """(N,) the pulses that follow one the other way, or none."""
    return np.asarray(np.diff(sign, prepend=way) != 0)


def check_band(search: Search, s: Samples) -> None:
    """Each sample within the sides of its count."""
    beyond, wait = search.excess(s) - search.noise(s), search.standard.wait * search.tick
    told = beyond - s.travel(max(wait, search.tick))
    search.position_error = max(search.position_error, float(told.max(initial=0.0)))
    out = ~(beyond <= s.travel(wait))
    search.report(
        "far from its count",
        np.rint(s.t[out] / search.tick),
        "{:.6g} pulses",
        abs(s.x - s.count)[out],
    )


def check_between(search: Search, chain: Samples) -> None:
    """Halve the intervals between samples in which x might turn outside the band, and look
    there.
    """
    a, b = chain[:-1], chain[1:]
    while len(a.t):
        span = b.t - a.t
        steepest = np.maximum(abs(a.a), abs(b.a)) + span * np.maximum(abs(a.j), abs(b.j))
        bulge = steepest * span**2 / 8  # by how much x can pass both ends of the interval
        # up to b the count is that from a on
        seen = Samples(b.t, b.x, b.v, b.a, b.j, a.count, a.way)
        away = np.maximum(search.excess(a), search.excess(seen))
        stays = (away + bulge <= 0) | (bulge <= search.noise(a))
        monotone = np.maximum(abs(a.v), abs(b.v)) >= steepest * span
        unsure = ~(stays | monotone) & (span > search.tick) & np.isfinite(away)
        a, b = a[unsure], b[unsure]
        middle = search.sample((a.t + b.t) / 2, a.count, a.way)
        check_band(search, middle)
        a, b = a.followed_by(middle), middle.followed_by(b)
