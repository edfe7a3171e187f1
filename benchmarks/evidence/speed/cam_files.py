"""Plan ordinary CAM files and compare each with the classical timing: `python -m
benchmarks.evidence.speed.cam_files [FOLDER …] [--seeds N] [--fit "0.02 mm"] [--order 2|3]`.

A CAM file moves slowly in the material and quickly above it. Without FOLDER, the files are
generated: pockets, contours, bores, drilling and engraving, with feeds of 5 to 600 mm/min between
rapids. Each follows from its seed alone. With FOLDER, all G-code files in it are read. The machine
is the bundled cartesian with a travel of ±1200 mm.

The baseline has the same limits and stops at every join: the trapezoid at order 2, the S-curve at
order 3; with a fit, along the fitted path or the path as written, whichever is quicker. A file is
marked `slower` if its motion takes longer than the baseline, and `late` if planning it takes more
than a quarter of its motion plus 5 s.
"""

import signal
from argparse import ArgumentParser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from copy import copy
from dataclasses import dataclass, replace
from math import cos, pi, sin
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from types import FrameType

import numpy as np

from benchmarks.evidence.measuring import time_calls
from benchmarks.evidence.published.compared import markdown
from benchmarks.evidence.speed.workpieces import LETTERS
from kinematics import Machine, load_machine
from kinematics.foundation.errors import MotionError
from kinematics.foundation.units import Unit
from planner import Classical, Plan, Program, classical, import_program, plan
from planner.baselines.classical import course
from planner.parallel import without_processes
from planner.sources.gcode import Gcode

# m: travel of each axis to either side.
TRAVEL = 1.2
# mm/min: the feeds of ordinary materials, from engraved steel to foam.
FEEDS = 5.0, 600.0
# mm: height of the rapids, and how far the features of a file lie from its zero.
CLEARANCE, REACH = 5.0, 300.0
# Features of a generated file, at most.
MAX_FEATURES = 5
# The baseline of each order: it has the limits of the plan.
BASELINES = {2: "trapezoid", 3: "s-curve"}
# Largest share of the motion that planning may take, and seconds on top of it.
LATE_SHARE, LATE_SECONDS = 0.25, 5.0
# s of processor time for the plan of a file, and again for its bound, unless the command says
# otherwise.
TIME_LIMIT = 600.0
MM_PER_INCH = 25.4

Move = tuple[str, dict[str, float]]
"""A G word and its arguments, in mm and mm/min."""


# A feature begins with the tool at CLEARANCE and ends there. It lies around its own zero.


def cut_contour(rng: np.random.Generator) -> Iterator[Move]:
    """Generate the outline of a plate with round corners, in one or two depths."""
    width, height = rng.uniform(10.0, 80.0, 2)
    radius = rng.uniform(0.05, 0.5) * min(width, height)
    feed = draw_feed(rng)
    yield "G0", {"X": radius, "Y": 0.0}
    for depth in range(1, int(rng.integers(2, 4))):
        yield "G1", {"Z": -float(depth), "F": feed * rng.uniform(0.2, 1.0)}
        yield "G1", {"X": width - radius, "Y": 0.0, "F": feed}
        yield "G3", {"X": width, "Y": radius, "I": 0.0, "J": radius}
        yield "G1", {"X": width, "Y": height - radius}
        yield "G3", {"X": width - radius, "Y": height, "I": -radius, "J": 0.0}
        yield "G1", {"X": radius, "Y": height}
        yield "G3", {"X": 0.0, "Y": height - radius, "I": 0.0, "J": -radius}
        yield "G1", {"X": 0.0, "Y": radius}
        yield "G3", {"X": radius, "Y": 0.0, "I": radius, "J": 0.0}
    yield "G0", {"Z": CLEARANCE}


