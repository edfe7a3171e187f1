"""The output of `plan` for a program that is planned in parts: written as it goes, each with the stop behind it."""

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path

from benchmarks.reports.parts_report import write_report
from kinematics import MotionError
from planner.export.formats.binary import PulseWriter, find_end
from planner.export.motion_file import MotionWriter, PartHead, read_parts
from planner.overview import Overview
from planner.parallel import Progress
from planner.path.chain import walk_path
from planner.plan_parts import PlanPart, PlanStanding, come_to_rest
from planner.pulses import PulseCheck, check_file, open_pulses
from planner.pulses.compensation.compensate import counted_motion
from pulsepath.inputs import Inputs
from pulsepath.job import Defect
from pulsepath.output.directory import RECORD
from pulsepath.output.plan_directory import BINARY, CERTIFICATE, MOTION, REPORT, SOURCES, StatedPulses
from pulsepath.output.plan_record import of_parts, of_pulse_file
from pulsepath.output.record import as_json
from pulsepath.output.verification import digest_pulses, seal_record
from pulsepath.progress import step


class PartsWriter:
    """The files of a plan in a folder, which grow part by part: at any instant a whole motion, that ends at rest."""

    def __init__(self, folder: Path, inputs: Inputs, pulses: bool, files: ExitStack) -> None:
        """pulses: whether they are written; files: closes what is opened here."""
        (folder / inputs.program_file).write_bytes(inputs.program_toml)
        (folder / SOURCES["machine"]).write_bytes(inputs.machine_toml)
        for name, content in inputs.companions.items():
            (folder / name).write_bytes(content)
        self._motion = MotionWriter.begin(files.enter_context((folder / MOTION).open("wb")))
        self._file = files.enter_context((folder / BINARY).open("wb")) if pulses else None
        self._pulses: PulseWriter | None = None

    def add(self, part: PlanPart) -> None:
        """What stays of a part, and its stop."""
        start, onward = part.start, part.standing.start
        head = PartHead(start.begin, start.length, start.steps, onward.steps - start.steps, _near(part))
        self._motion.add(part.motion, head)
        if self._file is not None and self._pulses is None:
            units = {axis.name: axis.unit for axis in part.standing.machine.axes}
            self._pulses = PulseWriter.begin(self._file, part.pulses, units)
        if self._pulses is not None:
            self._pulses.add(part.pulses, part.until)
        self._stop(part, stop=True)

    def end(self, part: PlanPart) -> None:
        """Nothing follows the stop of a part that was added."""
        self._stop(part, stop=False)

    def _stop(self, part: PlanPart, *, stop: bool) -> None:
        """stop: until another part takes its place."""
        last = part.rest_pulses is None
        if part.rest is not None:
            begin, start = part.standing.start.begin, part.start
            self._motion.add(part.rest, PartHead(begin, start.length, start.steps, part.steps, _near(part)), stop=stop)
        self._motion.mark(complete=last or not stop)
        if self._pulses is None:
            return
        if part.rest_pulses is not None:
            self._pulses.add(part.rest_pulses, max(part.until, find_end(part.rest_pulses)), stop=stop)
        self._pulses.mark(part.rest_pulses or part.pulses, complete=last or not stop)


def _near(part: PlanPart) -> tuple[float, ...] | None:
    return None if part.start.near is None else tuple(part.start.near.tolist())


def write(
    folder: Path,
    parts: Iterable[PlanPart],
    inputs: Inputs,
    tell: Callable[[PlanStanding], None],
    *,
    pulses: bool,
    figures: bool,
    keep: bool,
) -> tuple[PlanStanding, MotionError | None]:
    """Write everything into an empty folder as the parts come, the record last: what it holds, and why it is no more.

    pulses: their file as well. keep: where a part cannot be planned, the folder becomes a plan that ends with the stop
    before it, if there is any. Else raises as the parts do.
    """
    seen, part, no = Overview(), None, None
    with ExitStack() as files:
        writer = PartsWriter(folder, inputs, pulses, files)
        try:
            for part in parts:
                writer.add(part)
                seen.add(part.motion, part.start.begin, part.start.length)
                tell(part.standing)
        except MotionError as error:
            if not keep or part is None:
                raise
            no = error
            writer.end(part)
            if part.rest is not None:
                seen.add(part.rest, part.standing.start.begin, part.start.length)
    assert part is not None  # a program has a segment that moves, or is refused
    standing = part.standing if no is None else come_to_rest(part)
    ending = "" if no is None else f"It ends before the program does, with a stop: {no}"
    _finish(folder, standing, inputs, seen, pulses, figures, ending)
    return standing, no


def _finish(
    folder: Path, standing: PlanStanding, inputs: Inputs, seen: Overview, pulses: bool, figures: bool, ending: str
) -> None:
    """The check of the pulses that were written, the report, and the record."""
    verdict, digest = None, None
    if pulses:
        file = folder / BINARY
        with step("checking the pulses") as tell:
            verdict = check_parts_file(folder, file, inputs, standing, tell)
        if not verdict.holds:
            raise Defect(f"{verdict.fault_count} faults in the pulses, the first: {verdict.faults[0]}")
        digest = digest_pulses(open_pulses(file).parts())
        told = of_pulse_file(file, standing.pulses, standing.machine, verdict, standing.counted)
        (folder / CERTIFICATE).write_text(as_json(told), encoding="utf-8")
    with step("writing the report"):
        write_report(standing, seen, verdict, folder / REPORT, figures=figures, note=ending)
    record = of_parts(standing, inputs, digest, verdict, ending)
    (folder / RECORD).write_text(as_json(seal_record(record, folder)), encoding="utf-8")


def check_parts_file(folder: Path, file: Path, inputs: Inputs, standing: PlanStanding, tell: Progress) -> PulseCheck:
    """Of the pulses in a file against the motion in a folder."""
    machine = inputs.machine
    program = inputs.program
    motion = read_parts(folder / MOTION, walk_path(program, machine), machine, program.tool)
    counted = counted_motion(motion, machine.axes, machine.home_q)
    return check_file(file, StatedPulses(machine, counted, standing.pulses), tell)
