"""Numbers that others published (conformance.toml, [Sahbaz 2007]), and what we find for them: `page` shows them all.

`python -m benchmarks.evidence.published.conformance`: how often all forty assembly modes of Dietmaier's platform are
found from other seeds, and in which time.
"""

import tomllib
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.interpolate import PPoly
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.evidence.published.compared import NumberComparison
from benchmarks.evidence.published.sizing import PRINTED, needs
from kinematics import Axis, Hexapod, load_machine
from kinematics.analysis.assembly_modes import assembly_modes, solve_generic
from kinematics.foundation.arrays import Array
from kinematics.kinds.hexapod import joint_circle
from planner import time_optimal
from planner.pulses import generate

PUBLISHED = tomllib.loads((Path(__file__).parent / "conformance.toml").read_text(encoding="utf-8"))
INCH = 0.0254


def rubin() -> Hexapod:
    """The hexapod of the Vera Rubin Observatory: a platform that hangs below its base."""
    data = PUBLISHED["rubin_simulink"]
    base, platform = (1e-6 * np.stack([data[f"{end}_{c}"] for c in "xyz"], 1) for end in ("fixed", "moved"))
    return _hexapod(base, platform, RigidTransform.identity(), rest=(0, 0, -1))


def mini_tetra() -> Hexapod:
    """Pairs of base joints coincide; in metres."""
    data = PUBLISHED["mini_tetra"]
    base, platform, home = (INCH * np.array(data[key]) for key in ("base", "platform", "home"))
    return _hexapod(base, platform, RigidTransform.from_translation(home))


def dietmaier() -> Hexapod:
    """The platform with 40 real assembly modes for one set of leg lengths [Dietmaier 1998], as printed; home is one."""
    data = PUBLISHED["dietmaier"]
    home = RigidTransform.from_translation(data["one_position"])
    return _hexapod(np.array(data["base"]), np.array(data["platform"]), home)


def _hexapod(
    base: Array, platform: Array, home: RigidTransform, rest: tuple[float, float, float] = (0, 0, 1)
) -> Hexapod:
    axes = [Axis(f"leg{n}") for n in range(1, 7)]
    return Hexapod(base, platform, axes=axes, home=home, base_rest=rest, platform_rest=rest)


def length_changes() -> list[NumberComparison]:
    """Turned about a pivot on the axis: the platform's origin moves along."""
    data, machine = PUBLISHED["rubin_simulink"], rubin()
    shift, pivot = np.array(data["pose"][:3]), np.array(data["pivot_m"])
    turn = Rotation.from_euler("XYZ", data["pose"][3:])
    pose = RigidTransform.from_components(shift + pivot - turn.apply(pivot), turn)
    found = machine.inverse(pose) - machine.home_q
    return [
        NumberComparison(f"leg {k}", "m", f"{printed:.5f}", ours)
        for k, (printed, ours) in enumerate(zip(data["length_change_m"], found, strict=True), 1)
    ]


def home_lengths() -> list[NumberComparison]:
    found = mini_tetra().home_q / INCH
    printed = PUBLISHED["mini_tetra"]["home_lengths"]
    return [
        NumberComparison(f"leg {k}", "in", f"{value:.5f}", ours)
        for k, (value, ours) in enumerate(zip(printed, found, strict=True), 1)
    ]


def modes() -> list[NumberComparison]:
    """How many there are, and the one of them that is printed."""
    data, machine = PUBLISHED["dietmaier"], dietmaier()
    found = machine.assembly_modes(data["lengths"])
    place, rows = found.translation, found.rotation.as_matrix()[:, 0]
    position, row = np.array(data["one_position"]), np.array(data["one_rotation_row_1"])
    nearest = int(np.argmin(np.abs(place - position).max(1) + np.abs(rows - row).max(1)))
    return [
        NumberComparison("real assembly modes", "", str(data["real_modes"]), len(found)),
        *(
            NumberComparison(f"one mode, {axis}", "", f"{printed:.9f}", ours)
            for axis, printed, ours in zip("xyz", position, place[nearest], strict=True)
        ),
        *(
            NumberComparison(f"its rotation, row 1, column {k}", "", f"{printed:.6f}", ours)
            for k, (printed, ours) in enumerate(zip(row, rows[nearest], strict=True), 1)
        ),
    ]


def pulse_count() -> NumberComparison:
    """Pulses of one axis that moves from rest to rest over the printed position."""
    data = PUBLISHED["pulse_counts"]
    line = PPoly([[data["position"]], [0.0]], [0.0, 1.0])
    motion = time_optimal(line, max_speed=0.1, max_acceleration=1.0).trajectory
    schedule = generate(motion, [Axis("x", pulse=1 / data["steps_per_unit"])], [0.0])
    return NumberComparison(
        "pulses", "", str(data["pulses"]), float(schedule.counts(np.array([motion.duration]))[0, 0])
    )


