"""Sampling times of a motion, chosen so that the reader's interpolation stays within a tolerance.

Consumers run one polynomial per segment that meets the rows given at both its ends: one row
(position) is a straight line, two (and velocity) the cubic of PVT, three (and acceleration) a
quintic. What was written is decoded, interpolated so, and compared with the motion.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from math import ceil, factorial, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option
from kinematics.foundation.units import format_distinct
from kinematics.machine.axis import Axis
from planner.export.format import Exported, ExportSource
from planner.pulses.motion import AxesMotion


@dataclass(frozen=True, slots=True)
class Segments:
    """S segments, each from `start` to `end` (S,) s; `first` and `last` (rows, S, axes) are what
    its ends state.
    """

    start: Array
    end: Array
    first: Array
    last: Array

    @property
    def coefficients(self) -> Array:
        """(2 rows, S, axes) c of q(u) - q(0) = Σ c_i uⁱ, u in [0, 1]: of the way, whose rounding is
        as small as it.
        """
        rows = len(self.first)
        scale = (self.end - self.start)[:, None] ** np.arange(rows)[:, None, None]
        ends = np.concatenate([self.first * scale, self.last * scale])
        ends[0], ends[rows] = 0.0, self.last[0] - self.first[0]
        return np.tensordot(_from_ends(rows), ends, 1)

    def deviation(self, motion: AxesMotion, probes: int) -> Array:
        """(S, axes) how far the segments are from a motion, in its unit.

        The largest |e| at the ends of `probes` equal parts of a segment, and what it may grow to
        between them: a part of length d adds at most d² max|ë| / 8, with ë as it is inside (at an
        end q̈ may be that of the next piece).
        """
        u = np.linspace(0.0, 1.0, probes + 1)
        length = self.end - self.start
        state = motion.at((self.start[:, None] + length[:, None] * u).ravel())
        shape = (len(length), len(u), -1)
        c = self.coefficients
        power = np.arange(len(c))
        way = np.einsum("pi,isa->spa", u[:, None] ** power, c)
        bend = np.einsum(
            "pi,isa->spa", u[:, None] ** np.maximum(power - 2, 0) * power * (power - 1), c
        )
        error = abs(self.first[0][:, None] + way - state.q.reshape(shape)).max(1)
        bend -= (
            state.qdd.reshape(shape) * (length**2)[:, None, None]
        )  # ë times the square of the length
        return np.asarray(error + abs(bend[:, 1:-1]).max(1) / (8 * probes**2))

    def backward_way(self, motion: AxesMotion, probes: int) -> Array:
        """(S, axes) how far a cubic runs back inside its segment where the motion runs one way
        only, else 0.

        q̇(u) = c1 + 2 c2 u + 3 c3 u² is against the way between its roots r1 < r2 if both lie
        inside: by
        |c3| (r2 - r1)³ / 2. Other segments than cubics are not looked at.
        """
        if len(self.first) != 2:
            return np.zeros(self.first.shape[1:])
        u = np.linspace(0.0, 1.0, probes + 1)
        length = self.end - self.start
        qd = motion.at((self.start[:, None] + length[:, None] * u).ravel()).qd.reshape(
            len(length), len(u), -1
        )
        way = np.sign(qd.sum(1))
        one_way = (qd * way[:, None] >= 0).all(1)
        _, c1, c2, c3 = self.coefficients * way
        with np.errstate(divide="ignore", invalid="ignore"):
            middle, apart = -c2 / (3 * c3), 2 * np.sqrt(c2**2 - 3 * c1 * c3) / (3 * c3)
            inside = one_way & (c3 > 0) & (middle > 0) & (middle < 1) & (apart > 0)
            return np.where(inside, c3 * apart**3 / 2, 0.0)


@cache
def _from_ends(rows: int) -> Array:
    """(2 rows, 2 rows) coefficients by powers of u from value and derivatives at u = 0, and at u =
    1.
    """
    powers = range(2 * rows)
    at_start = [[factorial(i) if i == k else 0 for i in powers] for k in range(rows)]
    at_end = [
        [factorial(i) / factorial(i - k) if i >= k else 0 for i in powers] for k in range(rows)
    ]
    return np.asarray(
        np.rint(np.linalg.inv(np.array(at_start + at_end, float)) * 2) / 2
    )  # they are halves


TOLERANCE = 0.5  # pulses
SPACING_SHARE = 0.98  # of the tolerance is for the spacing, the rest for rounding
MAX_BACKWARD_PULSES = (
    0.01  # pulses that a segment may run back where the motion does not: rounding makes that much
)
REST_SPEED = 1.0  # pulses/s, slower is rest
REST_ACCELERATION = 1.0  # pulses/s², of what rounding leaves of an axis that stands
# of an axis' largest acceleration: a quintic makes 0.374 of a jump that it is told of on top
JUMP_SHARE = 0.05
GROUP_PIECES = 8  # pieces of the motion that one segment may span, so that no probe misses a swing
SEGMENT_PROBES = 8  # parts of a segment that is tried
MAX_SEGMENT_DURATION = 10.0  # s, so that rounded speeds do not lead astray
GROUP_BATCH = 256  # groups refined together
MAX_KNOTS = 1 << 27  # points

Steps = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Knots:
    """Whole time steps (K,) from 0 on, of `step` s each; the last is the end of the motion, or the
    next after it.

    tolerance  pulses, that they were chosen for; None where their spacing was given
    """

    steps: Steps
    step: float
    tolerance: float | None

    def describe(self) -> str:
        """How many segments, and how long they are."""
        length = np.diff(self.steps) * (1e3 * self.step)
        least, most = f"{length.min():.4g}", f"{length.max():.4g}"
        return f"segments: {len(length)}, of {least if least == most else f'{least} to {most}'} ms"


def steps_to_seconds(steps: Steps, step: float) -> Array:
    return np.asarray(steps * step)


def rows_at(motion: AxesMotion, t: Array, rows: int) -> Array:
    """(rows, N, axes) q, then q̇, then q̈ at instants t (N,); after the end they are as at the
    end.
    """
    state = motion.at(np.minimum(t, motion.duration))
    return np.stack([state.q, state.qd, state.qdd][:rows])


def refuse_moving_ends(motion: AxesMotion, axes: tuple[Axis, ...], format_: str) -> None:
    """Raise MotionError unless every axis starts and ends at rest."""
    speeds = motion.at(np.array([0.0, motion.duration])).qd
    for axis, column in zip(axes, speeds.T, strict=True):
        for speed, end in zip(column.tolist(), ("starts", "ends"), strict=True):
            if abs(speed) > REST_SPEED * axis.pulse:
                raise MotionError(
                    f"axis {axis.name}: {end} at {speed:.4g} {axis.unit}/s, but {format_} starts and ends at rest; "
                    "let the program do the same; a stop goes on as rows (csp, halstreamer) or pulses"
                )


def choose_knots(
    motion: AxesMotion,
    axes: tuple[Axis, ...],
    rows: int,
    *,
    step: float,
    tolerance: float | None,
    spacing: float | None,
    longest: int | None = None,
) -> Knots:
    """Knots for a consumer that is told `rows` of q, q̇, q̈.

    Segments between knots of the motion are halved, at such a knot where one lies near the middle,
    until the measured deviation of every axis is within the tolerance (pulses), and no cubic runs
    back where the motion does not. Who is told more than q has a knot wherever q̈ jumps: across a
    jump the interpolation bends more than the motion does. With a spacing (s) they are even,
    whatever error that makes, and the last outlasts the motion.

    step     s, every knot is a whole number of them
    longest  steps that a segment may last
    Raises MotionError where the motion lasts no time, or a tolerance or spacing is out of the
    possible.
    """
    if tolerance is not None and spacing is not None:
        raise MotionError("tolerance and spacing exclude each other; give one of them")
    end = ceil(motion.duration / step * (1 - 1e-15))
    if end < 1:
        raise MotionError(
            f"motion of {motion.duration:.4g} s: there is nothing to export; let the program move"
        )
    if spacing is not None:
        return Knots(_even_steps(end, spacing, step, longest), step, None)
    wanted = TOLERANCE if tolerance is None else tolerance
    if not (isfinite(wanted) and wanted > 0):
        raise MotionError(f"tolerance {wanted:g} pulses: must be above 0")
    marks, starts = _mark_steps(motion, step, end, np.array([axis.pulse for axis in axes]))
    if rows > 1:
        jumps = np.rint(motion.knots[find_jumps(motion, axes)] / step).astype(np.int64)
        starts = np.union1d(starts, jumps[jumps < end])
    starts = _cut_long_segments(starts, min(ceil(MAX_SEGMENT_DURATION / step), longest or end))
    parts = [starts[:1]]
    for first in range(0, len(starts) - 1, GROUP_BATCH):
        group = starts[first : first + GROUP_BATCH + 1]
        parts.append(_refine_segments(motion, axes, rows, step, wanted, marks, group))
    return Knots(np.concatenate(parts), step, wanted)


@dataclass(frozen=True, slots=True)
class KnotFormat:
    """The options of formats that are told the motion at knots."""

    tolerance: float | None = option(
        None,
        "largest error of the reader's interpolation, in pulses; sets the spacing. Default 0.5",
    )
    spacing: float | None = option(
        None, "fixed time between points instead; the resulting error is reported", "s"
    )

    def knots(
        self, source: ExportSource, rows: int, step: float, longest: int | None = None
    ) -> Knots:
        """Those that the options choose (`choose_knots`)."""
        return choose_knots(
            source.counted,
            source.machine.axes,
            rows,
            step=step,
            tolerance=self.tolerance,
            spacing=self.spacing,
            longest=longest,
        )


def _even_steps(end: int, spacing: float, step: float, longest: int | None) -> Steps:
    each = round(spacing / step) if isfinite(spacing) else 0
    if each < 1 or end / each > MAX_KNOTS or (longest is not None and each > longest):
        given, least, most = format_distinct(
            spacing, max(step, end * step / MAX_KNOTS), (longest or 0) * step, digits=10
        )
        upper = "" if longest is None else f" and at most {most} s"
        raise MotionError(f"spacing {given} s: must be at least {least} s{upper}; choose another")
    return np.arange(0, end + each, each)


def _mark_steps(motion: AxesMotion, step: float, end: int, pulse: Array) -> tuple[Steps, Steps]:
    """The motion's knots in steps, and those that part the first segments: ends of rests, every
    GROUP_PIECES-th from there.

    The ends of a rest are moved into it, where speeds are 0: a long cubic magnifies what is left of
    one.
    """
    t = motion.knots
    rest, between = (_is_resting(motion, when, pulse) for when in (t, (t[1:] + t[:-1]) / 2))
    between &= rest[1:] & rest[:-1]
    before, after = np.append(False, between), np.append(between, False)
    exact = t / step
    steps = np.where(
        after & ~before, np.ceil(exact), np.where(before & ~after, np.floor(exact), np.rint(exact))
    )
    steps = np.where(t < motion.duration, steps, end).astype(np.int64)
    near = (steps == end - 1) & (end > 1)  # a rounded end
    index = np.arange(len(t))
    since = index - np.maximum.accumulate(np.where(rest, index, 0))
    parting = (since % GROUP_PIECES == 0) & ~(before & after)
    return np.union1d(steps[~near], [0, end]), np.union1d(steps[parting & ~near], [0, end])


def find_jumps(motion: AxesMotion, axes: tuple[Axis, ...]) -> NDArray[np.bool_]:
    """(M+1,) the knots where q̈ of an axis jumps by more than JUMP_SHARE of its largest; none at
    order 3.
    """
    sides = [
        np.stack([motion.at(np.nextafter(t, 0)).qdd, motion.at(t).qdd])
        for t in _batches(motion.knots)
    ]
    before, after = np.concatenate(sides, axis=1)
    least = np.maximum(
        JUMP_SHARE * abs(after).max(0), [REST_ACCELERATION * axis.pulse for axis in axes]
    )
    return np.asarray((abs(after - before) > least).any(1))


def _is_resting(motion: AxesMotion, t: Array, pulse: Array) -> NDArray[np.bool_]:
    """Whether every axis stands at t (N,), a batch at a time."""
    return np.concatenate(
        [(abs(motion.at(part).qd) <= REST_SPEED * pulse).all(1) for part in _batches(t)]
    )


def _cut_long_segments(starts: Steps, longest: int) -> Steps:
    """Cut segments longer than `longest` into equal parts."""
    length = np.diff(starts)
    parts = -(-length // longest)
    which = np.repeat(np.arange(len(length)), parts)
    nth = np.arange(len(which)) - np.repeat(np.cumsum(parts) - parts, parts)
    # length · nth // parts, of which the product would overflow: 84 h in ns, cut into 30 000 parts
    each, rest = np.divmod(length, parts)
    return np.append(
        starts[which] + each[which] * nth + rest[which] * nth // parts[which], starts[-1]
    )


def _refine_segments(
    motion: AxesMotion,
    axes: tuple[Axis, ...],
    rows: int,
    step: float,
    tolerance: float,
    marks: Steps,
    group: Steps,
) -> Steps:
    """The ends of the segments into which a row of adjacent ones is halved."""
    pulse = np.array([axis.pulse for axis in axes])
    left, right = group[:-1], group[1:]
    done = []
    while len(left):
        share = np.concatenate(
            [
                _tolerance_use(
                    motion,
                    rows,
                    steps_to_seconds(lo, step),
                    steps_to_seconds(hi, step),
                    pulse,
                    tolerance,
                )
                for lo, hi in zip(_batches(left), _batches(right), strict=True)
            ]
        )
        fits = (share <= 1).all(1)
        done.append(right[fits])
        left, right, share = left[~fits], right[~fits], share[~fits]
        if (right - left < 2).any():
            segment = int(np.argmin(right - left))
            raise MotionError(
                f"axis {axes[int(share[segment].argmax())].name}: no spacing of whole {step:.4g} s keeps the reader "
                f"within {tolerance:g} pulses at {left[segment] * step:.6g} s; give a greater tolerance, or a spacing"
            )
        middle = _find_middles(marks, left, right)
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
    return np.sort(np.concatenate(done))


def _batches(values: NDArray[Any]) -> list[NDArray[Any]]:
    return np.array_split(values, -(-len(values) // (GROUP_BATCH * SEGMENT_PROBES)))


def _tolerance_use(
    motion: AxesMotion, rows: int, start: Array, end: Array, pulse: Array, tolerance: float
) -> Array:
    """(S, axes) what segments use of what they may: above 1 one is too long."""
    segments = Segments(start, end, rows_at(motion, start, rows), rows_at(motion, end, rows))
    off = segments.deviation(motion, SEGMENT_PROBES) / (SPACING_SHARE * tolerance)
    back = segments.backward_way(motion, SEGMENT_PROBES) / MAX_BACKWARD_PULSES
    return np.maximum(off, back) / pulse


def _find_middles(marks: Steps, left: Steps, right: Steps) -> Steps:
    """Where segments are halved: at the mark nearest the middle if it is in the middle half, else
    in the middle.
    """
    middle = (left + right) // 2
    after = np.clip(np.searchsorted(marks, middle), 1, len(marks) - 1)
    below, above = marks[after - 1], marks[after]
    near = np.where(middle - below <= above - middle, below, above)
    inside = (abs(near - middle) * 4 <= right - left) & (near > left) & (near < right)
    return np.where(inside, near, middle)


CHECK_PROBES = 16  # parts of a segment, and
PROBES_PER_PIECE = 4  # of every piece of the motion inside it
INSTANT_BATCH = 1 << 16  # compared together
READ = {1: "straight", 2: "cubic", 3: "quintic"}


def compare(
    motion: AxesMotion,
    axes: tuple[Axis, ...],
    knots: Knots,
    points: Iterable[tuple[Array, Array]],
    notes: tuple[str, ...],
) -> Exported:
    """What the points of a decoded file are from a motion.

    points  in blocks, in order: t (K,) s from the start, and what is stated there (rows, K, axes),
            m or rad
    Raises MotionError where that is more than the tolerance for which the knots were chosen.
    """
    pulse = np.array([axis.pulse for axis in axes])
    worst, back, backs, rows, moves = 0.0, 0.0, 0, 0, 0
    t, stated = np.empty(0), np.empty((0, 0, 0))
    for after, further in points:
        rows = len(further)
        t = np.concatenate([t[-1:], after])
        stated = np.concatenate([stated[:, -1:], further], 1) if stated.size else further
        moves += int(np.diff(stated[0], axis=0).any(1).sum())
        for part in _parts(motion, t):
            ends = slice(part.start + 1, part.stop + 1)
            segments = Segments(t[part], t[ends], stated[:, part], stated[:, ends])
            probes = _probes(motion, segments.start, segments.end)
            worst = max(worst, float((segments.deviation(motion, probes) / pulse).max()))
            runs = (segments.backward_way(motion, probes) / pulse).max(1)
            back, backs = (
                max(back, float(runs.max())),
                backs + int((runs > 2 * MAX_BACKWARD_PULSES).sum()),
            )
    if knots.tolerance is not None and not worst <= knots.tolerance:
        off, most = format_distinct(worst, knots.tolerance, digits=4)
        raise MotionError(
            f"decoded file: {off} pulses from the motion, more than the tolerance {most}; "
            "give a greater tolerance, or a spacing"
        )
    if backs:
        notes += (
            f"segments that run back where the motion does not, their speeds too high for their way: {backs}, by up to "
            f"{back:.3g} pulses; a smaller spacing mends that",
        )
    return Exported(
        worst, f"the motion, {READ[rows]} between the points", (knots.describe(), *notes), moves
    )


def _probes(motion: AxesMotion, start: Array, end: Array) -> int:
    pieces = np.searchsorted(motion.knots, end) - np.searchsorted(motion.knots, start)
    return max(CHECK_PROBES, PROBES_PER_PIECE * int(pieces.max()))


def _parts(motion: AxesMotion, t: Array) -> Iterable[slice]:
    """Runs of segments of which all instants are compared together."""
    first, last = 0, len(t) - 1
    size = (
        max(1, INSTANT_BATCH // max(CHECK_PROBES, _probes(motion, t[:-1], t[1:])))
        if last > 0
        else 1
    )
    for lo in range(first, last, size):
        yield slice(lo, min(lo + size, last))
