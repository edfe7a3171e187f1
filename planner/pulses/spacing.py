"""Room for the drive: pulses that fall closer together than its inputs take are moved apart, by the least that does."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kinematics.array import Array
from kinematics.axis import Axis
from kinematics.step_timing import StepTiming, whole
from kinematics.units import at_least
from planner.place import Infeasible, Place
from planner.pulses.motion import Motion
from planner.pulses.schedule import AxisPulses, Moved, PulseSchedule, Ticks

# Pulses by which moving may widen a count's bound; what needs more is no matter of a few ticks.
MOST = 0.5
# Instants looked at between where a pulse was and where it goes: the motion may turn there.
LOOKED = 9


def spaced(schedule: PulseSchedule, motion: Motion, axes: Sequence[Axis]) -> PulseSchedule:
    """The schedule with the pulses of every axis as far apart as its `timing` asks, those the other way farther.

    The largest shift is the least possible: with G the sum of the gaps needed up to each pulse and y = t - G, the new
    y is half-way between the largest before and the smallest after, the monotone sequence nearest to y in its worst
    entry. Raises Infeasible where a count would be off by more than half a pulse beyond its bound.
    """
    kept, moves = [], list(schedule.moves)
    for k, (pulses, axis) in enumerate(zip(schedule.axes, axes, strict=True)):
        if axis.timing is None or not len(pulses):
            kept.append(pulses)
            continue
        ticks = _apart(pulses, axis.timing, schedule)
        late = np.flatnonzero(ticks != pulses.ticks)
        if not len(late):
            kept.append(pulses)
            continue
        error = _travel(motion, k, pulses, ticks[late], late, schedule)
        worst = int(np.argmax(error))
        t = float(pulses.ticks[late[worst]]) / schedule.clock_hz
        if error[worst] > MOST:
            raise _refusal(motion, axis, axis.timing, pulses, int(late[worst]), schedule.clock_hz)
        farthest = float(abs(ticks - pulses.ticks).max()) / schedule.clock_hz
        widened = float(error[worst])
        moves.append(Moved(axis.name, len(late), farthest, widened, t, widened * axis.pulse))
        kept.append(replace(pulses, ticks=ticks, bound=pulses.bound + widened))
    return replace(schedule, axes=tuple(kept), moves=tuple(moves))


def _apart(pulses: AxisPulses, timing: StepTiming, schedule: PulseSchedule) -> Ticks:
    clock = schedule.clock_hz
    straight, back = timing.ticks(clock)
    setup = whole(timing.setup, clock)
    turns = pulses.direction[1:] != pulses.direction[:-1]
    needed = np.concatenate([[0], np.cumsum(np.where(turns, back, straight))])
    free = pulses.ticks - needed
    before = np.maximum.accumulate(free)
    after = np.minimum.accumulate(free[::-1])[::-1]
    last = int(schedule.duration * clock) - needed[-1]  # before the first pulse DIR is set up, after the end is none
    ticks: Ticks = np.clip((before + after) // 2, setup, max(last, setup)) + needed
    return ticks


def _travel(
    motion: Motion, k: int, pulses: AxisPulses, ticks: Ticks, which: np.ndarray, schedule: PulseSchedule
) -> Array:
    """(N,) pulses that the motion runs from where the chosen pulses were to where they go."""
    old, new = pulses.ticks[which], ticks
    share = np.linspace(0.0, 1.0, LOOKED)
    t = np.minimum((old + (new - old) * share[:, None]) / schedule.clock_hz, motion.duration)
    x = motion.at(t.ravel()).q[:, k].reshape(t.shape) / pulses.pulse
    travel: Array = abs(x - x[0]).max(axis=0)
    return travel


def _refusal(
    motion: Motion, axis: Axis, timing: StepTiming, pulses: AxisPulses, which: int, clock_hz: int
) -> Infeasible:
    """What the drive's inputs cannot take: where, how fast, and what would."""
    straight, back = timing.ticks(clock_hz)
    # of the times up to each pulse, the first from when DIR is set, the one too short that is nearest to the one moved
    turns = np.concatenate([[False], pulses.direction[1:] != pulses.direction[:-1]])
    had = np.diff(pulses.ticks, prepend=0)
    needed = np.where(turns, back, straight)
    needed[0] = whole(timing.setup, clock_hz)
    short = np.flatnonzero(had < needed)
    first = int(short[np.argmin(abs(short - which))])
    t, time, least = float(pulses.ticks[first]) / clock_hz, had[first] / clock_hz, needed[first] / clock_hz
    place = Place(float(motion.at(np.array([min(t, motion.duration)])).s[0]), t=t, axis=axis.name)
    what, limit = "drive timing", 1 / least
    if first == 0:
        what = "direction set-up before the first pulse"
        remedy = (
            f"its drive needs DIR {1e6 * timing.setup:.4g} us before STEP, and the first pulse is due after "
            f"{1e6 * time:.4g}: let the program begin with a dwell of {at_least(least - time + 1 / clock_hz)} s"
        )
    elif turns[first]:
        what, limit = "drive timing at a reversal", 1 / timing.reversal
        remedy = (
            f"its drive needs {1e6 * timing.reversal:.4g} us from a pulse to the next one the other way: let the axis "
            f"rest there for {at_least(timing.reversal)} s (a dwell), use a longer pulse, or hysteresis at reversals"
        )
    else:
        limit = timing.rate
        remedy = (
            f"its drive takes {timing.rate:.4g} pulses/s one way, so no pulse sooner than {1e6 * least:.4g} us after "
            f"another, and one comes after {1e6 * time:.4g}: "
            f"slow the motion there to {100 * time / least:.4g} % or less, "
            f"use a pulse {at_least(least / max(time, 1 / clock_hz))} times as long, or a rule that fires no faster"
        )
    return Infeasible(what, axis.name, place, 1 / max(time, 1 / clock_hz), limit, "1/s", remedy)
