"""The output of `plan` for a program that is planned in parts: written as it goes, each with the stop behind it."""

import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from kinematics import MotionError
from kinematics.files.atomic_files import name_file, write_named
from kinematics.foundation.names import count_noun
from planner.activity import Activity
from planner.export.formats.binary import PulseWriter, find_end
from planner.export.motion_file import MotionWriter, PartHead, follow_motion
from planner.export.plan_files import TriggerWriter, tabulate_trigger_csv
from planner.limits import limits_of
from planner.overview import Overview
from planner.path.chain import walk_path
from planner.plan_parts import PlanMark, PlanPart, PlanStanding, come_to_rest
from planner.program.model import Program
from planner.pulses import find_rule, open_pulses, pace_axes
from planner.pulses.checking.edge_reader import check_file_parts
from planner.pulses.triggers import holds_triggers
from pulsepath.inputs import Inputs
from pulsepath.job import Defect
from pulsepath.output.checkpoint import Checkpoint, holds_checkpoint, read_checkpoint, write_checkpoint
from pulsepath.output.directory import BEGUN, CHECKPOINT, MOTION, RECORD, REPORT, TRIGGERS
from pulsepath.output.drive_tables import tabulate_drives
from pulsepath.output.plan_directory import BINARY, CERTIFICATE, SOURCES
from pulsepath.output.plan_record import of_parts, of_pulse_file, of_pulses
from pulsepath.output.record import as_json
from pulsepath.output.verification import digest_pulses, seal_record
from pulsepath.process.intent import make_resume_command
from pulsepath.progress import note, step


class PartsWriter:
    """The files of a plan in a folder, which grow part by part: at any instant a whole motion, that ends at rest."""

    def __init__(
        self, folder: Path, pulses: bool, triggers: bool, sizes: Mapping[str, int] | None, files: ExitStack
    ) -> None:
        """pulses, triggers: whether they are written. sizes: bytes of files to be gone on with. files: closes them."""
        self._folder = folder
        names = [MOTION, *([BINARY] if pulses else []), *([TRIGGERS] if triggers else [])]
        self._files = {
            name: files.enter_context((folder / name).open("wb" if sizes is None else "r+b")) for name in names
        }
        self._pulses: PulseWriter | None = None
        self._triggers: TriggerWriter | None = None
        if sizes is None:
            self._motion = MotionWriter.begin(self._files[MOTION])
            return
        for name, file in self._files.items():
            size = file.seek(0, os.SEEK_END)
            if size < sizes[name]:
                told = (
                    f"has {count_noun(size, 'byte')}, and its checkpoint counts on {sizes[name]}: it cannot be resumed"
                )
                raise MotionError(f"{folder / name} {told}; omit --resume, and give --force to begin anew")
            file.truncate(sizes[name])
        self._motion = MotionWriter.resume(folder / MOTION, self._files[MOTION])
        if pulses:
            held = open_pulses(folder / BINARY, partial=True)
            self._pulses = PulseWriter.resume(self._files[BINARY], held)
        if triggers:
            self._files[TRIGGERS].seek(sizes[TRIGGERS])
            self._triggers = TriggerWriter(self._files[TRIGGERS])
        if self.sizes != {name: sizes[name] for name in self._files}:
            raise MotionError(f"{folder}: its files are damaged: omit --resume, and give --force to begin anew")

    @property
    def sizes(self) -> dict[str, int]:
        """Bytes by the name of the file."""
        return {name: file.tell() for name, file in self._files.items()}

    def secure(self) -> dict[str, int]:
        """The same, once all of it is on the disk."""
        for name, file in self._files.items():
            with name_file(self._folder / name):
                file.flush()
                os.fsync(file.fileno())
        return self.sizes

    def add(self, part: PlanPart) -> None:
        """What stays of a part, and its stop."""
        start, onward = part.start, part.standing.start
        head = PartHead(start.begin, start.length, start.steps, onward.steps - start.steps, _near(part))
        with name_file(self._folder / MOTION):
            self._motion.add(part.motion, head)
        if BINARY in self._files and self._pulses is None:
            units = {axis.name: axis.unit for axis in part.standing.machine.axes}
            self._pulses = PulseWriter.begin(self._files[BINARY], part.pulses, units)
        if self._pulses is not None:
            with name_file(self._folder / BINARY):
                self._pulses.add(part.pulses, part.until)
        if TRIGGERS in self._files and self._triggers is None:
            self._triggers = TriggerWriter.begin(self._files[TRIGGERS], part.standing.machine.axes)
        if self._triggers is not None:
            with name_file(self._folder / TRIGGERS):
                self._triggers.add(part.triggers, part.rest_triggers)
        self._stop(part, stop=True)

    def end(self, part: PlanPart) -> None:
        """Nothing follows the stop of a part that was added."""
        self._stop(part, stop=False)

    def _stop(self, part: PlanPart, *, stop: bool) -> None:
        """stop: until another part takes its place."""
        last = part.rest_pulses is None
        with name_file(self._folder / MOTION):
            if part.rest is not None:
                begin, start = part.standing.start.begin, part.start
                head = PartHead(begin, start.length, start.steps, part.steps, _near(part))
                self._motion.add(part.rest, head, stop=stop)
            self._motion.mark(complete=last or not stop)
        if self._pulses is None:
            return
        with name_file(self._folder / BINARY):
            if part.rest_pulses is not None:
                until = max(part.until, find_end(part.rest_pulses))
                self._pulses.add(part.rest_pulses, until, stop=stop)
            self._pulses.mark(part.rest_pulses or part.pulses, complete=last or not stop)


