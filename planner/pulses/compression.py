"""Pulses to the run-length step queue, short polynomials: the longest command within a tolerance,
again from its end.

A command starts where the one before ended, so they come one after another; but where a pulse is
kept exactly, what follows can be encoded without knowing what came before. So the pulses are cut
into blocks that end with such a pulse, and all blocks of all axes are encoded side by side: that
costs less than a command per block.

Where the pulse before fell at `last`, pulse j = 1, 2, … of a command falls at last + j·interval +
add·j(j-1)/2. Divided by j, that is a line over x = (j-1)/2 which has to stab the upright segment
between the bounds of pulse j:

    (earliest_j - last)/j  ≤  interval + add·x_j  ≤  (latest_j - last)/j

For a given add, the intervals that serve the first n pulses lie between a running maximum and a
running minimum. The adds that serve n pulses are an interval too, inside that of fewer pulses: the
bound that is broken first tells on which side of an add the better ones lie [after O'Rourke 1981,
on stabbing lines]. float64 is exact enough: a bound that is no whole number is at least 1/(2j),
8e-6, from one, and intervals below 2³² are rounded by less than 1e-6.

The search ends where no add serves more pulses if intervals need not be whole. What whole ones cost
beyond that is not searched for: an exhaustive encoder makes some 1 % fewer commands.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array, freeze_array, freeze_fields
from kinematics.foundation.errors import MotionError
from planner.pulses.schedule import AxisPulses, Signs, Ticks

MAX_COUNT = 65535
"""Most pulses of a command, an unsigned 16-bit number."""
MAX_ADD = 32767
"""Largest magnitude of a command's add, a signed 16-bit number."""
MAX_INTERVAL = 3 << 28
"""Most ticks of a command's interval, as Klipper's host has it (chelper/stepcompress.c,
CLOCK_DIFF_MAX).

Firmware compares times of 32 bits by the sign of their difference: what is 2³¹ or more ahead is
past to it.
"""