def cut_pocket(rng: np.random.Generator) -> Iterator[Move]:
    """Generate a pocket: a ramp into the material, a raster, and the walls."""
    width, height = rng.uniform(5.0, 40.0, 2)
    rows = int(rng.integers(3, 8))
    feed = draw_feed(rng)
    yield "G0", {"X": 0.0, "Y": 0.0}
    yield "G1", {"Z": 0.0, "F": feed}
    yield "G1", {"X": width, "Z": -1.0, "F": feed / 2}
    yield "G1", {"X": 0.0, "F": feed}
    for row in range(1, rows):
        yield "G1", {"Y": height * row / (rows - 1)}
        yield "G1", {"X": width if row % 2 else 0.0}
    for x, y in ((0.0, height), (0.0, 0.0), (width, 0.0), (width, height), (0.0, height)):
        yield "G1", {"X": x, "Y": y, "F": feed * 0.8}
    yield "G0", {"Z": CLEARANCE}


def cut_bore(rng: np.random.Generator) -> Iterator[Move]:
    """Generate a helix down into the material and a full circle at its bottom."""
    radius = rng.uniform(1.0, 15.0)
    feed = draw_feed(rng)
    yield "G0", {"X": radius, "Y": 0.0}
    yield "G1", {"Z": 0.2, "F": feed}
    for turn in range(1, int(rng.integers(2, 6))):
        yield "G2", {"X": radius, "Y": 0.0, "Z": -0.5 * turn, "I": -radius, "J": 0.0}
    yield "G2", {"X": radius, "Y": 0.0, "I": -radius, "J": 0.0}
    yield "G1", {"X": 0.0}
    yield "G0", {"Z": CLEARANCE}


def drill_holes(rng: np.random.Generator) -> Iterator[Move]:
    """Generate a row of holes, each drilled in steps with the chips cleared between them."""
    pitch = rng.uniform(2.0, 50.0)
    feed = draw_feed(rng)
    steps = int(rng.integers(1, 4))
    for hole in range(int(rng.integers(2, 6))):
        yield "G0", {"X": pitch * hole, "Y": 0.0}
        for step in range(1, steps + 1):
            yield "G0", {"Z": 1.5 - step}
            yield "G1", {"Z": -float(step), "F": feed}
            yield "G0", {"Z": 1.0}
        yield "G0", {"Z": CLEARANCE}


def engrave_letters(rng: np.random.Generator) -> Iterator[Move]:
    """Generate letters of straight strokes, 1.2 to 12 mm high."""
    scale = rng.uniform(0.2, 2.0)
    feed = draw_feed(rng)
    for place, letter in enumerate(rng.choice([*LETTERS], int(rng.integers(1, 4)))):
        for stroke in LETTERS[str(letter)]:
            points = [(scale * (x + 5 * place), scale * y) for x, y in stroke]
            yield "G0", {"X": points[0][0], "Y": points[0][1]}
            yield "G1", {"Z": -0.2, "F": feed / 2}
            for x, y in points[1:]:
                yield "G1", {"X": x, "Y": y, "F": feed}
            yield "G0", {"Z": CLEARANCE}


def engrave_curve(rng: np.random.Generator) -> Iterator[Move]:
    """Generate a smooth closed curve in short lines: what CAM makes of a spline."""
    count = int(rng.integers(12, 30))
    size, lobes = rng.uniform(2.0, 20.0), int(rng.integers(2, 4))
    wave = rng.uniform(0.05, 0.2)
    feed = draw_feed(rng)
    for k in range(count + 1):
        angle = 2 * pi * k / count
        radius = size * (1 + wave * cos(lobes * angle))
        point = {"X": radius * cos(angle), "Y": radius * sin(angle)}
        if k == 0:
            yield "G0", point
            yield "G1", {"Z": -0.2, "F": feed / 2}
        else:
            yield "G1", {**point, "F": feed}
    yield "G0", {"Z": CLEARANCE}


FEATURES: dict[str, Callable[[np.random.Generator], Iterator[Move]]] = {
    "contour": cut_contour,
    "pocket": cut_pocket,
    "bore": cut_bore,
    "drilling": drill_holes,
    "letters": engrave_letters,
    "curve": engrave_curve,
}


def draw_feed(rng: np.random.Generator) -> float:
    """Draw a feed in mm/min, evenly on a logarithmic scale."""
    low, high = np.log(FEEDS)
    return float(np.exp(rng.uniform(low, high)))


