"""The plug point of the export formats: what each is given, its options, and what it says of itself."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Protocol

from kinematics.errors import MotionError
from kinematics.machine import Machine
from planner.option import option as option
from planner.parallel import Progress, silent
from planner.pulses.compensate import counted
from planner.pulses.motion import Motion
from planner.pulses.schedule import PulseSchedule
from planner.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Source:
    """What is exported: a certified motion of a machine, and its checked pulses.

    name  of the program, for formats that hold one
    tell  told how much is written, of how much, by formats that write in parts
    counted  what a controller of the axes has to be told: the motion, or of axes that compensate what their motors do
    """

    name: str
    machine: Machine
    trajectory: Trajectory
    pulses: PulseSchedule
    tell: Progress = silent
    counted: Motion = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "counted", counted(self.trajectory, self.machine.axes, self.machine.home_q))


@dataclass(frozen=True, slots=True)
class Exported:
    """What a file holds of the motion, found by decoding it as its consumer would.

    error    pulses, the largest by which any axis of the decoded file is from what was exported
    against  what it is measured against, and how, in words: "the pulses, edge by edge"
    notes    what its user has to know: a spacing that was chosen, what the format cannot hold
    """

    error: float
    against: str
    notes: tuple[str, ...] = ()


def refuse_compensated(source: Source, format_: str) -> None:
    """Raise MotionError for axes that compensate, in a format whose controller makes its own way from stop to stop."""
    for axis in source.machine.axes:
        if axis.compensate:
            raise MotionError(
                f"{format_}: axis {axis.name} compensates {' and '.join(axis.compensate)} along the motion, which its "
                "controller does not follow; take compensate out of the machine's file"
            )


class Format(Protocol):
    """A file format: a frozen dataclass whose fields, made by `option`, are its options.

    The first line of its docstring is what the command's help says of it; the rest states units, line ends and limits.
    """

    suffix: ClassVar[str]

    def write(self, source: Source, path: Path, /) -> Exported:
        """Write the file. Raises MotionError, before anything is written where it can, for what it cannot hold."""
