"""Pulses closer together than their axis takes are moved apart, by the least that does.

They are as far apart as the pulse rate and the `timing` of the axis ask; those the other way may
have to be farther. Where an axis states a speed alone, these are 4 µs apart, or as pulses at that
speed are. The largest shift is the least possible: with G the sum of the gaps needed up to each
pulse and y = t - G, the new y is half-way between the largest before and the smallest after, the
monotone sequence nearest to y in its worst entry.

What comes later moves a pulse only if no room is between: pulses of a part are held back for
HELD_GAPS gaps, and what was given before stays where it is.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import Array
from kinematics.foundation.units import round_up_digits
from kinematics.machine.axis import Axis, ceil_ticks, directional_bounds
from planner.place import Infeasible, Place
from planner.pulses.schedule import MovedPulses, Signs, Ticks

MAX_WIDENING = 0.5
"""Pulses by which moving may widen a count's bound; what needs more is no matter of a few ticks."""
TRAVEL_INSTANTS = 9
"""Looked at between where a pulse was and where it goes: the motion may turn there."""
DEFAULT_REVERSAL_GAP = 4e-6
"""s from a pulse to the next one the other way of an axis that states a speed alone: a STEP of 2
µs, a low as long.
"""
HELD_GAPS = 32
"""Of the longest gaps that an axis asks for: so long before the end of a part its pulses wait for
the next.
"""

Travel = Callable[[int, ArrayLike], tuple[Array, Array]]
"""(axis, ticks (N,)) -> its motion there in pulses (N,), and the path length."""


@dataclass(frozen=True, slots=True)
class GivenPulse:
    """The last pulse of an axis that was given: when it was due, when it comes and would come at
    the earliest if none were moved ahead (ticks), and its direction.

    A negative tick is one before the start, of another motion; stands: DIR is as that pulse asked
    for it still.
    """

    due: int
    tick: int
    earliest: int
    direction: int
    stands: bool = True


@dataclass(frozen=True, slots=True)
class HeldPulses:
    """What has been fired of an axis and may still be moved: ticks when it is due, and directions;
    given: before it.
    """

    ticks: Ticks
    direction: Signs
    given: GivenPulse | None = None


