"""Planning of G-code files: motion, classical timing, lower bound, processor time and memory.

Without `--folder`, files are generated: 20 of ordinary CAM, or one `--shape` with `--lines`. The
shapes are planned on the bundled hexapod, all others on the bundled cartesian with a travel of
±1200 mm. The baseline has the same limits and stops at every join: the trapezoid at order 2, the
S-curve at order 3; with `--fit`, along the fitted path or the path as written, whichever is
quicker. A file is `slower` if its motion takes longer than the baseline, and `late` if planning it
takes more than a quarter of its motion plus 5 s.

Planning is the time from the file to the pulses, of all processes, without the lower bound. With
`--parts`, it is that of the command `plan --stream` in a new process: reading, planning, proofs,
pulses, their check, and files. The memory is the peak of the process so far.
"""

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from benchmarks.evidence.measuring import measure_apart, measure_here
from benchmarks.evidence.table import Row, Table
from benchmarks.evidence.workpieces import generate_cam_file, write_shape
from kinematics import Machine, load_machine
from kinematics.foundation.errors import MotionError
from kinematics.foundation.units import Unit
from planner import Classical, Plan, Program, classical, import_program, plan
from planner.baselines.classical import course
from planner.sources.gcode import Gcode

# m: travel of each axis to either side.
TRAVEL = 1.2
SEEDS = 20
# Lines of a shape that is planned first and not counted: it loads the kernels.
FIRST_LINES = 5
# The baseline of each order: it has the limits of the plan.
BASELINES = {2: "trapezoid", 3: "s-curve"}
# Largest share of the motion that planning may take, and seconds on top of it.
LATE_SHARE, LATE_SECONDS = 0.25, 5.0
# Lines of a file above which it has no lower bound: the bound would take longer than the plan.
MAX_BOUNDED = 2000
COLUMNS = (
    "file",
    "lines",
    "motion (s)",
    "baseline (s)",
    "gap (%)",
    "planning (s)",
    "share of the motion",
    "wall (s)",
    "memory (MB)",
    "marks",
)


@dataclass(frozen=True, slots=True)
class CamRun:
    """A planned file: times in s, memory in bytes, None for what was not computed.

    motion     duration of the plan; baseline: of the classical timing with the same limits
    gap        how far the motion is above the lower bound, as a share of the bound
    processor  time from the file to the pulses, of all processes
    refusal    why there is no plan; else ""
    """

    motion: float = float("nan")
    baseline: float | None = None
    gap: float | None = None
    processor: float = float("nan")
    wall: float = float("nan")
    memory: int = 0
    certified: bool = False
    refusal: str = ""

    @property
    def marks(self) -> list[str]:
        """List the faults of the plan."""
        if self.refusal:
            return [self.refusal]
        faults = {
            "slower": self.baseline is not None and self.motion > self.baseline,
            "late": self.processor > LATE_SHARE * self.motion + LATE_SECONDS,
            "not certified": not self.certified,
        }
        return [fault for fault, applies in faults.items() if applies]

    def row(self, file: Path) -> Row:
        """Return the row of the table."""
        return [
            file.name,
            count_lines(file),
            self.motion,
            self.baseline,
            None if self.gap is None else 100 * self.gap,
            self.processor,
            self.processor / self.motion,
            self.wall,
            self.memory / 1e6,
            ", ".join(self.marks),
        ]


def make_machine() -> Machine:
    """Return the bundled cartesian with room for a workpiece of any size."""
    machine = copy(load_machine("cartesian"))
    machine.axes = tuple(replace(axis, travel=(-TRAVEL, TRAVEL)) for axis in machine.axes)
    return machine


def read_program(file: Path, fit: float | None) -> Program:
    """Read a G-code file, whatever its suffix; fit: m, within which its path is fitted."""
    return import_program(file, "gcode", fit=fit).program


def find_baseline(planned: Plan, file: Path, fit: float | None) -> Classical:
    """Find the classical timing that is as good as the plan's limits allow.

    With a fit it is the quicker of two: along the fitted path, and along the path as written.
    """
    kind = BASELINES[planned.order]
    timings = [classical(planned, kind)]
    if fit is not None:
        written = course(read_program(file, None), planned.machine, planned.order)
        timings.append(classical(written, kind))
    return min(timings, key=lambda timing: timing.duration)


