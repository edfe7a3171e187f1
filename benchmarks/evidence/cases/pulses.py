"""Speed and memory of pulse schedules and of their files.

The motion of the program `circle` on the bundled hexapod, all six legs at 10 MHz, once and
`--times` times one after the other: 0.88 million pulses each. Each row is measured in a process of
its own, which has about 120 MB before the motion. Times are of the processor, the best of a few
runs.

    generate  the motion's pulses, exact to a tick
    parts     the same in parts of about 20 000 pulses, none of which is retained
    check     the independent check of the schedule against the motion
    others    export formats: a file is written, read back and compared with the schedule
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.evidence.measuring import measure_apart, time_calls
from benchmarks.evidence.table import Row, Table
from kinematics import Machine, load_machine
from kinematics.foundation.errors import MotionError
from planner import load_program, plan
from planner.export.format import ExportSource, find_format
from planner.pulses import PulseSchedule, PulseStream, check, find_rule, generate
from planner.trajectory import Trajectory

CLOCK = 10_000_000
STAGES = ("generate", "parts", "check", "binary", "npz", "steps", "pulses", "vcd")
# Parts of the motion whose pulses are made one after the other.
PARTS = 44
# Runs of a stage, which end early once they have taken that many seconds.
REPEATS, MOST_SECONDS = 7, 5.0


@dataclass(frozen=True, slots=True)
class StageRun:
    """A stage of a schedule: pulses, s of processor time; bytes of its file and notes of its
    export.
    """

    pulses: int
    seconds: float
    size: int | None = None
    notes: str = ""


def run_stage(stage: str, once: Trajectory, times: int) -> StageRun:
    """Run a stage in this process. Raises MotionError if a check or a comparison fails."""
    machine = load_machine("hexapod")
    if stage == "parts":
        return time_stage(lambda: sum(part.total for part in make_parts(machine, once, times)))
    motion = repeat_motion(once, times)

    def make() -> PulseSchedule:
        return generate(motion, machine.axes, machine.home_q, CLOCK)

    if stage == "generate":
        return time_stage(lambda: make().total)
    schedule = make()
    if stage == "check":
        return time_stage(lambda: check_schedule(schedule, motion, machine))
    source = ExportSource("circle", machine, motion, schedule)
    with TemporaryDirectory() as folder:
        return time_export(stage, source, Path(folder) / "file")


def time_stage(work: Callable[[], int]) -> StageRun:
    """Time work that returns a number of pulses."""
    pulses, seconds = time_calls(work, REPEATS, most=MOST_SECONDS)
    return StageRun(pulses, min(seconds))


def check_schedule(schedule: PulseSchedule, motion: Trajectory, machine: Machine) -> int:
    """Check a schedule against its motion, and return the number of its pulses."""
    verdict = check(schedule, motion, machine.axes, machine.home_q)
    if not verdict.holds:
        raise MotionError(f"the schedule is wrong: {verdict.faults[0]}")
    return schedule.total


def time_export(name: str, source: ExportSource, path: Path) -> StageRun:
    """Time a format, which reads its file back and compares it with the schedule."""
    exporter = find_format(name)()
    exported, seconds = time_calls(
        lambda: exporter.write(source, path),
        REPEATS,
        most=MOST_SECONDS,
    )
    if not np.isfinite(exported.error):
        raise MotionError(f"format {name}: the file does not hold the schedule")
    return StageRun(
        source.pulses.total, min(seconds), path.stat().st_size, "; ".join(exported.notes)
    )


def make_parts(machine: Machine, once: Trajectory, times: int) -> Iterator[PulseSchedule]:
    """Generate the pulses of a motion that is repeated, part by part."""
    stream = PulseStream(machine, CLOCK, find_rule("nearest"))
    ends = np.linspace(0, len(once.s), PARTS + 1).astype(int).tolist()
    parts = [once.cut(first, last) for first, last in pairwise(ends)] * times
    for number, part in enumerate(parts, 1):
        yield stream.add(part, last=number == len(parts))


def repeat_motion(motion: Trajectory, times: int) -> Trajectory:
    """Return a motion that ends where it begins, that many times one after the other."""
    knots = motion.knots[:-1] + motion.duration * np.arange(times)[:, None]
    profiles = (motion.s, motion.v, motion.a, motion.j, motion.piece)
    repeated = (np.tile(profile, times) for profile in profiles)
    return Trajectory(motion.path, np.append(knots.ravel(), motion.duration * times), *repeated)


def measure(times: int = 12) -> Iterator[Table]:
    """Yield the table of stages, each with the motion once and `times` times."""
    once = plan(load_program("circle"), load_machine("hexapod")).trajectory

    def rows() -> Iterator[Row]:
        for stage in STAGES:
            for count in (1, times):
                measured = measure_apart(run_stage, stage, once, count)
                run = measured.result
                yield [
                    stage,
                    run.pulses,
                    run.seconds,
                    run.pulses / run.seconds / 1e6,
                    measured.peak / 1e6,
                    run.size and run.size / run.pulses,
                    run.notes,
                ]

    columns = (
        "stage",
        "pulses",
        "processor time (s)",
        "million pulses a second",
        "memory (MB)",
        "bytes a pulse",
        "notes",
    )
    yield Table("", columns, rows())
