"""Needs of the initial design of [Sahbaz 2007, chapter 2], from its printed geometry.

The platform follows the printed move with the speed of Appendix B, a quarter of a sine up and
another down. The thesis prints 47.58 mm and 54.563 N, which do not follow from this geometry.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.evidence.published.compared import NumberComparison
from controllers.rig import time_path
from kinematics import load_machine
from kinematics.analysis.dynamics import Forces, forces
from kinematics.design.selection import ActuatorNeed, JointNeed, actuator_need, joint_need
from planner import Line, Program
from planner.path.actuation import actuate

PRINTED = ActuatorNeed(stroke=47.58e-3, force=54.563)
MACHINE = "hexapod-initial"

# Displacement (m) and turn of the platform from home, durations of the move and of each ramp (s).
DISPLACEMENT, TURN = np.array([0, 0.030, -0.030]), Rotation.from_euler("x", 10, degrees=True)
DURATION, RAMP, SAMPLES = 3.0, 0.6, 21
WRENCH = (-10.0, -10.0, -100.0, 1.0, -1.0, 0.0)
"""N and N·m on the platform's centre, along the axes of the base."""


def static_forces() -> Forces:
    """Return the forces of legs without mass, at the samples of the printed move."""
    machine = load_machine(MACHINE)
    path = actuate(Program([Line(DISPLACEMENT, TURN)]), machine)
    move = time_path(path, "quarter-sine", RAMP / DURATION, DURATION)
    samples = move.at(np.linspace(0.0, DURATION, SAMPLES))
    return forces(machine, samples, wrench=WRENCH)


def needs() -> tuple[ActuatorNeed, JointNeed]:
    """Return what the move needs: stroke, speed and force of a leg, tilt and force of a joint."""
    result = static_forces()
    return actuator_need([result]), joint_need(MACHINE, result.motion.pose, result.force)


def compare_needs() -> list[NumberComparison]:
    """Return the two printed numbers next to ours."""
    ours, _ = needs()
    remark = "does not follow from the printed geometry"
    stroke, force = 1e3 * (ours.stroke or 0), ours.force or 0
    return [
        NumberComparison("largest change of a leg's length", "mm", "47.58", stroke, remark),
        NumberComparison("largest force of a leg", "N", "54.563", force, remark),
    ]
