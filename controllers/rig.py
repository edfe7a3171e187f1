"""A rig: a machine, the drives behind its axes, the card that pulses them, the host that commands, and its tasks."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from controllers.card import PCI_8132, Card
from controllers.drives.servo import Servo, leg_servo
from controllers.drives.stepper import Stepper
from controllers.host import Host
from controllers.task import Task
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import nearest
from kinematics.machine.machine import Machine

Drive = Servo | Stepper


@dataclass(frozen=True, slots=True)
class Rig:
    """What a tracking law is tried on, as data.

    drives  one per axis of the machine
    card    one model; as many cards of it as the axes need
    host    when the law is asked
    tasks   what the rig is asked to do
    """

    machine: Machine
    drives: tuple[Drive, ...]
    card: Card = PCI_8132
    host: Host = field(default_factory=Host)
    name: str = "rig"
    tasks: tuple[Task, ...] = ()

    def __post_init__(self) -> None:
        if len(self.drives) != len(self.machine.axes):
            raise MotionError(
                f"rig: {len(self.drives)} drives for the {len(self.machine.axes)} axes of machine {self.machine.name}"
            )

    @property
    def about(self) -> str:
        """Name, drives and card: "hexapod-steppers: 6 steppers, card PCI-8132"."""
        kinds = [type(drive).__name__.lower() for drive in self.drives]
        drives = ", ".join(f"{kinds.count(kind)} {kind}s" for kind in dict.fromkeys(kinds))
        return f"{self.name}: {drives}, card {self.card.name}"

    def task(self, name: str) -> Task:
        """The task of a name. Raises MotionError with the nearest and all known ones."""
        known = {task.name: task for task in self.tasks}
        if name not in known:
            told = ", ".join(known) or "none"
            raise MotionError(f'rig {self.name} has no task "{name}"{nearest(name, known)}; tasks: {told}')
        return known[name]


def assumed_rig(machine: Machine, card: Card = PCI_8132) -> Rig:
    """`leg_servo` on every axis: an assumption, for whoever asks for it by this name."""
    return Rig(machine, tuple(leg_servo(axis) for axis in machine.axes), card, name="assumed servos")


def disturbed(rig: Rig, *, inertia: float = 1.0, friction: float = 1.0) -> Rig:
    """The same rig with other true inertias and frictions (factors), which its drives know nothing of."""

    return replace(rig, drives=tuple(drive.disturbed(inertia, friction) for drive in rig.drives))
