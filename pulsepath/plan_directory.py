"""What `plan` leaves behind: the record, the motion, the pulses, the report, and the files they were made from."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from controllers.rig_choice import rig_hint
from kinematics import Machine, MotionError, load_machine
from planner import Program, Trajectory, load_program
from planner.actuation import actuate
from planner.export import motion_json
from planner.limits import Limit, limits_of
from planner.orientation import choice_of, choose
from planner.parallel import Progress, silent
from planner.pulses import PulseCheck, PulseSchedule, check, check_file, generate, paced
from planner.pulses.compensate import counted
from pulsepath.directory import RECORD, is_ours
from pulsepath.inputs import Inputs
from pulsepath.job import Defect, Job
from pulsepath.options import LAWS
from pulsepath.progress import step
from pulsepath.pulse_record import of_pulse_file
from pulsepath.record import as_json, of_plan
from pulsepath.talk import note
from pulsepath.verification import changes, differences, digest_of_pulses, disproof, refuse, sealed

CERTIFICATE = "certificate.json"
"""What the check of the pulse file found: beside it."""
MOTION, TRAJECTORY, PULSES, REPORT, TRACK = "motion.json", "trajectory.csv", "pulses.csv", "report.html", "track.json"
TRIGGERS = "triggers.csv"
"""Only where the program has triggers."""
ORIENTATION = "orientation.json"
"""Only where the program leaves orientation free: what was chosen, by the index of the segment, from 0."""
DERIVED = (TRAJECTORY, PULSES, CERTIFICATE, TRIGGERS, REPORT, "figures")
"""What no command reads, so that it may be missing."""
NOT_VERIFIED = ", NOT VERIFIED"
"""Behind the name of a program whose plan was taken up all the same."""
SOURCES = {"program": "program.toml", "machine": "machine.toml"}


@dataclass(frozen=True, slots=True)
class Planned:
    """A plan taken up again: its motion, exactly as proved; clock and rule of its pulses, order of its limits.

    doubts: why it is not known to be what was proved; nothing but where that was asked for
    """

    program: Program
    machine: Machine
    trajectory: Trajectory
    clock_hz: int
    rule: str
    order: int
    pulse_digest: str | None = None
    doubts: tuple[str, ...] = ()

    @property
    def limits(self) -> tuple[Limit, ...]:
        """Those that the motion was proved to keep."""
        axes = paced(self.machine.axes, self.clock_hz, self.rule)
        return limits_of(self.trajectory.path, axes, self.order)

    def pulses(self, progress: Progress = silent) -> PulseSchedule:
        """The pulses, made again from the motion. Raises MotionError where they are not as they were, nor right."""
        axes, home_q = self.machine.axes, self.machine.home_q
        made = generate(self.trajectory, axes, home_q, self.clock_hz, self.rule, progress)
        if not self.doubts and digest_of_pulses(made) != self.pulse_digest:  # as by the arithmetic of another processor
            verdict = check(made, counted(self.trajectory, axes, home_q), axes, home_q)
            refuse([f"pulses made again from {MOTION}: {fault}" for fault in verdict.faults[:1]])
        return made


def write(folder: Path, job: Job, inputs: Inputs) -> PulseCheck:
    """Write everything into an empty folder, the record last; what the check of the written pulses found.

    Raises Defect where they fail it.
    """
    from planner.export import pulse_csv, trajectory_csv, trigger_csv

    plan = job.plan
    (folder / SOURCES["program"]).write_bytes(inputs.program_toml)
    (folder / SOURCES["machine"]).write_bytes(inputs.machine_toml)
    for name, content in inputs.companions.items():
        (folder / name).write_bytes(content)
    motion_json.write(plan.trajectory, folder / MOTION)
    if choice := choice_of(plan.program):
        (folder / ORIENTATION).write_text(as_json({str(k): chosen.tolist() for k, chosen in choice.items()}))
    trajectory_csv.write(plan.trajectory, folder / TRAJECTORY)
    axes = plan.machine.axes
    wiring, timing = [axis.direction for axis in axes], [axis.timing for axis in axes]
    with step(f"writing {plan.pulses.total} pulses") as tell:
        pulse_csv.write(plan.pulses, folder / PULSES, wiring, timing=timing, tell=tell)
    with step(f"checking {plan.pulses.total} pulses") as tell:
        verdict = check_file(folder / PULSES, plan, tell)
    if not verdict.holds:
        raise Defect(f"{verdict.fault_count} faults in the pulses, the first: {verdict.faults[0]}")
    (folder / CERTIFICATE).write_text(as_json(of_pulse_file(folder / PULSES, plan, verdict)), encoding="utf-8")
    if plan.triggers:
        trigger_csv.write(plan, folder / TRIGGERS)
    _report(folder / REPORT, job, verdict)
    (folder / RECORD).write_text(as_json(sealed(of_plan(job, inputs, verdict), folder)), encoding="utf-8")
    return verdict


def _report(page: Path, job: Job, verdict: PulseCheck) -> None:
    from benchmarks.report import draw_axes, draw_compared, write_report

    with step("writing the report"):
        drawn = draw_axes(job.plan) | draw_compared(job.plan, job.classical, job.realised) if job.figures else {}
    if job.rig is None:
        seen = job.seen()
    else:
        with step(f"tracking it under laws {' and '.join(LAWS)} on rig {job.rig.name}"):
            seen = job.seen()
    if seen.note:
        note(seen.note)
    with step("writing the report"):
        write_report(
            job.plan,
            job.classical,
            seen.metrics,
            page,
            verdict=verdict,
            others=job.others,
            realised=job.realised,
            figures={**seen.figures, **drawn},
            rig=job.rig,
            crossed=job.crossed,
            untracked=seen.note or rig_hint(job.plan.machine),
        )


def read(folder: Path, unverified: bool = False) -> Planned:
    """The plan in a folder: its files are as they were written, and its motion is proved once more.

    Raises MotionError where there is none, or where that does not hold; unverified: it then has doubts instead, and its
    motion is not proved.
    """
    if not is_ours(folder):
        raise MotionError(f"{folder} holds no plan: make one with pulsepath plan PROGRAM --out {folder}")
    record = json.loads((folder / RECORD).read_bytes())
    pulses = record.get("pulses")
    clock, rule, digest = (pulses.get(what) if isinstance(pulses, dict) else None for what in FIRING)
    if not isinstance(clock, int) or clock <= 0 or not isinstance(rule, str):
        raise MotionError(f"{folder / RECORD} names no clock or no rule of its pulses: plan it again")
    order = record.get("order")
    if order not in (2, 3):
        raise MotionError(f"{folder / RECORD} names no order, 2 or 3, of its limits: plan it again")
    doubts = differences(record, folder, RECORD, (*SOURCES.values(), MOTION), DERIVED)
    if not unverified:
        refuse(doubts)
    program, machine = load_program(folder / SOURCES["program"]), load_machine(str(folder / SOURCES["machine"]))
    # the files here are copies, by whose names nobody knows what was planned
    name = str(record.get("program") or program.name)
    program = replace(_oriented(program, folder / ORIENTATION), name=f"{name}{NOT_VERIFIED}" if unverified else name)
    machine = machine.called(str(record.get("machine") or machine.name))
    trajectory = motion_json.read(folder / MOTION, actuate(program, machine))
    taken = Planned(program, machine, trajectory, clock, rule, order, digest)
    if unverified:
        return replace(taken, doubts=(*doubts, "the motion was not proved again"))
    with step("proving the motion again"):
        found = disproof(trajectory, taken.limits)
    refuse([] if found is None else [f"{folder / MOTION}: {found}"])
    if record.get("duration_s") != trajectory.duration:
        refuse([f"{folder / RECORD} is of another motion than {MOTION}"])
    return taken


def refuse_own(folder: Path, target: Path, made: Path) -> None:
    """Raise MotionError where `made`, in the target's place, would change a file of the plan in a folder."""
    record = json.loads((folder / RECORD).read_bytes())
    if changes(record, folder, RECORD, target, made):
        raise MotionError(f"{target} is a file of the plan itself, which would no longer hold: give another with --out")


FIRING = ("clock_hz", "rule", "sha256")


def _oriented(program: Program, file: Path) -> Program:
    """The program as it was planned. Raises MotionError where what it leaves free was chosen, and that is not told."""
    try:
        chosen = {int(k): np.array(controls, float) for k, controls in json.loads(file.read_bytes()).items()}
        program = choose(program, chosen)
    except FileNotFoundError:
        pass
    except (ValueError, TypeError, AttributeError, IndexError) as error:
        raise MotionError(f"{file}: no orientation can be read from it ({error}): plan it again") from None
    free = [getattr(segment, "free", None) for segment in program.segments]
    if any(each is not None and each.controls is None for each in free):
        raise MotionError(f"{file}: does not tell the orientation that was chosen for free segments: plan it again")
    return program
