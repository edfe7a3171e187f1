"""The output of `plan`: record, motion, pulses, report, and copies of the input files.

What was proved of the written file of pulses stands in certificate.json.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import cache
from math import nan
from os import PathLike
from pathlib import Path

import numpy as np

from controllers.rig_choice import rig_hint
from kinematics import Machine, MotionError, load_machine
from kinematics.files.atomic_files import name_file, write_named
from kinematics.foundation.options import check_arguments
from planner import Plan, Program, Trajectory, load_program
from planner.export import plan_files
from planner.export.motion_file import follow_motion, read_duration, read_motion, read_parts, write_motion
from planner.orientation.orient import apply_choice, find_choice
from planner.parallel import Progress
from planner.path.actuation import actuate
from planner.path.chain import walk_path
from planner.program.joins import fit_joins
from planner.pulses import PulseCheck, PulseSchedule, check, check_file
from planner.pulses.checking.pulse_reader import read_compensation
from planner.pulses.schedule import AxisPulses, MovedPulses
from planner.request import PlanRequest, read_request_record
from planner.shaping.shaped_motion import shaper_length
from pulsepath.inputs import Inputs, Origin
from pulsepath.job import Defect, Job
from pulsepath.options import LAWS
from pulsepath.output.directory import MOTION, RECORD, REPORT, TRIGGERS, refuse_no_plan
from pulsepath.output.drive_tables import tabulate_drives
from pulsepath.output.plan_record import of_plan, of_pulse_file, of_pulses
from pulsepath.output.record import Record, as_json
from pulsepath.output.stored_plan import StatedSolution, StoredPlan
from pulsepath.output.verification import (
    changes,
    find_differences,
    find_violation,
    refuse,
    seal_record,
)
from pulsepath.progress import note, step

CERTIFICATE = "certificate.json"
"""What the check of the pulse file found: beside it."""
TRAJECTORY, TRACK = "trajectory.csv", "track.json"
BINARY = "pulses.bin"
PULSES = {"csv": "pulses.csv", "binary": BINARY, "none": None}
"""The file of pulses by the form that is asked for."""
DEFAULT_PULSES = "binary"
STOPS = "stops.csv"
"""Only where stops were asked for."""
ORIENTATION = "orientation.json"
"""Only where the program leaves orientation free: what was chosen, by the index of the segment, from 0."""
DERIVED = (TRAJECTORY, *filter(None, PULSES.values()), CERTIFICATE, TRIGGERS, STOPS, REPORT, "figures")
"""What no command reads, so that it may be missing."""
NOT_VERIFIED = ", NOT VERIFIED"
"""Behind the name of a program whose plan was taken up all the same."""
SOURCES = {"program": "program.toml", "machine": "machine.toml"}


def write(folder: Path, job: Job, inputs: Inputs, pulses: str = DEFAULT_PULSES) -> PulseCheck:
    """Write everything into an empty folder, the record last; what the check of the written pulses found.

    pulses: the form of their file, "csv", "binary" or "none". Raises Defect where they fail the check.
    """
    plan = job.plan
    write_named(folder / inputs.program_file, inputs.program_toml)
    write_named(folder / SOURCES["machine"], inputs.machine_toml)
    for name, content in inputs.companions.items():
        write_named(folder / name, content)
    with name_file(folder / MOTION):
        write_motion(plan.trajectory, folder / MOTION)
    if choice := find_choice(plan.program):
        record = {str(k): chosen.tolist() for k, chosen in choice.items()}
        write_named(folder / ORIENTATION, as_json(record))
    shaped = None if plan.shaped is None else plan.shaped.motion
    with name_file(folder / TRAJECTORY):
        plan_files.write_trajectory_csv(plan.trajectory, folder / TRAJECTORY, shaped)
    form = PULSES[pulses]
    file = None if form is None else folder / form
    if file is not None:
        with step(f"writing {plan.pulses.total} pulses") as tell, name_file(file):
            _write_pulses(file, plan, tell)
    with step(f"checking {plan.pulses.total} pulses") as tell:
        if file is not None:
            verdict = check_file(file, plan, tell)
        else:
            verdict = check(plan.pulses, plan.counted, plan.machine.axes, plan.machine.home_q)
    if not verdict.holds:
        raise Defect(f"{verdict.fault_count} faults in the pulses, the first: {verdict.faults[0]}")
    write_named(folder / CERTIFICATE, as_json(of_pulse_file(file, plan.pulses, plan.machine, verdict)))
    if plan.triggers:
        with name_file(folder / TRIGGERS):
            plan_files.write_trigger_csv(plan.triggers, plan.machine.axes, folder / TRIGGERS)
    if job.stops is not None:
        job.stops.save(folder / STOPS)
    with name_file(folder / REPORT):
        _write_report(folder / REPORT, job, verdict)
    write_named(folder / RECORD, as_json(seal_record(of_plan(job, inputs, verdict), folder)))
    return verdict


def _write_pulses(file: Path, plan: Plan, tell: Progress) -> None:
    """As the name of the file says."""
    from planner.export.formats import binary, pulse_csv

    axes = plan.machine.axes
    if file.name == PULSES["binary"]:
        binary.write(plan.pulses, file, {axis.name: axis.unit for axis in axes}, tell=tell)
    else:
        wiring, timing = [axis.direction for axis in axes], [axis.timing for axis in axes]
        pulse_csv.write(plan.pulses, file, wiring, timing=timing, tell=tell)


def _write_report(page: Path, job: Job, verdict: PulseCheck) -> None:
    from benchmarks.reports.plan_report import draw_axes, draw_comparisons, draw_worth, write_report

    drawn = {}
    if job.figures:
        with step("drawing the figures"):
            drawn = (
                draw_axes(job.plan)
                | draw_comparisons(job.plan, job.classical, job.realised)
                | draw_worth(job.worth, job.stops)
            )
    if job.rig is None:
        seen = job.seen()
    else:
        with step(f"tracking under laws {' and '.join(LAWS)} on rig {job.rig.name}"):
            seen = job.seen()
    if seen.note:
        note(seen.note)
    schedule = job.plan.pulses
    counted = [(len(axis), axis.final - axis.start) for axis in schedule.axes]
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
            worth=job.worth,
            left_out=job.left_out,
            change=job.change,
            stops=job.stops,
            unbounded=job.unbounded,
            scene=seen.scene,
            untracked=seen.note or rig_hint(job.plan.machine),
            drives=tabulate_drives(of_pulses(schedule, job.plan.machine, counted, None, verdict)),
        )


@check_arguments()
def load_plan(folder: str | PathLike[str], unverified: bool = False) -> StoredPlan:
    """Load the plan that `pulsepath plan` wrote into a folder; its motion is proved again.

    Parameters
    ----------
    folder
        That holds plan.json and the other files, as they were written.
    unverified
        Take what does not hold too: it then has doubts, and nothing is proved.

    Returns
    -------
    StoredPlan
        Has all that a plan has which `plan` returns.

    Raises
    ------
    MotionError
        There is no plan, or it does not hold.
    """
    return _load(Path(folder), unverified, nullcontext())


def read(folder: Path, unverified: bool = False) -> StoredPlan:
    """The same, which tells of its progress."""
    return _load(folder, unverified, step("certifying the motion again"))


def _load(folder: Path, unverified: bool, proving: AbstractContextManager[object]) -> StoredPlan:
    refuse_no_plan(folder)
    record = json.loads((folder / RECORD).read_bytes())
    pulses = record.get("pulses")
    clock, rule, digest = (pulses.get(what) if isinstance(pulses, dict) else None for what in FIRING_KEYS)
    if not isinstance(clock, int) or clock <= 0 or not isinstance(rule, str):
        raise MotionError(f"{folder / RECORD} states no pulse clock or firing rule: plan it again")
    request = _read_request(record, folder / RECORD)
    origin = _origin(record)
    source = SOURCES["program"] if origin is None else f"program{origin.suffix}"
    doubts = find_differences(record, folder, RECORD, (source, SOURCES["machine"], MOTION), DERIVED)
    if not unverified:
        refuse(doubts)
    own = str(folder / SOURCES["machine"])
    machine = load_machine(own)
    program = load_program(folder / source) if origin is None else origin.read(folder / source, own)
    if origin is None and (fit := record["inputs"]["fit_m"]) is not None:
        program = fit_joins(program, fit)
    # the files here are copies, by whose names nobody knows what was planned
    name = str(record.get("program") or program.name)
    program = replace(
        _restore_orientation(program, folder / ORIENTATION), name=f"{name}{NOT_VERIFIED}" if unverified else name
    )
    machine = machine.rename(str(record.get("machine") or machine.name))
    parts, whole = record.get("windows") is not None, record.get("ends_before") is None
    load, follow = _find_motion(folder / MOTION, program, machine, parts, whole)
    duration = read_duration(folder / MOTION) + shaper_length(machine.axes)
    stated = _state_pulses(pulses, duration, machine, clock, rule)
    held = next((folder / name for name in (BINARY, PULSES["csv"]) if name and (folder / name).is_file()), None)
    taken = StoredPlan(
        program,
        machine,
        load,
        clock,
        rule,
        request,
        follow,
        digest,
        stated,
        held,
        (),
        _read_solution(record, folder / RECORD),
    )
    if unverified:
        return replace(taken, pulse_file=None, doubts=(*doubts, "the motion was not proved again"))
    with proving:
        for motion in taken.parts():
            violation = find_violation(motion, taken.find_limits(motion), machine.axes)
            refuse([] if violation is None else [f"{folder / MOTION}: {violation}"])
    if record.get("duration_s") != duration:
        refuse([f"{folder / RECORD} belongs to another motion than {MOTION}"])
    return taken


def _read_request(record: Record, file: Path) -> PlanRequest:
    """Return the request that a record states. Raises MotionError where it states none."""
    try:
        request = read_request_record(record["request"])
    except (MotionError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise MotionError(f"{file} does not state its request ({error}): plan it again") from None
    if request.order not in (2, 3):
        raise MotionError(f"{file} states no order, 2 or 3: plan it again")
    return request


def _read_solution(record: Record, file: Path) -> StatedSolution:
    """Return what a record states of the solution. Raises MotionError where it states none."""
    try:
        solver, bound = record["solver"], record.get("lower_bound") or {}
        methods = solver["methods"]
        if isinstance(methods, dict):  # of a plan in parts: how many runs each solved
            methods = [name for name, count in methods.items() for _ in range(int(count))]
        return StatedSolution(
            int(solver["rounds"]),
            tuple(str(method) for method in methods),
            float(bound.get("duration_s", nan)),
        )
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise MotionError(f"{file} does not state its solution ({error!r}): plan it again") from None


def _find_motion(
    file: Path, program: Program, machine: Machine, parts: bool, whole: bool
) -> tuple[Callable[[], Trajectory], Callable[[], Iterator[Trajectory]] | None]:
    """How the motion in a file is loaded, and how it is followed part by part where it was planned so."""
    if not parts:
        trajectory = read_motion(file, actuate(program, machine))
        return (lambda: trajectory), None
    tool = program.tool
    return (
        cache(lambda: read_parts(file, walk_path(program, machine), machine, tool)),
        lambda: follow_motion(file, walk_path(program, machine), machine, tool, whole=whole),
    )


def _state_pulses(record: Record, duration: float, machine: Machine, clock: int, rule: str) -> PulseSchedule:
    """The schedule that plan.json states, without its pulses. Raises MotionError where it states none."""
    none = np.empty(0, np.int64), np.empty(0, np.int8)
    try:
        axes = [
            AxisPulses(axis.name, *none, int(each["start_count"]), axis.pulse, float(home), float(each["bound_pulses"]))
            for axis, home, each in zip(machine.axes, machine.home_q, record["axes"].values(), strict=True)
        ]
        moves = tuple(MovedPulses(**one) for one in record["moved_for_drives"])
        compensations = tuple(read_compensation(one) for one in record["compensations"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise MotionError(f"{RECORD} does not state its pulses ({error!r}): plan it again") from None
    return PulseSchedule(clock, tuple(axes), duration, rule, moves, compensations)


def _origin(record: Record) -> Origin | None:
    """How the program is read, where it is a file of another format. Raises MotionError where that is not told."""
    told = record.get("inputs")
    if not isinstance(told, dict) or not {"format", "options", "suffix", "fit_m"} <= told.keys():
        raise MotionError(f"{RECORD} does not say how its program is read: plan it again")
    return None if told["format"] is None else Origin(told["format"], told["options"], told["suffix"])


def refuse_own(folder: Path, target: Path, made: Path) -> None:
    """Raise MotionError where `made`, in the target's place, would change a file of the plan in a folder."""
    record = json.loads((folder / RECORD).read_bytes())
    if changes(record, folder, RECORD, target, made):
        raise MotionError(
            f"{target} is one of the plan's own files, and replacing it would invalidate the plan: give another --out"
        )


FIRING_KEYS = ("clock_hz", "rule", "sha256")


def _restore_orientation(program: Program, file: Path) -> Program:
    """The program as it was planned. Raises MotionError where what it leaves free was chosen, and that is not told."""
    try:
        chosen = {int(k): np.array(controls, float) for k, controls in json.loads(file.read_bytes()).items()}
        program = apply_choice(program, chosen)
    except FileNotFoundError:
        pass
    except (ValueError, TypeError, AttributeError, IndexError) as error:
        raise MotionError(f"{file}: no orientation can be read from it ({error}): plan it again") from None
    free = [getattr(segment, "free", None) for segment in program.segments]
    if any(each is not None and each.controls is None for each in free):
        raise MotionError(f"{file}: the orientation chosen for free segments is missing: plan it again")
    return program
