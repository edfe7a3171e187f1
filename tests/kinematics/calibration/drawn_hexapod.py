"""A hexapod with random errors, and noisy measurements of it: what calibrations are tested on.

The preset has Gaussian errors of its joints, lengths and pulses. Poses are drawn about the middle
of the stroke.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Hexapod, Machine, Noise, Pose
from kinematics.foundation.arrays import Array
from kinematics.machine.pose import make_pose

JOINTS, OFFSETS, FACTORS = 0.5e-3, 0.5e-3, 200e-6
"""Standard deviation of each coordinate of a joint and each length (m), and of each pulse's
share.
"""
NOISE = Noise(5e-6, 20e-6)
REACH, TILT, MIDDLE = 0.020, np.deg2rad(10), 0.025
"""Half ranges of position (m) and angles (rad), and the height above home (m) about which poses are
drawn.
"""
ALL_PARTS = ("factors", "offsets", "joints")


@dataclass(frozen=True, slots=True)
class BuiltMachine:
    """A machine as it was built: its joints, and what its counts do to its lengths."""

    nominal: Hexapod
    built: Hexapod
    offsets: Array
    factors: Array

    def poses(self, commanded: Pose) -> Pose:
        """Return the poses, from the nominal home, that the machine reaches when the nominal one is
        sent.
        """
        target = self.nominal.home * commanded
        sent = self.nominal.inverse(target) - self.nominal.home_q
        lengths = self.nominal.home_q + self.offsets + self.factors * sent
        return self.nominal.home.inv() * self.built.forward(lengths, near=target).pose


def draw(nominal: Hexapod, random: np.random.Generator) -> BuiltMachine:
    """Return a machine with random errors."""
    base, platform = (
        joints + random.normal(0, JOINTS, (6, 3)) for joints in (nominal.base, nominal.platform)
    )
    built = Hexapod(base, platform, axes=nominal.axes, home=nominal.home)
    return BuiltMachine(
        nominal, built, random.normal(0, OFFSETS, 6), 1 + random.normal(0, FACTORS, 6)
    )


def draw_commands(random: np.random.Generator, count: int = 40) -> Pose:
    """Return random poses from home."""
    position = np.array([0.0, 0.0, MIDDLE]) + random.uniform(-REACH, REACH, (count, 3))
    return make_pose(position, random.uniform(-TILT, TILT, (count, 3)))


def add_noise(pose: Pose, random: np.random.Generator) -> Pose:
    """Return measurements of poses, with NOISE."""
    turn = Rotation.from_rotvec(random.normal(0, NOISE.rotation, (len(pose), 3)))
    shift = random.normal(0, NOISE.position, (len(pose), 3))
    return RigidTransform.from_components(pose.translation + shift, turn * pose.rotation)


def predict_poses(nominal: Machine, calibrated: Machine, commanded: Pose) -> Pose:
    """Return the poses of the calibrated machine, from the nominal home, at the counts of the
    nominal one.
    """
    target = nominal.home * commanded
    counts = (nominal.inverse(target) - nominal.home_q) / [axis.pulse for axis in nominal.axes]
    lengths = calibrated.home_q + counts * [axis.pulse for axis in calibrated.axes]
    return nominal.home.inv() * calibrated.forward(lengths, near=target).pose


def rms(predicted: Pose, expected: Pose) -> dict[str, float]:
    """Return the root mean square of a component of position (m) and of rotation (rad)."""
    turn = (predicted.rotation * expected.rotation.inv()).as_rotvec()
    shift = predicted.translation - expected.translation
    return {
        "position": float(np.sqrt(np.mean(shift**2))),
        "rotation": float(np.sqrt(np.mean(turn**2))),
    }
