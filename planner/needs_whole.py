"""Stages of planning that need the whole motion at once, each with its reason and the remedy.

If any stage needs the whole motion, one window covers the path.

How far the others look:

- Windows look ahead as far as they reach, and at least four times their braking time
  (`planner.windows`).
- Pulses look back by one pulse, and ahead by the hold time of the drive
  (`planner.pulses.generation.stream`).
- Compensation of play looks ahead by eight times the duration of a take-up step, and by the time
  until an axis that hardly reverses moves on (`planner.pulses.compensation.compensate`).
- The time in a band of resonance looks as far as an axis stays in the band: windows meet where no
  axis is in one.
- Input shapers would look back by their length, half a period of the vibration for ZV and one for
  ZVD. They are still applied to the whole motion, since limits that the shaped motion exceeds are
  lowered and the motion is solved again.
"""

from collections.abc import Callable

from kinematics.machine.machine import Machine
from planner.program.model import Dwell, Program, Segment, SegmentStream, Synchronised
from planner.pulses import find_rule
from planner.request import PlanRequest

Stage = Callable[[PlanRequest, Program, Machine], str | None]
"""A function that returns why a stage needs the whole motion, or None."""


def find_whole_reason(request: PlanRequest, program: Program, machine: Machine) -> str | None:
    """Return why a plan is made as a whole, with a remedy. None: it can be made in parts."""
    reasons = (stage(request, program, machine) for stage in STAGES)
    return next((reason for reason in reasons if reason is not None), None)


def _check_goal(request: PlanRequest, program: Program, machine: Machine) -> str | None:
    if program.duration is not None:
        return "it states a duration, which is that of the whole: omit the duration"
    goals = {
        "a duration": request.duration is not None,
        "an objective with heat": request.heat > 0,
        "a gap": request.gap is not None,
    }
    for goal, is_given in goals.items():
        if is_given:
            return f"{goal} is a goal for the whole motion: omit it"
    if request.solver != "passes":
        return f"solver {request.solver} solves the whole motion: omit the solver"
    return None


def _check_rule(request: PlanRequest, program: Program, machine: Machine) -> str | None:
    rule = find_rule(request.rule) if isinstance(request.rule, str) else request.rule
    if not rule.whole_reason:
        return None
    reason = f"rule {rule.name} needs the whole motion, as {rule.whole_reason}"
    return f"{reason}: choose rule nearest"


def _check_ends(request: PlanRequest, program: Program, machine: Machine) -> str | None:
    if program.start_speed or program.end_speed:
        return "it begins or ends in motion: let it begin and end at rest"
    return None


def _check_machine(request: PlanRequest, program: Program, machine: Machine) -> str | None:
    if any(axis.shaper for axis in machine.axes):
        return "the machine has input shapers, which reach from each part into the next: take them out of its file"
    return None


def _check_segments(request: PlanRequest, program: Program, machine: Machine) -> str | None:
    # A file that is read while it is planned has no such segments.
    if isinstance(program.segments, SegmentStream):
        return None
    for number, segment in enumerate(program.segments, 1):
        if (reason := _describe_whole(segment)) is not None:
            return f"segment {number} {reason}: plan that segment by itself"
    return None


def _describe_whole(segment: Segment) -> str | None:
    if isinstance(segment, Dwell):
        return None
    if isinstance(segment, Synchronised):
        return "is a synchronised move"
    if getattr(segment, "speed_constant", False):
        return "asks for a constant speed"
    if getattr(segment, "free", None) is not None:
        return "leaves orientation free"
    return None


STAGES: tuple[Stage, ...] = (
    _check_rule,
    _check_goal,
    _check_ends,
    _check_machine,
    _check_segments,
)