def _near(part: PlanPart) -> tuple[float, ...] | None:
    return None if part.start.near is None else tuple(part.start.near.tolist())


def write(
    folder: Path,
    inputs: Inputs,
    plan: Callable[[PlanMark | None], Iterable[PlanPart]],
    options: Mapping[str, Any],
    tell: Callable[[PlanStanding, int], None],
    *,
    pulses: bool,
    figures: bool,
    keep: bool,
) -> tuple[PlanStanding, MotionError | None]:
    """Write everything into a folder as the parts come, the record last: what it holds, and why it is no more.

    A folder with a checkpoint is gone on with. plan: from a mark on; options: what makes it another plan.
    tell: is told what is known behind each part, and how many segments that are, of all repetitions.
    pulses: their file as well. keep: where a part cannot be planned, the folder becomes a plan that ends with the stop
    before it, if there is any. Else raises as the parts do.
    """
    seen, held, command = Overview(), Activity(inputs.program), make_resume_command()
    part, no, mark, sizes, ending = None, None, None, None, ""
    of = {**options, "inputs": inputs.digests, "fit": inputs.fit}
    of["reading"] = None if inputs.origin is None else {**inputs.origin.options, "format": inputs.origin.format}
    if holds_checkpoint(folder):
        known = read_checkpoint(folder, of, inputs.machine)
        mark, sizes = known.mark, known.sizes
        note(f"resuming {folder.name}: {known.reached}, are planned already")
        if known.complete:
            _look_again(seen, held, folder, inputs, options, mark)
            _finish(folder, mark.standing, inputs, seen, held, pulses, figures, known.ending)
            return mark.standing, MotionError(known.ending) if known.ending else None
    else:
        _write_inputs(folder, inputs)
    with ExitStack() as files:
        writer = PartsWriter(folder, pulses, holds_triggers(inputs.program), sizes, files)
        if mark is not None:
            _look_again(seen, held, folder, inputs, options, mark)
        try:
            for part in plan(mark):
                writer.add(part)
                seen.add(part.motion, part.start.begin, part.start.length)
                held.add(part.motion, part.start.begin, part.limits)
                done = _count_segments(part, inputs.program)
                reached = _describe_reached(part.standing, done, inputs.program)
                whole = part.rest_pulses is None
                write_checkpoint(folder, of, Checkpoint(part.mark, writer.secure(), whole, reached, command))
                tell(part.standing, done)
        except MotionError as error:
            if not keep or part is None:
                raise
            no = error
            writer.end(part)
            if part.rest is not None:
                seen.add(part.rest, part.standing.start.begin, part.start.length)
                held.add(part.rest, part.standing.start.begin, part.limits)
            ending = f"It ends before the program does, with a stop: {no}"
            ended = replace(part.mark, standing=come_to_rest(part))
            reached = _describe_reached(ended.standing, _count_segments(part, inputs.program), inputs.program)
            write_checkpoint(folder, of, Checkpoint(ended, writer.secure(), True, reached, command, ending))
    assert part is not None  # a program has a segment that moves, or is refused
    standing = part.standing if no is None else come_to_rest(part)
    _finish(folder, standing, inputs, seen, held, pulses, figures, ending)
    return standing, no


