"""The independent check of a pulse schedule against the motion it stands for. It shares no code with the generator."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.pulses.motion import Motion
from planner.pulses.schedule import AxisPulses, PulseSchedule

HALF_TICK = 0.501  # what rounding to a whole tick may take, and a thousandth for the arithmetic of both sides
ROUNDING = 64 * np.finfo(float).eps
BLOCK = 1 << 15
GRID = 8  # instants per knot interval besides the pulses' own
LISTED = 20  # faults of a kind listed per axis


@dataclass(frozen=True, slots=True)
class PulseFault:
    """One thing wrong with the pulses of an axis, at a clock tick."""

    axis: str
    tick: int
    what: str


@dataclass(frozen=True, slots=True)
class AxisCheck:
    """What the check found on one axis.

    time_error         ticks, largest |pulse - true crossing|; inf where the motion crosses no level there
    position_error     pulses, largest |count - (q - home)/pulse| beyond ½ + one tick's travel; 0 within
    smallest_interval  s between two pulses; inf with fewer than two
    final_error        pulses, count at the end - the count the motion ends on
    faults             the first few of each kind; fault_count has them all
    """

    name: str
    pulses: int
    time_error: float
    position_error: float
    smallest_interval: float
    final_error: int
    faults: tuple[PulseFault, ...]
    fault_count: int


@dataclass(frozen=True, slots=True)
class PulseCheck:
    """The verdict on a schedule, and its worst figures over all axes (units as in AxisCheck)."""

    axes: tuple[AxisCheck, ...]

    @property
    def holds(self) -> bool:
        return self.fault_count == 0

    @property
    def faults(self) -> tuple[PulseFault, ...]:
        return tuple(fault for axis in self.axes for fault in axis.faults)

    @property
    def fault_count(self) -> int:
        return sum(axis.fault_count for axis in self.axes)

    @property
    def time_error(self) -> float:
        return max((axis.time_error for axis in self.axes), default=0.0)

    @property
    def position_error(self) -> float:
        return max((axis.position_error for axis in self.axes), default=0.0)

    @property
    def smallest_interval(self) -> float:
        return min((axis.smallest_interval for axis in self.axes), default=np.inf)

    @property
    def highest_rate(self) -> float:
        """1/s."""
        return 1 / self.smallest_interval if self.smallest_interval > 0 else np.inf

    @property
    def final_error(self) -> int:
        return max((axis.final_error for axis in self.axes), key=abs, default=0)


@dataclass(frozen=True, slots=True)
class _Samples:
    """One axis in pulses from home at instants t (N,): x, its three derivatives (1/s, 1/s², 1/s³), and the count from t on."""

    t: Array
    x: Array
    v: Array
    a: Array
    j: Array
    count: NDArray[np.int64]

    def __getitem__(self, which: slice | NDArray[np.intp] | NDArray[np.bool_]) -> "_Samples":
        return _Samples(*(getattr(self, name)[which] for name in ("t", "x", "v", "a", "j", "count")))


@dataclass(slots=True)
class _Findings:
    """What is gathered while the axis is gone through."""

    axis: AxisPulses
    clock_hz: int
    time_error: float = 0.0
    position_error: float = 0.0
    kinds: Counter[str] = field(default_factory=Counter)
    faults: list[PulseFault] = field(default_factory=list)

    def report(self, kind: str, tick: Array | NDArray[np.int64], text: str, value: Array) -> None:
        """Note a fault of one kind at each tick (N,); `text` takes the value there."""
        room = max(0, LISTED - self.kinds[kind])
        self.kinds[kind] += len(tick)
        for at, number in zip(tick[:room], value[:room], strict=True):
            self.faults.append(PulseFault(self.axis.name, int(at), f"{kind}: {text.format(number)}"))


def check(schedule: PulseSchedule, trajectory: Motion) -> PulseCheck:
    """Prove that every axis fires where its motion crosses half a pulse, and nowhere else.

    - Each pulse: the motion is at the level between the counts before and after it, to within half a tick, going the pulse's way.
    - Between pulses: |count - x| ≤ ½ + half a tick's travel, x = (q - home)/pulse; at all times, since an interval between two samples
      is halved until the motion is monotone in it, or cannot leave the band: max|x - count| + max|ẍ|·δ²/8 ≤ ½.
    - The start count, the final count, and the order of the ticks.
    Positions are trusted to 64 roundings of q and of q̇·t. The trajectory is asked about once per pulse, in blocks.
    """
    width = trajectory.at(np.zeros(1)).q.shape[1]
    if width != len(schedule.axes):
        raise MotionError(f"the schedule has {len(schedule.axes)} axes, the motion {width}; check it against its own")
    grid = _grid(trajectory)
    axes = (_check_axis(schedule, k, trajectory, grid) for k in range(width))
    return PulseCheck(tuple(axes))


def _grid(motion: Motion) -> Array:
    """Instants that see every knot from both sides, and each interval inside."""
    lo, hi = motion.knots[:-1], motion.knots[1:]
    inside = lo[:, None] + (hi - lo)[:, None] * np.arange(GRID) / GRID
    every = np.linspace(0.0, motion.duration, 64 * GRID + 1)
    return np.unique(np.concatenate((inside.ravel(), np.nextafter(hi, lo), every)))


def _check_axis(schedule: PulseSchedule, k: int, motion: Motion, grid: Array) -> AxisCheck:
    axis, found = schedule.axes[k], _Findings(schedule.axes[k], schedule.clock_hz)
    steps = np.diff(axis.ticks)
    smallest = float(steps.min()) / schedule.clock_hz if len(steps) else np.inf
    if _is_sequence(found, steps, motion.duration):
        final_error = _check_motion(found, k, motion, grid)
    else:
        found.time_error = found.position_error = np.inf
        final_error = axis.final - round(
            float((motion.at(np.array([motion.duration])).q[0, k] - axis.home) / axis.pulse)
        )
    return AxisCheck(
        axis.name, len(axis.ticks), found.time_error, found.position_error, smallest, final_error,
        tuple(found.faults), found.kinds.total(),
    )  # fmt: skip


def _is_sequence(found: _Findings, steps: NDArray[np.int64], duration: float) -> bool:
    """Whether the ticks rise, from 0 to the end, and every direction is one."""
    axis, last = found.axis, duration * found.clock_hz + HALF_TICK
    back = np.flatnonzero(steps <= 0)
    found.report("order", axis.ticks[back + 1], "follows a pulse {} ticks before it", steps[back])
    outside = axis.ticks[(axis.ticks < 0) | (axis.ticks > last)]
    found.report("outside", outside, "the motion lasts from tick 0 to {:.0f}", np.full(len(outside), last))
    neither = abs(axis.direction) != 1
    found.report("no direction", axis.ticks[neither], "direction {} is neither +1 nor -1", axis.direction[neither])
    return found.kinds.total() == 0


def _check_motion(found: _Findings, k: int, motion: Motion, grid: Array) -> int:
    """Go through the axis once, block by block; the error of the final count."""
    axis = found.axis
    previous: _Samples | None = None
    for pulse, samples in _samples(found, k, motion, grid):
        noise = _noise(axis, samples)
        _check_levels(found, k, motion, pulse, samples, noise)
        _check_band(found, samples[pulse < 0], noise[pulse < 0])
        chain = samples if previous is None else _joined(previous, samples)
        _check_between(found, k, motion, chain)
        previous = samples[-1:]
    end = _state(motion, k, axis, np.array([motion.duration]), np.array([axis.final]))
    error = float(axis.final - end.x[0])
    if abs(error) <= _allowance(found.clock_hz, end, _noise(axis, end))[0]:
        return 0
    found.report(
        "final count",
        axis.ticks[-1:] if len(axis) else np.zeros(1),
        "{:+.3f} pulses from where the motion ends",
        np.array([error]),
    )
    return round(error)


def _samples(found: _Findings, k: int, motion: Motion, grid: Array) -> Iterator[tuple[NDArray[np.intp], _Samples]]:
    """Blocks of samples in the order of time: the number of the pulse that falls there (-1 on the grid), and the motion."""
    axis = found.axis
    start = axis.start
    for first in range(0, max(len(axis), 1), BLOCK):
        ticks, direction = axis.ticks[first : first + BLOCK], axis.direction[first : first + BLOCK]
        # A pulse that rounding put up to half a tick behind the end of the motion belongs to the end.
        fires = np.minimum(ticks / found.clock_hz, motion.duration)
        since = fires[0] if first else -np.inf
        until = axis.ticks[first + BLOCK] / found.clock_hz if first + BLOCK < len(axis) else np.inf
        part = grid[(grid >= since) & (grid < until)]
        t = np.concatenate((part, fires))
        order = np.argsort(t, kind="stable")  # a grid instant at a pulse comes first: it sees the count before
        pulse = np.concatenate((np.full(len(part), -1), np.arange(first, first + len(ticks))))[order]
        change = np.concatenate((np.zeros(len(part), np.int64), direction.astype(np.int64)))[order]
        yield pulse, _state(motion, k, axis, t[order], start + np.cumsum(change))
        start += int(change.sum())


def _state(motion: Motion, k: int, axis: AxisPulses, t: Array, count: NDArray[np.int64]) -> _Samples:
    state = motion.at(t)
    v, a, j = (values[:, k] / axis.pulse for values in (state.qd, state.qdd, state.qddd))
    return _Samples(t, (state.q[:, k] - axis.home) / axis.pulse, v, a, j, count)


def _noise(axis: AxisPulses, s: _Samples) -> Array:
    """(N,) pulses: what rounding of q and of t may do to x."""
    return ROUNDING * (abs(s.x) + 2 * abs(axis.home) / axis.pulse + abs(s.v * s.t))


def _allowance(clock_hz: int, s: _Samples, noise: Array) -> Array:
    """(N,) pulses by which the motion may be from the count: ½, and what it travels while the pulse waits for its tick."""
    wait = HALF_TICK / clock_hz
    return 0.5 + abs(s.v) * wait + abs(s.a) * wait**2 / 2 + noise


def _check_levels(
    found: _Findings, k: int, motion: Motion, pulse: NDArray[np.intp], samples: _Samples, noise: Array
) -> None:
    """Each pulse at the crossing of the level between its two counts, going its way, on an axis that moves."""
    which = pulse >= 0
    s, noise, ticks = samples[which], noise[which], found.axis.ticks[pulse[which]]
    sign = found.axis.direction[pulse[which]].astype(float)
    tick = 1 / found.clock_hz
    miss = (s.count - sign / 2) - s.x
    beyond = np.sign(miss) * np.maximum(abs(miss) - noise, 0.0)
    # The nearer root of v τ + a τ²/2 = beyond: how long after the sample the motion is at the level.
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(np.maximum(s.v**2 + 2 * s.a * beyond, 0.0))
        wait = np.where(beyond == 0, 0.0, 2 * beyond / (s.v + np.copysign(root, s.v)))
    error = (ticks * tick - s.t - wait) * found.clock_hz
    error[np.isnan(error)] = np.inf
    found.time_error = max(found.time_error, float(abs(error).max(initial=0.0)))
    found.position_error = max(found.position_error, float((abs(beyond) - abs(s.v) * tick).max(initial=0.0)))
    off = abs(error) > HALF_TICK
    found.report("off its crossing", ticks[off], "{:+.4g} ticks", error[off])
    astray = sign * s.v < -(abs(s.a) * tick + abs(s.j) * tick**2) - noise / tick
    found.report("against the motion", ticks[astray], "the axis moves at {:+.4g} pulses/s", s.v[astray])
    still = np.flatnonzero(s.v == 0)
    around = np.concatenate((s.t[still] - tick, s.t[still] + tick)).clip(0.0, motion.duration)
    resting = still[(motion.at(around).qd[:, k].reshape(2, -1) == 0).all(axis=0)]
    found.report("at rest", ticks[resting], "the axis stands still at {:.9g} s", s.t[resting])


def _check_band(found: _Findings, s: _Samples, noise: Array) -> None:
    """Each sample between pulses within half a pulse of its count."""
    away = abs(s.x - s.count)
    found.position_error = max(
        found.position_error, float((away - 0.5 - noise - abs(s.v) / found.clock_hz).max(initial=0.0))
    )
    out = away > _allowance(found.clock_hz, s, noise)
    found.report("far from its count", np.rint(s.t[out] * found.clock_hz), "{:.4g} pulses", away[out])


def _check_between(found: _Findings, k: int, motion: Motion, chain: _Samples) -> None:
    """Halve the intervals between samples in which the motion might turn outside the band, and look there."""
    a, b = chain[:-1], chain[1:]
    while True:
        span = b.t - a.t
        steepest = np.maximum(abs(a.a), abs(b.a)) + span * np.maximum(abs(a.j), abs(b.j))
        away = np.maximum(abs(a.x - a.count), abs(b.x - a.count))
        stays = away + steepest * span**2 / 8 <= 0.5
        monotone = np.maximum(abs(a.v), abs(b.v)) > steepest * span
        open_ = np.flatnonzero(~(stays | monotone) & (span > 1 / found.clock_hz))
        if not len(open_):
            return
        a, b = a[open_], b[open_]
        middle = _state(motion, k, found.axis, (a.t + b.t) / 2, a.count)
        _check_band(found, middle, _noise(found.axis, middle))
        a, b = _joined(a, middle), _joined(middle, b)


def _joined(first: _Samples, second: _Samples) -> _Samples:
    return _Samples(
        *(np.concatenate((getattr(first, n), getattr(second, n))) for n in ("t", "x", "v", "a", "j", "count"))
    )
