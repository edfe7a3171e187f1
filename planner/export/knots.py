"""At which instants a motion is stated, so that what a consumer makes of it stays within a tolerance."""

from dataclasses import dataclass
from math import ceil, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.array import Array
from kinematics.axis import Axis
from kinematics.errors import MotionError
from kinematics.units import apart
from planner.export.format import option
from planner.export.hermite import Segments
from planner.pulses.motion import Motion

TOLERANCE = 0.5  # pulses
CHOSEN = 0.98  # of the tolerance is for the spacing, the rest for rounding
BACKWARD = 0.01  # pulses that a segment may run back where the motion does not: rounding makes that much
STANDING = 1.0  # pulses/s, slower is rest
GROUP = 8  # pieces of the motion that one segment may span, so that no probe misses a swing
PROBES = 8  # parts of a segment that is tried
LONGEST = 10.0  # s, so that rounded speeds do not lead astray
WINDOW = 256  # groups refined together
MOST = 1 << 27  # points

Steps = NDArray[np.int64]


def tolerance_option() -> Any:
    return option(None, "pulses that the reader's interpolation may be off; sets the spacing. Default 0.5")


def spacing_option() -> Any:
    return option(None, "even time between points instead; what error that makes is told", "s")


@dataclass(frozen=True, slots=True)
class Knots:
    """Whole time steps (K,) from 0 on, of `step` s each; the last is the end of the motion, or the next after it.

    tolerance  pulses, that they were chosen for; None where their spacing was given
    """

    steps: Steps
    step: float
    tolerance: float | None

    def stated(self) -> str:
        """How many segments, and how long they are."""
        length = np.diff(self.steps) * (1e3 * self.step)
        least, most = f"{length.min():.4g}", f"{length.max():.4g}"
        return f"segments: {len(length)}, of {least if least == most else f'{least} to {most}'} ms"


def seconds(steps: Steps, step: float) -> Array:
    return np.asarray(steps * step)


def rows_at(motion: Motion, t: Array, rows: int) -> Array:
    """(rows, N, axes) q, then q̇, then q̈ at instants t (N,); after the end they are as at the end."""
    state = motion.at(np.minimum(t, motion.duration))
    return np.stack([state.q, state.qd, state.qdd][:rows])


def refuse_moving_ends(motion: Motion, axes: tuple[Axis, ...], format_: str) -> None:
    """Raise MotionError unless every axis starts and ends at rest."""
    speeds = motion.at(np.array([0.0, motion.duration])).qd
    for axis, column in zip(axes, speeds.T, strict=True):
        for speed, end in zip(column.tolist(), ("starts", "ends"), strict=True):
            if abs(speed) > STANDING * axis.pulse:
                raise MotionError(
                    f"axis {axis.name}: {end} at {speed:.4g} {axis.unit}/s, but {format_} is from rest to rest; "
                    "let the program start and end at rest"
                )


def choose(
    motion: Motion,
    axes: tuple[Axis, ...],
    rows: int,
    *,
    step: float,
    tolerance: float | None,
    spacing: float | None,
    longest: int | None = None,
) -> Knots:
    """Knots for a consumer that is told `rows` of q, q̇, q̈.

    Segments between knots of the motion are halved, at such a knot where one lies near the middle, until the measured
    deviation of every axis is within the tolerance (pulses), and no cubic runs back where the motion does not. With a
    spacing (s) they are even, whatever error that makes, and the last outlasts the motion.

    step     s, every knot is a whole number of them
    longest  steps that a segment may last
    Raises MotionError where the motion lasts no time, or a tolerance or spacing is out of the possible.
    """
    if tolerance is not None and spacing is not None:
        raise MotionError("tolerance and spacing exclude each other; give one of them")
    end = ceil(motion.duration / step * (1 - 1e-15))
    if end < 1:
        raise MotionError(f"motion of {motion.duration:.4g} s: there is nothing to export; let the program move")
    if spacing is not None:
        return Knots(_even(end, spacing, step, longest), step, None)
    wanted = TOLERANCE if tolerance is None else tolerance
    if not (isfinite(wanted) and wanted > 0):
        raise MotionError(f"tolerance {wanted:g} pulses: must be above 0")
    marks, starts = _marks(motion, step, end, np.array([axis.pulse for axis in axes]))
    starts = _cut(starts, min(ceil(LONGEST / step), longest or end))
    parts = [starts[:1]]
    for first in range(0, len(starts) - 1, WINDOW):
        group = starts[first : first + WINDOW + 1]
        parts.append(_refined(motion, axes, rows, step, wanted, marks, group))
    return Knots(np.concatenate(parts), step, wanted)