@dataclass(frozen=True, slots=True)
class StepQueue:
    """The commands of one axis, in ticks of the schedule's clock: pulse k (from 0) of a command
    falls at

        first + k·interval + add·k(k+1)/2     with first = last + interval

    where last is the last pulse of the command before, or the tick that the clock is reset to.

    interval   (M,) int64, 0 to MAX_INTERVAL: from the pulse before to the first
    count      (M,) int64, 1 to 65535 pulses
    add        (M,) int64, ±32767: what the interval grows by after every pulse
    direction  (M,) int8, +1/-1 in q
    reset      (M,) int64, the tick that the clock is set to before the command; -1: it goes on
    """

    name: str
    interval: Ticks
    count: Ticks
    add: Ticks
    direction: Signs
    reset: Ticks

    def __post_init__(self) -> None:
        freeze_fields(self, "interval", "count", "add", "reset", dtype=np.int64)
        object.__setattr__(self, "direction", freeze_array(self.direction, np.int8))

    def __len__(self) -> int:
        return len(self.interval)

    @property
    def last(self) -> Ticks:
        """(M,) the tick from which each command counts: of the pulse before, or of the reset."""
        end = np.cumsum(
            self.count * self.interval + self.add * (self.count * (self.count - 1) // 2)
        )
        before = np.concatenate([[0], end[:-1]])
        resets = np.flatnonzero(self.reset >= 0)
        shift = np.zeros(len(self), np.int64)
        if len(resets):
            offset = self.reset[resets] - before[resets]
            shift[resets] = np.diff(offset, prepend=0)
        result: Ticks = before + np.cumsum(shift)
        return result


def decompress(queue: StepQueue) -> tuple[Ticks, Signs]:
    """Ticks (N,) and directions (N,) of the pulses that the commands stand for."""
    first = np.cumsum(queue.count) - queue.count
    command: NDArray[np.intp] = np.repeat(np.arange(len(queue)), queue.count)
    nth = np.arange(len(command)) - first[command]
    ticks = (
        queue.last[command]
        + (nth + 1) * queue.interval[command]
        + queue.add[command] * (nth * (nth + 1) // 2)
    )
    return ticks, queue.direction[command]


MAX_ELEMENTS = 1 << 16  # of an array: it stays in the processor's cache
WINDOW = 16  # pulses that are looked at first
WINDOW_GROWTH = 4  # times as many where they do not suffice
WINDOW_MARGIN = 1.25  # times the pulses of the command before are looked at for the next
FIRST_PULSES = 4  # pulses of a first command
ADD_TRIALS = np.array([[-1], [0], [1]])  # around the add that is thought best


Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Bounds:
    """Pulses that commands are made for: block after block, each behind the pulse from whose tick
    it starts.

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
    """Commands (M, 4) of all blocks, in no order: first pulse, interval, count, add; once: only the
    first of each.
    """
    begin, end = bounds.begin, bounds.end
    whole = np.ones(len(begin), np.int64)
    lanes = _Lanes(
        at=begin.copy(),
        last=bounds.ticks[begin - 1],
        end=end,
        window=WINDOW * whole,
        add=0 * whole,
        low=-MAX_ADD * whole,
        high=MAX_ADD * whole,
        fresh=whole > 0,
        usual=FIRST_PULSES * whole,
    )
    found = [np.empty((0, 4), np.int64)]
    active = np.flatnonzero(begin < end)
    while len(active):
        # The fullest window first: the others wait until they are many.
        windows, many = np.unique(lanes.window[active], return_counts=True)
        window = int(windows[many.argmax()])
        chosen = active[lanes.window[active] == window]
        for part in np.array_split(chosen, -(-len(chosen) * window // MAX_ELEMENTS)):
            found.append(_advance(bounds, lanes, part, window))
        active = active[lanes.at[active] < (begin[active] + 1 if once else end[active])]
    return np.concatenate(found)


def _advance(bounds: Bounds, lanes: _Lanes, k: Indices, window: int) -> Ticks:
    """Look at the next pulses of the lanes k, as many as the window: the commands (M, 4) of those
    that are settled.
    """
    at = lanes.at[k]
    limit = (
        np.minimum(lanes.end[k], bounds.turns[np.searchsorted(bounds.turns, at, side="right")]) - at
    )
    limit = np.minimum(limit, MAX_COUNT)
    earliest, latest, x = _segments(bounds, at, lanes.last[k], limit, window)
    guess = _estimate(earliest, latest, np.minimum(limit, lanes.usual[k]))
    tried = np.clip(np.where(lanes.fresh[k], guess, lanes.add[k]) + ADD_TRIALS, -MAX_ADD, MAX_ADD)
    lanes.fresh[k] = False
    look = _try_adds(earliest, latest, x, tried, bounds.least)
    look.way[look.broken >= np.minimum(limit, window)] = 0
    lower = (look.way[0] < 0) & (tried[0] > lanes.low[k])
    higher = (look.way[-1] > 0) & (tried[-1] < lanes.high[k])
    lanes.high[k[lower]], lanes.low[k[higher]] = tried[0, lower] - 1, tried[-1, higher] + 1
    for beyond, edge, way in ((lower, 0, -1), (higher, -1, 1)):
        if beyond.any():
            needed = _required_add(
                earliest[:, beyond],
                latest[:, beyond],
                x,
                look.broken[edge, beyond],
                way,
                bounds.least,
            )
            ahead = (
                way * np.maximum(way * needed, way * tried[edge, beyond] + 1) + way
            )  # the tries are around it
            lanes.add[k[beyond]] = np.clip(ahead, lanes.low[k[beyond]], lanes.high[k[beyond]])
    best = look.served.argmax(0), np.arange(len(k))
    count = look.served[best]
    wider = ~lower & ~higher & (count == window) & (window < limit)
    lanes.add[k[wider]] = tried[best][wider]
    lanes.window[k[wider]] *= WINDOW_GROWTH
    done = ~lower & ~higher & ~wider
    best = best[0][done], best[1][done]
    return _emit_commands(
        bounds, lanes, k[done], count[done], tried[best], look.least[best], look.greatest[best]
    )


def _segments(
    bounds: Bounds, at: Ticks, last: Ticks, limit: Ticks, window: int
) -> tuple[Array, Array, Array]:
    """Ends of the segments (W, L) that lines have to stab, and their x (W, 1); beyond the limit
    none can.
    """
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


def _try_adds(earliest: Array, latest: Array, x: Array, add: Ticks, least: int) -> _Look:
    """Look at adds (T, L) for the segments (W, L)."""
    slope = add * x[:, None]
    low, high = earliest[:, None] - slope, latest[:, None] - slope
    np.maximum(
        low, least - 2 * slope, out=low
    )  # the interval before pulse j is interval + add·(j-1)
    most, fewest = np.maximum.accumulate(low), np.minimum.accumulate(high)
    broken = np.count_nonzero(most <= fewest, axis=0)
    served = np.count_nonzero(np.ceil(most) <= np.floor(fewest), axis=0)
    each = np.arange(len(add))[:, None], np.arange(add.shape[1])
    first: Ticks = np.minimum(broken, len(x) - 1)
    way = np.where(low[first, *each] > fewest[first, *each], 1, -1)
    return _Look(
        served, np.ceil(most[served - 1, *each]), np.floor(fewest[served - 1, *each]), broken, way
    )


def _required_add(
    earliest: Array, latest: Array, x: Array, broken: Ticks, way: int, least: int
) -> Ticks:
    """The add (L,) nearest to those tried, on the side `way`, that meets the broken segment with
    each one before.
    """
    there = (earliest if way > 0 else -latest)[broken, np.arange(len(broken))]
    here = latest if way > 0 else -earliest
    run = x[broken, 0] - x
    slope = np.where(run > 0, (there - here) / np.where(run > 0, run, 1.0), -np.inf).max(axis=0)
    if way > 0:  # the interval before it is long enough, too
        run = x[broken, 0] + run
        apart = np.where(run >= x[broken, 0], (least - latest) / np.maximum(run, 0.5), -np.inf).max(
            axis=0
        )
        slope = np.maximum(slope, apart)
    return np.asarray(way * np.ceil(slope), np.int64)


def _emit_commands(
    bounds: Bounds,
    lanes: _Lanes,
    k: Indices,
    count: Ticks,
    add: Ticks,
    least: Array,
    greatest: Array,
) -> Ticks:
    """The commands (M, 4), of the interval that ends nearest to the pulse's own tick; their lanes
    start again there.
    """
    at, curve = lanes.at[k], add * (count * (count - 1) // 2)
    wanted = (bounds.ticks[at + count - 1] - lanes.last[k] - curve) / count
    interval = np.clip(np.rint(wanted), least, greatest).astype(np.int64)
    lanes.at[k] += count
    lanes.last[k] += count * interval + curve
    lanes.low[k], lanes.high[k], lanes.fresh[k], lanes.usual[k] = -MAX_ADD, MAX_ADD, True, count
    wider = np.ceil(np.log(np.maximum(WINDOW_MARGIN * count / WINDOW, 1)) / np.log(WINDOW_GROWTH))
    lanes.window[k] = WINDOW * WINDOW_GROWTH ** wider.astype(np.int64)
    return np.column_stack([at, interval, count, np.where(count > 1, add, 0)])


PROBE_COMMANDS = 64  # commands that tell how long one is
PROBE_PULSES = 1 << 13  # pulses that each may be long
BLOCK_COMMANDS = 20  # of that length in a block
MIN_BLOCK_PULSES = 128  # pulses of a block
PIECE_PULSES = 1 << 20  # pulses encoded together: what bounds the memory


def compress(axes: Sequence[AxisPulses], tolerance: int, least: int = 1) -> tuple[StepQueue, ...]:
    """The commands for each axis, every pulse within `tolerance` ticks of its own.

    least  ticks: no two pulses of an axis come closer, and none out of order
    Raises MotionError where pulses of an axis are closer already, or one is before tick 0.
    """
    if tolerance < 0 or least < 1:
        raise MotionError(
            f"tolerance {tolerance} and least interval {least} ticks: must be at least 0 and 1"
        )
    firsts = [_find_resets(axis, tolerance, least) for axis in axes]
    # Stretches (M, 3) between resets: axis, and the pulses from the second on.
    stretches = np.concatenate(
        [np.empty((0, 3), np.int64)]
        + [
            np.column_stack([np.full(len(first), k), first + 1, np.append(first, len(axis))[1:]])
            for k, (axis, first) in enumerate(zip(axes, firsts, strict=True))
        ]
    )
    stretches = stretches[stretches[:, 1] < stretches[:, 2]]
    found = [np.empty((0, 5), np.int64)]
    for blocks in _pieces(stretches, _typical_pulses(axes, stretches, tolerance, least)):
        found.append(_encode(axes, blocks, tolerance, least))
    commands = np.concatenate(found)
    return tuple(
        _queue(axis, first, commands[commands[:, 0] == k, 1:])
        for k, (axis, first) in enumerate(zip(axes, firsts, strict=True))
    )


def _find_resets(axis: AxisPulses, tolerance: int, least: int) -> Ticks:
    """The pulses before which the clock is reset: the first, and those after a wait longer than an
    interval can be.
    """
    if len(axis) and axis.ticks[0] < 0:
        raise MotionError(
            f"axis {axis.name}: its first pulse is at tick {axis.ticks[0]}; the clock starts at 0"
        )
    gap = np.diff(axis.ticks)
    if len(gap) and gap.min() < least:
        i = int(gap.argmin())
        raise MotionError(
            f"axis {axis.name}: the pulses at ticks {axis.ticks[i]} and {axis.ticks[i + 1]} are {gap[i]} ticks apart, "
            f"limit {least}; choose a smaller least interval, or slow the motion"
        )
    return np.flatnonzero(
        np.concatenate([[True], gap > MAX_INTERVAL - 2 * tolerance])[: len(axis)]
    ).astype(np.int64)


def _typical_pulses(
    axes: Sequence[AxisPulses], stretches: Ticks, tolerance: int, least: int
) -> int:
    """How many pulses a command has about, by the first ones from pulses here and there."""
    lengths = stretches[:, 2] - stretches[:, 1]
    if not len(lengths):
        return 1
    behind = np.cumsum(lengths)
    probes = np.unique(np.linspace(0, behind[-1] - 1, PROBE_COMMANDS).astype(np.int64))
    stretch = np.searchsorted(behind, probes, side="right")
    axis, _, end = stretches[stretch].T
    begin = end - (behind[stretch] - probes)
    blocks = np.column_stack(
        [axis, begin, np.minimum(end, begin + PROBE_PULSES), np.zeros_like(begin)]
    )
    return int(np.median(_encode(axes, blocks, tolerance, least, once=True)[:, 3]))


def _pieces(stretches: Ticks, typical: int) -> Iterator[Ticks]:
    """Blocks (M, 4) that are encoded together: axis, begin, end, and 1 where the last pulse is kept
    exactly.
    """
    size = max(MIN_BLOCK_PULSES, BLOCK_COMMANDS * typical)
    blocks: list[tuple[int, int, int, bool]] = []
    total = 0
    for axis, begin, end in stretches.tolist():
        for start in range(begin, end, size):
            stop = min(start + size, end)
            blocks.append((axis, start, stop, stop < end))
            total += stop - start
            if total >= PIECE_PULSES:
                yield np.array(blocks, np.int64)
                blocks, total = [], 0
    if blocks:
        yield np.array(blocks, np.int64)


def _encode(
    axes: Sequence[AxisPulses], blocks: Ticks, tolerance: int, least: int, once: bool = False
) -> Ticks:
    """Commands (M, 5) of blocks (B, 4): axis, first pulse, interval, count, add."""
    rows = blocks.tolist()
    ticks = np.concatenate([axes[k].ticks[begin - 1 : end] for k, begin, end, _ in rows])
    direction = np.concatenate([axes[k].direction[begin - 1 : end] for k, begin, end, _ in rows])
    turns = np.append(np.flatnonzero(np.diff(direction)) + 1, len(ticks))
    end = np.cumsum(blocks[:, 2] - blocks[:, 1] + 1)
    begin = np.concatenate([[1], end[:-1] + 1])
    earliest, latest = ticks - tolerance, ticks + tolerance
    kept = blocks[:, 3] == 1
    _narrow_bounds(ticks, earliest, latest, begin[kept], end[kept] - 1, least)
    place, interval, count, add = encode(
        Bounds(ticks, earliest, latest, turns, begin, end, least), once
    ).T
    block = np.searchsorted(end, place, side="right")
    return np.column_stack(
        [blocks[block, 0], place - begin[block] + blocks[block, 1], interval, count, add]
    )


def _narrow_bounds(
    ticks: Ticks, earliest: Ticks, latest: Ticks, begin: Ticks, last: Ticks, least: int
) -> None:
    """Narrow the bounds: the last pulses of blocks are kept exactly, and those before them early
    enough for that.
    """
    room = earliest[last] = latest[last] = ticks[last]
    while len(last):
        last, room = last - 1, room - least
        tight = (last >= begin) & (room < latest[last])
        begin, last, room = begin[tight], last[tight], room[tight]
        latest[last] = room


def _queue(axis: AxisPulses, first: Ticks, commands: Ticks) -> StepQueue:
    """The queue of an axis, whose first pulses are commands of their own."""
    reset = np.where((axis.ticks[first] > MAX_INTERVAL) | (first > 0), axis.ticks[first], 0)
    alone = np.column_stack(
        [first, axis.ticks[first] - reset, np.ones_like(first), np.zeros_like(first)]
    )
    commands = np.concatenate([alone, commands])
    place, interval, count, add = commands[np.argsort(commands[:, 0])].T
    resets = np.full(len(place), -1)
    resets[np.searchsorted(place, first)] = reset
    return StepQueue(axis.name, interval, count, add, axis.direction[place], resets)
