"""How an order-3 run grows with its length: `python -m benchmarks.evidence.speed.polyline [--lines 20,60,200,1000]`.

Lines of 0.4 mm by a seeded random walk of the hexapod, 25 mm above home, blended within 0.02 mm, so that nothing stops
between the first and the last. Solved and proved in windows, as `plan` does with long programs, from the program on;
and as a whole, from the path on. Processor time of one process, kernels loaded.
"""

import resource
from argparse import ArgumentParser
from dataclasses import dataclass
from time import process_time

import numpy as np
from scipy.spatial.transform import RigidTransform

from benchmarks.evidence.measuring import time_calls
from benchmarks.evidence.published.compared import markdown
from kinematics import load_machine
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.path.chain import walk_path
from planner.program.model import Line, Program
from planner.program.modifiers import Blend
from planner.timing.certified_solve import certified_solve
from planner.windows import Window, WindowPlanner

# m: length and height of the lines, how far they stray from the middle, and the blends' tolerance; rad, a turn at most.
STEP, HEIGHT, REACH, BLEND = 4e-4, 25e-3, 15e-3, 2e-5
TURN = 0.6
LENGTHS = (20, 60, 200, 1000)
# Lines of a first run that is not counted: it loads the kernels.
FIRST_LINES = 3


@dataclass(frozen=True, slots=True)
class PolylineRun:
    """duration (s) of the motion, its intervals, how it was made, processor time (s), memory (MB) so far."""

    lines: int
    duration: float
    intervals: int
    method: str
    processor: float
    memory: float

    @property
    def per_line(self) -> float:
        """Processor time of each line (ms)."""
        return 1e3 * self.processor / self.lines


def walk(lines: int, seed: int = 0) -> Program:
    """So many lines, each turned from the one before it by up to TURN, and by a right angle where it would stray."""
    rng = np.random.default_rng(seed)
    angle, place, segments = 0.0, np.zeros(2), []
    for k in range(lines):
        angle += rng.uniform(-TURN, TURN)
        step = STEP * np.array([np.cos(angle), np.sin(angle)])
        if np.hypot(*(place + step)) > REACH:
            angle += np.pi / 2
            step = STEP * np.array([np.cos(angle), np.sin(angle)])
        place = place + step
        end = np.append(place, HEIGHT)
        segments.append(Line(end, join=Blend(BLEND)) if k < lines - 1 else Line(end))
    return Program(start=RigidTransform.from_translation([0.0, 0.0, HEIGHT]), segments=tuple(segments))


def run_in_windows(lines: int, order: int = 3) -> PolylineRun:
    """Solve and prove such a walk in this process, window by window."""
    machine = load_machine("hexapod")
    program = walk(lines)
    planner = WindowPlanner(machine, lambda path: limits_of(path, machine.axes, order), order)

    def plan() -> tuple[Window, int, int]:
        intervals = count = 0
        for window in planner(walk_path(program, machine)):
            intervals, count = intervals + window.kept, count + 1
        return window, intervals, count

    (last, intervals, count), (processor,) = time_calls(plan, clock=process_time)
    told = f"{count} window{'s'[: count > 1]}"
    return PolylineRun(lines, last.next.begin, intervals, told, processor, _peak_memory())


def run(lines: int, order: int = 3) -> PolylineRun:
    """Solve and prove such a walk in this process, as a whole."""
    machine = load_machine("hexapod")
    path = actuate(walk(lines), machine)
    limits = limits_of(path, machine.axes, order)
    found, (processor,) = time_calls(lambda: certified_solve(path, limits, order), clock=process_time)
    motion = found.trajectory
    return PolylineRun(lines, motion.duration, len(motion.knots) - 1, found.methods[0], processor, _peak_memory())


def _peak_memory() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def table(runs: list[PolylineRun]) -> str:
    """As Markdown."""
    head = (
        "lines",
        "motion (s)",
        "intervals of a line",
        "processor time (s)",
        "of a line (ms)",
        "memory (MB)",
        "method",
    )
    rows = [
        (
            str(one.lines),
            f"{one.duration:.4f}",
            f"{one.intervals / one.lines:.0f}",
            f"{one.processor:.2f}",
            f"{one.per_line:.1f}",
            f"{one.memory:.0f}",
            one.method,
        )
        for one in runs
    ]
    return markdown(head, rows)


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--lines", default=",".join(map(str, LENGTHS)))
    parser.add_argument("--order", type=int, choices=(2, 3), default=3)
    asked = parser.parse_args()
    lengths = [int(lines) for lines in asked.lines.split(",")]
    for way in (run_in_windows, run):  # which takes more memory comes last
        way(FIRST_LINES, asked.order)
        print(f"{table([way(lines, asked.order) for lines in lengths])}\n")


if __name__ == "__main__":
    main()
