"""Machines: pose <-> actuator coordinates, joint tilt, travel, and proofs about them."""

from os import PathLike

from kinematics.accuracy import Budget, error_budget
from kinematics.arm import Arm, Joints
from kinematics.axis import Axis
from kinematics.beam import Beam
from kinematics.body import Body, Leg, cylinder
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
from kinematics.catalogue import Actuator, Joint, load_actuators, load_joints
from kinematics.clearance import Disc
from kinematics.deflection import Deflection
from kinematics.dynamics import Forces, forces
from kinematics.error_sources import Backlash, LeadError, PulseLength, Quantization, Temperature
from kinematics.errors import Fault, FileError, MotionError, NotInstalled, OutOfReach
from kinematics.forward import Forward
from kinematics.hexapod import Hexapod, joint_circle
from kinematics.leadscrew_axis import Leadscrew, Slide, StepMotor, Traverse
from kinematics.linkage import Linkage
from kinematics.load import Load
from kinematics.machine import Machine
from kinematics.machine_writer import machine_toml
from kinematics.margins import Margins
from kinematics.motion import Motion, motion_of_axes, motion_of_poses
from kinematics.needs import ActuatorNeed, AxisMotion, JointNeed, actuator_need, joint_need
from kinematics.pose import Pose
from kinematics.posture import Posture, posture_of_axes, posture_of_pose
from kinematics.selection import Selection, select_parts
from kinematics.sizing import StepperSizing, size_stepper
from kinematics.traverser import Traverser
from kinematics.tripod import Tripod
from kinematics.urdf import read_urdf
from kinematics.workspace import Workspace, workspace

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
    from kinematics.registry import load_machine

    return load_machine(name_or_path)


def machine_names() -> tuple[str, ...]:
    """Names of the bundled machines."""
    from kinematics.registry import machine_names

    return machine_names()


def load_measurements(name_or_path: str | PathLike[str]) -> Measurements:
    """The measured poses of a preset's name or of a TOML file."""
    from kinematics.calibration.measurement_file import load_measurements

    return load_measurements(name_or_path)