def _count_segments(part: PlanPart, program: Program) -> int:
    """Up to the end of a part, of all repetitions."""
    repetition = part.motion.path.place(0.0, int(part.motion.piece[-1])).repetition or 1
    return (repetition - 1) * len(program.segments) + part.standing.segment


def _describe_reached(standing: PlanStanding, segments: int, program: Program) -> str:
    """How far a plan is."""
    total = program.repeat * len(program.segments)
    return f"segments 1 to {segments} of {total}, {standing.duration:.1f} s of motion"


def _write_inputs(folder: Path, inputs: Inputs) -> None:
    write_named(folder / inputs.program_file, inputs.program_toml)
    write_named(folder / SOURCES["machine"], inputs.machine_toml)
    for name, content in inputs.companions.items():
        write_named(folder / name, content)


def _look_again(
    seen: Overview, held: Activity, folder: Path, inputs: Inputs, options: Mapping[str, Any], mark: PlanMark
) -> None:
    """At the parts that were planned before."""
    program, begin = inputs.program, 0.0
    steps = walk_path(program, inputs.machine)
    axes = pace_axes(inputs.machine.axes, options["clock_hz"], find_rule(options["rule"]))
    for motion in follow_motion(folder / MOTION, steps, inputs.machine, program.tool, whole=False):
        if begin >= mark.standing.duration:
            return  # its stop
        at = motion.path.place(0.0, 0, 0.0)
        assert at.t is not None
        begin = at.t + motion.duration
        seen.add(motion, at.t, at.s)
        held.add(motion, at.t, limits_of(motion.path, axes, options["order"]))


def _finish(
    folder: Path,
    standing: PlanStanding,
    inputs: Inputs,
    seen: Overview,
    held: Activity,
    pulses: bool,
    figures: bool,
    ending: str,
) -> None:
    """The check of the pulses that were written, the report, and the record."""
    program, machine = inputs.program, inputs.machine
    verdict, digest = None, None
    if pulses:
        file = folder / BINARY
        with step("checking the pulses") as tell:
            steps = walk_path(program, machine)
            motions = follow_motion(folder / MOTION, steps, machine, program.tool, whole=not ending)
            verdict = check_file_parts(file, standing.pulses, machine, motions, tell)
        if not verdict.holds:
            raise Defect(f"{count_noun(verdict.fault_count, 'fault')} in the pulses, the first: {verdict.faults[0]}")
        digest = digest_pulses(open_pulses(file).parts())
        proof = of_pulse_file(file, standing.pulses, standing.machine, verdict, standing.counted)
        write_named(folder / CERTIFICATE, as_json(proof))
    from benchmarks.reports.parts_report import write_report  # which takes matplotlib along

    told = of_pulses(standing.pulses, standing.machine, standing.counted, digest, verdict)
    triggers = [tabulate_trigger_csv(folder / TRIGGERS, standing.triggers)] if standing.triggers else []
    with step("writing the report"), name_file(folder / REPORT):
        write_report(
            standing,
            seen,
            held,
            verdict,
            folder / REPORT,
            figures=figures,
            note=ending,
            drives=tabulate_drives(told),
            triggers=triggers,
        )
    record = of_parts(standing, inputs, digest, verdict, ending)
    write_named(folder / RECORD, as_json(seal_record(record, folder, (BEGUN, CHECKPOINT))))
