"""Read a plan from its folder, and prove its motion again."""

import json
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import nan
from os import PathLike
from pathlib import Path

import numpy as np

from kinematics import Machine, MotionError, load_machine
from kinematics.files.chunk_file import holds_chunks
from kinematics.foundation.options import check_arguments
from planner import Plan, Program, Trajectory, load_program
from planner.certificate.certify import Certificate
from planner.export.motion_file import follow_motion, read_duration, read_motion, read_parts
from planner.limits import Limit, limits_of
from planner.orientation.orient import apply_choice
from planner.parallel import Progress, ignore_progress
from planner.path.actuation import actuate
from planner.path.chain import walk_path
from planner.program.joins import fit_joins
from planner.pulses import (
    AxesMotion,
    PulseFile,
    PulseSchedule,
    check,
    find_rule,
    generate,
    open_pulses,
    pace_axes,
)
from planner.pulses.checking.pulse_reader import list_statements, read_compensation
from planner.pulses.compensation.compensate import counted_motion
from planner.pulses.schedule import AxisPulses, MovedPulses
from planner.request import PlanRequest, read_request_record
from planner.shaping.shaped_motion import shaper_length
from planner.shaping.shaped_proof import ShapedProof
from pulsepath.inputs import Origin
from pulsepath.output.directory import RECORD, refuse_no_plan
from pulsepath.output.record import Record
from pulsepath.progress import step
from pulsepath.store.files import BINARY, CSV, DERIVED, MOTION, ORIENTATION, SOURCES
from pulsepath.store.verify import (
    describe_violation,
    digest_pulses,
    find_differences,
    prove_motion,
    refuse,
)

NOT_VERIFIED = ", NOT VERIFIED"
"""Suffix of the program's name in a plan that was read with `unverified`."""


# The certificate of a motion, and its proof after the input shapers, if there are any.
Proofs = tuple[Certificate, ShapedProof | None]


@dataclass(eq=False)
class StoredSource:
    """The results of a plan in its folder. Each is read or computed at its first use.

    motion      file of the motion
    schedule    clock, rule and duration of the pulses as plan.json states them, without the pulses
    digest      SHA-256 of the pulses that were checked
    verified    True if the folder is as it was written
    pulse_file  file of the pulses, if there is one
    in_parts    True if the plan was made in parts
    complete    True if the motion runs to the end of the program
    """

    program: Program
    machine: Machine
    order: int
    motion: Path
    schedule: PulseSchedule
    digest: str | None = None
    verified: bool = False
    pulse_file: Path | None = None
    in_parts: bool = False
    complete: bool = True
    _pulses: PulseSchedule | None = field(default=None, init=False)

    @property
    def duration(self) -> float:
        """Time (s) for which the machine moves. The motion is not read for it."""
        return self.schedule.duration

    @cached_property
    def trajectory(self) -> Trajectory:
        """Whole motion, before any input shapers."""
        if not self.in_parts:
            return read_motion(self.motion, actuate(self.program, self.machine))
        steps = walk_path(self.program, self.machine)
        return read_parts(self.motion, steps, self.machine, self.program.tool)

    def follow(self) -> Iterator[Trajectory]:
        """Yield the motion part by part, each on its own path, with a time from 0."""
        if not self.in_parts:
            yield self.trajectory
            return
        steps = walk_path(self.program, self.machine)
        tool = self.program.tool
        yield from follow_motion(self.motion, steps, self.machine, tool, whole=self.complete)

    @cached_property
    def limits(self) -> tuple[Limit, ...]:
        """Limits that the motion was planned and proved with."""
        return self.find_limits(self.trajectory)

    def find_limits(self, motion: Trajectory) -> tuple[Limit, ...]:
        """Return the limits of the whole motion, or of a part, on its own path."""
        paced = pace_axes(self.machine.axes, self.schedule.clock_hz, self.schedule.rule)
        return limits_of(motion.path, paced, self.order)

    def prove(self) -> Iterator[Proofs]:
        """Prove the motion part by part. The proofs of a whole motion are kept."""
        if not self.in_parts:
            yield self._proofs
            return
        for motion in self.follow():
            yield prove_motion(motion, self.find_limits(motion), self.machine.axes)

    @cached_property
    def _proofs(self) -> Proofs:
        return prove_motion(self.trajectory, self.limits, self.machine.axes)

    @property
    def certificate(self) -> Certificate:
        """Proof that the motion keeps every limit, made again at its first use."""
        return self._proofs[0]

    @property
    def shaped(self) -> ShapedProof | None:
        """Motion after the input shapers, and its proof."""
        return self._proofs[1]

    @cached_property
    def counted(self) -> AxesMotion:
        """Motion that the pulses count."""
        return counted_motion(self.trajectory, self.machine.axes, self.machine.home_q)

    def open_pulses(self) -> PulseFile | None:
        """Open the binary file of the pulses, to be read part by part.

        None: there is no such file, or it does not state and contain what was proved.
        """
        if self.pulse_file is None or not holds_chunks(self.pulse_file):
            return None
        file = open_pulses(self.pulse_file)
        unchanged = (
            _states_same(file.stated, self.schedule) and digest_pulses(file.parts()) == self.digest
        )
        return file if unchanged else None

    def read_pulses(self, progress: Progress = ignore_progress) -> PulseSchedule:
        """Return the pulses from their file; without one, make them again from the motion.

        Raises MotionError if pulses that were made again fail the check.
        """
        if self._pulses is None:
            file = self.open_pulses()
            self._pulses = self._generate(progress) if file is None else file.read(progress)
        return self._pulses

    def _generate(self, progress: Progress) -> PulseSchedule:
        axes = self.machine.axes
        home_q = self.machine.home_q
        clock_hz, rule = self.schedule.clock_hz, self.schedule.rule
        pulses = generate(self.trajectory, axes, home_q, clock_hz, rule, progress)
        # Another processor's arithmetic may give other pulses, which are checked instead.
        if self.verified and digest_pulses([pulses]) != self.digest:
            verdict = check(pulses, self.counted, axes, home_q)
            refuse([f"pulses made again from {MOTION}: {fault}" for fault in verdict.faults[:1]])
        return pulses


