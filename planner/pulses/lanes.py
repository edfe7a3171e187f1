"""The longest command from each of many starts at once, and again from its end: the work behind `compress`.

Where the pulse before fell at `last`, pulse j = 1, 2, … of a command falls at last + j·interval + add·j(j-1)/2. Divided
by j, that is a line over x = (j-1)/2 which has to stab the upright segment between the bounds of pulse j:

    (earliest_j - last)/j  ≤  interval + add·x_j  ≤  (latest_j - last)/j

For a given add, the intervals that serve the first n pulses lie between a running maximum and a running minimum. The
adds that serve n pulses are an interval too, inside that of fewer pulses: the bound that is broken first tells on which
side of an add the better ones lie [after O'Rourke 1981, on stabbing lines]. float64 is exact enough: a bound that is no
whole number is at least 1/(2j), 8e-6, from one, and intervals below 2³² are rounded by less than 1e-6.

The search ends where no add serves more pulses if intervals need not be whole. What whole ones cost beyond that is not
searched for: an exhaustive encoder makes some 1 % fewer commands.
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
ROOM = 1.25  # times the pulses of the command before are looked at for the next
USUAL = 4  # pulses of a first command
TRIES = np.array([[-1], [0], [1]])  # around the add that is thought best


Indices = NDArray[np.intp]


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
    """Blocks at work, (B,) each.

    at, last, end   the next pulse, the tick of the one before as decoded, and where the block ends
    window          pulses to look at
    add, low, high  the add thought best, and between what the best one lies
    fresh           nothing is thought yet
    usual           pulses of the command before
    """

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
        usual=USUAL * whole,
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


def _advance(bounds: Bounds, lanes: _Lanes, k: Indices, window: int) -> Ticks:
    """Look at the next pulses of the lanes k, as many as the window: the commands (M, 4) of those that are settled."""
    at = lanes.at[k]
    limit = np.minimum(lanes.end[k], bounds.turns[np.searchsorted(bounds.turns, at, side="right")]) - at
    limit = np.minimum(limit, COUNT)
    earliest, latest, x = _segments(bounds, at, lanes.last[k], limit, window)
    guess = _estimate(earliest, latest, np.minimum(limit, lanes.usual[k]))
    tried = np.clip(np.where(lanes.fresh[k], guess, lanes.add[k]) + TRIES, -ADD, ADD)
    lanes.fresh[k] = False
    look = _serve(earliest, latest, x, tried, bounds.least)
    look.way[look.broken >= np.minimum(limit, window)] = 0
    lower = (look.way[0] < 0) & (tried[0] > lanes.low[k])
    higher = (look.way[-1] > 0) & (tried[-1] < lanes.high[k])
    lanes.high[k[lower]], lanes.low[k[higher]] = tried[0, lower] - 1, tried[-1, higher] + 1
    for beyond, edge, way in ((lower, 0, -1), (higher, -1, 1)):
        if beyond.any():
            needed = _needed(earliest[:, beyond], latest[:, beyond], x, look.broken[edge, beyond], way, bounds.least)
            ahead = way * np.maximum(way * needed, way * tried[edge, beyond] + 1) + way  # the tries are around it
            lanes.add[k[beyond]] = np.clip(ahead, lanes.low[k[beyond]], lanes.high[k[beyond]])
    best = look.served.argmax(0), np.arange(len(k))
    count = look.served[best]
    wider = ~lower & ~higher & (count == window) & (window < limit)
    lanes.add[k[wider]] = tried[best][wider]
    lanes.window[k[wider]] *= WIDER
    done = ~lower & ~higher & ~wider
    best = best[0][done], best[1][done]
    return _settle(bounds, lanes, k[done], count[done], tried[best], look.least[best], look.greatest[best])


def _segments(bounds: Bounds, at: Ticks, last: Ticks, limit: Ticks, window: int) -> tuple[Array, Array, Array]:
    """Ends of the segments (W, L) that lines have to stab, and their x (W, 1); beyond the limit none can."""
    j = np.arange(1, window + 1)[:, None]
    index = np.minimum(at + (j - 1), len(bounds.ticks) - 1)
    earliest = (bounds.earliest[index] - last) / j
    latest = (bounds.latest[index] - last) / j
    beyond = j > limit
    earliest[beyond], latest[beyond] = np.inf, -np.inf
    earliest[0] = np.maximum(earliest[0], bounds.least)
    return earliest, latest, (j - 1) / 2


def _estimate(earliest: Array, latest: Array, n: Ticks) -> Ticks:
    """The add (L,) of the line through the middles of the segments n and half of it."""
    lane, half = np.arange(len(n)), (n + 1) // 2
    there, here = ((earliest[i - 1, lane] + latest[i - 1, lane]) / 2 for i in (n, half))
    return np.asarray(np.rint(2 * (there - here) / np.maximum(1, n - half)), np.int64)


@dataclass(frozen=True, slots=True)
class _Look:
    """What adds are good for, (T, L) each.

    served           pulses with a whole interval
    least, greatest  such intervals
    broken           the segment (from 0) that no interval at all meets together with those before
    way              +1/-1 where greater or smaller adds might
    """

    served: Ticks
    least: Array
    greatest: Array
    broken: Ticks
    way: Ticks


def _serve(earliest: Array, latest: Array, x: Array, add: Ticks, least: int) -> _Look:
    """Look at adds (T, L) for the segments (W, L)."""
    slope = add * x[:, None]
    low, high = earliest[:, None] - slope, latest[:, None] - slope
    np.maximum(low, least - 2 * slope, out=low)  # the interval before pulse j is interval + add·(j-1)
    most, fewest = np.maximum.accumulate(low), np.minimum.accumulate(high)
    broken = np.count_nonzero(most <= fewest, axis=0)
    served = np.count_nonzero(np.ceil(most) <= np.floor(fewest), axis=0)
    each = np.arange(len(add))[:, None], np.arange(add.shape[1])
    first: Ticks = np.minimum(broken, len(x) - 1)
    way = np.where(low[first, *each] > fewest[first, *each], 1, -1)
    return _Look(served, np.ceil(most[served - 1, *each]), np.floor(fewest[served - 1, *each]), broken, way)


def _needed(earliest: Array, latest: Array, x: Array, broken: Ticks, way: int, least: int) -> Ticks:
    """The add (L,) nearest to those tried, on the side `way`, that meets the broken segment with each one before."""
    there = (earliest if way > 0 else -latest)[broken, np.arange(len(broken))]
    here = latest if way > 0 else -earliest
    run = x[broken, 0] - x
    slope = np.where(run > 0, (there - here) / np.where(run > 0, run, 1.0), -np.inf).max(axis=0)
    if way > 0:  # the interval before it is long enough, too
        run = x[broken, 0] + run
        apart = np.where(run >= x[broken, 0], (least - latest) / np.maximum(run, 0.5), -np.inf).max(axis=0)
        slope = np.maximum(slope, apart)
    return np.asarray(way * np.ceil(slope), np.int64)


def _settle(
    bounds: Bounds, lanes: _Lanes, k: Indices, count: Ticks, add: Ticks, least: Array, greatest: Array
) -> Ticks:
    """The commands (M, 4), of the interval that ends nearest to the pulse's own tick; their lanes start again there."""
    at, curve = lanes.at[k], add * (count * (count - 1) // 2)
    wanted = (bounds.ticks[at + count - 1] - lanes.last[k] - curve) / count
    interval = np.clip(np.rint(wanted), least, greatest).astype(np.int64)
    lanes.at[k] += count
    lanes.last[k] += count * interval + curve
    lanes.low[k], lanes.high[k], lanes.fresh[k], lanes.usual[k] = -ADD, ADD, True, count
    wider = np.ceil(np.log(np.maximum(ROOM * count / WINDOW, 1)) / np.log(WIDER))
    lanes.window[k] = WINDOW * WIDER ** wider.astype(np.int64)
    return np.column_stack([at, interval, count, np.where(count > 1, add, 0)])
