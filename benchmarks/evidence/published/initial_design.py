"""What the initial design of [Sahbaz 2007, chapter 2] needs of its actuators: `python -m
benchmarks.evidence.published.initial_design`.

From its printed geometry, along its printed move with the speed of its Appendix B. The thesis prints 47.58 mm and
54.563 N. They do not follow from this geometry; ours stand beside them.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.analysis.dynamics import forces
from kinematics.design.selection import ActuatorNeed, AxisMotion, JointNeed, actuator_need, joint_need
from kinematics.foundation.arrays import Array
from kinematics.foundation.table import align_columns
from kinematics.kinds.hexapod import Hexapod, joint_circle
from kinematics.machine.axis import Axis
from kinematics.machine.motion import motion_of_poses

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
    """Share of the way and its rate (1/s) at t: a quarter of a sine up to V₀ and another down, of RAMP each.

    ω = π/(2 t₁), V₀ = 1/(2/ω + tp − 2 t₁) [Sahbaz 2007, Appendix B].
    """
    omega = np.pi / (2 * RAMP)
    top = 1 / (2 / omega + DURATION - 2 * RAMP)
    up, down = np.minimum(t, RAMP), np.maximum(t - (DURATION - RAMP), 0.0)
    rate = top * np.sin(omega * up) * np.cos(omega * down)
    steady = np.clip(t - RAMP, 0.0, DURATION - 2 * RAMP)
    share = top * ((1 - np.cos(omega * up) + np.sin(omega * down)) / omega + steady)
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


def main() -> None:
    """Print stroke, force, speed and tilt, beside print where there is one."""
    actuator, joint = needs()
    found = (
        ("largest change of a leg's length", "mm", 1e3, actuator.stroke, "47.58"),
        ("largest force of a leg", "N", 1.0, actuator.force, "54.563"),
        ("highest speed of a leg", "mm/s", 1e3, actuator.speed, "-"),
        ("largest tilt of a joint", "deg", np.rad2deg(1.0), joint.tilt, "-"),
    )
    rows = [(what, unit, f"{scale * (value or 0):.3f}", printed) for what, unit, scale, value, printed in found]
    print(align_columns(("what", "unit", "ours", "printed"), rows))
    print("The two printed numbers do not follow from the printed geometry; the legs here have no mass.")


if __name__ == "__main__":
    main()