@dataclass(frozen=True, slots=True)
class LeastGaps:
    """Least ticks of an axis from a pulse to the next one the same way and the other way, and from
    the start, when DIR is set, to the first; all pulses stay whole multiples of `grain` apart.
    """

    straight: int
    back: int
    setup: int
    grain: int

    @classmethod
    def from_axis(cls, axis: Axis, clock_hz: int, grain: int) -> "LeastGaps":
        straight, back = axis.pulse_ticks(clock_hz, grain)
        if axis.max_pulse_rate is None and axis.timing is None and axis.max_speed is not None:
            least = min(DEFAULT_REVERSAL_GAP, axis.pulse / max(directional_bounds(axis.max_speed)))
            back = max(back, -(-ceil_ticks(least, clock_hz) // grain) * grain)
        return cls(
            straight,
            back,
            0 if axis.timing is None else ceil_ticks(axis.timing.setup, clock_hz),
            grain,
        )

    @property
    def hold(self) -> int:
        """Ticks for which pulses wait for those that may come."""
        return HELD_GAPS * max(self.straight, self.back, self.setup) + self.grain

    def list_needed(self, held: HeldPulses) -> Ticks:
        """(N,) ticks from the pulse before, at least: from the start to the first of all."""
        way = 0 if held.given is None else held.given.direction
        needed = np.where(np.diff(held.direction, prepend=way) != 0, self.back, self.straight)
        if held.given is None:
            needed[:1] = self.setup
        elif held.given.tick < 0 and (not held.given.stands or (held.direction[:1] != way).any()):
            # DIR is turned at the start of this motion, at the earliest
            needed[:1] = np.maximum(
                needed[:1], -(-(self.setup - held.given.tick) // self.grain) * self.grain
            )
        return np.asarray(needed, np.int64)

    def space(self, held: HeldPulses, since: int, end: int | None) -> tuple[Ticks, Ticks]:
        """(N,) ticks of the pulses held, none before `since` or behind the end, and the earliest
        that they might have.

        end: None where the motion goes on.
        """
        given, grain, due = held.given, self.grain, held.ticks
        gaps = self.list_needed(held)
        start = 0 if given is None else given.earliest
        if due[0] >= max(since, start + gaps[0]) and (np.diff(due) >= gaps[1:]).all():
            return due, due
        offset = int(due[0]) % grain
        if given is None:
            gaps[0] = 0
        needed = np.cumsum(gaps) // grain
        free = (due - offset) // grain - needed
        first = -(-(since - offset) // grain) - needed[0]
        if given is None:
            first = max(first, -(-(self.setup - offset) // grain))
            before = np.maximum.accumulate(free)
        else:
            first = max(first, -(-(given.tick - offset) // grain))
            before = np.maximum.accumulate(np.maximum(free, -(-(given.earliest - offset) // grain)))
        after = np.minimum.accumulate(free[::-1])[::-1]
        last = (
            np.iinfo(np.int64).max
            if end is None
            else max((end - offset) // grain - needed[-1], first)
        )
        spaced: Ticks = (np.clip((before + after) // 2, first, last) + needed) * grain + offset
        return spaced, (before + needed) * grain + offset


@dataclass(frozen=True, slots=True)
class Spaced:
    """Pulses of an axis that stay (N,), those that are still held, and what moving them costs so
    far.
    """

    ticks: Ticks
    direction: Signs
    held: HeldPulses
    moved: MovedPulses | None


def space_pulses(
    held: HeldPulses,
    k: int,
    axis: Axis,
    gaps: LeastGaps,
    clock_hz: int,
    travel: Travel,
    moved: MovedPulses | None = None,
    since: int = 0,
    until: int | None = None,
    end: int | None = None,
) -> Spaced:
    """The pulses of axis k before a tick, as far apart as it takes them; the others are held.

    since: before which all are given. until: None gives all. end: tick at which the motion ends, if
    it does. moved: what it cost before. Raises Infeasible where a count would be off by more than
    half a pulse beyond its bound.
    """
    if not len(held.ticks):
        return Spaced(held.ticks, held.direction, held, moved)
    ticks, earliest = gaps.space(held, since, end)
    count = len(ticks) if until is None else int(np.searchsorted(ticks, until))
    if not count:
        return Spaced(held.ticks[:0], held.direction[:0], held, moved)
    due, direction = held.ticks[:count], held.direction[:count]
    late = np.flatnonzero(ticks[:count] != due)
    if len(late):
        share = np.linspace(0.0, 1.0, TRAVEL_INSTANTS)
        seen = due[late] + (ticks[late] - due[late]) * share[:, None]
        x = travel(k, seen.ravel())[0].reshape(seen.shape)
        error = abs(x - x[0]).max(axis=0)
        worst = int(np.argmax(error))
        if error[worst] > MAX_WIDENING:
            raise _spacing_error(held, int(late[worst]), k, axis, gaps, clock_hz, travel)
        farthest, widened = (
            float(abs(ticks[late] - due[late]).max()) / clock_hz,
            float(error[worst]),
        )
        t = float(due[late[worst]]) / clock_hz
        if moved is not None:
            farthest = max(farthest, moved.time)
            widened, t = (widened, t) if widened > moved.error else (moved.error, moved.t)
        many = len(late) + (0 if moved is None else moved.pulses)
        moved = MovedPulses(axis.name, many, farthest, widened, t, widened * axis.pulse)
    due_at, tick, soonest, way = (
        int(each[count - 1]) for each in (due, ticks, earliest, direction)
    )
    given = GivenPulse(due_at, tick, soonest, way)
    rest = replace(held, ticks=held.ticks[count:], direction=held.direction[count:], given=given)
    return Spaced(ticks[:count], direction, rest, moved)


def _spacing_error(
    held: HeldPulses, which: int, k: int, axis: Axis, gaps: LeastGaps, clock_hz: int, travel: Travel
) -> Infeasible:
    """What an axis cannot take: where, how fast, and what it would."""
    # of the times up to each pulse, the first from when DIR is set, the one too short that is
    # nearest to the one moved
    had = np.diff(held.ticks, prepend=0 if held.given is None else held.given.due)
    needed = gaps.list_needed(held)
    turns = (
        np.diff(
            held.direction,
            prepend=held.direction[0] if held.given is None else held.given.direction,
        )
        != 0
    )
    short = np.flatnonzero(had < needed)
    first = int(short[np.argmin(abs(short - which))]) if len(short) else which
    time, least = had[first] / clock_hz, needed[first] / clock_hz
    place = Place(
        float(travel(k, held.ticks[first : first + 1])[1][0]),
        t=float(held.ticks[first]) / clock_hz,
        axis=axis.name,
    )
    who = "it" if axis.timing is None else "its drive"
    what, limit = "pulse rate" if axis.timing is None else "drive timing", 1 / least
    if first == 0 and held.given is None:
        what = "direction set-up before the first pulse"
        remedy = (
            f"its drive needs DIR {1e6 * least:.4g} us before STEP, and the first pulse is due after "
            f"{1e6 * time:.4g}: let the program begin with a dwell of {round_up_digits(least - time + 1 / clock_hz)} s"
        )
    elif first == 0 and held.given is not None and held.given.tick < 0:
        what += " behind the pulses that were sent"
        remedy = (
            f"{who} takes the first pulse {1e6 * least:.4g} us after the last one sent, and it is due after "
            f"{1e6 * time:.4g}: choose another instant"
        )
    elif turns[first]:
        what += " at a reversal"
        remedy = (
            f"{who} needs {1e6 * least:.4g} us between opposite pulses: let the axis "
            f"rest there for {round_up_digits(least)} s (a dwell), use a longer pulse, or hysteresis at reversals "
            '(rule "nearest:hysteresis=0.2")'
        )
    else:
        limit = min(limit, axis.pulse_rate)
        remedy = (
            f"{who} takes {limit:.4g} pulses/s one way, so no pulse sooner than {1e6 * least:.4g} us after "
            f"another, and one comes after {1e6 * time:.4g}: "
            f"slow the motion there to {100 * time / least:.4g} % or less, "
            f"use a pulse {round_up_digits(least / max(time, 1 / clock_hz))} times as long, or a rule "
            "that fires no faster"
        )
    return Infeasible(what, axis.name, place, 1 / max(time, 1 / clock_hz), limit, "1/s", remedy)
