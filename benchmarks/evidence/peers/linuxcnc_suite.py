"""LinuxCNC's own files for its trajectory planner, read, planned and certified: `python -m
benchmarks.evidence.peers.linuxcnc_suite DIR [--config INI] [--order 2|3] [--only WORD]`.

DIR is `tests/trajectory-planner/circular-arcs/nc_files` of LinuxCNC's sources, `violation_checks` of it is taken first;
INI its configuration of a machine, `configs/XYZ.ini` beside DIR: the axes' travel, speed and acceleration, and of order
3 a jerk that reaches the acceleration in 50 ms, which LinuxCNC does not have. Every file is planned part by part with
pulses, or refused with its line. G64 without a tolerance, which leaves the path by any distance, is fitted within
--tolerance; words of spindle, coolant and tools are left out; blocks that begin with a slash are skipped, as LinuxCNC
does unless it is told otherwise. Uses of the limits are of differences of the axes' positions at every millisecond,
not of the derivatives that the certificate is about, whose bound stands beside them.
"""

from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from re import finditer
from time import process_time
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from benchmarks.evidence.published.compared import markdown
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import FileError, MotionError
from kinematics.kinds.traverser import Traverser
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from planner.place import Infeasible
from planner.plan_parts import plan_parts
from planner.program.model import Program
from planner.sources.gcode import Gcode

FIRST = "violation_checks"
IGNORED = "M S T H D G43 G97"
PERIOD, RISE = 1e-3, 0.05
"""s: of a controller, and that an axis takes to its acceleration."""
METRES = {"inch": 0.0254, "in": 0.0254, "mm": 1e-3}
TOLERANCE = 25.4e-6
"""m: a thousandth of an inch."""
QUANTITIES = ("speed", "acceleration", "jerk")


@dataclass(frozen=True, slots=True)
class Limits:
    """Of an axis of a configuration, SI units: lowest and highest place, speed, acceleration."""

    low: float
    high: float
    speed: float
    acceleration: float


def read_limits(ini: Path) -> tuple[list[Limits], str]:
    """X, Y, Z of a configuration of LinuxCNC, and its unit of length."""
    text = "\n".join(line.partition("#")[0] for line in ini.read_text(encoding="utf-8").splitlines())
    sections = [
        (section[1], {key[1]: key[2] for key in finditer(r"(?m)^\s*(\w+)\s*=\s*(\S+)", section[2])})
        for section in finditer(r"(?ms)^\[(\w+)\](.*?)(?=^\[|\Z)", text)
    ]
    unit = next(keys["LINEAR_UNITS"] for name, keys in sections if name == "TRAJ")
    scale, found = METRES[unit], list[Limits]()
    for k in range(3):
        keys = next(keys for name, keys in sections if name in (f"AXIS_{k}", f"JOINT_{k}"))
        values = (keys[name] for name in ("MIN_LIMIT", "MAX_LIMIT", "MAX_VELOCITY", "MAX_ACCELERATION"))
        found.append(Limits(*(float(value) * scale for value in values)))
    return found, unit


def build_machine(limits: Sequence[Limits]) -> Machine:
    """Three slides, and a rotary axis that stands; home is its zero."""
    slides = [
        Axis(
            name,
            travel=(one.low, one.high),
            max_speed=one.speed,
            max_acceleration=one.acceleration,
            max_jerk=one.acceleration / RISE,
            pulse=1e-6,
        )
        for name, one in zip("XYZ", limits, strict=True)
    ]
    rotary = Axis("R", kind="rotary", max_speed=1.0, max_acceleration=10.0, max_jerk=200.0, pulse=1e-3)
    return Traverser(axes=(*slides, rotary), home=RigidTransform.identity(), name="linuxcnc")


class Differences:
    """The largest differences of an axis' positions at every period, as shares of its limits.

    limits  (orders, axes): of speed, acceleration, and jerk or not
    """

    def __init__(self, limits: Array, period: float = PERIOD) -> None:
        self.limits, self.period = limits, period
        self.largest = np.zeros(limits.shape)
        self._last = np.empty((0, limits.shape[1]))

    def add(self, q: Array) -> None:
        """Positions (N, axes) that follow the ones before."""
        rows = np.concatenate([self._last, q])
        for k, limit in enumerate(self.limits):
            if len(rows) > k + 1:
                size = np.abs(np.diff(rows, k + 1, axis=0)).max(0) / self.period ** (k + 1)
                self.largest[k] = np.maximum(self.largest[k], size / limit)
        self._last = rows[-len(self.limits) :]

    @property
    def uses(self) -> list[float]:
        """The largest share of all axes, of each order."""
        return [float(use) for use in self.largest.max(1)]


@dataclass(frozen=True, slots=True)
class FileOutcome:
    """What became of a file. duration: s; refused: with its line, "" where it was planned.

    proved, sampled  largest uses of limits: of all, by the certificate; of speed, acceleration (and jerk), by samples
    took             s of processor time, reading and pulses too
    """

    segments: int = 0
    duration: float = 0.0
    proved: float = 0.0
    sampled: tuple[float, ...] = ()
    took: float = 0.0
    refused: str = ""


def read_program(file: Path, tolerance: float, unit: str = "mm", blend: float | None = None) -> Program:
    """As LinuxCNC would read it. Raises FileError.

    blend: m, within which joins are rounded that the file says nothing of
    """
    fit = tolerance if blend is None else None
    length: Literal["mm", "in"] = "in" if METRES[unit] > 1e-3 else "mm"
    source = Gcode(ignore=IGNORED, fit=fit, blend=blend, length=length, block_delete="skip")
    return source.stream(file).program


