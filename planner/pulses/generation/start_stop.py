"""The start/stop rate of a stepper: up to it the motor starts, stops and turns at once [Sasidhar
1981, figure 3-2].

Beyond it (the slew region) the rate may only change gradually: from one interval between pulses to
the next at most by a factor of two, which motion at constant acceleration from rest stays below
(1.45 from the first to the second).
"""

from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.machine.axis import Axis
from planner.place import Infeasible, Place
from planner.pulses.schedule import AxisPulses, Ticks

MAX_RATE_RATIO = 2.0
"""Of the rates of two intervals in turn, beyond the start/stop rate."""
ROUNDING = 2.0
"""Ticks by which rounding changes the difference of two intervals."""


@dataclass(frozen=True, slots=True)
class Pace:
    """The last pulse of an axis so far, and the interval before it: ∞ at rest and after a turn;
    ticks.
    """

    tick: float = -np.inf
    interval: float = np.inf
    way: int = 0


def interval_at(axis: Axis, speed: float, clock_hz: int) -> float:
    """Return the ticks from pulse to pulse of an axis at a speed (m/s or rad/s); ∞ at rest."""
    return clock_hz * axis.pulse / abs(speed) if speed else np.inf


def begin_pace(axis: Axis, speed: float, clock_hz: int) -> Pace:
    """Return the pace of an axis that has a speed (m/s or rad/s) when its pulses begin."""
    interval = interval_at(axis, speed, clock_hz)
    return Pace(-interval, interval, int(np.sign(speed)))


def follow_pulses(
    pace: Pace, pulses: AxisPulses, axis: Axis, clock_hz: int, end: float | None
) -> Pace:
    """Return the pace after pulses; raise Infeasible where they start, stop or turn faster than the
    axis can.

    end  the interval in ticks with which the axis goes on after the last of them; None where more
         pulses follow
    """
    if axis.start_stop_rate is None or not len(pulses):
        return pace
    ticks = np.concatenate([[pace.tick], pulses.ticks])
    ways = np.concatenate([[pace.way or pulses.direction[0]], pulses.direction])
    turned = np.diff(ways) != 0
    intervals = np.where(turned, np.inf, np.diff(ticks))
    after = pulses.ticks
    if end is not None:
        intervals, after = np.append(intervals, end), np.append(after, after[-1])
    before = np.concatenate([[pace.interval], intervals[:-1]])
    _refuse_jump(before, intervals, after, axis, clock_hz)
    made = len(pulses) - 1
    return replace(
        pace, tick=float(ticks[-1]), interval=float(intervals[made]), way=int(pulses.direction[-1])
    )


def _refuse_jump(before: Array, after: Array, ticks: Ticks, axis: Axis, clock_hz: int) -> None:
    """Raise Infeasible at the first two intervals in turn that jump in rate beyond the start/stop
    rate.
    """
    least = clock_hz / (axis.start_stop_rate or np.inf)
    shorter, longer = np.minimum(before, after), np.maximum(before, after)
    jumps = np.flatnonzero(
        (shorter < least - ROUNDING) & (longer > MAX_RATE_RATIO * shorter + ROUNDING)
    )
    if not len(jumps):
        return
    n = int(jumps[0])
    place = Place(0.0, t=float(ticks[n]) / clock_hz, axis=axis.name)
    rate = float(clock_hz / shorter[n])
    remedy = "lower the axis' acceleration, or take another firing rule: the motor would lose steps"
    raise Infeasible(
        "start/stop rate", axis.name, place, rate, axis.start_stop_rate or 0.0, "1/s", remedy
    )
