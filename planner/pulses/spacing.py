"""Room between pulses: those closer together than their axis takes are moved apart, by the least that does."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kinematics.array import Array
from kinematics.axis import Axis, sides
from kinematics.step_timing import whole
from kinematics.units import at_least
from planner.place import Infeasible, Place
from planner.pulses.motion import Motion
from planner.pulses.schedule import AxisPulses, Moved, PulseSchedule, Ticks

# Pulses by which moving may widen a count's bound; what needs more is no matter of a few ticks.
MOST = 0.5
# Instants looked at between where a pulse was and where it goes: the motion may turn there.
LOOKED = 9


# s from a pulse to the next one the other way of an axis that states a speed alone: a STEP of 2 µs, and a low as long.
USUAL = 4e-6


def spaced(schedule: PulseSchedule, motion: Motion, axes: Sequence[Axis], grain: int = 1) -> PulseSchedule:
    """The schedule with the pulses of every axis as far apart as its pulse rate and its `timing` ask.

    Those the other way may have to be farther; where an axis states a speed alone, these are 4 µs apart, or as pulses
    at that speed are. grain: ticks, of which all pulses of an axis stay whole multiples apart. The largest shift
    is the least possible: with G the sum of the gaps needed up to each pulse and y = t - G, the new y is half-way
    between the largest before and the smallest after, the monotone sequence nearest to y in its worst entry. Raises
    Infeasible where a count would be off by more than half a pulse beyond its bound.
    """
    kept, moves = [], list(schedule.moves)
    for k, (pulses, axis) in enumerate(zip(schedule.axes, axes, strict=True)):
        if not len(pulses):
            kept.append(pulses)
            continue
        ticks = _apart(pulses, axis, schedule, grain)
        late = np.flatnonzero(ticks != pulses.ticks)
        if not len(late):
            kept.append(pulses)
            continue
        error = _travel(motion, k, pulses, ticks[late], late, schedule)
        worst = int(np.argmax(error))
        t = float(pulses.ticks[late[worst]]) / schedule.clock_hz
        if error[worst] > MOST:
            raise _refusal(motion, axis, pulses, int(late[worst]), schedule.clock_hz, grain)
        farthest = float(abs(ticks - pulses.ticks).max()) / schedule.clock_hz
        widened = float(error[worst])
        moves.append(Moved(axis.name, len(late), farthest, widened, t, widened * axis.pulse))
        kept.append(replace(pulses, ticks=ticks, bound=pulses.bound + widened))
    return replace(schedule, axes=tuple(kept), moves=tuple(moves))


def _apart(pulses: AxisPulses, axis: Axis, schedule: PulseSchedule, grain: int) -> Ticks:
    gaps, setup = _needed(pulses, axis, schedule.clock_hz, grain)
    if pulses.ticks[0] >= setup and (np.diff(pulses.ticks) >= gaps).all():
        return pulses.ticks
    offset = int(pulses.ticks[0]) % grain
    needed = np.concatenate([[0], np.cumsum(gaps)]) // grain
    free = (pulses.ticks - offset) // grain - needed
    before = np.maximum.accumulate(free)
    after = np.minimum.accumulate(free[::-1])[::-1]
    # before the first pulse DIR is set up, after the end is none
    first = -(-(setup - offset) // grain)
    last = (int(schedule.duration * schedule.clock_hz) - offset) // grain - needed[-1]
    ticks: Ticks = (np.clip((before + after) // 2, first, max(last, first)) + needed) * grain + offset
    return ticks


def _needed(pulses: AxisPulses, axis: Axis, clock_hz: int, grain: int) -> tuple[Ticks, int]:
    """(N-1,) ticks from each pulse to the next, at least; and from the start, when DIR is set, to the first."""
    straight, back = axis.pulse_ticks(clock_hz, grain)
    turns = pulses.direction[1:] != pulses.direction[:-1]
    if axis.max_pulse_rate is None and axis.timing is None and axis.max_speed is not None:
        least = whole(min(USUAL, axis.pulse / max(sides(axis.max_speed))), clock_hz)
        back = max(back, -(-least // grain) * grain)
    return np.where(turns, back, straight), whole(axis.timing.setup, clock_hz) if axis.timing is not None else 0


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


def _refusal(motion: Motion, axis: Axis, pulses: AxisPulses, which: int, clock_hz: int, grain: int) -> Infeasible:
    """What an axis cannot take: where, how fast, and what it would."""
    # of the times up to each pulse, the first from when DIR is set, the one too short that is nearest to the one moved
    gaps, setup = _needed(pulses, axis, clock_hz, grain)
    turns = np.concatenate([[False], pulses.direction[1:] != pulses.direction[:-1]])
    had, needed = np.diff(pulses.ticks, prepend=0), np.concatenate([[setup], gaps])
    short = np.flatnonzero(had < needed)
    first = int(short[np.argmin(abs(short - which))])
    t, time, least = float(pulses.ticks[first]) / clock_hz, had[first] / clock_hz, needed[first] / clock_hz
    place = Place(float(motion.at(np.array([min(t, motion.duration)])).s[0]), t=t, axis=axis.name)
    who = "it" if axis.timing is None else "its drive"
    what, limit = "pulse rate" if axis.timing is None else "drive timing", 1 / least
    if first == 0:
        what = "direction set-up before the first pulse"
        remedy = (
            f"its drive needs DIR {1e6 * least:.4g} us before STEP, and the first pulse is due after "
            f"{1e6 * time:.4g}: let the program begin with a dwell of {at_least(least - time + 1 / clock_hz)} s"
        )
    elif turns[first]:
        what += " at a reversal"
        remedy = (
            f"{who} needs {1e6 * least:.4g} us from a pulse to the next one the other way: let the axis "
            f"rest there for {at_least(least)} s (a dwell), use a longer pulse, or hysteresis at reversals "
            '(rule "nearest:hysteresis=0.2")'
        )
    else:
        limit = min(limit, axis.pulse_rate)
        remedy = (
            f"{who} takes {limit:.4g} pulses/s one way, so no pulse sooner than {1e6 * least:.4g} us after "
            f"another, and one comes after {1e6 * time:.4g}: "
            f"slow the motion there to {100 * time / least:.4g} % or less, "
            f"use a pulse {at_least(least / max(time, 1 / clock_hz))} times as long, or a rule that fires no faster"
        )
    return Infeasible(what, axis.name, place, 1 / max(time, 1 / clock_hz), limit, "1/s", remedy)
