"""The output of `plan` for a program that is planned in parts: written as the parts come."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path

from kinematics import Axis, MotionError
from kinematics.files.atomic_files import name_file, write_named
from kinematics.foundation.names import count_noun
from planner.activity import Activity
from planner.export.formats.binary import PulseWriter, find_end
from planner.export.motion_file import MotionWriter, PartHead, follow_motion
from planner.export.plan_files import TriggerWriter, tabulate_trigger_csv
from planner.overview import Overview
from planner.path.chain import walk_path
from planner.plan_parts import PlanPart, PlanStanding, come_to_rest
from planner.program.model import Program
from planner.pulses import open_pulses
from planner.pulses.checking.edge_reader import check_file_parts
from planner.pulses.checking.verdict import PulseCheck
from planner.pulses.triggers import holds_triggers
from pulsepath.inputs import Inputs
from pulsepath.job import Defect
from pulsepath.output.directory import MOTION, RECORD, REPORT, TRIGGERS
from pulsepath.output.drive_tables import tabulate_drives
from pulsepath.output.plan_directory import BINARY, CERTIFICATE, SOURCES
from pulsepath.output.plan_record import of_parts, of_pulse_file, of_pulses
from pulsepath.output.record import as_json
from pulsepath.output.verification import digest_pulses, seal_record
from pulsepath.progress import step
from pulsepath.requests import ReportRequest


class PartsWriter:
    """Writes motion, pulses and triggers of a plan into a folder, part by part."""

    def __init__(
        self,
        folder: Path,
        axes: Sequence[Axis],
        files: ExitStack,
        *,
        pulses: bool,
        triggers: bool,
    ) -> None:
        """Open the files. files: closes them. pulses, triggers: whether they are written."""
        self._folder = folder
        self._units = {axis.name: axis.unit for axis in axes}
        names = [MOTION, *([BINARY] if pulses else []), *([TRIGGERS] if triggers else [])]
        self._files = {name: files.enter_context((folder / name).open("wb")) for name in names}
        self._motion = MotionWriter(self._files[MOTION])
        self._pulses: PulseWriter | None = None  # its head needs what the first part states
        self._triggers = TriggerWriter(self._files[TRIGGERS], axes) if triggers else None

    def add(self, part: PlanPart) -> None:
        """Write a part, without its stop."""
        start, following = part.start, part.standing.start
        steps = following.steps - start.steps
        head = PartHead(start.begin, start.length, start.steps, steps, _near(part))
        with name_file(self._folder / MOTION):
            self._motion.add(part.motion, head)

        if BINARY in self._files:
            with name_file(self._folder / BINARY):
                if self._pulses is None:
                    self._pulses = PulseWriter(self._files[BINARY], part.pulses, self._units)
                self._pulses.add(part.pulses, part.until)

        if self._triggers is not None:
            with name_file(self._folder / TRIGGERS):
                self._triggers.add(part.triggers)

    def finish(self, part: PlanPart) -> None:
        """Write the stop of the last part, if it has one, and complete the files."""
        with name_file(self._folder / MOTION):
            if part.rest is not None:
                begin, start = part.standing.start.begin, part.start
                head = PartHead(begin, start.length, start.steps, part.steps, _near(part))
                self._motion.add(part.rest, head)
            self._motion.finish()

        if self._pulses is not None:
            with name_file(self._folder / BINARY):
                if part.rest_pulses is not None:
                    self._pulses.add(part.rest_pulses, max(part.until, find_end(part.rest_pulses)))
                self._pulses.finish(part.rest_pulses or part.pulses)

        if self._triggers is not None:
            with name_file(self._folder / TRIGGERS):
                self._triggers.add(part.rest_triggers)
                self._files[TRIGGERS].flush()


def _near(part: PlanPart) -> tuple[float, ...] | None:
    return None if part.start.near is None else tuple(part.start.near.tolist())


def write(
    folder: Path,
    inputs: Inputs,
    parts: Iterable[PlanPart],
    report: ReportRequest,
    tell: Callable[[PlanStanding, int], None],
) -> tuple[PlanStanding, MotionError | None]:
    """Write the files of a plan into a folder as its parts come, the record last.

    Return the plan at its end, and the refusal that ended it early, if any.
    tell: called after each part with the plan so far, and its number of segments in all repetitions.
    Raises what the parts raise, unless the report keeps the parts before that.
    """
    _write_inputs(folder, inputs)
    has_pulses = report.pulses != "none"
    extremes, activity = Overview(), Activity(inputs.program)
    part: PlanPart | None = None
    refusal: MotionError | None = None
    with ExitStack() as files:
        axes, marked = inputs.machine.axes, holds_triggers(inputs.program)
        writer = PartsWriter(folder, axes, files, pulses=has_pulses, triggers=marked)
        try:
            for part in parts:
                writer.add(part)
                extremes.add(part.motion, part.start.begin, part.start.length)
                activity.add(part.motion, part.start.begin, part.limits)
                tell(part.standing, _count_segments(part, inputs.program))
        except MotionError as error:
            if not report.keep_certified or part is None:
                raise
            refusal = error
        assert part is not None  # a program has a segment that moves, or is refused
        writer.finish(part)

    if part.rest is not None:
        begin = part.standing.start.begin
        extremes.add(part.rest, begin, part.start.length)
        activity.add(part.rest, begin, part.limits)
    standing = come_to_rest(part)
    ending = "" if refusal is None else f"It ends before the program does, with a stop: {refusal}"
    verdict, digest = None, None
    if has_pulses:
        verdict = _check_pulses(folder, standing, inputs, ending)
        digest = digest_pulses(open_pulses(folder / BINARY).parts())
    pulses = of_pulses(standing.pulses, standing.machine, standing.counted, digest, verdict)

    from benchmarks.reports.parts_report import write_report  # which takes matplotlib along

    triggers = []
    if standing.triggers:
        triggers.append(tabulate_trigger_csv(folder / TRIGGERS, standing.triggers))
    with step("writing the report"), name_file(folder / REPORT):
        write_report(
            standing,
            extremes,
            activity,
            verdict,
            folder / REPORT,
            figures=report.figures,
            note=ending,
            drives=tabulate_drives(pulses),
            triggers=triggers,
        )
    record = of_parts(standing, inputs, digest, verdict, ending)
    write_named(folder / RECORD, as_json(seal_record(record, folder)))
    return standing, refusal


def _count_segments(part: PlanPart, program: Program) -> int:
    """Up to the end of a part, of all repetitions."""
    repetition = part.motion.path.place(0.0, int(part.motion.piece[-1])).repetition or 1
    return (repetition - 1) * len(program.segments) + part.standing.segment


def _write_inputs(folder: Path, inputs: Inputs) -> None:
    write_named(folder / inputs.program_file, inputs.program_toml)
    write_named(folder / SOURCES["machine"], inputs.machine_toml)
    for name, content in inputs.companions.items():
        write_named(folder / name, content)


def _check_pulses(folder: Path, standing: PlanStanding, inputs: Inputs, ending: str) -> PulseCheck:
    """Check the file of pulses against the file of the motion, and write their certificate."""
    program, machine = inputs.program, inputs.machine
    file = folder / BINARY
    with step("checking the pulses") as tell:
        steps = walk_path(program, machine)
        motions = follow_motion(folder / MOTION, steps, machine, program.tool, whole=not ending)
        verdict = check_file_parts(file, standing.pulses, machine, motions, tell)
    if not verdict.holds:
        faults = count_noun(verdict.fault_count, "fault")
        raise Defect(f"{faults} in the pulses, the first: {verdict.faults[0]}")
    proof = of_pulse_file(file, standing.pulses, standing.machine, verdict, standing.counted)
    write_named(folder / CERTIFICATE, as_json(proof))
    return verdict
