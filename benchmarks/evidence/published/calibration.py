"""Calibration, held against the truth and against the thesis: `python -m benchmarks.evidence.published.calibration`.

Synthetic: the preset `hexapod` with Gaussian errors of its joints, lengths and pulses, 40 noisy poses to identify 48
parameters from, and 40 others to predict, for 20 seeds. The poses are drawn about the middle of the stroke. Published:
the five parameters of [Sahbaz 2007, Tables 6.2 and 6.3].
"""

from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Hexapod, Machine, Pose, load_machine
from kinematics.calibration import Calibration, calibrate
from kinematics.calibration.measurement_file import load_measurements
from kinematics.calibration.measurements import Noise, whole_poses
from kinematics.foundation.arrays import Array
from kinematics.machine.pose import make_pose

SEEDS, POSES = 20, 40
JOINTS, OFFSETS, FACTORS = 0.5e-3, 0.5e-3, 200e-6
"""Standard deviation of each coordinate of a joint and each length (m), and of each pulse's share."""
NOISE = Noise(5e-6, 20e-6)
REACH, TILT, MIDDLE = 0.020, np.deg2rad(10), 0.025
"""Half ranges of position (m) and angles (rad), and the height above home (m) about which poses are drawn."""
ALL_PARTS = ("factors", "offsets", "joints")
TARGETS = {"position": 7e-6, "rotation": 25e-6}
REAL_TARGETS = {"after": 14e-6, "left out": 17e-6}


@dataclass(frozen=True, slots=True)
class BuiltMachine:
    """A machine as it was built: its joints, and what its counts do to its lengths."""

    nominal: Hexapod
    built: Hexapod
    offsets: Array
    factors: Array

    def poses(self, commanded: Pose) -> Pose:
        """What it does, from the nominal home pose, when the nominal machine is sent to poses from there."""
        target = self.nominal.home * commanded
        sent = self.nominal.inverse(target) - self.nominal.home_q
        reached = self.built.forward(self.nominal.home_q + self.offsets + self.factors * sent, near=target)
        return self.nominal.home.inv() * reached.pose


def draw(nominal: Hexapod, random: np.random.Generator) -> BuiltMachine:
    base, platform = (joints + random.normal(0, JOINTS, (6, 3)) for joints in (nominal.base, nominal.platform))
    built = Hexapod(base, platform, axes=nominal.axes, home=nominal.home)
    return BuiltMachine(nominal, built, random.normal(0, OFFSETS, 6), 1 + random.normal(0, FACTORS, 6))


def draw_commands(random: np.random.Generator, count: int = POSES) -> Pose:
    position = np.array([0.0, 0.0, MIDDLE]) + random.uniform(-REACH, REACH, (count, 3))
    return make_pose(position, random.uniform(-TILT, TILT, (count, 3)))


def add_noise(pose: Pose, random: np.random.Generator) -> Pose:
    turn = Rotation.from_rotvec(random.normal(0, NOISE.rotation, (len(pose), 3)))
    shift = random.normal(0, NOISE.position, (len(pose), 3))
    return RigidTransform.from_components(pose.translation + shift, turn * pose.rotation)


def predict_poses(nominal: Machine, calibrated: Machine, commanded: Pose) -> Pose:
    """Where the calibrated machine says that the counts lead which the nominal one sends; from the nominal home."""
    target = nominal.home * commanded
    counts = (nominal.inverse(target) - nominal.home_q) / [axis.pulse for axis in nominal.axes]
    lengths = calibrated.home_q + counts * [axis.pulse for axis in calibrated.axes]
    return nominal.home.inv() * calibrated.forward(lengths, near=target).pose


def rms(found: Pose, expected: Pose) -> dict[str, float]:
    """Root mean square per component: m and rad."""
    turn = (found.rotation * expected.rotation.inv()).as_rotvec()
    shift = found.translation - expected.translation
    return {"position": float(np.sqrt(np.mean(shift**2))), "rotation": float(np.sqrt(np.mean(turn**2)))}


def calibrate_synthetic(seed: int) -> tuple[Calibration, dict[str, float], dict[str, float]]:
    """A calibration, and its errors at the held-out poses: against their measurement, and against the truth."""
    random = np.random.default_rng(seed)
    drawn = draw(_load_nominal(), random)
    used, held = draw_commands(random), draw_commands(random)
    found = calibrate(drawn.nominal, whole_poses(used, add_noise(drawn.poses(used), random), noise=NOISE), ALL_PARTS)
    truth, guess = drawn.poses(held), predict_poses(drawn.nominal, found.machine, held)
    return found, rms(guess, add_noise(truth, random)), rms(guess, truth)


def _load_nominal() -> Hexapod:
    return cast(Hexapod, load_machine("hexapod"))


def main() -> None:
    print("seed   held out: against the measurement     against the truth        residual/noise")
    rows = []
    for seed in range(SEEDS):
        found, measured, truth = calibrate_synthetic(seed)
        rows.append((measured, truth))
        print(f"{seed:>4}   {_format_errors(measured):<38}{_format_errors(truth):<25}{found.scale:.3f}")
    for k, what in enumerate(("against the measurement", "against the truth")):
        whole = {name: float(np.sqrt(np.mean([row[k][name] ** 2 for row in rows]))) for name in TARGETS}
        worst = {name: max(row[k][name] for row in rows) for name in TARGETS}
        kept = all(worst[name] <= TARGETS[name] for name in TARGETS)
        wanted = f"wanted: at most {_format_errors(TARGETS)}: {'met by every seed' if kept else 'MISSED'}"
        print(f"{what}, over all seeds: {_format_errors(whole)}; worst seed {_format_errors(worst)}; {wanted}")
    found = calibrate(_load_nominal(), load_measurements("cmm"))
    stages = {"before": found.before, "after": found.after, "left out": found.left_out}
    print(f"[Sahbaz 2007, Tables 6.2 and 6.3], {len(found.parameters)} parameters, RMS per component:")
    for name, errors in stages.items():
        value = found.rms(errors)
        target = REAL_TARGETS.get(name)
        verdict = (
            "" if target is None else f"; wanted: at most {1e6 * target:g}: {'met' if value <= target else 'MISSED'}"
        )
        print(f"    {name:<9}{1e6 * value:8.2f} µm{verdict}")
    print(f"    factor   {found['factor'].value:.4f} ± {found['factor'].error:.4f}; an independent fit found 1.0178")


def _format_errors(errors: dict[str, float]) -> str:
    return f"{1e6 * errors['position']:.2f} µm, {1e6 * errors['rotation']:.2f} µrad"


if __name__ == "__main__":
    main()