def _states_same(file: PulseSchedule, stated: PulseSchedule) -> bool:
    axes = range(len(stated.axes))
    return len(file.axes) == len(axes) and all(
        list_statements(file, k) == list_statements(stated, k) for k in axes
    )


@check_arguments()
def load_plan(folder: str | PathLike[str], unverified: bool = False) -> Plan:
    """Load the plan that `pulsepath plan` wrote into a folder; its motion is proved again.

    Parameters
    ----------
    folder
        Folder with plan.json and the other files.
    unverified
        Load a changed plan too. It then has `doubts`, and is not proved.

    Returns
    -------
    Plan
        As `plan` returns one. Its motion and pulses are read at their first use.

    Raises
    ------
    MotionError
        There is no plan, a file was changed, or the motion does not keep its limits.
    """
    return _load(Path(folder), unverified, nullcontext())


def read(folder: Path, unverified: bool = False) -> Plan:
    """Load a plan as `load_plan`, and show the progress."""
    return _load(folder, unverified, step("certifying the motion again"))


def _load(folder: Path, unverified: bool, proving: AbstractContextManager[object]) -> Plan:
    refuse_no_plan(folder)
    file = folder / RECORD
    record = json.loads(file.read_bytes())
    clock, rule, digest = _read_firing(record, file)
    request = _read_request(record, file)
    origin = _origin(record)
    source_name = SOURCES["program"] if origin is None else f"program{origin.suffix}"
    needed = (source_name, SOURCES["machine"], MOTION)
    doubts = find_differences(record, folder, RECORD, needed, DERIVED)
    if not unverified:
        refuse(doubts)
    program, machine = _read_inputs(record, folder, origin, source_name)
    if unverified:
        program = replace(program, name=f"{program.name}{NOT_VERIFIED}")
    rounds, methods, least = _read_solution(record, file)

    duration = read_duration(folder / MOTION) + shaper_length(machine.axes)
    pulse_files = [folder / name for name in (BINARY, CSV) if (folder / name).is_file()]
    source = StoredSource(
        program,
        machine,
        request.resolved_order,
        folder / MOTION,
        _state_pulses(record["pulses"], duration, machine, clock, rule),
        digest,
        verified=not unverified,
        # The pulses of an unverified plan are made again from its motion.
        pulse_file=pulse_files[0] if pulse_files and not unverified else None,
        in_parts=record.get("windows") is not None,
        complete=record.get("ends_before") is None,
    )
    plan = Plan(request, program, machine, source, rounds, methods, least)
    if unverified:
        if not source.in_parts:
            _ = source.trajectory  # refuses a damaged file at once
        return replace(plan, doubts=(*doubts, "the motion was not proved again"))

    with proving:
        for proofs in source.prove():
            violation = describe_violation(*proofs)
            refuse([] if violation is None else [f"{folder / MOTION}: {violation}"])
    if record.get("duration_s") != duration:
        refuse([f"{file} belongs to another motion than {MOTION}"])
    return plan


