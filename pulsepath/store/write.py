"""Write the folder of a plan: record, motion, pulses, report, and copies of the input files.

The record is written last. The verdict on the written pulses is in certificate.json.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from benchmarks.reports import plan_report
from benchmarks.reports.plan_content import PlanReport
from benchmarks.reports.plan_summary import list_counts
from controllers.rig_choice import rig_hint
from kinematics import Axis, MotionError
from kinematics.files.atomic_files import name_file, write_named
from kinematics.foundation.names import count_noun
from planner import Plan
from planner.activity import Activity
from planner.export import plan_files
from planner.export.formats import binary, pulse_csv
from planner.export.formats.binary import PulseWriter, find_end
from planner.export.motion_file import MotionWriter, PartHead, write_motion
from planner.export.plan_files import TriggerWriter, tabulate_trigger_csv
from planner.orientation.orient import find_choice
from planner.overview import Overview
from planner.parallel import Progress
from planner.plan_parts import PlanPart, PlanStanding, come_to_rest
from planner.program.model import Program
from planner.pulses import PulseCheck, open_pulses
from planner.pulses.triggers import holds_triggers
from pulsepath.inputs import Inputs
from pulsepath.job import Defect, Job, examine_loaded
from pulsepath.output.directory import RECORD, REPORT
from pulsepath.output.drive_tables import tabulate_drives
from pulsepath.output.plan_record import record_plan, record_pulse_file, record_pulses
from pulsepath.output.record import Record, as_json
from pulsepath.progress import step
from pulsepath.requests import ReportRequest
from pulsepath.store.files import (
    BINARY,
    CERTIFICATE,
    MOTION,
    ORIENTATION,
    PULSES,
    SOURCES,
    STOPS,
    TRAJECTORY,
    TRIGGERS,
)
from pulsepath.store.read import StoredSource
from pulsepath.store.verify import check_pulses, digest_pulses, seal_record


def write_whole(folder: Path, job: Job, inputs: Inputs, pulses: str = "binary") -> PlanReport:
    """Write a plan that was made as a whole into an empty folder. Return the content of its report.

    pulses: the form of their file, "csv", "binary" or "none".

    Raises Defect if the written pulses fail the check.
    """
    plan = job.plan
    _write_inputs(folder, inputs)
    with name_file(folder / MOTION):
        write_motion(plan.trajectory, folder / MOTION)
    if choice := find_choice(plan.program):
        record = {str(k): chosen.tolist() for k, chosen in choice.items()}
        write_named(folder / ORIENTATION, as_json(record))
    shaped = None if plan.shaped is None else plan.shaped.motion
    with name_file(folder / TRAJECTORY):
        plan_files.write_trajectory_csv(plan.trajectory, folder / TRAJECTORY, shaped)
    name = PULSES[pulses]
    file = None if name is None else folder / name
    if file is not None:
        with step(f"writing {plan.pulses.total} pulses") as tell, name_file(file):
            _write_pulses(file, plan, tell)

    with step(f"checking {plan.pulses.total} pulses") as tell:
        verdict = check_pulses(file, plan.machine, plan.source, tell)
    _refuse_faults(verdict)
    write_named(
        folder / CERTIFICATE, as_json(record_pulse_file(file, plan.pulses, plan.machine, verdict))
    )
    if plan.triggers:
        with name_file(folder / TRIGGERS):
            plan_files.write_trigger_csv(plan.triggers, plan.machine.axes, folder / TRIGGERS)
    results = job.complete(verdict)
    if results.stops is not None:
        results.stops.save(folder / STOPS)
    _write_report(folder, results, len(plan.triggers))
    _write_record(folder, record_plan(results, inputs, digest_pulses([plan.pulses])))
    return results


def _write_pulses(file: Path, plan: Plan, tell: Progress) -> None:
    """Write the pulses in the form that the name of the file states."""
    axes = plan.machine.axes
    if file.name == BINARY:
        binary.write(plan.pulses, file, {axis.name: axis.unit for axis in axes}, tell=tell)
        return
    wiring = [axis.direction for axis in axes]
    timing = [axis.timing for axis in axes]
    pulse_csv.write(plan.pulses, file, wiring, timing=timing, tell=tell)


def _write_report(folder: Path, report: PlanReport, triggers: int) -> None:
    """Write the page of a plan, with the timing of its drives and the triggers of its table."""
    plan = report.plan
    pulses = record_pulses(plan.pulses, plan.machine, list_counts(plan), None, report.verdict)
    tables = [tabulate_trigger_csv(folder / TRIGGERS, triggers)] if triggers else []
    report = replace(report, drives=tabulate_drives(pulses), triggers=tables)
    page = folder / REPORT
    with step("writing the report"), name_file(page):
        plan_report.write_report(report, page)


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
        self._pulses: PulseWriter | None = None  # its head needs the first part
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
                self._pulses.finish(come_to_rest(part).pulses)

        if self._triggers is not None:
            with name_file(self._folder / TRIGGERS):
                self._triggers.add(part.rest_triggers)
                self._files[TRIGGERS].flush()


def _near(part: PlanPart) -> tuple[float, ...] | None:
    return None if part.start.near is None else tuple(part.start.near.tolist())


def write_parts(
    folder: Path,
    inputs: Inputs,
    parts: Iterable[PlanPart],
    report: ReportRequest,
    tell: Callable[[PlanStanding, int], None],
) -> tuple[PlanReport, MotionError | None]:
    """Write a plan into an empty folder as its parts come.

    Return the content of its report, and the refusal that ended it early, if any.

    tell: called after each part with the plan so far, and its number of segments in all
    repetitions.

    Raises what the parts raise, unless the report keeps the parts before that; Defect if the
    written pulses fail the check.
    """
    _write_inputs(folder, inputs)
    machine = inputs.machine
    has_pulses = report.pulses != "none"
    overview = Overview()
    activity = Activity(inputs.program)

    def observe(part: PlanPart) -> None:
        overview.add(part.motion, part.start.begin, part.start.length)
        activity.add(part.motion, part.start.begin, part.limits)
        tell(part.standing, _count_segments(part, inputs.program))

    part, refusal = _write_motion(folder, inputs, parts, report, observe)
    if part.rest is not None:
        begin = part.standing.start.begin
        overview.add(part.rest, begin, part.start.length)
        activity.add(part.rest, begin, part.limits)
    standing = come_to_rest(part)
    ending = "" if refusal is None else f"It ends before the program does, with a stop: {refusal}"
    source = StoredSource(
        inputs.program,
        machine,
        standing.order,
        folder / MOTION,
        standing.pulses,
        pulse_file=folder / BINARY if has_pulses else None,
        in_parts=True,
        complete=refusal is None,
    )
    verdict: PulseCheck | None = None
    if has_pulses:
        verdict = _check_parts(folder, standing, source)
        source.digest = digest_pulses(open_pulses(folder / BINARY).parts())

    results = PlanReport(
        standing,
        verdict,
        overview,
        activity,
        ending,
        untracked=rig_hint(machine),
        figures=None if report.figures else {},
    )
    if report.examines_motion:
        results = _examine(results, source, report)
    _write_report(folder, results, standing.triggers)
    if results.stops is not None:
        results.stops.save(folder / STOPS)
    _write_record(folder, record_plan(results, inputs, source.digest, standing))
    return results, refusal


def _write_motion(
    folder: Path,
    inputs: Inputs,
    parts: Iterable[PlanPart],
    report: ReportRequest,
    observe: Callable[[PlanPart], None],
) -> tuple[PlanPart, MotionError | None]:
    """Write motion, pulses and triggers part by part.

    Return the last part, and the refusal that ended the plan early, if any. observe: called after
    each part.
    """
    part: PlanPart | None = None
    refusal: MotionError | None = None
    with ExitStack() as files:
        writer = PartsWriter(
            folder,
            inputs.machine.axes,
            files,
            pulses=report.pulses != "none",
            triggers=holds_triggers(inputs.program),
        )
        try:
            for part in parts:
                writer.add(part)
                observe(part)
        except MotionError as error:
            if not report.keep_certified or part is None:
                raise
            refusal = error
        assert part is not None  # a program has a segment that moves, or is refused
        writer.finish(part)
    return part, refusal


def _examine(results: PlanReport, source: StoredSource, report: ReportRequest) -> PlanReport:
    """Return the content of the report of the whole motion, with the results that were
    requested.
    """
    standing = results.plan
    assert isinstance(standing, PlanStanding)
    plan = Plan(
        standing.request,
        source.program,
        source.machine,
        source,
        standing.rounds,
        tuple(Counter(standing.methods).elements()),
    )
    examined = examine_loaded(plan, report)
    return replace(
        examined,
        verdict=results.verdict,
        ending=results.ending,
        figures=results.figures,
    )


def _check_parts(folder: Path, standing: PlanStanding, source: StoredSource) -> PulseCheck:
    """Check the file of pulses against the file of the motion, and write the verdict."""
    machine = source.machine
    file = folder / BINARY
    with step("checking the pulses") as tell:
        verdict = check_pulses(file, machine, source, tell)
    _refuse_faults(verdict)
    record = record_pulse_file(file, standing.pulses, machine, verdict, standing.counted)
    write_named(folder / CERTIFICATE, as_json(record))
    return verdict


def _refuse_faults(verdict: PulseCheck) -> None:
    """Raise Defect if the pulses fail the check."""
    if not verdict.holds:
        faults = count_noun(verdict.fault_count, "fault")
        raise Defect(f"{faults} in the pulses, the first: {verdict.faults[0]}")


def _write_record(folder: Path, record: Record) -> None:
    """Write the record, with the digests of all files. It is the last file of a folder."""
    write_named(folder / RECORD, as_json(seal_record(record, folder)))


def _write_inputs(folder: Path, inputs: Inputs) -> None:
    write_named(folder / inputs.program_file, inputs.program_toml)
    write_named(folder / SOURCES["machine"], inputs.machine_toml)
    for name, content in inputs.companions.items():
        write_named(folder / name, content)


def _count_segments(part: PlanPart, program: Program) -> int:
    """Return the number of segments up to the end of a part, in all repetitions."""
    piece = int(part.motion.piece[-1])
    repetition = part.motion.path.place(0.0, piece).repetition or 1
    return (repetition - 1) * len(program.segments) + part.standing.segment
