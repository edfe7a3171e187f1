"""How well and how fast pulses become a step queue: `python -m benchmarks.evidence.speed.compression`, some two
minutes.

On the program `circle` with the hexapod, all six legs: pulses per command beside those of an exhaustive search for the
longest command, and pulses per second of processor time, the best of three. With --fast without the exhaustive search.

The search is slow, and of other parts than `planner.pulses.compression`: whole numbers throughout, one command after
the other, every interval that a command may begin with, each with every add. The intervals that reach the first pulse
are few; for each, the pulses after it bound the add from both sides. The command that serves most pulses is taken, of
several the one whose last pulse is nearest to its own tick.
"""

import sys
from functools import partial

import numpy as np

from benchmarks.evidence.measuring import time_calls
from kinematics import load_machine
from planner import load_program, plan
from planner.pulses import compress, decompress, generate
from planner.pulses.schedule import AxisPulses, Ticks

WINDOW = 64  # pulses that are looked at first
MAX_COUNT, MAX_ADD = 65535, 32767
MAX_ADDS_TRIED = 16  # adds that are compared where one interval allows many


def find_longest_commands(axis: AxisPulses, tolerance: int, least: int = 1) -> list[tuple[int, int, int]]:
    """Commands (interval, count, add), each the longest there is from where the one before ended; the clock is at 0."""
    commands: list[tuple[int, int, int]] = []
    last = 0
    turns = [*(np.flatnonzero(np.diff(axis.direction)) + 1).tolist(), len(axis)]
    at = 0
    while at < len(axis):
        end = next(turn for turn in turns if turn > at)
        interval, count, add = _longest_command(axis.ticks[at:end] - last, tolerance, least if at else 0)
        commands.append((interval, count, add))
        last += count * interval + add * (count * (count - 1) // 2)
        at += count
    return commands


def _longest_command(ticks: Ticks, tolerance: int, least: int) -> tuple[int, int, int]:
    """The longest command for pulses (N,) counted from the one before."""
    most = min(len(ticks), MAX_COUNT)
    window = min(WINDOW, most)
    intervals = np.arange(max(int(ticks[0]) - tolerance, least), int(ticks[0]) + tolerance + 1)[:, None]
    while True:
        j = np.arange(2, window + 1)
        triangle, space = j * (j - 1) // 2, ticks[1:window] - j * intervals
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
            off = abs(count * interval + add * (count * (count - 1) // 2) - int(ticks[count - 1]))
            best = min(best, (off, interval, add))
    return best[1], count, best[2]


CASES = ((10_000_000, 1), (10_000_000, 10), (10_000_000, 25), (100_000_000, 1))
TARGET, RATE = 0.9, 1e6
REPEATS = 3


def main() -> None:
    """Print a row for each clock and tolerance."""
    machine = load_machine("hexapod")
    trajectory = plan(load_program("circle"), machine).trajectory
    print(f"targets: {TARGET} of the exhaustive search, {RATE / 1e6:.0f} M pulses/s")
    print("clock MHz  tolerance us  pulses   commands  pulses/command  exhaustive  ratio  M pulses/s  off us")
    for clock, micro in CASES:
        schedule = generate(trajectory, machine.axes, machine.home_q, clock)
        tolerance = clock * micro // 1_000_000
        queues, times = time_calls(partial(compress, schedule.axes, tolerance), REPEATS)
        off = max(
            int(abs(decompress(queue)[0] - axis.ticks).max()) for queue, axis in zip(queues, schedule.axes, strict=True)
        )
        commands = sum(len(queue) for queue in queues)
        least = np.nan
        if "--fast" not in sys.argv[1:]:
            least = sum(len(find_longest_commands(axis, tolerance)) for axis in schedule.axes)
        print(
            f"{clock / 1e6:9.0f}  {micro:12d}  {schedule.total:7d}  {commands:8d}  {schedule.total / commands:14.1f}"
            f"  {schedule.total / least:10.1f}  {least / commands:5.3f}  {schedule.total / min(times) / 1e6:10.2f}"
            f"  {1e6 * off / clock:6.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
