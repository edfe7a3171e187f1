"""Exhaustive search for the longest commands of a step queue.

It is slow and shares nothing with `planner.pulses.compression`: whole numbers throughout, one
command after the other, every interval that a command may begin with, each with every add.
"""

import numpy as np

WINDOW = 64  # pulses that are tried first
MAX_COUNT, MAX_ADD = 65535, 32767
MAX_ADDS_TRIED = 16  # adds that are compared where one interval allows many


def find_longest_commands(axis, tolerance, least=1):
    """List commands (interval, count, add), each as long as possible. The clock begins at 0."""
    commands = []
    last = 0
    turns = [*(np.flatnonzero(np.diff(axis.direction)) + 1).tolist(), len(axis)]
    at = 0
    while at < len(axis):
        end = next(turn for turn in turns if turn > at)
        interval, count, add = find_longest(
            axis.ticks[at:end] - last, tolerance, least if at else 0
        )
        commands.append((interval, count, add))
        last += count * interval + add * (count * (count - 1) // 2)
        at += count
    return commands


def find_longest(ticks, tolerance, least):
    """Find the longest command for pulses (N,) counted from the pulse before.

    Of several, it is the one whose last pulse is nearest to its own tick.
    """
    most = min(len(ticks), MAX_COUNT)
    window = min(WINDOW, most)
    first = int(ticks[0])
    intervals = np.arange(max(first - tolerance, least), first + tolerance + 1)[:, None]
    while True:
        # each pulse bounds the add from both sides
        j = np.arange(2, window + 1)
        triangle = j * (j - 1) // 2
        space = ticks[1:window] - j * intervals
        low = np.maximum(-((tolerance - space) // triangle), -((intervals - least) // (j - 1)))
        low = np.maximum(np.maximum.accumulate(low, axis=1), -MAX_ADD)
        high = np.minimum(np.minimum.accumulate((space + tolerance) // triangle, axis=1), MAX_ADD)
        counts = 1 + (low <= high).sum(axis=1)
        count = int(counts.max())
        if count < window or window == most:
            break
        window = min(2 * window, most)
    best = np.inf, 0, 0
    for row in np.flatnonzero(counts == count):
        interval = int(intervals[row, 0])
        adds = [0] if count == 1 else np.arange(low[row, count - 2], high[row, count - 2] + 1)
        for add in np.array(adds)[:: max(1, len(adds) // MAX_ADDS_TRIED)].tolist():
            error = abs(count * interval + add * (count * (count - 1) // 2) - int(ticks[count - 1]))
            best = min(best, (error, interval, add))
    return best[1], count, best[2]
