"""The longest command from each of many starts at once, and again from its end: the work behind `compress`.

Where the pulse before fell at `last`, pulse j = 1, 2, … of a command falls at last + j·interval + add·j(j-1)/2. Divided by
j, that is a line over x = (j-1)/2 which has to stab the upright segment between the bounds of pulse j:

    (earliest_j - last)/j  ≤  interval + add·x_j  ≤  (latest_j - last)/j

For a given add, the intervals that serve the first n pulses lie between a running maximum and a running minimum. The adds
that serve n pulses are an interval too, inside that of fewer pulses: the bound that is broken first tells on which side
of an add the better ones lie [after O'Rourke 1981, on stabbing lines]. In float64 the lines are exact enough: a bound
that is no whole number is at least 1/(2j) from one, 8e-6, and intervals below 2³² are rounded by less than 1e-6.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.array import Array
from planner.pulses.schedule import Ticks
from planner.pulses.step_queue import ADD, COUNT

ELEMENTS = 1 << 16  # of an array: it stays in the processor's cache
WINDOW = 16  # pulses that are looked at first
WIDER = 4  # times as many where they do not suffice
TRIES = (0, -1, 1)  # around the add that is thought best


@dataclass(frozen=True, slots=True)
class Bounds:
    """Pulses that commands are made for: block after block, each behind the pulse from whose tick it starts.

    ticks, earliest, latest  (N,) where each pulse is, and between what it may fall
    turns                    indices where a run that goes one way has ended; N is the last
    begin, end               (B,) indices of each block
    least                    ticks between any two pulses
    """

    ticks: Ticks
    earliest: Ticks
    latest: Ticks
    turns: Ticks
    begin: Ticks
    end: Ticks
    least: int


@dataclass(slots=True)
class _Lanes:
    """Blocks at work, one entry each: the next pulse, the tick of the one before, the block's end; pulses looked at;
    the add that is thought best, between which it lies, and how far to go in search of it."""

    at: Ticks
    last: Ticks
    end: Ticks
    window: Ticks
    add: Ticks
    low: Ticks
    high: Ticks
    fresh: NDArray[np.bool_]
    usual: Ticks


def encode(bounds: Bounds, once: bool = False) -> Ticks:
    """Commands (M, 4) of all blocks, in no order: first pulse, interval, count, add; once: only the first of each."""
    begin, end = bounds.begin, bounds.end
    whole = np.ones(len(begin), np.int64)
    lanes = _Lanes(
        at=begin.copy(),
        last=bounds.ticks[begin - 1],
        end=end,
        window=WINDOW * whole,
        add=0 * whole,
        low=-ADD * whole,
        high=ADD * whole,
        fresh=whole > 0,
        usual=4 * whole,
    )
    found = [np.empty((0, 4), np.int64)]
    active = np.flatnonzero(begin < end)
    while len(active):
        # The fullest window first: the others wait until they are many.
        windows, many = np.unique(lanes.window[active], return_counts=True)
        window = int(windows[many.argmax()])
        chosen = active[lanes.window[active] == window]
        for part in np.array_split(chosen, -(-len(chosen) * window // ELEMENTS)):
            found.append(_advance(bounds, lanes, part, window))
        active = active[lanes.at[active] < (begin[active] + 1 if once else end[active])]
    return np.concatenate(found)


def _advance(bounds: Bounds, lanes: _Lanes, k: NDArray[np.intp], window: int) -> Ticks:
    """Look at the next pulses of the lanes k, as many as the window: the commands (M, 4) of those that are settled."""
    at, last = lanes.at[k], lanes.last[k]
    limit = np.minimum(lanes.end[k], bounds.turns[np.searchsorted(bounds.turns, at, side="right")]) - at
    limit = np.minimum(limit, COUNT)
    j = np.arange(1, window + 1)[:, None]
    x, out = (j - 1) / 2, j > limit
    index = np.minimum(at + (j - 1), len(bounds.ticks) - 1)
    earliest = (bounds.earliest[index] - last) / j
    latest = (bounds.latest[index] - last) / j
    earliest[out], latest[out] = np.inf, -np.inf
    lanes.add[k] = np.where(lanes.fresh[k], _estimate(earliest, latest, np.minimum(limit, lanes.usual[k])), lanes.add[k])
    lanes.fresh[k] = False
    # one (tries, lanes) each: the add, how many pulses it serves, how many if intervals were not whole, and the bounds
    tried = np.clip(lanes.add[k] + np.array(TRIES)[:, None], -ADD, ADD)
    looks = [_serve(earliest, latest, x, add, bounds.least) for add in tried]
    served, real, way, low, high = (np.array(part) for part in zip(*looks, strict=True))
    way[real >= np.minimum(limit, window)] = 0
    best = served.argmax(0), np.arange(len(k))
    count, add = served[best], tried[best]
    lower, higher = (way[1] < 0) & (tried[1] > lanes.low[k]), (way[2] > 0) & (tried[2] < lanes.high[k])
    wider = (count == window) & (window < limit)
    more = lower | higher
    if more.any():
        # TRIES: 1 is the lowest, 2 the highest
        toward = np.where(higher, 1, -1)[more]
        edge = np.where(higher, 2, 1)[more], np.flatnonzero(more)
        lanes.low[k[higher]], lanes.high[k[lower]] = tried[2, higher] + 1, tried[1, lower] - 1
        next_ = _needed(earliest[:, more], latest[:, more], x, real[edge], toward)
        next_ = toward * np.maximum(toward * next_, toward * tried[edge] + 1) + toward
        lanes.add[k[more]] = np.clip(next_, lanes.low[k[more]], lanes.high[k[more]])
    lanes.window[k[wider]] *= WIDER
    done = ~(more | wider)
    k, count, add, at, last = k[done], count[done], add[done], at[done], last[done]
    curve = add * (count * (count - 1) // 2)
    wanted = bounds.ticks[at + count - 1] - last - curve
    interval = np.clip(np.rint(wanted / count), low[best][done], high[best][done]).astype(np.int64)
    lanes.at[k], lanes.last[k] = at + count, last + count * interval + curve
    lanes.add[k], lanes.fresh[k] = add, True
    lanes.low[k], lanes.high[k] = -ADD, ADD
    lanes.usual[k] = count
    lanes.window[k] = WINDOW * WIDER ** np.ceil(np.log(np.maximum(1.25 * count / WINDOW, 1)) / np.log(WIDER)).astype(np.int64)
    return np.column_stack([at, interval, count, np.where(count > 1, add, 0)])


def _estimate(earliest: Array, latest: Array, n: Ticks) -> Ticks:
    """The add (L,) of the line through the middles of the segments (W, L) n and half of it."""
    lane, half = np.arange(len(n)), (n + 1) // 2
    there, here = ((earliest[i - 1, lane] + latest[i - 1, lane]) / 2 for i in (n, half))
    return np.rint(2 * (there - here) / np.maximum(1, n - half)).astype(np.int64)


def _serve(earliest: Array, latest: Array, x: Array, add: Ticks, least: int) -> tuple[Ticks, Ticks, Ticks, Array, Array]:
    """How many pulses an add serves with a whole interval, and with any; where the better adds lie beyond these, +1/-1;
    the least and the greatest whole interval for those it serves. All (L,); earliest, latest (W, L)."""
    slope = add * x
    low = earliest - slope
    np.maximum(low, least - 2 * slope, out=low)  # the interval before pulse j is interval + add·(j-1)
    high = latest - slope
    most, fewest = np.maximum.accumulate(low), np.minimum.accumulate(high)
    real = np.count_nonzero(most <= fewest, axis=0)
    whole = np.count_nonzero(np.ceil(most) <= np.floor(fewest), axis=0)
    lane = np.arange(len(add))
    broken = np.minimum(real, len(x) - 1)
    way = np.where(low[broken, lane] > fewest[broken - 1, lane], 1, -1)
    return whole, real, way, np.ceil(most[whole - 1, lane]), np.floor(fewest[whole - 1, lane])


def _needed(earliest: Array, latest: Array, x: Array, broken: Ticks, way: Ticks) -> Ticks:
    """The add (L,) nearest to those before, on the side `way`, with which the segment `broken` is met as well."""
    lane = np.arange(len(way))
    there = np.where(way > 0, earliest[broken, lane], -latest[broken, lane])
    here = np.where(way > 0, latest, -earliest)
    run = x[broken, 0] - x
    slope = np.where(run > 0, (there - here) / np.where(run > 0, run, 1.0), -np.inf)
    return way * np.ceil(slope.max(axis=0)).astype(np.int64)
