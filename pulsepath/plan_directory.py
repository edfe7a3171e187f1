"""What `plan` leaves behind: the record, the motion, the pulses, the report, and the files they were made from."""

import json
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

from kinematics import Machine, MotionError, load_machine
from planner import Program, Trajectory, load_program
from planner.actuation import actuate
from planner.export import motion_json
from planner.limits import Limit, limits_of
from planner.parallel import Progress, silent
from planner.pulses import PulseCheck, PulseSchedule, check_file, generate, paced
from pulsepath.directory import RECORD, is_ours
from pulsepath.inputs import Inputs
from pulsepath.job import Defect, Job
from pulsepath.progress import step
from pulsepath.pulse_record import of_pulse_file
from pulsepath.record import as_json, of_plan
from pulsepath.second_work import LAWS
from pulsepath.talk import note

CERTIFICATE = "certificate.json"
"""What the check of the pulse file found: beside it."""
MOTION, TRAJECTORY, PULSES, REPORT, TRACK = "motion.json", "trajectory.csv", "pulses.csv", "report.html", "track.json"
TRIGGERS = "triggers.csv"
"""Only where the program has triggers."""
SOURCES = {"program": "program.toml", "machine": "machine.toml"}


@dataclass(frozen=True, slots=True)
class Planned:
    """A plan taken up again: its motion, exactly as proved; clock and rule of its pulses, order of its limits."""

    program: Program
    machine: Machine
    trajectory: Trajectory
    clock_hz: int
    rule: str
    order: int

    @property
    def limits(self) -> tuple[Limit, ...]:
        """Those that the motion was proved to keep."""
        axes = paced(self.machine.axes, self.clock_hz, self.rule)
        return limits_of(self.trajectory.path, axes, self.order)

    def pulses(self, progress: Progress = silent) -> PulseSchedule:
        """The pulses, made again from the motion."""
        return generate(self.trajectory, self.machine.axes, self.machine.home_q, self.clock_hz, self.rule, progress)


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
    (folder / RECORD).write_text(as_json(of_plan(job, inputs, verdict)), encoding="utf-8")
    return verdict


def _report(page: Path, job: Job, verdict: PulseCheck) -> None:
    from benchmarks.report import draw_axes, draw_compared, write_report

    with step("writing the report"):
        drawn = draw_axes(job.plan) | draw_compared(job.plan, job.classical, job.realised) if job.figures else {}
    with step(f"tracking it under laws {' and '.join(LAWS)}"):
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
        )


def read(folder: Path) -> Planned:
    """The plan in a folder. Raises MotionError where there is none, or where its sources are no longer the same."""
    if not is_ours(folder):
        raise MotionError(f"{folder} holds no plan: make one with pulsepath plan PROGRAM --out {folder}")
    record = json.loads((folder / RECORD).read_bytes())
    digests = record.get("provenance", {}).get("sha256", {})
    clock, rule = (record.get("pulses", {}).get(what) for what in ("clock_hz", "rule"))
    if not isinstance(clock, int) or clock <= 0 or not isinstance(rule, str):
        raise MotionError(f"{folder / RECORD} names no clock or no rule of its pulses: plan it again")
    order = record.get("order")
    if order not in (2, 3):
        raise MotionError(f"{folder / RECORD} names no order, 2 or 3, of its limits: plan it again")
    for what, name in SOURCES.items():
        content = (folder / name).read_bytes()
        if sha256(content).hexdigest() != digests.get(what):
            raise MotionError(f"{folder / name} is not the {what} that the plan was made from: plan it again")
    program, machine = load_program(folder / SOURCES["program"]), load_machine(str(folder / SOURCES["machine"]))
    # the files here are copies, by whose names nobody knows what was planned
    program = replace(program, name=str(record.get("program") or program.name))
    machine = machine.called(str(record.get("machine") or machine.name))
    trajectory = motion_json.read(folder / MOTION, actuate(program, machine))
    return Planned(program, machine, trajectory, clock, rule, order)
