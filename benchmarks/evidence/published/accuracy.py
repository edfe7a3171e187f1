"""Error budgets, and how well they predict simulated errors: `python -m benchmarks.evidence.published.accuracy`."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.evidence.published.sizing import FRAME, INCH, LOAD, POUND_FORCE
from kinematics import load_machine
from kinematics.design.accuracy import Backlash, Budget, LeadError, PulseLength, Quantization, Temperature, error_budget
from kinematics.design.deflection import Deflection
from kinematics.foundation.arrays import Array
from kinematics.kinds.traverser import Traverser
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose

POSES, SAMPLES = 72, 20_000
# What a hexapod of ordinary parts may have; no source prints these.
SOURCES = (
    Quantization(),
    PulseLength(200e-6),
    Backlash(2e-6),
    LeadError(rate=50e-6, periodic=1e-6),
    Temperature(ambient=2.0, heating=5.0, frame_expansion=23e-6),
)


def circle(machine: Machine) -> Pose:
    """The preset circle: 15 mm about the axis, 25 mm above home, the platform level."""
    angle = np.linspace(0, 2 * np.pi, POSES, endpoint=False)
    way = np.stack([0.015 * np.cos(angle), 0.015 * np.sin(angle), np.full(POSES, 0.025)], 1)
    return RigidTransform.from_components(machine.home.translation + way, machine.home.rotation)


def simulate_errors(machine: Machine, pose: Pose) -> tuple[Array, Array]:
    """Standard deviation and largest size (6,) of the errors of a pose, from pulses rounded to the nearest one."""
    q, random = machine.inverse(pose), np.random.default_rng(0)
    pulse = np.array([axis.pulse for axis in machine.axes])
    target = q - machine.home_q + random.uniform(-50, 50, (SAMPLES, len(q))) * pulse
    found = machine.forward(q + np.round(target / pulse) * pulse - target, near=pose).pose
    turn = np.asarray((found.rotation * pose.rotation.inv()).as_rotvec())
    error = np.concatenate([found.translation - pose.translation, turn], 1)
    return error.std(0), np.abs(error).max(0)


def traverser_frame() -> Budget:
    """The frame of [Sasidhar 1981, Appendix D] under the traverser: one span of 21 in, X at its top, 70 in above."""
    axes = [Axis(name, pulse=0.000625 * INCH) for name in "XYZ"] + [Axis("R", "rotary", pulse=np.deg2rad(0.9))]
    machine = Traverser(axes=axes, home=RigidTransform.identity())
    z = np.linspace(0, FRAME.span, 85)
    pose = RigidTransform.from_translation(np.stack([np.full(85, 48 * INCH), np.zeros(85), z], 1))
    frame = Deflection(FRAME, LOAD * POUND_FORCE, (-22 * INCH, 0, 0), along=(0, 0, 1), down=(-1, 0, 0))
    return error_budget(machine, pose, [Quantization(), LeadError(rate=(1e-3, 1e-3, 1e-3, 0.0)), frame])


def main() -> None:
    machine = load_machine("hexapod")
    pose = circle(machine)
    print(error_budget(machine, pose, SOURCES))
    tilted = pose[0] * RigidTransform.from_rotation(Rotation.from_euler("XYZ", [6, -7, 0], degrees=True))
    budget = error_budget(machine, tilted, [Quantization()]).total
    sigma, largest = simulate_errors(machine, tilted)
    print(f"\nquantization at the circle's start, tilted by 6 and -7 deg; {SAMPLES} simulated poses / budget:")
    print("  standard deviation " + "  ".join(f"{ratio:.4f}" for ratio in sigma / budget.sigma[0]))
    print("  largest / bound    " + "  ".join(f"{ratio:.4f}" for ratio in largest / budget.worst[0]))
    print()
    print(traverser_frame())


if __name__ == "__main__":
    main()
