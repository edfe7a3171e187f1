"""The independent check of a pulse schedule against the motion it stands for. It shares no code with the generator."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.array import Array
from kinematics.axis import Axis
from kinematics.errors import MotionError
from planner.pulses.motion import AxisMotion, Motion
from planner.pulses.schedule import AxisPulses, PulseSchedule, Signs, Ticks
from planner.pulses.verdict import AxisCheck, PulseCheck, PulseFault

HALF_TICK = 0.501  # what rounding to a whole tick may take, and a thousandth for the arithmetic of both sides
ROUNDING = 64 * np.finfo(float).eps
BLOCK = 1 << 15  # pulses gone through together
GRID = 8  # instants per knot interval besides the pulses' own
LISTED = 20  # faults of one kind listed per axis


def check(
    schedule: PulseSchedule,
    trajectory: Motion,
    machine_axes: Sequence[Axis] | None = None,
    home_q: ArrayLike | None = None,
) -> PulseCheck:
    """Prove that every axis keeps to what its schedule states of it, and that it is of this motion.

    With x = (q - home)/pulse:
    - Under the rule "nearest" with its bound of ½, at each pulse x is at the level between the counts before and after
      it, to half a tick, going the pulse's way; and between pulses |count - x| ≤ ½ + half a tick's travel.
    - Under any other rule or bound, |count - x| ≤ bound + one tick's travel before, between and after the pulses.
    - Between the samples too: an interval δ is halved until x is monotone in it, or max|count - x| + max|ẍ| δ²/8 is
      within the bound, with the motion's jerk taken to be largest at the ends of intervals (an eighth of a knot
      interval, or less).
    - The ticks rise; the start and final counts are the motion's, and so is the duration.
    - Names, pulses and homes are the machine's, where machine_axes and home_q (n,) are given.
    Positions are trusted to 64 roundings of q, of home and of q̇·t. The motion is asked about once per pulse, in blocks.
    Raises MotionError where the motion has another number of axes.
    """
    return check_parts(schedule, [schedule], trajectory, machine_axes, home_q)


def check_parts(
    stated: PulseSchedule,
    parts: Iterable[PulseSchedule],
    trajectory: Motion,
    machine_axes: Sequence[Axis] | None = None,
    home_q: ArrayLike | None = None,
) -> PulseCheck:
    """The same of parts that follow each other in time, in memory for one: `stated` says all but their pulses."""
    width = trajectory.at(np.zeros(1)).q.shape[1]
    if width != len(stated.axes):
        raise MotionError(f"the schedule has {len(stated.axes)} axes, the motion {width}; check it against its own")
    grid = _grid(trajectory)
    searches = [_Search(stated, k, trajectory, grid, stated.axes[k].start) for k in range(width)]
    for search in searches:
        _check_identity(search, machine_axes, home_q)
    for part in parts:
        for search, axis in zip(searches, part.axes, strict=True):
            _add(search, axis)
    return PulseCheck(tuple(_concluded(search) for search in searches))


@dataclass(frozen=True, slots=True)
class _Samples:
    """x and its three derivatives (pulses, s) at instants t (N,), and the count from t on."""

    t: Array
    x: Array
    v: Array
    a: Array
    j: Array
    count: NDArray[np.int64]

    def __getitem__(self, which: slice | NDArray[Any]) -> "_Samples":
        return _Samples(*(getattr(self, part.name)[which] for part in fields(self)))

    def followed_by(self, other: "_Samples") -> "_Samples":
        return _Samples(*(np.concatenate((getattr(self, p.name), getattr(other, p.name))) for p in fields(self)))


@dataclass(slots=True)
class _Search:
    """One axis of a schedule, its motion, and what has been found so far: pulses, the latest, the closest two (ticks).

    grid (s): what is still to be looked at; count, last: after the pulses so far, and the last sample (1,).
    """

    schedule: PulseSchedule
    k: int
    motion: Motion
    grid: Array
    count: int
    pulses: int = 0
    latest: int | None = None
    closest: float = np.inf
    last: "_Samples | None" = None
    time_error: float = 0.0
    position_error: float = 0.0
    kinds: Counter[str] = field(default_factory=Counter)
    faults: list[PulseFault] = field(default_factory=list)

    @property
    def axis(self) -> AxisPulses:
        return self.schedule.axes[self.k]

    @property
    def tick(self) -> float:
        return 1 / self.schedule.clock_hz

    @property
    def ordered(self) -> bool:
        """Without an order there is nothing to measure against the motion."""
        return not any(self.kinds[kind] for kind in ("order", "outside", "direction"))

    @property
    def exact(self) -> bool:
        """The pulses stand for crossings of half a pulse, so that each has its one right tick."""
        return self.schedule.rule == "nearest" and self.axis.bound == 0.5

    def sample(self, t: Array, count: NDArray[np.int64]) -> _Samples:
        motion = self.motion
        state, k = (motion.axis_at(t, self.k), 0) if isinstance(motion, AxisMotion) else (motion.at(t), self.k)
        v, a, j = (values[:, k] / self.axis.pulse for values in (state.qd, state.qdd, state.qddd))
        return _Samples(t, (state.q[:, k] - self.axis.home) / self.axis.pulse, v, a, j, count)

    def noise(self, s: _Samples) -> Array:
        """(N,) pulses: what rounding may have done to x."""
        return ROUNDING * (abs(s.x) + 2 * abs(self.axis.home) / self.axis.pulse + abs(s.v * s.t))

    def travel(self, s: _Samples, ticks: float = 1.0) -> Array:
        """(N,) pulses that x runs in so many ticks."""
        time = ticks * self.tick
        return abs(s.v) * time + abs(s.a) * time**2 / 2

    def allowance(self, s: _Samples) -> Array:
        """(N,) pulses by which x may be from the count: the bound, and its travel while a pulse waits for its tick."""
        return self.axis.bound + self.travel(s, HALF_TICK if self.exact else 2 * HALF_TICK) + self.noise(s)

    def report(self, kind: str, ticks: NDArray[Any], text: str, values: NDArray[Any]) -> None:
        """Note a fault of one kind at each of the ticks (N,); `text` takes the value (N,) there."""
        room = max(0, LISTED - self.kinds[kind])
        self.kinds[kind] += len(ticks)
        for tick, value in zip(ticks[:room], values[:room], strict=True):
            self.faults.append(PulseFault(self.axis.name, int(tick), f"{kind}: {text.format(value)}"))


def _grid(motion: Motion) -> Array:
    """Instants that see every knot from both sides, and each interval inside."""
    lo, hi = motion.knots[:-1], motion.knots[1:]
    inside = lo[:, None] + (hi - lo)[:, None] * np.arange(GRID) / GRID
    throughout = np.linspace(0.0, motion.duration, 64 * GRID + 1)
    return np.unique(np.concatenate((inside.ravel(), np.nextafter(hi, lo), throughout)))


def _add(search: _Search, part: AxisPulses) -> None:
    """Go through the pulses of a part, block by block."""
    _check_order(search, part)
    for lo in range(0, len(part) if search.ordered else 0, BLOCK):
        _check_motion(search, part.ticks[lo : lo + BLOCK], part.direction[lo : lo + BLOCK])
    if not search.ordered:
        search.count += int(part.direction.sum(dtype=np.int64))


def _concluded(search: _Search) -> AxisCheck:
    """The findings, once there are no more pulses."""
    if search.ordered:
        _check_motion(search, np.empty(0, np.int64), np.empty(0, np.int8))
    else:
        search.time_error = search.position_error = np.inf
    time_error = search.time_error if search.exact else None
    _check_end(search, "start count", 0.0, search.axis.start)
    final_error = _check_end(search, "final count", search.motion.duration, search.count)
    figures = time_error, search.position_error, search.closest * search.tick, final_error
    return AxisCheck(search.axis.name, search.pulses, *figures, tuple(search.faults), search.kinds.total())


def _check_identity(search: _Search, machine_axes: Sequence[Axis] | None, home_q: ArrayLike | None) -> None:
    """The schedule is of this motion, and of this machine."""
    axis, nowhere = search.axis, np.zeros(1, np.int64)
    late = search.schedule.duration - search.motion.duration
    if not abs(late) <= search.tick:
        search.report("duration", nowhere, "{:+.9g} s from the motion's", np.array([late]))
    if machine_axes is not None:
        given = machine_axes[search.k]
        if axis.name != given.name:
            search.report(f"name: the machine's axis is {given.name}", nowhere, "{:.0f}", np.array([search.k + 1]))
        if axis.pulse != given.pulse:
            search.report("pulse", nowhere, "{:.9g} times the machine's", np.array([axis.pulse / given.pulse]))
    if home_q is not None:
        off = axis.home - float(np.asarray(home_q, float)[search.k])
        if abs(off) > ROUNDING * abs(axis.home):
            search.report("home", nowhere, "{:+.9g} from the machine's", np.array([off]))


def _check_order(search: _Search, part: AxisPulses) -> None:
    """The ticks rise, from 0 to the end, and every direction is one."""
    last = search.motion.duration / search.tick
    for lo in range(0, len(part), BLOCK):
        ticks, direction = part.ticks[lo : lo + BLOCK], part.direction[lo : lo + BLOCK]
        steps = np.diff(ticks) if search.latest is None else np.diff(ticks, prepend=search.latest)
        back = np.flatnonzero(steps <= 0)
        search.report("order", ticks[back + len(ticks) - len(steps)], "{} ticks after the pulse before it", steps[back])
        outside = ticks[(ticks < 0) | (ticks > last + HALF_TICK)]
        search.report("outside", outside, "the motion ends at tick {:.1f}", np.full(len(outside), last))
        neither = abs(direction) != 1
        search.report("direction", ticks[neither], "{} is neither +1 nor -1", direction[neither])
        search.closest = min(search.closest, float(steps.min()) if len(steps) else np.inf)
        search.latest, search.pulses = int(ticks[-1]), search.pulses + len(ticks)


def _check_motion(search: _Search, ticks: Ticks, direction: Signs) -> None:
    """The next pulses (N,), and all that lies ahead of the last; without pulses, the rest of the motion."""
    # A pulse that rounding put up to half a tick behind the end of the motion is seen at the end.
    fires = np.minimum(ticks / search.schedule.clock_hz, search.motion.duration)
    ahead = int(np.searchsorted(search.grid, fires[-1], side="right")) if len(fires) else len(search.grid)
    between, search.grid = search.grid[:ahead], search.grid[ahead:]
    t = np.concatenate((between, fires))
    order = np.argsort(t, kind="stable")  # a grid instant at a pulse comes first: it sees the count before
    pulse = np.concatenate((np.full(ahead, -1), np.arange(len(fires))))[order]
    change = np.concatenate((np.zeros(ahead, np.int64), direction))[order]
    samples = search.sample(t[order], search.count + np.cumsum(change))
    search.count += int(change.sum())
    fired = pulse >= 0
    if search.exact:
        _check_levels(search, ticks, direction.astype(float), samples[fired])
        _check_band(search, samples[~fired])
    else:
        _check_band(search, samples)
        _check_band(search, replace(samples[fired], count=samples.count[fired] - direction))
    _check_between(search, samples if search.last is None else search.last.followed_by(samples))
    search.last = samples[-1:] if len(t) else search.last


def _check_levels(search: _Search, ticks: Ticks, sign: Array, s: _Samples) -> None:
    """Each pulse at the crossing of the level between its two counts, going its way, on an axis that moves."""
    tick, noise = search.tick, search.noise(s)
    miss = (s.count - sign / 2) - s.x
    miss = np.sign(miss) * np.maximum(abs(miss) - noise, 0.0)
    # The nearer root of v τ + a τ²/2 = miss: how long after the sample x is at the level.
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(np.maximum(s.v**2 + 2 * s.a * miss, 0.0))
        wait = np.where(miss == 0, 0.0, 2 * miss / (s.v + np.copysign(root, s.v)))
    error = (ticks * tick - s.t - wait) / tick
    error[np.isnan(error)] = np.inf
    search.time_error = max(search.time_error, float(abs(error).max(initial=0.0)))
    search.position_error = max(search.position_error, float((abs(miss) - search.travel(s)).max(initial=0.0)))
    off = abs(error) > HALF_TICK
    search.report("off its crossing", ticks[off], "{:+.4g} ticks", error[off])
    astray = sign * s.v < -(abs(s.a) * tick + abs(s.j) * tick**2) - noise / tick
    search.report("against the motion", ticks[astray], "x moves at {:+.4g} pulses/s", s.v[astray])
    still = np.flatnonzero(s.v == 0)
    around = np.concatenate((s.t[still] - tick, s.t[still] + tick)).clip(0.0, search.motion.duration)
    resting = still[(search.motion.at(around).qd[:, search.k].reshape(2, -1) == 0).all(axis=0)]
    search.report("at rest", ticks[resting], "the axis stands still at {:.9g} s", s.t[resting])


def _check_band(search: _Search, s: _Samples) -> None:
    """Each sample within the bound of its count."""
    away = abs(s.x - s.count)
    beyond = away - search.axis.bound - search.noise(s) - search.travel(s)
    search.position_error = max(search.position_error, float(beyond.max(initial=0.0)))
    out = ~(away <= search.allowance(s))
    search.report("far from its count", np.rint(s.t[out] / search.tick), "{:.6g} pulses", away[out])


def _check_between(search: _Search, chain: _Samples) -> None:
    """Halve the intervals between samples in which x might turn outside the band, and look there."""
    a, b = chain[:-1], chain[1:]
    while len(a.t):
        span = b.t - a.t
        steepest = np.maximum(abs(a.a), abs(b.a)) + span * np.maximum(abs(a.j), abs(b.j))
        bulge = steepest * span**2 / 8  # by how much x can pass both ends of the interval
        away = np.maximum(abs(a.x - a.count), abs(b.x - a.count))
        stays = (away + bulge <= search.axis.bound) | (bulge <= search.noise(a))
        monotone = np.maximum(abs(a.v), abs(b.v)) >= steepest * span
        unsure = ~(stays | monotone) & (span > search.tick) & np.isfinite(away)
        a, b = a[unsure], b[unsure]
        middle = search.sample((a.t + b.t) / 2, a.count)
        _check_band(search, middle)
        a, b = a.followed_by(middle), middle.followed_by(b)


def _check_end(search: _Search, kind: str, t: float, count: int) -> float:
    """The count at one end of the motion: 0 where it is right, else by how many pulses it is not."""
    end = search.sample(np.array([t]), np.array([count]))
    error = count - end.x
    if abs(error[0]) <= search.allowance(end)[0]:
        return 0.0
    search.report(kind, np.rint(end.t / search.tick), "{:+.6g} pulses from the motion", error)
    return float(error[0])
