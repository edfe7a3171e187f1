"""A program on a machine as it stands before it is timed: what every timing of it begins with."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from planner.actuation import MachinePath, actuate
from planner.limits import Limit, limits_of
from planner.program.model import Program


@dataclass(frozen=True, slots=True)
class Course:
    """The path of a program in a machine's actuators, and the limits of a motion along it."""

    program: Program
    machine: Machine
    path: MachinePath
    limits: tuple[Limit, ...] = field(repr=False)


def course(program: Program, machine: Machine, order: int, axes: Sequence[Axis] | None = None) -> Course:
    """Of a program in which nothing is left open. Raises MotionError for a path that cannot be drawn.

    axes: with limits of their own in place of the machine's.
    """
    path = actuate(program, machine)
    return Course(program, machine, path, limits_of(path, machine.axes if axes is None else axes, order))