def plan_file(file: Path, machine: Machine, order: int, fit: float | None) -> CamRun:
    """Plan a file in this process, and compare it with its baseline and its lower bound."""
    measured = measure_here(lambda: plan(read_program(file, fit), machine, order=order))
    planned = measured.result
    baseline = find_baseline(planned, file, fit)
    return CamRun(
        planned.trajectory.duration,
        baseline.duration,
        gap=planned.gap if count_lines(file) <= MAX_BOUNDED else None,
        processor=measured.processor,
        wall=measured.wall,
        memory=measured.peak,
        certified=planned.certificate.holds and baseline.certificate.holds,
    )


def plan_in_parts(file: Path, order: int) -> CamRun:
    """Plan a file on the hexapod by the command, part by part."""
    out = file.with_suffix("")
    command = f"pulsepath plan {file} --machine hexapod --stream --order {order} --out {out} -q"
    words = [sys.executable, "-m", *command.split(), "--no-figures"]
    measured = measure_apart(partial(subprocess.run, capture_output=True, text=True), words)
    if measured.result.returncode:
        raise MotionError(measured.result.stderr)
    record = json.loads((out / "plan.json").read_bytes())
    return CamRun(
        record["duration_s"],
        processor=measured.processor,
        wall=measured.wall,
        memory=measured.peak,
        certified=record["certificate"]["holds"],
    )


def count_lines(file: Path) -> int:
    with file.open("rb") as text:
        return sum(1 for _ in text)


def find_files(folder: Path) -> list[Path]:
    """List the files of a folder that a G-code reader takes by their suffix, in order of length."""
    suffixes = {*Gcode.suffixes, ".gc"}
    files = [file for file in folder.iterdir() if file.suffix.lower() in suffixes]
    return sorted(files, key=count_lines)


def write_cam_files(folder: Path) -> list[Path]:
    """Write the generated CAM files into a folder."""
    files = [folder / f"seed-{seed}.nc" for seed in range(1, SEEDS + 1)]
    for seed, file in enumerate(files, 1):
        file.write_text(generate_cam_file(seed))
    return files


def try_file(file: Path, work: Callable[[Path], CamRun]) -> CamRun:
    """Plan a file; a refusal is a row of the table, too."""
    try:
        return work(file)
    except MotionError as error:
        return CamRun(refusal=f"refused: {str(error).splitlines()[0]}")


def measure(
    shape: Literal["", "spiral", "surface", "engraving", "marking", "slots"] = "",
    lines: int = 1177,
    folder: Path | None = None,
    order: Literal[2, 3] = 3,
    fit: str | None = None,
    parts: bool = False,
) -> Iterator[Table | str]:
    """Yield the table of files, and how many of them have marks."""
    if parts and not shape:
        raise MotionError("--parts needs a --shape: ordinary CAM files are short and planned whole")
    tolerance = None if fit is None else Unit("m", above=0).read(fit, {})
    machine = load_machine("hexapod") if shape else make_machine()
    runs: list[CamRun] = []

    def plan_one(file: Path) -> CamRun:
        if parts:
            return plan_in_parts(file, order)
        return plan_file(file, machine, order, tolerance)

    def rows() -> Iterator[Row]:
        for file in files:
            runs.append(try_file(file, plan_one))
            yield runs[-1].row(file)

    with TemporaryDirectory() as name:
        scratch = Path(name)
        plan_one(write_shape("slots", FIRST_LINES, scratch / "first.nc"))
        if folder is not None:
            files = find_files(folder)
        elif shape:
            files = [write_shape(shape, lines, scratch / f"{shape}.nc")]
        else:
            files = write_cam_files(scratch)
        yield Table(
            "", COLUMNS, rows(), f"order {order}, fit {fit}, {'in parts' if parts else 'whole'}"
        )
    counts = Counter(mark for run in runs for mark in run.marks)
    faults = ", ".join(f"{count} {mark}" for mark, count in counts.items())
    yield f"{len(runs)} files; {faults or 'no marks'}"
