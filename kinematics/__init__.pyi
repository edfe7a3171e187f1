from .analysis.clearance import Disc as Disc
from .analysis.dynamics import Forces as Forces, forces as forces
from .analysis.forward import Forward as Forward
from .analysis.margins import Margins as Margins
from .analysis.platform_motion import (
    motion_of_axes as motion_of_axes,
    motion_of_poses as motion_of_poses,
)
from .analysis.posture import (
    Posture as Posture,
    posture_of_axes as posture_of_axes,
    posture_of_pose as posture_of_pose,
)
from .analysis.workspace import Workspace as Workspace, workspace as workspace
from .calibration import (
    Calibration as Calibration,
    Measurements as Measurements,
    Noise as Noise,
    calibrate as calibrate,
    calibration_parts as calibration_parts,
    foreseen_errors as foreseen_errors,
    measured_positions as measured_positions,
    whole_poses as whole_poses,
)
from .calibration.measurement_file import load_measurements as load_measurements
from .design.accuracy import (
    Backlash as Backlash,
    Budget as Budget,
    LeadError as LeadError,
    PulseLength as PulseLength,
    Quantization as Quantization,
    Temperature as Temperature,
    error_budget as error_budget,
)
from .design.catalogue import (
    Actuator as Actuator,
    Joint as Joint,
    load_actuators as load_actuators,
    load_joints as load_joints,
)
from .design.deflection import Beam as Beam, Deflection as Deflection
from .design.selection import (
    ActuatorNeed as ActuatorNeed,
    AxisMotion as AxisMotion,
    JointNeed as JointNeed,
    Selection as Selection,
    actuator_need as actuator_need,
    joint_need as joint_need,
    select_parts as select_parts,
)
from .design.sizing import (
    Leadscrew as Leadscrew,
    Slide as Slide,
    StepMotor as StepMotor,
    StepperSizing as StepperSizing,
    Traverse as Traverse,
    size_stepper as size_stepper,
)
from .foundation.errors import (
    Fault as Fault,
    FileError as FileError,
    MotionError as MotionError,
    NotInstalled as NotInstalled,
    OutOfReach as OutOfReach,
)
from .kinds.arm import Arm as Arm, read_urdf as read_urdf
from .kinds.hexapod import Hexapod as Hexapod, joint_circle as joint_circle
from .kinds.linkage import Linkage as Linkage
from .kinds.traverser import Traverser as Traverser
from .kinds.tripod import Tripod as Tripod
from .kinds.urdf import Joints as Joints
from .machine.axis import Axis as Axis
from .machine.shaper import Shaper as Shaper
from .machine.load import Body as Body, Leg as Leg, Load as Load, cylinder as cylinder
from .machine.machine import Machine as Machine
from .machine.machine_file import load_machine as load_machine, machine_names as machine_names
from .machine.machine_writer import machine_toml as machine_toml
from .machine.motion import Motion as Motion
from .machine.pose import Pose as Pose