# Table 4.3, as printed (degrees): Rx, Ry and Rz of each leg.
LEG_ANGLES = (
    ("-5.27128754", "-2.17930829", "22.3996672"),
    ("-0.746796351", "5.65389711", "-82.4631226"),
    ("4.52990963", "-3.46806031", "142.637208"),
    ("-4.52990963", "-3.46806031", "37.3627917"),
    ("0.746796351", "5.65389711", "-97.5368774"),
    ("5.27128754", "-2.17930829", "157.600333"),
)
# Table 6.4 for θ = (6, −7, 0)° (degrees).
AXIS_ANGLES, THETA = {"α": "97", "β": "95.955", "γ": "9.20972"}, (6, -7, 0)


def table_4_3() -> Hexapod:
    """The final design with both joint circles of 149 mm, the upper frame at 400 mm, joints 389.5 mm apart."""
    base, platform = joint_circle(0.149, np.deg2rad(30), 0), joint_circle(0.149, np.deg2rad(60), -0.0105)
    home = RigidTransform.from_translation([0, 0, 0.4])
    return Hexapod(base, platform, axes=[Axis(f"leg{n}") for n in range(1, 7)], home=home)


def leg_angles() -> list[NumberComparison]:
    """Return the angles of each leg, whose direction n is in the first three columns of the Jacobian.

    Rx = atan2(−n_y, n_z) and Ry = asin(n_x) turn the z axis into n. Rz = atan2(−M₂₀, M₂₁), M =
    Rx·Ry, turns the part about n until its y axis is level; a half turn changes nothing in that,
    and the table has either.
    """
    machine = table_4_3()
    x, y, z = machine.jacobian(machine.home)[:, :3].T
    angles = np.array([np.arctan2(-y, z), np.arcsin(x)]).T
    turned = Rotation.from_euler("XY", angles).as_matrix()
    level = np.arctan2(-turned[:, 2, 0], turned[:, 2, 1])
    degrees = np.rad2deg(np.column_stack([angles, level]))
    printed = np.array(LEG_ANGLES, float)
    degrees[:, 2] += 180 * np.rint((printed[:, 2] - degrees[:, 2]) / 180)
    return [
        NumberComparison(f"leg {leg + 1}, {name}", "deg", text, ours)
        for leg, row in enumerate(LEG_ANGLES)
        for name, text, ours in zip(("Rx", "Ry", "Rz"), row, degrees[leg], strict=True)
    ]


def reference_voltage() -> list[NumberComparison]:
    """Return V_ref = 0.5 V/A · I, equation (4.1): what sets a driver board to the motor's current."""
    current = 0.7
    return [NumberComparison("V_ref at 0.7 A a phase", "V", "0.350", 0.5 * current)]


def axis_angles() -> list[NumberComparison]:
    """Between the world's axes and the platform's z axis: cos α = R₀₂, cos β = R₁₂, cos γ = R₂₂."""
    found = np.rad2deg(np.arccos(Rotation.from_euler("XYZ", THETA, degrees=True).as_matrix()[:, 2]))
    remark = "9.2098 to all digits printed but the last"
    return [
        NumberComparison(name, "deg", printed, ours, remark if name == "γ" else "")
        for (name, printed), ours in zip(AXIS_ANGLES.items(), found, strict=True)
    ]


def compare_retracted_lengths() -> list[NumberComparison]:
    """Between joint centres; derived from the frames' distance that the thesis' program states."""
    lengths = 1e3 * load_machine("hexapod").home_q
    return [NumberComparison(f"leg {k}", "mm", "219.0774", ours) for k, ours in enumerate(lengths, 1)]


def initial_design() -> list[NumberComparison]:
    """What its chapter 2 needs of an actuator."""
    ours, _ = needs()
    remark = "does not follow from the printed geometry"
    return [
        NumberComparison(what, unit, f"{scale * (printed or 0):.{digits}f}", scale * (found or 0), remark)
        for what, unit, scale, digits, printed, found in (
            ("largest change of a leg's length", "mm", 1e3, 2, PRINTED.stroke, ours.stroke),
            ("largest force of a leg", "N", 1, 3, PRINTED.force, ours.force),
        )
    ]


SEEDS = 20


def main() -> None:
    machine, lengths = dietmaier(), PUBLISHED["dietmaier"]["lengths"]
    print(f"{'seed':>4}{'modes':>7}{'largest residual':>18}{'nearest two':>13}{'start system':>14}{'modes':>9}")
    complete = 0
    for seed in range(SEEDS):
        begin = perf_counter()
        solve_generic(seed)
        ready = perf_counter()
        modes = assembly_modes(machine, lengths, seed=seed)
        done = perf_counter()
        residual = np.abs(machine.inverse(modes) - lengths).max()
        matrices = modes.as_matrix()
        apart = np.abs(matrices[:, None] - matrices).max((2, 3)) + np.diag(np.full(len(modes), np.inf))
        complete += len(modes) == 40
        times = f"{ready - begin:>12.2f} s{done - ready:>7.2f} s"
        print(f"{seed:>4}{len(modes):>7}{residual:>18.1e}{apart.min():>13.3f}{times}")
    print(f"all 40 in {complete} of {SEEDS} seeds")


if __name__ == "__main__":
    main()
