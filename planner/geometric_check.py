"""The check of a program on a machine without planning: limits that slowing down cannot fix."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from kinematics.foundation.casadi_function import enclose_without_compiler
from kinematics.foundation.errors import MotionError, NotFree, OutOfReach
from kinematics.foundation.options import check_arguments
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import MachineSource, load_machine
from planner.avoidable_stops import find_avoidable_stops
from planner.certificate.conditioning import find_poorest
from planner.certificate.feasibility import Standing, prove_feasibility
from planner.limits import OwnLimit, limits_of, usual_order
from planner.limits.registry import geometric_limits, make_own_limits
from planner.orientation.orient import orient_open
from planner.path.actuation import actuate
from planner.path.point_to_point import departures
from planner.place import Infeasible, LostPath
from planner.program.model import Program
from planner.program.program_file import ProgramSource, load_program


@check_arguments("program", "machine", "limits")
@enclose_without_compiler()
def check(
    program: ProgramSource, machine: MachineSource, *, limits: Sequence[OwnLimit] = ()
) -> Standing:
    """Prove the limits that slowing down cannot fix over the path of a program.

    Parameters
    ----------
    program, machine
        Each as it is, by its name, or by the path of its file.
    limits
        Of your own, as of `plan`.

    Returns
    -------
    Standing
        Violations, the worst first, and margins.

    Raises
    ------
    MotionError
        The path cannot be drawn.
    """
    program, machine = load_program(program), load_machine(machine)
    program = orient_open(program, machine, usual_order(machine.axes, program))
    try:
        path = actuate(program, machine)
    except OutOfReach as error:
        raise add_advice(error, program, machine, 2) from None
    geometric = (each for each in make_own_limits(path, limits) if each.geometric)
    standing = prove_feasibility(path, (*limits_of(path, machine.axes, 2), *geometric))
    worst = tuple(add_advice(error, program, machine, 2) for error in standing.violations[:1])
    violations = (*worst, *standing.violations[1:])
    standing = replace(
        standing,
        violations=violations,
        blends=path.blends,
        fit=path.fit,
        departures=departures(path),
        overshoots=path.overshoots,
    )
    if violations:
        return standing
    kind = usual_order(machine.axes, program)
    stops = find_avoidable_stops(program, path, limits_of(path, machine.axes, kind, limits), kind)
    return replace(standing, conditioning=find_poorest(path), avoidable=stops)


def add_advice(
    error: MotionError,
    program: Program,
    machine: Machine,
    order: int,
) -> MotionError:
    """Add to a geometric violation how far the path must shrink or move. Others stay unchanged."""
    from planner.remedies import find_remedy

    if isinstance(error, NotFree):
        return error
    advice = partial(find_remedy, program, machine, order)
    if isinstance(error, Infeasible):
        return error.add_advice(advice) if error.kind in geometric_limits() else error
    return LostPath(str(error), advice).in_segment(error.segment)
