"""Speed and memory of pulse schedules, from 1e5 to 1e8 pulses: `python -m benchmarks.evidence.speed.pulses`, some
three minutes.

On the program `circle` with the hexapod, all six legs, at 10 MHz: coarser pulses for the fewest, then the program run
again and again, as a long one would be. Every row is a process of its own: processor time (of several runs the best)
and peak memory are its alone, which begins at some 120 MB for Python and the planner's libraries.

    generate   motion to ticks, exact to one
    parts      the same part by part, some 20 000 pulses each, none of which is kept
    check      the independent check of the schedule against the motion
    npz        the schedule on disk in parts, read back part by part and compared
    binary     the schedule as pulses.bin, read back part by part and compared
    grow       pulses made and written part by part, as a plan that grows does, and checked part by part beside the
               motion: none of these holds the schedule or the motion
    csv        the edges as text, to the null device: what a disk takes is not counted
    file       such a file read back and checked, as `plan` does: 100 bytes a pulse on the disk for temporary files

parts, check, grow, csv and file go up to 1e7 pulses, with --full to 1e8 (some twenty minutes more, and 10 GB on the
disk). What is in the files: bytes a pulse, beside the rows of binary, grow and file.
"""

import json
import os
import resource
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np

from benchmarks.evidence.measuring import Result, run_in_new_process, time_calls
from kinematics import Hexapod, Machine, load_machine
from planner import load_program, plan
from planner.export import motion_file
from planner.export.format import ExportSource
from planner.export.formats import binary, npz, pulse_csv
from planner.path.actuation import actuate
from planner.pulses import PulseSchedule, PulseStream, check, check_file, find_rule, generate, open_pulses
from planner.pulses.checking import check_motion_parts
from planner.pulses.motion import AxesMotion
from planner.trajectory import Trajectory

CLOCK = 10_000_000
CASES = {100_000: (1, 8.83), 1_000_000: (1, 1.0), 10_000_000: (12, 1.0), 100_000_000: (114, 1.0)}
"""Repetitions, and how much coarser the pulses are, for about so many pulses."""
PARTS = 44
"""Of the motion, made one after the other."""
STAGES = ("generate", "parts", "npz", "binary", "grow", "check", "csv", "file")
LARGE_STAGES = ("parts", "check", "grow", "csv", "file")
TARGET, STRETCH, MEMORY = 5e6, 15e6, 2e9
SINGLE_RUN_PULSES = 3_000_000  # pulses from which once has to do
REPEATS = 7


def main() -> None:
    """Print a row for each stage and number of pulses."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--full", action="store_true", help="check, csv and file up to 1e8 pulses as well")
    parser.add_argument(
        "--row", nargs=3, metavar=("STAGE", "COUNT", "MOTION"), help="one row, as the rest calls itself"
    )
    options = parser.parse_args()
    if options.row:
        stage, count, path = options.row
        print(json.dumps(measure_stage(stage, int(count), Path(path))))
        return
    print(f"targets: generate {TARGET / 1e6:.0f} M pulses per CPU-second, {STRETCH / 1e6:.0f} at best; 1e8 in 2 GB")
    print("stage         pulses   CPU s   M pulses/s   peak MB   bytes/pulse above the fewest   in the file")
    with TemporaryDirectory() as folder:
        motion = Path(folder) / "motion.bin"
        motion_file.write_motion(plan(load_program("circle"), load_machine("hexapod")).trajectory, motion)
        for stage in STAGES:
            least: tuple[int, float] | None = None
            for count in CASES:
                if count == max(CASES) and stage in LARGE_STAGES and not options.full:
                    continue
                pulses, seconds, peak, size = run_in_new_process(__spec__.name, "--row", stage, count, motion)
                least = least or (pulses, peak)
                more = (peak - least[1]) / (pulses - least[0]) if pulses > least[0] else np.nan
                figures = f"{seconds:>8.2f}{pulses / seconds / 1e6:>13.2f}{peak / 1e6:>10.0f}{more:>10.1f}"
                figures += f"{size / pulses:>24.2f}" if size else ""
                print(f"{stage:<9}{pulses:>11}{figures}", flush=True)


def measure_stage(stage: str, count: int, motion: Path) -> tuple[int, float, int, int]:
    """Pulses, CPU seconds of the stage, peak bytes of this process, and bytes of the file where there is one."""
    repetitions, coarser = CASES[count]
    machine = load_coarse_hexapod(coarser)
    once = motion_file.read_motion(motion, actuate(load_program("circle"), machine))
    if stage == "parts":
        pulses, seconds = time_best(
            lambda: sum(part.total for _, part in make_parts(machine, once, repetitions)), count
        )
        return pulses, seconds, measure_peak(), 0
    if stage == "grow":
        pulses, seconds, size = grow_file(machine, once, repetitions, motion.with_name("pulses.bin"))
        return pulses, seconds, measure_peak(), size
    trajectory = repeat_motion(once, repetitions)
    axes, size = machine.axes, 0
    schedule, seconds = time_best(lambda: generate(trajectory, axes, machine.home_q, CLOCK), count)
    if stage == "check":
        verdict, seconds = time_best(lambda: check(schedule, trajectory, axes, machine.home_q), count)
        if not verdict.holds:
            raise SystemExit(f"the schedule is wrong: {verdict.faults[0]}")
    elif stage == "npz":
        source = ExportSource("circle", machine, trajectory, schedule)
        exported, seconds = time_best(lambda: npz.Npz().write(source, motion.with_name("pulses.npz")), count)
        if exported.error:
            raise SystemExit("the file does not hold the schedule")
    elif stage == "binary":
        source, path = ExportSource("circle", machine, trajectory, schedule), motion.with_name("pulses.bin")
        exported, seconds = time_best(lambda: binary.Binary().write(source, path), count)
        size = path.stat().st_size
        if exported.error:
            raise SystemExit("the file does not hold the schedule")
    elif stage == "csv":
        wiring = [axis.direction for axis in axes]
        _, seconds = time_best(lambda: pulse_csv.write(schedule, os.devnull, wiring), count)
    elif stage == "file":
        written = WrittenPulses(machine, trajectory, schedule)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "pulses.csv"
            pulse_csv.write(schedule, path, [axis.direction for axis in axes])
            verdict, seconds = time_best(lambda: check_file(path, written), count)
            size = path.stat().st_size
        if not verdict.holds:
            raise SystemExit(f"the file is wrong: {verdict.faults[0]}")
    return schedule.total, seconds, measure_peak(), size


def measure_peak() -> int:
    """Bytes of this process at its peak."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def cut_motion(once: Trajectory, times: int) -> Iterator[Trajectory]:
    """A motion again and again, in parts that begin at time 0."""
    ends = np.linspace(0, len(once.s), PARTS + 1).astype(int)
    for _ in range(times):
        yield from (once.cut(int(first), int(last)) for first, last in pairwise(ends))


