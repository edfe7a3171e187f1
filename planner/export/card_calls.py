"""Motion as calls of the cards PCI-8132 and PCI-8164: one absolute move per axis and interval of
time.

At t_k an axis that has to go on is sent ta_move(pos, start, max, tacc, tdec): pos is the count
nearest to its position at t_{k+1}, start and max are speeds (magnitudes, pulses/s), tacc = t_{k+1}
- t_k and tdec = 0. Card semantics are not printed; assumed are those of [Sahbaz 2007] as the
virtual card has them: the speed runs from start to max linearly within tacc, tdec = 0 stops dead on
the target, and the axis waits there. With D = |pos - the last pos| the speeds are

    start = v(t_k) + δ,  max = 2 D/tacc - start,  δ = D/tacc - (v(t_k) + v(t_{k+1}))/2,

whole steps of the card's 16-bit speed registers, max rounded up, so that every move is over when
the next is sent. So it does not matter whether a card replaces a running move or queues behind it,
errors do not add up, and the final counts are exact. Times are whole microseconds; an axis' own
turning points and rests take the place of the nearest instants of the grid. Counts and their signs
are the wiring's (direction -1: extension is sent as negative counts). The calls are replayed in
closed form, for the largest error by which they are from the motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, require
from kinematics.foundation.names import count_noun
from kinematics.foundation.polynomials import shift_polynomials
from kinematics.foundation.units import format_distinct
from planner.export.format import ExportSource
from planner.pulses.generation.pieces import FIT_TOLERANCE, UNSEEN_FACTOR, Pieces, cut_monotone, fit
from planner.pulses.schedule import refuse_counter
from planner.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Call:
    """One call: at `time` (s) `function`(axis, position, start, top, tacc, tdec), in pulses,
    pulses/s and s.
    """

    time: float
    name: str
    function: str
    axis: int
    position: int
    start: float
    top: float
    tacc: float
    tdec: float = 0.0


def wired_counts(source: ExportSource, k: int, t: Array) -> tuple[Array, Array]:
    """Position (pulses) and speed (pulses/s) of an axis at instants t (N,), in the counts of its
    wiring.
    """
    axis, state = source.machine.axes[k], source.counted.at(t)
    scale = axis.direction / axis.pulse
    return (state.q[:, k] - source.machine.home_q[k]) * scale, state.qd[:, k] * scale


def replay_error(source: ExportSource, calls: Sequence[Call]) -> float:
    """Pulses by which command positions of the calls are from the motion at most, over continuous
    time.

    p(τ) = p₀ ± min(D, start τ + (max - start) τ²/(2 tacc)), then waiting. Between all instants at
    which either changes its piece, p - x is a quintic: it is cut where it turns round, and largest
    at one of the cuts. The motion's own quintics are true to some 1e-6 pulse, which is added, as
    `planner.pulses.generation.levels` does.
    """
    pieces = fit(
        source.counted, FIT_TOLERANCE * np.array([axis.pulse for axis in source.machine.axes])
    )
    return max(
        (_axis_replay_error(source, pieces, k, calls) for k in range(len(source.machine.axes))),
        default=0.0,
    )


def _axis_replay_error(
    source: ExportSource, pieces: Pieces, k: int, calls: Sequence[Call]
) -> float:
    axis, duration = source.machine.axes[k], source.trajectory.duration
    own = [call for call in calls if call.name == axis.name]
    moves = _moves(own, float(source.pulses.axes[k].start * axis.direction))
    cuts = np.concatenate(
        [pieces.start, [duration], moves.begin, moves.begin + moves.ramp, moves.end]
    )
    cuts = np.unique(np.maximum(cuts, 0.0))
    lo, span = cuts[:-1], np.diff(cuts)
    middle = lo + span / 2
    of = np.searchsorted(pieces.start, middle, side="right") - 1
    x = shift_polynomials(
        pieces.coefficients[k][:, of],
        (lo - pieces.start[of]) / pieces.length[of],
        span / pieces.length[of],
    )
    rests = middle > duration
    x[0, rests], x[1:, rests] = pieces.coefficients[k][:, -1].sum(), 0.0
    x[0] -= source.machine.home_q[k]
    away = x * (-axis.direction / axis.pulse)
    away[:3] += moves.at(lo, span, middle)
    slack = (pieces.noise[k] + UNSEEN_FACTOR * pieces.error[k]) / axis.pulse
    turns = cut_monotone(lo, span, away, slack).coefficients
    return float(max(abs(turns[0]).max(), abs(turns.sum(axis=0)).max()) + 2 * slack)


@dataclass(frozen=True, slots=True)
class _Moves:
    """The moves of one axis: when each begins (s), how long its ramp is, when it has arrived, and
    from where to where.

    In front of them stands one that goes nowhere, from before the start on.
    """

    begin: Array
    ramp: Array
    end: Array
    before: Array
    target: Array
    start: Array
    top: Array

    def at(self, lo: Array, span: Array, middle: Array) -> Array:
        """Coefficients (3, S) in v of p(lo + span v), v in [0, 1], of intervals inside which
        nothing changes.
        """
        nth: NDArray[np.intp] = np.searchsorted(self.begin, middle, side="right") - 1
        begin, ramp, u, w = (each[nth] for each in (self.begin, self.ramp, self.start, self.top))
        gain = (w - u) / ramp
        tau, ramping = lo - begin, middle < begin + ramp
        way = np.where(ramping, tau * (u + gain * tau / 2), ramp * (u + w) / 2 + w * (tau - ramp))
        speed, bend = np.where(ramping, u + gain * tau, w), np.where(ramping, gain, 0.0)
        run: Array = np.sign(self.target - self.before)[nth] * np.stack(
            (way, speed * span, bend * span**2 / 2)
        )
        run[0] += self.before[nth]
        waits = middle >= self.end[nth]
        run[0, waits], run[1:, waits] = self.target[nth[waits]], 0.0
        return run


def _moves(own: Sequence[Call], at_first: float) -> _Moves:
    numbers = [(call.time, call.tacc, call.position, call.start, call.top) for call in own]
    begin, ramp, target, u, w = np.array([(-1.0, 1.0, at_first, 0.0, 1.0), *numbers]).T
    before = np.concatenate([[at_first], target[:-1]])
    far, ramped, gain = abs(target - before), ramp * (u + w) / 2, (w - u) / ramp
    # The smaller root of u τ + gain τ²/2 = D, in the form that loses no digits.
    root = np.sqrt(np.maximum(u**2 + 2 * gain * far, 0.0))
    within = 2 * far / np.maximum(u + root, np.finfo(float).tiny)
    end = begin + np.where(far <= ramped, np.minimum(within, ramp), ramp + (far - ramped) / w)
    return _Moves(begin, ramp, end, before, target, u, w)


REGISTER = 65535
"""Largest value of a speed register; its step is the range it is set to, divided by this [Sahbaz
2007, Appendix A].
"""
MICROSECONDS = 1_000_000
MAX_SPACING_US, MIN_SPACING_US = 64_000, 1_000
"""µs between calls that are tried, halved until the error is small enough."""
MAX_ERROR_PULSES = 1.0
"""pulses: ½ is rounding of the targets alone."""
SPEED_HEADROOM = 1.001
"""Headroom of a speed range over the largest speed in it."""


@dataclass(frozen=True, slots=True)
class CardKind:
    """A kind of card: its call, what a channel can emit (pulses/s), and how many axes its library
    numbers.
    """

    function: str
    max_speed: float
    axes: int


KINDS = {
    "8132": CardKind("_8132_ta_move", 2.4e6, 24),
    "8164": CardKind("_8164_start_ta_move", 6.55e6, 48),
}
"""By the number in a card's name.

