"""Least times on the lines of STEP and DIR, for pulses that have been checked and have no lines
yet.

Pulses state when STEP rises. How long it stays high depends on the program that makes the lines:
here, the pulse CSV. STEP is high for one width on all axes. DIR changes when STEP falls or the hold
of the drive is over, whichever is later, and for the first pulse at time 0.
"""

from collections.abc import Sequence
from math import inf, isfinite

from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from planner.export.formats.pulse_csv import Spacing, high_ticks, turn_ticks
from planner.pulses.checking.verdict import LineTimes, PulseCheck


def time_lines(
    found: PulseCheck, clock_hz: int, axes: Sequence[Axis]
) -> tuple[LineTimes | None, ...]:
    """Return the least times on the lines of each axis: as its file was read, else from the check's
    figures.

    With the width w of STEP and the delay d of DIR after a pulse: high = w, low = interval - w, and
    where the axis turns back setup = min(reversal - d, first) and hold = d. None where no width
    fits between the pulses.
    """
    if all(axis.lines is not None for axis in found.axes):
        return tuple(axis.lines for axis in found.axes)
    closest = [_ticks(axis.smallest_interval, clock_hz) for axis in found.axes]
    back = [_ticks(axis.smallest_reversal, clock_hz) for axis in found.axes]
    known = [ticks for ticks in closest if ticks is not None]
    spacing = Spacing(clock_hz, min(known, default=None), tuple(back), 0, (), ())
    try:
        timing = [axis.timing for axis in axes]
        width = high_ticks(spacing, None, timing)
        delays = turn_ticks(spacing, width, timing)
    except MotionError:
        return (None,) * len(found.axes)
    times = []
    for axis, least, turn, delay in zip(found.axes, closest, back, delays, strict=True):
        first = _ticks(axis.first, clock_hz)
        low = inf if least is None else least - width
        setup = min(inf if turn is None else turn - delay, inf if first is None else first)
        high, hold, interval = (
            inf if none else each
            for none, each in (
                (axis.pulses == 0, width),
                (turn is None, delay),
                (least is None, least or 0),
            )
        )
        times.append(
            LineTimes(
                axis.name, *(ticks / clock_hz for ticks in (high, low, setup, hold, interval))
            )
        )
    return tuple(axis.lines or made for axis, made in zip(found.axes, times, strict=True))


def _ticks(time: float, clock_hz: int) -> int | None:
    return round(time * clock_hz) if isfinite(time) else None
