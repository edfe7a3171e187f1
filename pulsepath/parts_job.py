"""What the command `plan` computes of a long program: its plan part by part, written as it goes."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from time import perf_counter

from kinematics import MotionError
from planner import Infeasible
from planner.limits import find_unkept_limits, usual_order
from planner.plan_parts import MOST_WHOLE, PlanStanding, find_whole_reason, plan_parts
from planner.pulses import find_rule
from pulsepath.inputs import Inputs
from pulsepath.output import parts_directory
from pulsepath.progress import detail, note, step


@dataclass(frozen=True, slots=True)
class Firing:
    """How pulses are made: ticks/s of their clock, the rule; written: whether there is to be a file of them."""

    clock_hz: int
    rule: str
    written: bool


def choose_parts(stream: bool | None, inputs: Inputs, rule: str, whole: Sequence[str]) -> bool:
    """Whether a program is planned in parts; stream: as asked, None: as it is best.

    whole: options that were given and need all of a motion. Raises MotionError where it is asked for and cannot be.
    """
    program, why = inputs.program, None
    if stream is False or (stream is None and program.repeat * len(program.segments) <= MOST_WHOLE):
        return False
    if whole:
        why = f"with {whole[0]}: omit that, or run pulsepath track or export on the plan later"
    elif (reason := find_whole_reason(program, inputs.machine, find_rule(rule))) is not None:
        why = f"{reason}: give --whole, or plan that part by itself"
    if why is not None and stream:
        raise MotionError(f"--stream: program {program.name} cannot be planned in parts {why}")
    if why is not None:
        detail(f"planned as a whole: {why}")
    return why is None


def run_parts(
    inputs: Inputs, order: int | None, firing: Firing, folder: Path, figures: bool, keep: bool
) -> tuple[PlanStanding, MotionError | None]:
    """Plan into a folder, or go on with what is there: what it holds then, and why it is not all.

    Raises as `parts_directory.write`.
    """
    program, machine = inputs.program, inputs.machine
    for field in find_unkept_limits(machine):
        note(f"note: {machine.name} states {field} but no masses, so no plan can respect it")
    begin, reached = perf_counter(), 0.0

    def describe(done: int, of: int) -> str:
        spent = perf_counter() - begin
        left = spent * (of - done) / max(done, 1)
        speed = reached / max(spent, 1e-9)
        return (
            f"segment {done} of {of}, {reached:.1f} s of motion, {speed:.1f} times real time, about {left:.0f} s left"
        )

    with step(f"planning {program.name} on {machine.name} part by part", describe) as tell:

        def tell_standing(standing: PlanStanding) -> None:
            nonlocal reached
            reached = standing.duration
            tell(standing.segment, len(program.segments))

        kind = usual_order(machine.axes) if order is None else order
        plan = partial(plan_parts, program, machine, order=kind, clock_hz=firing.clock_hz, rule=firing.rule)
        options = {"order": kind, **asdict(firing)}
        try:
            standing, no = parts_directory.write(
                folder,
                inputs,
                lambda mark: plan(after=mark),
                options,
                tell_standing,
                pulses=firing.written,
                figures=figures,
                keep=keep,
            )
        except Infeasible as error:
            _tell_line(inputs, error)
            raise
    if isinstance(no, Infeasible):
        _tell_line(inputs, no)
    return standing, no


def _tell_line(inputs: Inputs, no: Infeasible) -> None:
    """In which line of its file the segment is that is refused."""
    program = inputs.program
    number = None if no.place is None else no.place.segment
    line = 0 if number is None else program.segments[number - 1].line_number
    if line:
        suffix = ".toml" if inputs.origin is None else inputs.origin.suffix
        note(f"segment {number} is in line {line} of {program.name}{suffix}")
