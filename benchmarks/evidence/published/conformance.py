"""Numbers that others published about kinematics and pulses (conformance.toml), next to ours."""

import tomllib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.evidence.published.compared import NumberComparison
from kinematics import Axis, Hexapod, load_machine
from kinematics.kinds.hexapod import joint_circle
from planner import time_optimal
from planner.pulses import generate

PUBLISHED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
AXES = [Axis(f"leg{n}") for n in range(1, 7)]
LEGS = [f"leg {n}" for n in range(1, 7)]


def compare(
    names: Iterable[str],
    unit: str,
    published: Iterable[str],
    ours: Iterable[float],
) -> list[NumberComparison]:
    """Return the comparisons of several numbers in one unit."""
    numbers = zip(names, published, ours, strict=True)
    return [NumberComparison(name, unit, text, value) for name, text, value in numbers]


def published_hexapod(name: str) -> Hexapod:
    """Return a hexapod of the file. Lengths are multiplied by its unit, where it has one."""
    data = PUBLISHED[name]
    unit = data.get("unit", 1.0)
    base, platform, home = (unit * np.array(data[key]) for key in ("base", "platform", "home"))
    rest = data.get("rest", (0, 0, 1))
    return Hexapod(
        base,
        platform,
        axes=AXES,
        home=RigidTransform.from_translation(home),
        base_rest=rest,
        platform_rest=rest,
    )


def table_4_3() -> Hexapod:
    """Return the final design with both joint circles of 149 mm, joints 389.5 mm apart in
    height.
    """
    base = joint_circle(0.149, np.deg2rad(30), 0)
    platform = joint_circle(0.149, np.deg2rad(60), -0.0105)
    return Hexapod(base, platform, axes=AXES, home=RigidTransform.from_translation([0, 0, 0.4]))


def length_changes() -> list[NumberComparison]:
    """Return the changes of the legs' lengths.

    The pivot is on the axis, off the platform's origin.
    """
    data = PUBLISHED["rubin_simulink"]
    machine = published_hexapod("rubin_simulink")
    shift, pivot = np.array(data["pose"][:3]), np.array(data["pivot_m"])
    turn = Rotation.from_euler("XYZ", data["pose"][3:])
    pose = RigidTransform.from_components(shift + pivot - turn.apply(pivot), turn)
    changes = machine.inverse(pose) - machine.home_q
    return compare(LEGS, "m", print_digits(data["length_change_m"], 5), changes)


def home_lengths() -> list[NumberComparison]:
    """Return the lengths at home."""
    data = PUBLISHED["mini_tetra"]
    lengths = published_hexapod("mini_tetra").home_q / data["unit"]
    return compare(LEGS, "in", print_digits(data["home_lengths"], 5), lengths)


def modes() -> list[NumberComparison]:
    """Return the number of assembly modes, and the one that is printed."""
    data = PUBLISHED["dietmaier"]
    poses = published_hexapod("dietmaier").assembly_modes(data["lengths"])
    positions = poses.translation
    nearest = int(np.argmin(np.abs(positions - data["one_position"]).max(1)))
    row = poses[nearest].rotation.as_matrix()[0]
    return compare(
        [
            "real assembly modes",
            "one mode, x",
            "one mode, y",
            "one mode, z",
            "its rotation, row 1, column 1",
            "its rotation, row 1, column 2",
            "its rotation, row 1, column 3",
        ],
        "",
        [
            str(data["real_modes"]),
            *print_digits(data["one_position"], 9),
            *print_digits(data["one_rotation_row_1"], 6),
        ],
        [len(poses), *positions[nearest], *row],
    )


def pulse_count() -> list[NumberComparison]:
    """Return the pulses of one axis that moves from rest to rest over the printed position."""
    data = PUBLISHED["pulse_counts"]
    line = PPoly([[data["position"]], [0.0]], [0.0, 1.0])
    motion = time_optimal(line, max_speed=0.1, max_acceleration=1.0).trajectory
    schedule = generate(motion, [Axis("x", pulse=1 / data["steps_per_unit"])], [0.0])
    count = schedule.counts(np.array([motion.duration]))[0]
    return compare(["pulses"], "", [str(data["pulses"])], count)


def leg_angles() -> list[NumberComparison]:
    """Return the angles of each leg: Rx and Ry turn the z axis into its direction, Rz its x axis
    level.

    The directions are in the first three columns of the Jacobian. A half turn about z changes
    nothing in that, and the table has either.
    """
    machine = table_4_3()
    z = machine.jacobian(machine.home)[:, :3]
    x = np.cross((0, 0, 1), z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    turns = Rotation.from_matrix(np.stack([x, np.cross(z, x), z], 2))
    degrees = turns.as_euler("XYZ", degrees=True)
    printed = PUBLISHED["leg_angles"]["degrees"]
    printed_z = np.array(printed, float)[:, 2]
    degrees[:, 2] += 180 * np.rint((printed_z - degrees[:, 2]) / 180)
    texts = [text for leg in printed for text in leg]
    names = [f"{leg}, {name}" for leg in LEGS for name in ("Rx", "Ry", "Rz")]
    return compare(names, "deg", texts, degrees.ravel())


def reference_voltage() -> list[NumberComparison]:
    """Return V_ref = 0.5 V/A · I, which sets a driver board to the motor's current."""
    return [NumberComparison("V_ref at 0.7 A a phase", "V", "0.350", 0.5 * 0.7)]


def axis_angles() -> list[NumberComparison]:
    """Return the angles between the world's axes and the platform's z axis for θ = (6, −7, 0)°."""
    turn = Rotation.from_euler("XYZ", (6, -7, 0), degrees=True)
    alpha, beta, gamma = np.rad2deg(np.arccos(turn.as_matrix()[:, 2]))
    remark = "9.2098 to all digits printed but the last"
    return [
        NumberComparison("α", "deg", "97", alpha),
        NumberComparison("β", "deg", "95.955", beta),
        NumberComparison("γ", "deg", "9.20972", gamma, remark),
    ]


def retracted_lengths() -> list[NumberComparison]:
    """Return the lengths between joint centres; print follows from the frames' distance in its
    program.
    """
    return compare(LEGS, "mm", ["219.0774"] * 6, 1e3 * load_machine("hexapod").home_q)


def print_digits(values: ArrayLike, digits: int) -> list[str]:
    """Return numbers of the file as they are printed: trailing zeros included."""
    return [f"{value:.{digits}f}" for value in np.asarray(values)]