def _even(end: int, spacing: float, step: float, longest: int | None) -> Steps:
    each = round(spacing / step) if isfinite(spacing) else 0
    if each < 1 or end / each > MOST or (longest is not None and each > longest):
        given, least, most = apart(spacing, max(step, end * step / MOST), (longest or 0) * step, digits=10)
        upper = "" if longest is None else f" and at most {most} s"
        raise MotionError(f"spacing {given} s: must be at least {least} s{upper}; choose another")
    return np.arange(0, end + each, each)


def _marks(motion: Motion, step: float, end: int, pulse: Array) -> tuple[Steps, Steps]:
    """The motion's knots in steps, and those that part the first segments: ends of rests, every GROUP-th from there.

    The ends of a rest are moved into it, where speeds are 0: a long cubic magnifies what is left of one.
    """
    t = motion.knots
    rest, between = (_resting(motion, when, pulse) for when in (t, (t[1:] + t[:-1]) / 2))
    between &= rest[1:] & rest[:-1]
    before, after = np.append(False, between), np.append(between, False)
    exact = t / step
    steps = np.where(after & ~before, np.ceil(exact), np.where(before & ~after, np.floor(exact), np.rint(exact)))
    steps = np.where(t < motion.duration, steps, end).astype(np.int64)
    near = (steps == end - 1) & (end > 1)  # a rounded end
    index = np.arange(len(t))
    since = index - np.maximum.accumulate(np.where(rest, index, 0))
    parting = (since % GROUP == 0) & ~(before & after)
    return np.union1d(steps[~near], [0, end]), np.union1d(steps[parting & ~near], [0, end])


def _resting(motion: Motion, t: Array, pulse: Array) -> NDArray[np.bool_]:
    """Whether every axis stands at t (N,), a batch at a time."""
    parts = np.array_split(t, -(-len(t) // (WINDOW * PROBES)))
    return np.concatenate([(abs(motion.at(part).qd) <= STANDING * pulse).all(1) for part in parts])


def _cut(starts: Steps, longest: int) -> Steps:
    """The segments with those longer than `longest` cut into equal parts."""
    length = np.diff(starts)
    parts = -(-length // longest)
    which = np.repeat(np.arange(len(length)), parts)
    nth = np.arange(len(which)) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(starts[which] + length[which] * nth // parts[which], starts[-1])


def _refined(
    motion: Motion, axes: tuple[Axis, ...], rows: int, step: float, tolerance: float, marks: Steps, group: Steps
) -> Steps:
    """The ends of the segments into which a row of adjacent ones is halved."""
    pulse = np.array([axis.pulse for axis in axes])
    left, right = group[:-1], group[1:]
    done = []
    while len(left):
        share = np.concatenate(
            [
                _use(motion, rows, seconds(lo, step), seconds(hi, step), pulse, tolerance)
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
        middle = _middle(marks, left, right)
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
    return np.sort(np.concatenate(done))


def _batches(steps: Steps) -> list[Steps]:
    return np.array_split(steps, -(-len(steps) // (WINDOW * PROBES)))


def _use(motion: Motion, rows: int, start: Array, end: Array, pulse: Array, tolerance: float) -> Array:
    """(S, axes) what segments use of what they may: above 1 one is too long."""
    segments = Segments(start, end, rows_at(motion, start, rows), rows_at(motion, end, rows))
    off = segments.deviation(motion, PROBES) / (CHOSEN * tolerance)
    back = segments.backward(motion, PROBES) / BACKWARD
    return np.maximum(off, back) / pulse


def _middle(marks: Steps, left: Steps, right: Steps) -> Steps:
    """Where segments are halved: at the mark nearest the middle if it is in the middle half, else in the middle."""
    middle = (left + right) // 2
    after = np.clip(np.searchsorted(marks, middle), 1, len(marks) - 1)
    below, above = marks[after - 1], marks[after]
    near = np.where(middle - below <= above - middle, below, above)
    inside = (abs(near - middle) * 4 <= right - left) & (near > left) & (near < right)
    return np.where(inside, near, middle)