def make_parts(machine: Machine, once: Trajectory, times: int) -> Iterator[tuple[int, PulseSchedule]]:
    """The tick before which pulses are final, and those of each part."""
    stream, many = PulseStream(machine, CLOCK, find_rule("nearest")), PARTS * times
    for n, motion in enumerate(cut_motion(once, times), 1):
        part = stream.add(motion, last=n == many)
        yield stream.until, part


def grow_file(machine: Machine, once: Trajectory, times: int, path: Path) -> tuple[int, float, int]:
    """Pulses, CPU seconds and bytes of a file that grows by a part at a time, and is checked as a whole."""
    begin = process_time()
    with path.open("w+b") as file:
        writer: binary.PulseWriter | None = None
        for until, part in make_parts(machine, once, times):
            writer = writer or binary.PulseWriter.begin(file, part)
            writer.add(part, until)
            writer.mark(part)
        assert writer is not None
        writer.mark(part, complete=True)
    held = open_pulses(path)
    motions = cut_motion(once, times)
    verdict = check_motion_parts(held.stated, held.parts(), motions, machine.axes, machine.home_q)
    seconds = process_time() - begin
    if not verdict.holds:
        raise SystemExit(f"the file is wrong: {verdict.faults[0]}")
    return sum(held.pulses), seconds, path.stat().st_size


@dataclass(frozen=True, slots=True)
class WrittenPulses:
    """What the file stands for."""

    machine: Machine
    counted: AxesMotion
    pulses: PulseSchedule


def load_coarse_hexapod(coarser: float) -> Hexapod:
    """The preset, its pulses so many times longer."""
    usual = load_machine("hexapod")
    if not isinstance(usual, Hexapod):
        raise SystemExit("the preset hexapod is another machine")
    axes = [replace(axis, pulse=axis.pulse * coarser) for axis in usual.axes]
    return Hexapod(usual.base, usual.platform, axes=axes, home=usual.home)


def time_best(work: Callable[[], Result], count: int) -> tuple[Result, float]:
    """The result, and the CPU seconds of the best run; of long ones the only."""
    result, times = time_calls(work, 1 if count > SINGLE_RUN_PULSES else REPEATS)
    return result, min(times)


def repeat_motion(motion: Trajectory, times: int) -> Trajectory:
    """A motion that ends where it begins, again and again."""
    knots = motion.knots[:-1] + motion.duration * np.arange(times)[:, None]
    parts = (np.tile(each, times) for each in (motion.s, motion.v, motion.a, motion.j, motion.piece))
    return Trajectory(motion.path, np.append(knots.ravel(), motion.duration * times), *parts)


if __name__ == "__main__":
    main()
