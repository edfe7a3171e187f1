"""Machines: pose <-> actuator coordinates, joint tilt, travel, and proofs about them."""

from kinematics.axis import Axis
from kinematics.errors import Fault, FileError, MotionError, OutOfReach
from kinematics.forward import Forward
from kinematics.hexapod import Hexapod
from kinematics.machine import Machine
from kinematics.margins import Margins
from kinematics.pose import Pose

__all__ = [
    "Axis",
    "Fault",
    "FileError",
    "Forward",
    "Hexapod",
    "Machine",
    "Margins",
    "MotionError",
    "OutOfReach",
    "Pose",
    "load_machine",
    "machine_names",
]


def load_machine(name_or_path: str) -> Machine:
    """The machine of a preset's name or of a TOML file."""
    from kinematics.registry import load_machine

    return load_machine(name_or_path)


def machine_names() -> tuple[str, ...]:
    """Names of the bundled machines."""
    from kinematics.registry import machine_names

    return machine_names()