def plan_file(
    file: Path,
    machine: Machine,
    order: int,
    tolerance: float = TOLERANCE,
    unit: str = "mm",
    blend: float | None = None,
) -> FileOutcome:
    """One file planned part by part, held against its limits by samples, or refused."""
    begin = process_time()
    try:
        program = read_program(file, tolerance, unit, blend)
    except FileError as refused:
        fault = refused.faults[0]
        return FileOutcome(refused=f"line {fault.line}: {fault.message}")
    axes = machine.axes[:3]
    limits = [[getattr(axis, f"max_{name}") for axis in axes] for name in QUANTITIES[:order]]
    differences, elapsed = Differences(np.array(limits)), 0.0
    standing = None
    try:
        for part in plan_parts(program, machine, order=order):
            end = elapsed + part.motion.duration
            first, last = int(np.ceil(elapsed / PERIOD)), int(np.ceil(end / PERIOD))
            if last > first:
                times = np.clip(np.arange(first, last) * PERIOD - elapsed, 0.0, part.motion.duration)
                differences.add(part.motion.at(times).q[:, :3])
            elapsed, standing = end, part.standing
    except MotionError as refused:
        return FileOutcome(len(program.segments), refused=_tell_refusal(program, refused))
    if standing is None:
        return FileOutcome(len(program.segments), refused="nothing moves")
    proof = standing.certificate
    told = "" if proof.holds else "not certified"
    worst = max(proof.worst.values())
    took = process_time() - begin
    return FileOutcome(len(program.segments), standing.duration, worst, tuple(differences.uses), took, told)


def _tell_refusal(program: Program, refused: MotionError) -> str:
    number = None
    if isinstance(refused, Infeasible) and refused.place is not None:
        number = refused.place.segment
    line = "" if number is None else f"line {program.segments[number - 1].line_number}: "
    return line + str(refused).partition("\n")[0]


def find_files(folder: Path, only: str = "", lines: int | None = None) -> list[Path]:
    """Those of violation_checks first; links to folders that are read in their own place are left out.

    lines: at most, of a file
    """
    found = [file for file in folder.rglob("*.ngc") if only in str(file) and not file.is_symlink()]
    if lines is not None:
        found = [file for file in found if file.read_bytes().count(b"\n") <= lines]
    return sorted(found, key=lambda file: (FIRST not in file.parts, file))


def compare(files: Sequence[Path], root: Path, machine: Machine, orders: Sequence[int], tolerance: float, unit: str
            ) -> Iterator[list[str]]:  # fmt: skip
    """A row for each file: how long its motion takes at each order, and how far its limits are used."""
    for file in files:
        row = [str(file.relative_to(root)), ""]
        for order in orders:
            try:
                found = plan_file(file, machine, order, tolerance, unit)
            except Exception as crash:  # whatever it is, the table names it and goes on to the next file
                found = FileOutcome(refused=f"CRASH {type(crash).__name__}: {crash}")
            row[1] = str(found.segments or "")
            if found.refused:
                row += [found.refused, "", "", ""]
                continue
            uses = " / ".join(f"{use:.4f}" for use in found.sampled)
            row += [f"{found.duration:.3f}", f"{found.proved:.7f}", uses, f"{found.took:.2f}"]
        yield row


def main() -> None:
    parser = ArgumentParser(prog="python -m benchmarks.evidence.peers.linuxcnc_suite", description=__doc__)
    parser.add_argument("folder", type=Path, help="nc_files of LinuxCNC's sources")
    parser.add_argument("--config", type=Path, help="a configuration of LinuxCNC; default configs/XYZ.ini beside DIR")
    parser.add_argument("--order", type=int, choices=(2, 3), action="append")
    parser.add_argument("--only", default="", help="what a file's path has to contain")
    parser.add_argument("--tolerance", type=float, default=1e3 * TOLERANCE, help="mm, of G64 without one")
    parser.add_argument("--lines", type=int, help="leave files of more lines out")
    asked = parser.parse_args()
    limits, unit = read_limits(asked.config or asked.folder.parent / "configs" / "XYZ.ini")
    orders = asked.order or [2, 3]
    header = ["file", "segments"]
    for order in orders:
        told = " / ".join(QUANTITIES[:order])
        header += [f"order {order} (s)", "proved", f"sampled: {told}", "took (s)"]
    files = find_files(asked.folder, asked.only, asked.lines)
    print(markdown(header, []), flush=True)
    done, refused, sums = 0, 0, np.zeros((len(orders), 2))
    for row in compare(files, asked.folder, build_machine(limits), orders, 1e-3 * asked.tolerance, unit):
        print(markdown(header, [row]).splitlines()[-1], flush=True)
        planned = [bool(row[k]) for k in range(3, len(row), 4)]
        done += all(planned)
        refused += not any(planned)
        if all(planned):
            sums += [[float(row[k]), float(row[k + 3])] for k in range(2, len(row), 4)]
    print(f"\n{len(files)} files: {done} planned and certified, {refused} refused with the line, ", end="")
    print(f"{len(files) - done - refused} planned at one order")
    for order, (motion, took) in zip(orders, sums.tolist(), strict=True):
        print(f"order {order}: {motion:.1f} s of motion in {took:.1f} s of processor time, {took / motion:.3f} of it")


if __name__ == "__main__":
    main()
