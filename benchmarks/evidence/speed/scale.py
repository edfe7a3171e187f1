"""How planning grows with the program: `python -m benchmarks.evidence.speed.scale [--segments N] [--order 2|3]`.

A zig-zag raster of lines, half circles and stops on the hexapod, layer upon layer, of a quarter, half and all of N
segments. Each is planned in a process of its own; times are those of the clock on the wall and of the processors,
memory is the largest that the planning process held, and the largest that one of the processes held that it started.
"""

import json
from argparse import ArgumentParser
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from math import log
from time import perf_counter

import numpy as np

from benchmarks.evidence.measuring import run_in_new_process, time_calls
from benchmarks.evidence.published.compared import markdown
from kinematics import load_machine
from planner import plan
from planner.program.model import Arc, Line, Program, Segment

# m: the lines of a row, the way between two rows, between two layers, and of the first layer above home.
STEP, PITCH, RISE, HEIGHT = 2e-3, 1e-3, 1e-3, 20e-3
# Lines of a row, and rows of a layer.
LINES, ROWS = 3, 16


def raster(segments: int) -> Program:
    """The first so many segments of the raster, relative to home; on the hexapod a thousand take some minutes."""
    endless = _segments()
    return Program(tuple(next(endless) for _ in range(segments)), name=f"raster-{segments}")


def _segments() -> Iterator[Segment]:
    """Rows to and fro along x about y = 0, half circles from each row to the next; every layer runs back over the last.

    Layers rise from the height to 10 mm above it and fall again, so the raster stays in the machine's travel.
    """
    x, y, z = -LINES * STEP / 2, -(ROWS - 1) * PITCH / 2, HEIGHT
    yield Line(np.array([x, y, z]))
    along, across, up = 1.0, 1.0, 1.0
    layer = 0
    while True:
        for row in range(ROWS):
            for _ in range(LINES):
                x += along * STEP
                yield Line(np.array([x, y, z]))
            if row < ROWS - 1:
                y += across * PITCH
                yield Arc(np.array([x, y - across * PITCH / 2, z]), np.array([0.0, 0.0, 1.0]), along * across * np.pi)
            along = -along
        across = -across
        layer += 1
        if layer % 10 == 0:
            up = -up
        z += up * RISE
        yield Line(np.array([x, y, z]))


# What a thousand segments may take (s), by order, and the memory of all processes together (MB).
TARGETS, MAX_MEMORY_MB = {2: 4.0, 3: 10.0}, 600.0


@dataclass(frozen=True, slots=True)
class PlanRun:
    """One plan: wall and processor time (s), memory (MB) of the process and of the largest that it started."""

    segments: int
    motion: float
    pulses: int
    wall: float
    processor: float
    memory: float
    others: float


def run(segments: int, order: int) -> PlanRun:
    """Plan in this process."""
    import resource

    machine = load_machine("hexapod")
    planned, (wall,) = time_calls(lambda: plan(raster(segments), machine, order=order), clock=perf_counter)
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    processor = sum(one.ru_utime + one.ru_stime for one in used)
    memory, others = (one.ru_maxrss / 1024 for one in used)
    return PlanRun(segments, planned.trajectory.duration, planned.pulses.total, wall, processor, memory, others)


def table(runs: list[PlanRun]) -> str:
    """One row per run, each of a process of its own, with the power of N by which wall time grew."""
    head = ("segments", "motion (s)", "pulses", "wall (s)", "grows as", "processors (s)", "memory (MB)", "others (MB)")
    rows = []
    for n, one in enumerate(runs):
        growth = ""
        if n:
            before = runs[n - 1]
            growth = f"N^{log(one.wall / before.wall) / log(one.segments / before.segments):.2f}"
        figures = (f"{one.motion:.1f}", f"{one.pulses}", f"{one.wall:.1f}", growth)
        rows.append((f"{one.segments}", *figures, f"{one.processor:.1f}", f"{one.memory:.0f}", f"{one.others:.0f}"))
    return markdown(head, rows)


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--segments", type=int, default=1000)
    parser.add_argument("--order", type=int, choices=(2, 3))
    parser.add_argument("--one", type=int, help="plan so many segments in this process, and print the figures")
    chosen = parser.parse_args()
    if chosen.one is not None:
        print(json.dumps(asdict(run(chosen.one, chosen.order))))
        return
    for order in (chosen.order,) if chosen.order else (2, 3):
        sizes = (chosen.segments // part for part in (4, 2, 1))
        runs = [PlanRun(**run_in_new_process(__spec__.name, "--one", size, "--order", order)) for size in sizes]
        print(
            f"order {order}; wanted for 1000 segments: {TARGETS[order]:.0f} s, {MAX_MEMORY_MB:.0f} MB\n\n"
            f"{table(runs)}\n",
            flush=True,
        )


if __name__ == "__main__":
    main()
