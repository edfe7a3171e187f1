"""How well and how fast pulses become a step queue: `python -m benchmarks.evidence.speed.compression`, some two
minutes.

On the program `circle` with the hexapod, all six legs: pulses per command beside those of an exhaustive search for the
longest command (`benchmarks.evidence.speed.exhaustive_steps`), and pulses per second of processor time, the best of
three. With --fast without the exhaustive search.
"""

import sys
from time import process_time

import numpy as np

from benchmarks.evidence.speed.exhaustive_steps import find_longest_commands
from kinematics import load_machine
from planner import load_program, plan
from planner.pulses import compress, decompress, generate

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
        times = []
        for _ in range(REPEATS):
            begin = process_time()
            queues = compress(schedule.axes, tolerance)
            times.append(process_time() - begin)
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
