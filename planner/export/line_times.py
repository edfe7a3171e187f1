"""The least times on the lines of STEP and DIR, of pulses that have been checked and have no lines yet.

Pulses state when STEP rises. How long it stays high is for whoever makes the lines: here, as the pulse CSV has them.
STEP is high for one width on all axes, and DIR changes when STEP falls, for the first pulse at time 0.
"""

from collections.abc import Sequence
from math import inf, isfinite

from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from planner.export.formats.pulse_csv import Spacing, high_ticks
from planner.pulses.checking.verdict import LineTimes, PulseCheck


def time_lines(found: PulseCheck, clock_hz: int, axes: Sequence[Axis]) -> tuple[LineTimes | None, ...]:
    """The least times on the lines of each axis: as its file was read, else as they follow from the check's figures.

    high = w, low = interval - w, setup = min(reversal - w, first), hold = w where the axis turns back, with the least
    interval, the least interval at a reversal and the time of the first pulse. None where no width fits between them.
    """
    if all(axis.lines is not None for axis in found.axes):
        return tuple(axis.lines for axis in found.axes)
    closest = [_ticks(axis.smallest_interval, clock_hz) for axis in found.axes]
    back = [_ticks(axis.smallest_reversal, clock_hz) for axis in found.axes]
    known = [ticks for ticks in closest if ticks is not None]
    spacing = Spacing(clock_hz, min(known, default=None), tuple(back), 0, (), ())
    try:
        width = high_ticks(spacing, None, [axis.timing for axis in axes])
    except MotionError:
        return (None,) * len(found.axes)
    times = []
    for axis, least, turn in zip(found.axes, closest, back, strict=True):
        first = _ticks(axis.first, clock_hz)
        low = inf if least is None else least - width
        setup = min(inf if turn is None else turn - width, inf if first is None else first)
        high, hold, interval = (
            inf if none else each
            for none, each in ((axis.pulses == 0, width), (turn is None, width), (least is None, least or 0))
        )
        times.append(LineTimes(axis.name, *(ticks / clock_hz for ticks in (high, low, setup, hold, interval))))
    return tuple(axis.lines or made for axis, made in zip(found.axes, times, strict=True))


def _ticks(time: float, clock_hz: int) -> int | None:
    return round(time * clock_hz) if isfinite(time) else None
