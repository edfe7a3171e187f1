"""What the initial design of [Sahbaz 2007, chapter 2] needs of its actuators, from its printed geometry.

The thesis prints 47.58 mm and 54.563 N. They do not follow from this geometry; ours stand beside them.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.array import Array
from kinematics.axis import Axis
from kinematics.dynamics import forces
from kinematics.hexapod import Hexapod, joint_circle
from kinematics.motion import motion_of_poses
from kinematics.needs import ActuatorNeed, AxisMotion, JointNeed, actuator_need, joint_need

PRINTED = ActuatorNeed(stroke=47.58e-3, force=54.563)

DURATION, RAMP, SAMPLES = 3.0, 0.6, 21
FROM, TO, TILT = np.array([0, 0, 0.230]), np.array([0, 0.030, 0.200]), np.deg2rad(10)
WRENCH = np.array([-10.0, -10.0, -100.0, 1.0, -1.0, 0.0])
"""N and N·m on the platform's centre, along the axes of the base."""


def machine() -> Hexapod:
    """Joint circles of 100 mm below (gap 20°) and 149 mm above (60°); the platform at 230 mm is home."""
    return Hexapod(
        joint_circle(0.100, np.deg2rad(20), 0.0175),
        joint_circle(0.149, np.deg2rad(60), -0.0075),
        axes=[Axis(f"leg{n}") for n in range(1, 7)],
        home=RigidTransform.from_translation(FROM),
        name="initial design",
    )


def progress(t: Array) -> tuple[Array, Array]:
    """Share of the way and its rate (1/s) at t: a trapezoid of speed with ramps of RAMP."""
    top = 1 / (DURATION - RAMP)
    rate = top * np.minimum(1.0, np.minimum(t, DURATION - t) / RAMP)
    rising, falling = top * t**2 / (2 * RAMP), 1 - top * (DURATION - t) ** 2 / (2 * RAMP)
    share = np.where(t < RAMP, rising, np.where(t > DURATION - RAMP, falling, top * (t - RAMP / 2)))
    return share, rate


def needs() -> tuple[ActuatorNeed, JointNeed]:
    """Stroke, speed and static force of legs without mass, over the samples of the printed move."""
    initial = machine()
    share, rate = progress(np.linspace(0.0, DURATION, SAMPLES))
    pose = RigidTransform.from_components(
        FROM + share[:, None] * (TO - FROM), Rotation.from_rotvec(share[:, None] * [TILT, 0, 0])
    )
    motion = motion_of_poses(initial, pose, rate[:, None] * np.concatenate([TO - FROM, [TILT, 0, 0]]))
    force = forces(initial, motion, wrench=WRENCH).force
    return actuator_need([AxisMotion(motion.q, motion.qd, force)]), joint_need(initial, pose, force)