def _read_firing(record: Record, file: Path) -> tuple[int, str, str | None]:
    """Return clock, rule and digest of the pulses. Raises MotionError if the record states none."""
    pulses = record.get("pulses")
    if not isinstance(pulses, dict):
        pulses = {}
    clock, rule = pulses.get("clock_hz"), pulses.get("rule")
    if type(clock) is not int or clock <= 0 or not isinstance(rule, str):
        raise MotionError(f"{file} states no pulse clock or firing rule: plan it again")
    try:
        find_rule(rule)
    except MotionError as error:
        raise MotionError(
            f"{file} states an unknown firing rule ({error}): plan it again"
        ) from None
    return clock, rule, pulses.get("sha256")


def _read_inputs(
    record: Record,
    folder: Path,
    origin: Origin | None,
    source_name: str,
) -> tuple[Program, Machine]:
    """Read program and machine of a plan, under the names that they had when it was made."""
    machine_file = str(folder / SOURCES["machine"])
    machine = load_machine(machine_file)
    file = folder / source_name
    program = load_program(file) if origin is None else origin.read(file, machine_file)
    if origin is None and (fit := record["inputs"]["fit_m"]) is not None:
        program = fit_joins(program, fit)
    program = _restore_orientation(program, folder / ORIENTATION)
    name = str(record.get("program") or program.name)
    machine = machine.rename(str(record.get("machine") or machine.name))
    return replace(program, name=name), machine


def _read_request(record: Record, file: Path) -> PlanRequest:
    """Return the request that a record states. Raises MotionError if it states none."""
    try:
        request = read_request_record(record["request"])
    except (MotionError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise MotionError(f"{file} does not state its request ({error}): plan it again") from None
    if request.order not in (2, 3):
        raise MotionError(f"{file} states no order, 2 or 3: plan it again")
    return request


def _read_solution(record: Record, file: Path) -> tuple[int, tuple[str, ...], float]:
    """Return rounds, methods and lower estimate (s) of the solution, as a `Plan` has them.

    The estimate is NaN if the record states none. Raises MotionError for a record without a
    solution.
    """
    try:
        solver, bound = record["solver"], record.get("lower_bound") or {}
        methods = solver["methods"]
        if isinstance(methods, dict):  # of a plan in parts: how many runs each solved
            methods = [name for name, count in methods.items() for _ in range(int(count))]
        return (
            int(solver["rounds"]),
            tuple(str(method) for method in methods),
            float(bound.get("duration_s", nan)),
        )
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise MotionError(
            f"{file} does not state its solution ({error!r}): plan it again"
        ) from None


def _state_pulses(
    record: Record, duration: float, machine: Machine, clock: int, rule: str
) -> PulseSchedule:
    """Return the schedule that plan.json states, without its pulses.

    Raises MotionError if it states none.
    """
    none = np.empty(0, np.int64), np.empty(0, np.int8)
    try:
        axes = [
            AxisPulses(
                axis.name,
                *none,
                int(each["start_count"]),
                axis.pulse,
                float(home),
                float(each["bound_pulses"]),
            )
            for axis, home, each in zip(
                machine.axes, machine.home_q, record["axes"].values(), strict=True
            )
        ]
        moves = tuple(MovedPulses(**one) for one in record["moved_for_drives"])
        compensations = tuple(read_compensation(one) for one in record["compensations"])
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise MotionError(
            f"{RECORD} does not state its pulses ({error!r}): plan it again"
        ) from None
    return PulseSchedule(clock, tuple(axes), duration, rule, moves, compensations)


def _origin(record: Record) -> Origin | None:
    """Return how a program in another format is read. None: the program is in our own format.

    Raises MotionError if the record does not state it.
    """
    inputs = record.get("inputs")
    if (
        not isinstance(inputs, dict)
        or not {"format", "options", "suffix", "fit_m"} <= inputs.keys()
    ):
        raise MotionError(f"{RECORD} does not say how its program is read: plan it again")
    if inputs["format"] is None:
        return None
    return Origin(inputs["format"], inputs["options"], inputs["suffix"])


def _restore_orientation(program: Program, file: Path) -> Program:
    """Return the program with the orientation that was chosen for its free segments.

    Raises MotionError if the choice is missing or unreadable.
    """
    try:
        chosen = {
            int(k): np.array(controls, float)
            for k, controls in json.loads(file.read_bytes()).items()
        }
        program = apply_choice(program, chosen)
    except FileNotFoundError:
        pass
    except (ValueError, TypeError, AttributeError, IndexError) as error:
        raise MotionError(
            f"{file}: no orientation can be read from it ({error}): plan it again"
        ) from None
    free = [getattr(segment, "free", None) for segment in program.segments]
    if any(each is not None and each.controls is None for each in free):
        raise MotionError(
            f"{file}: the orientation chosen for free segments is missing: plan it again"
        )
    return program
