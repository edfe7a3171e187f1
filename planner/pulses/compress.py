"""Pulses to the run-length step queue: the longest command that stays within a tolerance, and again from its end.

A command starts where the one before ended, so they come one after another; but where a pulse is kept exactly, what
follows can be encoded without knowing what came before. So the pulses are cut into blocks that end with such a pulse,
and all blocks of all axes are encoded side by side: that costs less than a command per block.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from kinematics.errors import MotionError
from planner.pulses.lanes import Bounds, encode
from planner.pulses.schedule import AxisPulses, Ticks
from planner.pulses.step_queue import INTERVAL, StepQueue

PROBES = 64  # commands that tell how long one is
PROBE = 1 << 13  # pulses that each may be long
COMMANDS = 20  # of that length in a block
SHORTEST = 128  # pulses of a block
PIECE = 1 << 20  # pulses encoded together: what bounds the memory


def compress(axes: Sequence[AxisPulses], tolerance: int, least: int = 1) -> tuple[StepQueue, ...]:
    """The commands for each axis, every pulse within `tolerance` ticks of its own.

    least  ticks: no two pulses of an axis come closer, and none out of order
    Raises MotionError where pulses of an axis are closer already, or one is before tick 0.
    """
    if tolerance < 0 or least < 1:
        raise MotionError(f"tolerance {tolerance} and least interval {least} ticks: must be at least 0 and 1")
    firsts = [_firsts(axis, tolerance, least) for axis in axes]
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
    for blocks in _pieces(stretches, _typical(axes, stretches, tolerance, least)):
        found.append(_encode(axes, blocks, tolerance, least))
    commands = np.concatenate(found)
    return tuple(
        _queue(axis, first, commands[commands[:, 0] == k, 1:])
        for k, (axis, first) in enumerate(zip(axes, firsts, strict=True))
    )


def _firsts(axis: AxisPulses, tolerance: int, least: int) -> Ticks:
    """The pulses before which the clock is reset: the first, and those after a wait longer than an interval can be."""
    if len(axis) and axis.ticks[0] < 0:
        raise MotionError(f"axis {axis.name}: its first pulse is at tick {axis.ticks[0]}; the clock starts at 0")
    gap = np.diff(axis.ticks)
    if len(gap) and gap.min() < least:
        i = int(gap.argmin())
        raise MotionError(
            f"axis {axis.name}: the pulses at ticks {axis.ticks[i]} and {axis.ticks[i + 1]} are {gap[i]} ticks apart, "
            f"limit {least}; choose a smaller least interval, or slow the motion"
        )
    return np.flatnonzero(np.concatenate([[True], gap > INTERVAL - 2 * tolerance])[: len(axis)]).astype(np.int64)


def _typical(axes: Sequence[AxisPulses], stretches: Ticks, tolerance: int, least: int) -> int:
    """How many pulses a command has about, by the first ones from pulses here and there."""
    lengths = stretches[:, 2] - stretches[:, 1]
    if not len(lengths):
        return 1
    behind = np.cumsum(lengths)
    probes = np.unique(np.linspace(0, behind[-1] - 1, PROBES).astype(np.int64))
    stretch = np.searchsorted(behind, probes, side="right")
    axis, _, end = stretches[stretch].T
    begin = end - (behind[stretch] - probes)
    blocks = np.column_stack([axis, begin, np.minimum(end, begin + PROBE), np.zeros_like(begin)])
    return int(np.median(_encode(axes, blocks, tolerance, least, once=True)[:, 3]))


def _pieces(stretches: Ticks, typical: int) -> Iterator[Ticks]:
    """Blocks (M, 4) that are encoded together: axis, begin, end, and 1 where the last pulse is kept exactly."""
    size = max(SHORTEST, COMMANDS * typical)
    blocks: list[tuple[int, int, int, bool]] = []
    total = 0
    for axis, begin, end in stretches.tolist():
        for start in range(begin, end, size):
            stop = min(start + size, end)
            blocks.append((axis, start, stop, stop < end))
            total += stop - start
            if total >= PIECE:
                yield np.array(blocks, np.int64)
                blocks, total = [], 0
    if blocks:
        yield np.array(blocks, np.int64)


def _encode(axes: Sequence[AxisPulses], blocks: Ticks, tolerance: int, least: int, once: bool = False) -> Ticks:
    """Commands (M, 5) of blocks (B, 4): axis, first pulse, interval, count, add."""
    rows = blocks.tolist()
    ticks = np.concatenate([axes[k].ticks[begin - 1 : end] for k, begin, end, _ in rows])
    direction = np.concatenate([axes[k].direction[begin - 1 : end] for k, begin, end, _ in rows])
    turns = np.append(np.flatnonzero(np.diff(direction)) + 1, len(ticks))
    end = np.cumsum(blocks[:, 2] - blocks[:, 1] + 1)
    begin = np.concatenate([[1], end[:-1] + 1])
    earliest, latest = ticks - tolerance, ticks + tolerance
    kept = blocks[:, 3] == 1
    _keep(ticks, earliest, latest, begin[kept], end[kept] - 1, least)
    place, interval, count, add = encode(Bounds(ticks, earliest, latest, turns, begin, end, least), once).T
    block = np.searchsorted(end, place, side="right")
    return np.column_stack([blocks[block, 0], place - begin[block] + blocks[block, 1], interval, count, add])


def _keep(ticks: Ticks, earliest: Ticks, latest: Ticks, begin: Ticks, last: Ticks, least: int) -> None:
    """Narrow the bounds: the last pulses of blocks are kept exactly, and those before them early enough for that."""
    room = earliest[last] = latest[last] = ticks[last]
    while len(last):
        last, room = last - 1, room - least
        tight = (last >= begin) & (room < latest[last])
        begin, last, room = begin[tight], last[tight], room[tight]
        latest[last] = room


def _queue(axis: AxisPulses, first: Ticks, commands: Ticks) -> StepQueue:
    """The queue of an axis, whose first pulses are commands of their own."""
    reset = np.where((axis.ticks[first] > INTERVAL) | (first > 0), axis.ticks[first], 0)
    alone = np.column_stack([first, axis.ticks[first] - reset, np.ones_like(first), np.zeros_like(first)])
    commands = np.concatenate([alone, commands])
    place, interval, count, add = commands[np.argsort(commands[:, 0])].T
    resets = np.full(len(place), -1)
    resets[np.searchsorted(place, first)] = reset
    return StepQueue(axis.name, interval, count, add, axis.direction[place], resets)
