"""The ramp of [Sasidhar 1981, 5.2]: the count of the timer is changed by a constant after each
pulse.

Between two rests of an axis, N pulses share T timer counts, as many as the motion has. With the
least count m of the motion and the constant d, the counts from pulse to pulse are

    m + d R, m + d (R - 1), …, m + d,  m, …, m,  m + d, …, m + d R,   in all  N m + d R (R + 1)

with the largest R that fits into T. A run too short for both ramps is split into two equal halves,
of R = N/2 pulses each, and m becomes as large as T allows.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, floor, isqrt

import numpy as np

from kinematics.foundation.errors import MotionError
from planner.pulses.generation.levels import Levels, find_crossings
from planner.pulses.generation.motion_parts import Fired, MotionPart
from planner.pulses.motion import AxesMotion
from planner.pulses.schedule import AxisPulses, Ticks

BISECTIONS = 60
"""Halvings that find an instant of rest to rounding."""
LOOKS = 512
"""Instants of a run at which its speed is looked at, besides the knots in it."""
REST_SHARE = 1e-9
"""Of an axis' highest speed: below it the axis rests."""


@dataclass(frozen=True, slots=True)
class Run:
    """Pulses first to last of an axis, all one way, between two rests at begin and end (s)."""

    first: int
    last: int
    begin: float
    end: float

    @property
    def pulses(self) -> int:
        return self.last - self.first


def fire_equal_steps(part: MotionPart, timer: int, step: int, grain: int) -> Fired:
    """Return the pulses of a whole motion, each axis' counts changed by `step` from pulse to pulse.

    timer  Hz of the timer, of which one count is `grain` ticks of the pulses' clock

    Raises MotionError for a timer that is slower than an axis' pulses.
    """
    crossings = find_crossings(part, Levels(0.5))
    fired = []
    for k, crossed in enumerate(crossings.axes):
        ticks = [
            _time_run(part.motion, run, k, crossed, (timer, step)) * grain
            for run in find_runs(part.motion, k, crossed, part.clock_hz)
        ]
        joined = np.concatenate([np.zeros(0, np.int64), *ticks])
        bound = _measure_bound(part, k, replace(crossed, ticks=joined))
        fired.append(replace(crossed, ticks=joined, bound=bound))
        part.tell(k + 1, len(crossings.axes))
    return replace(crossings, axes=tuple(fired))


def find_runs(motion: AxesMotion, k: int, crossed: AxisPulses, clock_hz: int) -> Iterator[Run]:
    """Find the runs of axis k: from rest to rest, all pulses one way.

    crossed  the axis' pulses where the motion crosses their levels
    """
    knots = np.asarray(motion.knots, float)
    speeds = motion.at(knots).qd[:, k]
    rests = knots[np.abs(speeds) <= REST_SHARE * np.abs(speeds).max(initial=0.0)]
    rests = np.unique(np.concatenate([[0.0], rests, [motion.duration]]))
    times = np.minimum(crossed.ticks / clock_hz, motion.duration)
    # a run ends where the next pulse goes the other way, or where the axis rests before it
    turned = np.diff(crossed.direction) != 0
    rested = np.diff(np.searchsorted(rests, times, side="right")) != 0
    cuts = np.flatnonzero(turned | rested) + 1
    turns = {int(n): _find_turn(motion, k, times[n - 1], times[n]) for n in cuts if turned[n - 1]}
    edges = [0, *cuts.tolist(), len(times)]
    for first, last in pairwise(edges):
        if first == last:
            continue
        before = rests[np.searchsorted(rests, times[first], side="right") - 1]
        after = rests[min(np.searchsorted(rests, times[last - 1], side="left"), len(rests) - 1)]
        begin = max(float(before), turns.get(first, 0.0))
        end = min(float(after), turns.get(last, motion.duration))
        yield Run(first, last, begin, end)


def _find_turn(motion: AxesMotion, k: int, low: float, high: float) -> float:
    """Return the instant between two pulses at which axis k turns round, in s."""
    way = np.sign(motion.at(np.array([low])).qd[0, k])
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        if np.sign(motion.at(np.array([middle])).qd[0, k]) == way:
            low = middle
        else:
            high = middle
    return low


def _time_run(
    motion: AxesMotion, run: Run, k: int, crossed: AxisPulses, ramp: tuple[int, int]
) -> Ticks:
    """Return the timer's counts (N,) from the start of the motion to each pulse of a run."""
    timer, step = ramp
    begin, end = ceil(run.begin * timer - 1e-6), floor(run.end * timer + 1e-6)
    knots = np.asarray(motion.knots, float)
    inside = knots[(knots > run.begin) & (knots < run.end)]
    looks = np.concatenate([np.linspace(run.begin, run.end, LOOKS), inside])
    rate = float(np.abs(motion.at(looks).qd[:, k]).max()) / crossed.pulse
    least = ceil(timer / rate) if rate > 0 else end - begin
    counts = share_counts(run.pulses, end - begin, least, step)
    if counts is None:
        raise MotionError(
            f"axis {crossed.name}: {run.pulses} pulses in {run.end - run.begin:.6g} s near t = {run.begin:.6g} s are "
            f"more than a timer of {timer} Hz can count; use a faster timer clock, or slow the motion"
        )
    # what the ramps leave of the time is shared by both ends
    idle = (end - begin - int(counts.sum())) // 2
    return begin + idle + np.cumsum(counts)


def share_counts(pulses: int, total: int, least: int, step: int) -> Ticks | None:
    """Return the counts (pulses,) of a run of `total` counts, none below `least`; None where they
    do not fit.

    The least count gives way where it does not leave a count for each pulse.
    """
    if total < pulses:
        return None
    least = min(least, total // pulses)
    # the largest R with step·R (R + 1) ≤ total − pulses·least
    room = (total - pulses * least) // step
    ramp = (isqrt(4 * room + 1) - 1) // 2
    if 2 * ramp > pulses:
        ramp = pulses // 2
        least = (total - step * ramp * (ramp + 1)) // pulses
    counts = np.full(pulses, least, np.int64)
    rise = step * np.arange(ramp, 0, -1, dtype=np.int64)
    counts[:ramp] += rise
    counts[pulses - ramp :] += rise[::-1]
    return counts


def _measure_bound(part: MotionPart, k: int, axis: AxisPulses) -> float:
    """Return by how many pulses the count and the motion of axis k differ at most.

    Between two pulses an axis of one run goes one way, so the difference is largest at a pulse, or
    at a rest.
    """
    knots = np.asarray(part.motion.knots, float)
    t = np.concatenate([knots, np.minimum(axis.ticks / part.clock_hz, part.motion.duration)])
    x = (part.motion.at(t).q[:, k] - axis.home) / axis.pulse
    ticks = np.concatenate([np.round(knots * part.clock_hz).astype(np.int64), axis.ticks])
    after = axis.counts(ticks)
    before = axis.counts(ticks - 1)
    off = np.maximum(np.abs(x - after), np.abs(x - before)).max(initial=0.0)
    return float(max(off, 0.5)) + 1e-6
