"""A rig: a machine, the drives behind its axes, and the card that pulses them."""

from __future__ import annotations

from dataclasses import dataclass

from controllers.card import PCI_8132, Card
from controllers.servo import Servo, leg_servo
from kinematics.errors import MotionError
from kinematics.machine import Machine


@dataclass(frozen=True, slots=True)
class Rig:
    """What a tracking law is tried on, as data.

    drives  one per axis of the machine
    card    one model; as many cards of it as the axes need
    """

    machine: Machine
    drives: tuple[Servo, ...]
    card: Card = PCI_8132

    def __post_init__(self) -> None:
        if len(self.drives) != len(self.machine.axes):
            raise MotionError(
                f"rig: {len(self.drives)} drives for the {len(self.machine.axes)} axes of machine {self.machine.name}"
            )


def assumed_rig(machine: Machine, card: Card = PCI_8132) -> Rig:
    """The rig assumed behind a machine that states none: `leg_servo` on every axis."""
    return Rig(machine, tuple(leg_servo(axis) for axis in machine.axes), card)