Limits: [Sahbaz 2007, Appendix A]; twelve cards of two or of four axes.
"""


@dataclass(frozen=True, slots=True)
class CallList:
    """The calls in the order of time, the spacing (s) of their grid, and the speed range (pulses/s)
    of every axis.
    """

    calls: tuple[Call, ...]
    spacing: float
    ranges: tuple[float, ...]
    notes: tuple[str, ...]


def call_list(source: ExportSource, spacing: float | None, speed_range: float | None) -> CallList:
    """The calls that make a motion; None: the longest spacing that errs by a pulse at most, the
    least speed range.

    Raises MotionError for an axis without a card, a count beyond the counters, a speed beyond the
    card or the range.
    """
    kinds = find_card_kinds(source)
    for pulses, axis in zip(source.pulses.axes, source.machine.axes, strict=True):
        refuse_counter(pulses, axis)
    if spacing is not None:
        if not 1e-6 <= spacing <= 1e3:
            raise MotionError(f"adlink: spacing {spacing} s must be from 1 µs to 1000 s")
        return require(_make_calls(source, kinds, round(spacing * MICROSECONDS), speed_range))
    tried = MAX_SPACING_US
    while tried // 2 >= MIN_SPACING_US:
        made = _make_calls(source, kinds, tried, speed_range)
        # coarse ramps overshoot the motion's speeds: finer ones may fit the cards
        if (
            not isinstance(made, MotionError)
            and replay_error(source, made.calls) <= MAX_ERROR_PULSES
        ):
            return made
        tried //= 2
    return require(_make_calls(source, kinds, tried, speed_range))


def find_card_kinds(source: ExportSource, format: str = "adlink") -> list[CardKind]:
    """The kind of card of each axis; format: that asks, for messages.

    Raises MotionError for an axis without one.
    """
    kinds: list[CardKind] = []
    names: dict[str, str | None] = {}
    for axis in source.machine.axes:
        found = [number for number in KINDS if number in (axis.card or "")]
        if len(found) != 1:
            wired = f"is wired to {axis.card!r}" if axis.card else "has no card"
            raise MotionError(
                f"{format}: axis {axis.name} of machine {source.machine.name} {wired}; give it a PCI-8132 or a "
                f'PCI-8164 in [wiring], as in {axis.name} = ["PCI-8164", 0]'
            )
        (number,) = found
        if names.setdefault(number, axis.card) != axis.card:
            raise MotionError(
                f"{format}: {names[number]!r} and {axis.card!r} are two cards of one type; the card library numbers "
                "axes across all cards of a type: use one name and number the channels consecutively"
            )
        if axis.channel is None or axis.channel >= KINDS[number].axes:
            raise MotionError(
                f"{format}: axis {axis.name}: channel {axis.channel}; limit {KINDS[number].axes - 1}"
            )
        kinds.append(KINDS[number])
    return kinds


def _make_calls(
    source: ExportSource, kinds: Sequence[CardKind], spacing: int, speed_range: float | None
) -> CallList | MotionError:
    """The calls; what to say where they would need speeds beyond the card or the range."""
    trajectory = source.trajectory
    end = int(np.ceil(trajectory.duration * MICROSECONDS))
    grid = np.append(np.arange(0, end, spacing), end)
    rests = _find_rests(trajectory)
    found: list[Call] = []
    ranges = []
    for k, (axis, kind) in enumerate(zip(source.machine.axes, kinds, strict=True)):
        t = _merge_instants(grid, np.concatenate([rests, _find_turns(source, k)]))
        x, v = wired_counts(source, k, t / MICROSECONDS)
        target = np.rint(x).astype(np.int64)
        pulses = source.pulses.axes[k]
        target[0], target[-1] = pulses.start * axis.direction, pulses.final * axis.direction
        way, h = np.diff(target), np.diff(t) / MICROSECONDS
        mean, sign = abs(way) / h, np.sign(way)
        start = np.clip(mean + sign * (v[:-1] - v[1:]) / 2, 0.0, 2 * mean)
        fastest = float(np.maximum(start, 2 * mean - start).max(initial=0.0))
        top = max(fastest * SPEED_HEADROOM, 1.0) if speed_range is None else speed_range
        if top > kind.max_speed or fastest > top:
            when = float(t[int(np.maximum(start, 2 * mean - start).argmax())]) / MICROSECONDS
            needed, range_, most = format_distinct(fastest, top, kind.max_speed)
            return MotionError(
                f"adlink: axis {axis.name} needs {needed} pulses/s at t = {when:.6g} s, its speed range is "
                f"{range_} and the card's {most}; widen the range, use a longer pulse, or slow down"
            )
        step = top / REGISTER
        low = np.maximum(np.minimum(np.rint(start / step), np.floor(2 * mean / step) - 1), 1)
        high = np.maximum(np.ceil(2 * mean / step - low), 1)
        ranges.append(top)
        for n in np.flatnonzero(way).tolist():
            found.append(
                Call(
                    int(t[n]) / MICROSECONDS, axis.name, kind.function, int(axis.channel or 0), int(target[n + 1]),
                    float(low[n] * step), float(high[n] * step), int(t[n + 1] - t[n]) / MICROSECONDS,
                )
            )  # fmt: skip
    found.sort(key=lambda call: call.time)  # stable: axes stay in order within an instant
    return CallList(
        tuple(found), spacing / MICROSECONDS, tuple(ranges), _notes(source, found, spacing, ranges)
    )


def _notes(
    source: ExportSource, calls: Sequence[Call], spacing: int, ranges: Sequence[float]
) -> tuple[str, ...]:
    axes = source.machine.axes
    starts = [
        axis.direction * pulses.start for axis, pulses in zip(axes, source.pulses.axes, strict=True)
    ]
    spans = ", ".join(f"{axis.name} {top:.1f}" for axis, top in zip(axes, ranges, strict=True))
    return (
        f"{count_noun(len(calls), 'call')}, {spacing / 1e3:g} ms apart for an axis that moves; the "
        "pulses fired are within 0.5 more",
        f"counters must stand at {', '.join(map(str, starts))} at time 0",
        f"speed ranges that were rounded to, in pulses/s: {spans}",
        "assumed of the cards: speeds are magnitudes, tacc is the time of the whole ramp, tdec = 0 stops dead",
    )


def _merge_instants(grid: np.ndarray, own: np.ndarray) -> np.ndarray:
    """The grid (µs) with an axis' own instants in place of the nearest inner ones."""
    inside = np.unique(np.rint(own).astype(np.int64))
    inside = inside[(inside > 0) & (inside < grid[-1])]
    if not len(inside) or len(grid) < 3:
        return np.union1d(grid, inside)
    inner = grid[1:-1]
    right = np.clip(np.searchsorted(inner, inside), 0, len(inner) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(abs(inner[right] - inside) <= abs(inner[left] - inside), right, left)
    return np.union1d(np.delete(grid, 1 + nearest), inside)


def _find_rests(trajectory: Trajectory) -> Array:
    """µs at which the motion is at rest at a knot."""
    speed = trajectory.at(trajectory.knots).sd
    still = speed <= 1e-9 * max(float(speed.max(initial=0.0)), 1e-300)
    return np.asarray(trajectory.knots[still] * MICROSECONDS)


def _find_turns(source: ExportSource, k: int) -> Array:
    """µs at which an axis turns round, between two opposite pulses: halved until q̇ = 0 is known to
    below one.
    """
    pulses = source.pulses.axes[k]
    last = np.flatnonzero(np.diff(pulses.direction))
    lo, hi = (pulses.ticks[last + n] / source.pulses.clock_hz for n in (0, 1))
    sign = np.sign(wired_counts(source, k, lo)[1])
    for _ in range(40 if len(last) else 0):
        middle = (lo + hi) / 2
        before = np.sign(wired_counts(source, k, middle)[1]) == sign
        lo, hi = np.where(before, middle, lo), np.where(before, hi, middle)
    return np.asarray(lo * MICROSECONDS)
