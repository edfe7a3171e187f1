"""What `plan` leaves behind: the record, the motion, the pulses, the report, and the files they were made from."""

import json
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from kinematics import Machine, MotionError, load_machine
from planner import Program, Trajectory, load_program
from planner.actuation import actuate
from planner.export import motion_json
from pulsepath.directory import RECORD, is_ours
from pulsepath.inputs import Inputs
from pulsepath.job import Job
from pulsepath.record import as_json, of_plan

MOTION, TRAJECTORY, PULSES, REPORT, TRACK = "motion.json", "trajectory.csv", "pulses.csv", "report.html", "track.json"
TRIGGERS = "triggers.csv"
"""Only where the program has triggers."""
SOURCES = {"program": "program.toml", "machine": "machine.toml"}


@dataclass(frozen=True, slots=True)
class Planned:
    """A plan taken up again: its motion, exactly as it was proved."""

    program: Program
    machine: Machine
    trajectory: Trajectory


def write(folder: Path, job: Job, inputs: Inputs) -> None:
    """Write everything into an empty folder, the record last."""
    from benchmarks.report import write_report
    from planner.export import pulse_csv, trajectory_csv, trigger_csv

    (folder / SOURCES["program"]).write_bytes(inputs.program_toml)
    (folder / SOURCES["machine"]).write_bytes(inputs.machine_toml)
    motion_json.write(job.plan.trajectory, folder / MOTION)
    trajectory_csv.write(job.plan, folder / TRAJECTORY)
    pulse_csv.write(job.plan.pulses, folder / PULSES, [axis.direction for axis in job.plan.machine.axes])
    if job.plan.triggers:
        trigger_csv.write(job.plan, folder / TRIGGERS)
    write_report(job.plan, job.classical, job.metrics, folder / REPORT, verdict=job.verdict, others=job.others)
    (folder / RECORD).write_text(as_json(of_plan(job, inputs)), encoding="utf-8")


def read(folder: Path) -> Planned:
    """The plan in a folder. Raises MotionError where there is none, or where its sources are no longer the same."""
    if not is_ours(folder):
        raise MotionError(f"{folder} holds no plan: make one with pulsepath plan PROGRAM --out {folder}")
    digests = json.loads((folder / RECORD).read_bytes()).get("provenance", {}).get("sha256", {})
    for what, name in SOURCES.items():
        content = (folder / name).read_bytes()
        if sha256(content).hexdigest() != digests.get(what):
            raise MotionError(f"{folder / name} is not the {what} that the plan was made from: plan it again")
    program, machine = load_program(folder / SOURCES["program"]), load_machine(str(folder / SOURCES["machine"]))
    return Planned(program, machine, motion_json.read(folder / MOTION, actuate(program, machine)))