def generate_cam_file(seed: int, features: Sequence[str] | None = None) -> str:
    """Generate the text of a G-code file.

    features: names in FEATURES. None: one to MAX_FEATURES of them, drawn by the seed.
    """
    rng = np.random.default_rng([seed, 32])
    if features is None:
        count = int(rng.integers(1, MAX_FEATURES + 1))
        features = [str(name) for name in rng.choice([*FEATURES], count)]
    inches = rng.random() < 0.25
    lines = [f"{'G20' if inches else 'G21'} G90 G17", f"S{rng.integers(5, 24)}000 M3"]
    lines.append(write_move(("G0", {"Z": CLEARANCE}), (0.0, 0.0), inches))
    for name in features:
        x, y = rng.uniform(-REACH, REACH, 2)
        lines += [write_move(move, (x, y), inches) for move in FEATURES[name](rng)]
    return "\n".join([*lines, "M5", "M2", ""])


def write_move(move: Move, origin: tuple[float, float], inches: bool) -> str:
    """Return the block of a move of a feature at `origin` (mm), rounded as CAM rounds it."""
    word, arguments = move
    digits, unit = (4, MM_PER_INCH) if inches else (3, 1.0)
    shift = {"X": origin[0], "Y": origin[1]}
    words = [word]
    for letter, value in arguments.items():
        value = (value + shift.get(letter, 0.0)) / unit
        words.append(f"{letter}{value:.{digits}f}")
    return " ".join(words)


@dataclass(frozen=True, slots=True)
class CamOptions:
    """How files are planned.

    fit      m, within which the path is fitted; None: the path is as written
    seconds  of processor time for the plan with its baseline, and again for the lower bound
    """

    order: int
    fit: float | None = None
    seconds: float = TIME_LIMIT


@dataclass(frozen=True, slots=True)
class CamRun:
    """A planned file: times in s, gap as a share of the proved lower bound.

    motion     duration of the plan; baseline: of the classical timing with the same limits
    gap        how far the motion is above the lower bound; None if the bound was not computed
    processor  time to read the file and to plan it, with its pulses and without the bound
    refusal    why there is no plan; else ""
    """

    name: str
    lines: int
    motion: float = float("nan")
    baseline: float = float("nan")
    gap: float | None = None
    processor: float = float("nan")
    certified: bool = False
    refusal: str = ""

    @property
    def slower(self) -> bool:
        """Return whether the motion takes longer than the baseline."""
        return self.motion > self.baseline

    @property
    def late(self) -> bool:
        """Return whether planning took too long for the motion."""
        return self.processor > LATE_SHARE * self.motion + LATE_SECONDS

    @property
    def cells(self) -> list[str]:
        """Row of the table."""
        if self.refusal:
            return [self.name, str(self.lines), "", "", "", "", self.refusal]
        marks = {"slower": self.slower, "late": self.late, "not certified": not self.certified}
        return [
            self.name,
            str(self.lines),
            f"{self.motion:.5f}",
            f"{self.baseline:.5f}",
            "out of time" if self.gap is None else f"{100 * self.gap:.4f} %",
            f"{self.processor:.2f}",
            ", ".join(mark for mark, applies in marks.items() if applies),
        ]


HEADER = ("file", "lines", "motion (s)", "baseline (s)", "gap", "planning (s)", "marks")


class OutOfTime(Exception):
    """A file took more processor time than it was given."""


