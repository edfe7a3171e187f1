"""Workpieces as CAM writes them, of any length, and how long planning them takes: `python -m
benchmarks.evidence.speed.workpieces [--lines N] [--order 2|3] [--whole] [--fit-only] [NAME …]`.

Each is G-code, made line by line: a spiral pocket; a raster over a freeform surface, with z in every line; an engraving
of letters, most of whose joins are corners; the same with a wait at each stroke, which several processes can plan; and
slots of lines and arcs that meet smoothly and not. Each is planned part by part by the command line, with pulses and
their check. Printed: seconds of motion, which share of them planning
takes, memory, and how long the motion takes that is planned as a whole.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from math import cos, hypot, pi, sin
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kinematics import Machine

TOLERANCE, FEED, STEP = 0.02, 600.0, 0.42
"""mm; mm/min; mm between points of the spiral."""
HEAD = f"G21 G90 G17 G64 P{TOLERANCE}"


def spiral(lines: int, step: float = STEP, pitch: float = 1.5, radius: float = 1.0) -> Iterator[str]:
    """A pocket: an Archimedean spiral from the middle, in lines of `step`, coordinates to 1 µm; up again and anew
    where it would be wider than 9 mm."""
    yield HEAD
    yield f"G1 X{radius} Y0 Z25 F{FEED:.0f}"
    angle, growth = 0.0, pitch / (2 * pi)
    for _ in range(lines):
        r = radius + growth * angle
        if r > 9.0:
            yield "G0 Z26"
            yield f"G0 X{radius} Y0"
            yield "G1 Z25"
            angle = 0.0
            continue
        # the angle whose chord is a step, by the middle of it
        middle = r + growth * step / (2 * hypot(r, growth))
        angle += step / hypot(middle, growth)
        r = radius + growth * angle
        yield f"G1 X{r * cos(angle):.3f} Y{r * sin(angle):.3f}"


def surface(lines: int, step: float = 0.4, width: float = 16.0, pitch: float = 0.5) -> Iterator[str]:
    """A raster to and fro over z = 25 + sin(0.6 x) cos(0.5 y) + 0.1 sin(1.5 x + y), z in every line; over and over."""

    def height(x: float, y: float) -> float:
        return 25 + sin(0.6 * x) * cos(0.5 * y) + 0.1 * sin(1.5 * x + y)

    yield HEAD
    rows, row, forth = int(width / pitch), 0, True
    columns = int(width / step)
    yield f"G1 X{-width / 2:.3f} Y{-width / 2:.3f} Z{height(-width / 2, -width / 2):.3f} F{FEED:.0f}"
    told = 0
    while told < lines:
        y = pitch * (row if row < rows else 2 * rows - row) - width / 2
        for k in range(columns + 1):
            x = (step * k - width / 2) * (1 if forth else -1)
            if told < lines and (k or row):
                yield f"G1 X{x:.3f} Y{y:.3f} Z{height(x, y):.3f}"
                told += 1
        row, forth = (row + 1) % (2 * rows), not forth


LETTERS: dict[str, list[list[tuple[float, float]]]] = {
    "P": [[(0, 0), (0, 6), (2.5, 6), (3.6, 5.4), (4, 4.5), (3.6, 3.6), (2.5, 3), (0, 3)]],
    "U": [[(0, 6), (0, 2), (0.4, 0.8), (1.3, 0.1), (2, 0), (2.7, 0.1), (3.6, 0.8), (4, 2), (4, 6)]],
    "L": [[(0, 6), (0, 0), (3.6, 0)]],
    "S": [[(3.8, 5), (3.2, 5.7), (2, 6), (0.8, 5.6), (0.3, 4.6), (0.8, 3.6), (2, 3.1), (3.3, 2.5), (3.8, 1.5),
           (3.2, 0.4), (2, 0), (0.8, 0.3), (0.2, 1)]],
    "E": [[(3.8, 0), (0, 0), (0, 6), (3.8, 6)], [(0, 3), (3, 3)]],
}  # fmt: skip
"""Strokes of letters 4 wide and 6 high."""


def engraving(lines: int, text: str = "PULSE", scale: float = 0.5) -> Iterator[str]:
    """Letters in lines, the pen lifted between strokes, one row of text below the other; over and over."""
    yield HEAD
    told, row = 0, 0
    while told < lines:
        for nth, letter in enumerate(text):
            for stroke in LETTERS[letter]:
                points = [((x + 5 * nth) * scale - 6, (y - 8 * (row % 4)) * scale + 4) for x, y in stroke]
                moves = [f"G0 X{points[0][0]:.3f} Y{points[0][1]:.3f} Z26", f"G1 Z25 F{FEED:.0f}"]
                moves += [f"G1 X{x:.3f} Y{y:.3f}" for x, y in points[1:]]
                for move in [*moves, "G0 Z26"]:
                    if told == lines:
                        return
                    yield move
                    told += 1
        row += 1


def marking(lines: int) -> Iterator[str]:
    """The same, with a wait of 50 ms where the pen is down."""
    told = 0
    for move in engraving(lines):
        waits = move.startswith("G1 Z25")
        if (told := told + 1 + waits) > lines + 1:
            return
        yield from (move, "G4 P0.05") if waits else (move,)


def slots(lines: int) -> Iterator[str]:
    """Slots whose half circles meet their lines smoothly, and lenses whose arcs meet at corners; over and over."""
    yield HEAD
    yield f"G1 X-5 Y-2 Z25 F{FEED:.0f}"
    slot = ["G1 X5 Y-2", "G3 X5 Y2 I0 J2", "G1 X-5 Y2", "G3 X-5 Y-2 I0 J-2"]
    lens = ["G2 X5 Y-2 I5 J-3", "G2 X-5 Y-2 I-5 J3"]
    every = [*slot, *lens, *slot, "G3 X-5.1 Y-2.1 I-0.1 J0", "G1 X-5 Y-2"]
    told = 0
    while told < lines:
        for move in islice(every, lines - told):
            yield move
            told += 1


WORKPIECES: dict[str, Callable[[int], Iterator[str]]] = {
    "spiral": spiral,
    "surface": surface,
    "engraving": engraving,
    "marking": marking,
    "slots": slots,
}


def write_workpiece(name: str, lines: int, file: Path) -> Path:
    """A file of about so many lines."""
    with file.open("w") as out:
        out.writelines(f"{line}\n" for line in WORKPIECES[name](lines))
        out.write("M2\n")
    return file


def describe_fit(name: str, lines: int, machine: "Machine") -> str:
    """What reading, drawing and fitting a file as a stream takes, and what comes of it."""
    import resource

    from planner.path.chain import draw_segments
    from planner.path.fit import fit_chains
    from planner.sources.gcode import Gcode

    with TemporaryDirectory() as folder:
        begun = time.process_time()
        program = Gcode().stream(write_workpiece(name, lines, Path(folder) / f"{name}.nc")).program
        pieces, worst = 0, 0.0
        for part in fit_chains(draw_segments(program, machine), machine.characteristic_length):
            pieces += len(part.pieces)
            worst = max(worst, 0.0 if part.fitted is None else part.fitted.deviation)
        took = time.process_time() - begun
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return (
        f"{lines} lines, {pieces} pieces within {worst * 1e6:.2f} um of them (proved), "
        f"{1e3 * took / lines:.3f} ms a line, {memory:.0f} MB at most"
    )


@dataclass(frozen=True, slots=True)
class Planned:
    """What planning a file part by part, as the command line does, took and gave.

    processor, wall  s, of the whole command: reading, planning, proofs, pulses and their check, files
    memory, files    bytes: of memory at most; of all that is written
    duration         s, of the motion; whole: the same planned at once, where that was asked for
    windows, worst   how many it was planned in; the largest proven share of a limit
    """

    name: str
    lines: int
    order: int
    processor: float
    wall: float
    memory: int
    files: int
    duration: float
    windows: int
    worst: float
    whole: float | None = None

    def __str__(self) -> str:
        share = f"{self.processor / self.duration:.3f} of it in processor time, {self.wall / self.duration:.3f} in all"
        told = f"{self.name}, {self.lines} lines, order {self.order}: {self.duration:.3f} s of motion in {share}; "
        told += f"{self.memory / 1e6:.0f} MB, files of {self.files / 1e6:.1f} MB, {self.windows} windows, "
        told += f"limits used to {self.worst:.7f}"
        if self.whole is not None:
            told += f"; planned as a whole {self.whole:.3f} s, {100 * (self.duration / self.whole - 1):+.4f} %"
        return told


# Runs a command, and tells its processor time (s) and its memory at most (KiB): of a process that was small when it was
# started, since what starts another counts as its memory.
MEASURE = """
import json, resource, subprocess, sys
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([used.ru_utime + used.ru_stime, used.ru_maxrss]))
sys.exit(code)
"""


def plan_workpiece(name: str, lines: int, order: int, machine: str, whole: bool = False) -> Planned:
    """A file planned by the command line. Raises RuntimeError with what that says where it fails."""
    with TemporaryDirectory() as folder:
        file, out = write_workpiece(name, lines, Path(folder) / f"{name}.nc"), Path(folder) / "plan"
        command = [sys.executable, "-m", "pulsepath", "plan", str(file), "--machine", machine, "--stream"]
        command += ["--no-figures", "--order", str(order), "--out", str(out), "--quiet"]
        begun = time.perf_counter()
        done = subprocess.run([sys.executable, "-c", MEASURE, *command], capture_output=True, text=True)
        wall = time.perf_counter() - begun
        if done.returncode:
            raise RuntimeError(f"{name}, order {order}: {done.stderr.strip()}")
        processor, memory = json.loads(done.stdout)
        record = json.loads((out / "plan.json").read_bytes())
        found = Planned(
            name,
            lines,
            order,
            processor,
            wall,
            1024 * memory,
            sum(written.stat().st_size for written in out.rglob("*") if written.is_file()),
            record["duration_s"],
            record["windows"],
            max(limit["worst_ratio"] for limit in record["certificate"]["limits"].values()),
        )
        if not whole:
            return found
        from kinematics import load_machine
        from planner import import_program, plan

        made = plan(import_program(file).program, load_machine(machine), order=order)
        return replace(found, whole=made.trajectory.duration)


def main() -> None:
    """Every workpiece asked for, at the orders asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=[])
    parser.add_argument("--lines", type=int, default=1177)
    parser.add_argument("--order", type=int, choices=(2, 3), action="append")
    parser.add_argument("--machine", default="hexapod")
    parser.add_argument("--whole", action="store_true", help="plan as a whole as well, and tell what that saves")
    parser.add_argument("--fit-only", action="store_true", help="read, draw and fit as a stream, and plan nothing")
    asked = parser.parse_args()
    from kinematics import load_machine

    for name in asked.names or WORKPIECES:
        if asked.fit_only:
            print(f"{name}: {describe_fit(name, asked.lines, load_machine(asked.machine))}", flush=True)
            continue
        for order in asked.order or (2, 3):
            print(plan_workpiece(name, asked.lines, order, asked.machine, asked.whole), flush=True)


if __name__ == "__main__":
    main()
