"""LinuxCNC's own files for its planner: read, planned part by part and certified, or refused.

`--folder` is `tests/trajectory-planner/circular-arcs/nc_files` of LinuxCNC's sources, `--config`
its configuration of a machine, by default `configs/XYZ.ini` next to the folder: the axes' travel,
speed and acceleration. At order 3 a jerk that reaches the acceleration in 50 ms is added, which
LinuxCNC does not have. G64 without a tolerance is fitted within `--tolerance` mm; words of spindle,
coolant and tools are left out; blocks that begin with a slash are skipped, as in LinuxCNC. Uses are
of differences of the axes' positions at every millisecond, not of the derivatives that the
certificate is about. Times are s of processor time, reading and pulses included.
"""

from collections.abc import Iterator
from configparser import ConfigParser
from pathlib import Path
from time import process_time
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from benchmarks.evidence.peers.problems import QUANTITIES
from benchmarks.evidence.table import Row, Table, store_rows
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import FileError, MotionError
from kinematics.kinds.traverser import Traverser
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from planner.place import Infeasible
from planner.plan_parts import plan_parts
from planner.program.model import Program
from planner.sources.gcode import Gcode

IGNORED = "M S T H D G43 G97"
PERIOD, RISE = 1e-3, 0.05
"""s: of a controller, and that an axis takes to its acceleration."""
METRES = {"inch": 0.0254, "in": 0.0254, "mm": 1e-3}
COLUMNS = ("file", "order", "segments", "motion (s)", "proved", *QUANTITIES, "time (s)", "refused")


def measure(
    folder: Path,
    config: Path | None = None,
    only: str = "",
    tolerance: float = 0.0254,
    lines: int | None = None,
) -> Iterator[Table]:
    """Yield a row for each file and order, and the sums.

    only: part of the paths of the files to plan; lines: most lines of a file
    """
    machine, unit = read_machine(config or folder.parent / "configs" / "XYZ.ini")
    rows: list[Row] = []
    planned = plan_files(folder, machine, (only, lines), (unit, tolerance))
    yield Table("", COLUMNS, store_rows(planned, rows))
    sums: list[Row] = []
    for order in (2, 3):
        attempted = [row for row in rows if row[1] == order]
        done = [row for row in attempted if row[-1] is None]
        motion, time = (sum(float(row[k] or 0) for row in done) for k in (3, 8))
        sums.append([order, len(done), len(attempted) - len(done), motion, time])
    yield Table("Sums", ("order", "planned", "refused", "motion (s)", "time (s)"), sums)


def read_machine(ini: Path) -> tuple[Machine, str]:
    """Return three slides with the limits of a configuration, and its unit of length."""
    config = ConfigParser(
        strict=False,
        allow_no_value=True,
        interpolation=None,
        inline_comment_prefixes="#",
    )
    config.read_string(ini.read_text(encoding="utf-8"))
    unit = config["TRAJ"]["LINEAR_UNITS"]
    slides = []
    for number, name in enumerate("XYZ"):
        section = config[f"AXIS_{number}" if f"AXIS_{number}" in config else f"JOINT_{number}"]
        keys = ("MIN_LIMIT", "MAX_LIMIT", "MAX_VELOCITY", "MAX_ACCELERATION")
        low, high, speed, acceleration = (float(section[key]) * METRES[unit] for key in keys)
        slide = Axis(
            name,
            travel=(low, high),
            max_speed=speed,
            max_acceleration=acceleration,
            max_jerk=acceleration / RISE,
            pulse=1e-6,
        )
        slides.append(slide)
    rotary = Axis(
        "R",
        kind="rotary",
        max_speed=1.0,
        max_acceleration=10.0,
        max_jerk=200.0,
        pulse=1e-3,
    )
    home = RigidTransform.identity()
    return Traverser(axes=(*slides, rotary), home=home, name="linuxcnc"), unit


def plan_files(
    folder: Path,
    machine: Machine,
    chosen: tuple[str, int | None],
    reading: tuple[str, float],
) -> Iterator[Row]:
    """Yield a row for each file and order. Links are left out: their files are in the folder."""
    only, lines = chosen
    for file in sorted(folder.rglob("*.ngc")):
        if file.is_symlink() or only not in str(file):
            continue
        if lines is not None and file.read_bytes().count(b"\n") > lines:
            continue
        for order in (2, 3):
            yield [str(file.relative_to(folder)), order, *plan_file(file, machine, order, *reading)]


def plan_file(file: Path, machine: Machine, order: int, unit: str, tolerance: float) -> Row:
    """Return segments, duration, largest proved use, sampled uses, time, and the refusal."""
    begin = process_time()
    try:
        program = read_program(file, unit, tolerance)
    except FileError as error:
        fault = error.faults[0]
        return [None] * 7 + [f"line {fault.line}: {fault.message}"]
    try:
        duration, proved, positions = plan_program(program, machine, order)
    except MotionError as error:
        return [len(program.segments), *[None] * 6, describe_refusal(program, error)]
    time = process_time() - begin
    uses: list[float | None] = [None] * 3
    for power, name in enumerate(QUANTITIES[:order], 1):
        limits = [getattr(axis, f"max_{name}") for axis in machine.axes[:3]]
        rates = np.diff(positions, power, axis=0) / PERIOD**power
        uses[power - 1] = float((np.abs(rates) / limits).max())
    return [len(program.segments), duration, proved, *uses, time, None]


def read_program(file: Path, unit: str, tolerance: float) -> Program:
    """Read a file as LinuxCNC would. Raises FileError."""
    length: Literal["mm", "in"] = "mm" if unit == "mm" else "in"
    source = Gcode(ignore=IGNORED, fit=1e-3 * tolerance, length=length, block_delete="skip")
    return source.stream(file).program


def plan_program(program: Program, machine: Machine, order: int) -> tuple[float, float, Array]:
    """Return duration, largest proved use, and positions (N, 3) at every period."""
    positions = []
    elapsed = 0.0
    standing = None
    for part in plan_parts(program, machine, order=order):
        end = elapsed + part.motion.duration
        times = np.arange(np.ceil(elapsed / PERIOD), np.ceil(end / PERIOD)) * PERIOD - elapsed
        if len(times):
            positions.append(part.motion.at(np.clip(times, 0.0, part.motion.duration)).q[:, :3])
        elapsed = end
        standing = part.standing
    if standing is None:
        raise MotionError("nothing moves")
    return standing.duration, max(standing.certificate.worst.values()), np.concatenate(positions)


def describe_refusal(program: Program, error: MotionError) -> str:
    """Return the first line of a refusal with its line in the file."""
    message = str(error).partition("\n")[0]
    if not isinstance(error, Infeasible) or error.place is None or error.place.segment is None:
        return message
    return f"line {program.segments[error.place.segment - 1].line_number}: {message}"