@contextmanager
def limit_time(seconds: float) -> Iterator[None]:
    """Raise OutOfTime if the block takes more processor time than that, where the system can."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise OutOfTime

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def make_machine() -> Machine:
    """Return the bundled cartesian with room for a workpiece of any size."""
    machine = copy(load_machine("cartesian"))
    machine.axes = tuple(replace(axis, travel=(-TRAVEL, TRAVEL)) for axis in machine.axes)
    return machine


def read_program(file: Path, fit: float | None) -> Program:
    """Read a G-code file, whatever its suffix; fit: m, within which its path is fitted."""
    return import_program(file, "gcode", fit=fit).program


def find_baseline(made: Plan, file: Path, fit: float | None) -> Classical:
    """Find the classical timing that is as good as the plan's limits allow.

    With a fit it is the quicker of two: along the fitted path, and along the path as written.
    """
    kind = BASELINES[made.order]
    timings = [classical(made, kind)]
    if fit is not None:
        written = course(read_program(file, None), made.machine, made.order)
        timings.append(classical(written, kind))
    return min(timings, key=lambda timing: timing.duration)


def plan_file(file: Path, machine: Machine, options: CamOptions) -> CamRun:
    """Plan a file in this process, and compare it with its baseline and its lower bound.

    Raises MotionError for a file that cannot be read or planned, OutOfTime for a slow one.
    """

    def read_and_plan() -> Plan:
        return plan(read_program(file, options.fit), machine, order=options.order)

    with without_processes():
        with limit_time(options.seconds):
            made, (processor,) = time_calls(read_and_plan, clock=process_time)
            baseline = find_baseline(made, file, options.fit)
        gap: float | None = None
        with suppress(OutOfTime), limit_time(options.seconds):
            gap = made.gap
    return CamRun(
        file.name,
        count_lines(file),
        motion=made.trajectory.duration,
        baseline=baseline.duration,
        gap=gap,
        processor=processor,
        certified=made.certificate.holds and baseline.certificate.holds,
    )


def try_file(file: Path, machine: Machine, options: CamOptions) -> CamRun:
    """Plan a file as `plan_file` does; a refusal is a row of the table, too."""
    try:
        return plan_file(file, machine, options)
    except OutOfTime:
        refusal = f"given up after {options.seconds:.0f} s"
    except MotionError as error:
        refusal = f"refused: {str(error).splitlines()[0]}"
    return CamRun(file.name, count_lines(file), refusal=refusal)


def count_lines(file: Path) -> int:
    with file.open("rb") as text:
        return sum(1 for _ in text)


def find_files(folder: Path) -> list[Path]:
    """List the files of a folder that a G-code reader takes by their suffix, in order of length."""
    suffixes = {*Gcode.suffixes, ".gc"}
    files = [file for file in folder.iterdir() if file.suffix.lower() in suffixes]
    return sorted(files, key=count_lines)


def write_files(folder: Path, seeds: int) -> list[Path]:
    """Write the generated files of the first seeds into a folder."""
    files = [folder / f"seed-{seed}.nc" for seed in range(seeds)]
    for seed, file in enumerate(files):
        file.write_text(generate_cam_file(seed))
    return files


def main() -> None:
    name = "python -m benchmarks.evidence.speed.cam_files"
    parser = ArgumentParser(prog=name, description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--seeds", type=int, default=20, help="how many files are generated")
    parser.add_argument("--fit", help='tolerance of a fit, as "0.02 mm"; default: no fit')
    parser.add_argument("--order", type=int, choices=(2, 3), default=3)
    limit_help = "s of processor time for a plan, and again for its bound"
    parser.add_argument("--limit", type=float, default=TIME_LIMIT, help=limit_help)
    given = parser.parse_args()
    fit = None if given.fit is None else Unit("m", above=0).read(given.fit, {})
    options = CamOptions(given.order, fit, given.limit)
    machine = make_machine()
    runs: list[CamRun] = []
    with TemporaryDirectory() as scratch:
        first, *generated = write_files(Path(scratch), given.seeds + 1)
        # the first plan loads the kernels: it is not counted
        try_file(first, machine, options)
        files = [file for folder in given.folders for file in find_files(folder)]
        print(markdown(HEADER, []), flush=True)
        for file in files if given.folders else generated:
            runs.append(try_file(file, machine, options))
            print(markdown(runs[-1].cells, []).splitlines()[0], flush=True)
    print(f"\n{summarize(runs)}")


def summarize(runs: Sequence[CamRun]) -> str:
    """Count the files, and those of them with a mark."""
    planned = [one for one in runs if not one.refusal]
    slower = sum(one.slower for one in planned)
    late = sum(one.late for one in planned)
    uncertified = sum(not one.certified for one in planned)
    widest = max((one.gap for one in planned if one.gap is not None), default=0.0)
    return (
        f"{len(planned)} of {len(runs)} files planned: {slower} slower than the baseline, "
        f"{late} late, {uncertified} not certified; the widest gap is {100 * widest:.4f} %"
    )


if __name__ == "__main__":
    main()
