"""Machines: pose <-> actuator coordinates, joint tilt, travel, and proofs about them."""

from os import PathLike

from kinematics.analysis.clearance import Disc
from kinematics.analysis.dynamics import Forces, forces
from kinematics.analysis.forward import Forward
from kinematics.analysis.margins import Margins
from kinematics.analysis.posture import Posture, posture_of_axes, posture_of_pose
from kinematics.analysis.workspace import Workspace, workspace
from kinematics.calibration import (
    Calibration,
    Measurements,
    Noise,
    calibrate,
    calibration_parts,
    foreseen_errors,
    measured_positions,
    whole_poses,
)
from kinematics.design.accuracy import Backlash, Budget, LeadError, PulseLength, Quantization, Temperature, error_budget
from kinematics.design.catalogue import Actuator, Joint, load_actuators, load_joints
from kinematics.design.deflection import Beam, Deflection
from kinematics.design.selection import (
    ActuatorNeed,
    AxisMotion,
    JointNeed,
    Selection,
    actuator_need,
    joint_need,
    select_parts,
)
from kinematics.design.sizing import Leadscrew, Slide, StepMotor, StepperSizing, Traverse, size_stepper
from kinematics.foundation.errors import Fault, FileError, MotionError, NotInstalled, OutOfReach
from kinematics.kinds.arm import Arm, Joints, read_urdf
from kinematics.kinds.hexapod import Hexapod, joint_circle
from kinematics.kinds.linkage import Linkage
from kinematics.kinds.traverser import Traverser
from kinematics.kinds.tripod import Tripod
from kinematics.machine.axis import Axis
from kinematics.machine.load import Body, Leg, Load, cylinder
from kinematics.machine.machine import Machine
from kinematics.machine.machine_writer import machine_toml
from kinematics.machine.motion import Motion, motion_of_axes, motion_of_poses
from kinematics.machine.pose import Pose

__all__ = [
    "Actuator",
    "ActuatorNeed",
    "Arm",
    "Axis",
    "AxisMotion",
    "Backlash",
    "Beam",
    "Body",
    "Budget",
    "Calibration",
    "Deflection",
    "Disc",
    "Fault",
    "FileError",
    "Forces",
    "Forward",
    "Hexapod",
    "Joint",
    "JointNeed",
    "Joints",
    "LeadError",
    "Leadscrew",
    "Leg",
    "Linkage",
    "Load",
    "Machine",
    "Margins",
    "Measurements",
    "Motion",
    "MotionError",
    "Noise",
    "NotInstalled",
    "OutOfReach",
    "Pose",
    "Posture",
    "PulseLength",
    "Quantization",
    "Selection",
    "Slide",
    "StepMotor",
    "StepperSizing",
    "Temperature",
    "Traverse",
    "Traverser",
    "Tripod",
    "Workspace",
    "actuator_need",
    "calibrate",
    "calibration_parts",
    "cylinder",
    "error_budget",
    "forces",
    "foreseen_errors",
    "joint_circle",
    "joint_need",
    "load_actuators",
    "load_joints",
    "load_machine",
    "load_measurements",
    "machine_names",
    "machine_toml",
    "measured_positions",
    "motion_of_axes",
    "motion_of_poses",
    "posture_of_axes",
    "posture_of_pose",
    "read_urdf",
    "select_parts",
    "size_stepper",
    "whole_poses",
    "workspace",
]


def load_machine(name_or_path: str | PathLike[str]) -> Machine:
    """The machine of a preset's name or of a TOML file."""
    from kinematics.machine.machine_file import load_machine

    return load_machine(name_or_path)


def machine_names() -> tuple[str, ...]:
    """Names of the bundled machines."""
    from kinematics.machine.machine_file import machine_names

    return machine_names()


def load_measurements(name_or_path: str | PathLike[str]) -> Measurements:
    """The measured poses of a preset's name or of a TOML file."""
    from kinematics.calibration.measurement_file import load_measurements

    return load_measurements(name_or_path)
