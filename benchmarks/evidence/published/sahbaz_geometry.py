"""Angles and lengths that [Sahbaz 2007] prints of its hexapod, beside ours: `python -m
benchmarks.evidence.published.sahbaz_geometry`."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.evidence.published.compared import NumberComparison, comparison
from benchmarks.evidence.published.initial_design import PRINTED, needs
from kinematics import Axis, Hexapod, load_machine
from kinematics.kinds.hexapod import joint_circle

# Table 4.3, as printed (degrees): Rx and Ry of each leg.
LEG_ANGLES = (
    ("-5.27128754", "-2.17930829"),
    ("-0.746796351", "5.65389711"),
    ("4.52990963", "-3.46806031"),
    ("-4.52990963", "-3.46806031"),
    ("0.746796351", "5.65389711"),
    ("5.27128754", "-2.17930829"),
)
# Table 6.4 for θ = (6, −7, 0)° (degrees).
AXIS_ANGLES, THETA = {"α": "97", "β": "95.955", "γ": "9.20972"}, (6, -7, 0)


def table_4_3() -> Hexapod:
    """The final design with both joint circles of 149 mm, the upper frame at 400 mm, joints 389.5 mm apart."""
    base, platform = joint_circle(0.149, np.deg2rad(30), 0), joint_circle(0.149, np.deg2rad(60), -0.0105)
    home = RigidTransform.from_translation([0, 0, 0.4])
    return Hexapod(base, platform, axes=[Axis(f"leg{n}") for n in range(1, 7)], home=home)


def leg_angles() -> list[NumberComparison]:
    """Rx = atan2(−n_y, n_z), Ry = asin(n_x) of each leg's direction n, the first three columns of the Jacobian."""
    machine = table_4_3()
    x, y, z = machine.jacobian(machine.home)[:, :3].T
    found = np.rad2deg([np.arctan2(-y, z), np.arcsin(x)]).T
    return [
        NumberComparison(f"leg {leg + 1}, {name}", "deg", printed, ours)
        for leg, row in enumerate(LEG_ANGLES)
        for name, printed, ours in zip(("Rx", "Ry"), row, found[leg], strict=True)
    ]


def axis_angles() -> list[NumberComparison]:
    """Between the world's axes and the platform's z axis: cos α = R₀₂, cos β = R₁₂, cos γ = R₂₂."""
    found = np.rad2deg(np.arccos(Rotation.from_euler("XYZ", THETA, degrees=True).as_matrix()[:, 2]))
    remark = "9.2098 to all digits printed but the last"
    return [
        NumberComparison(name, "deg", printed, ours, remark if name == "γ" else "")
        for (name, printed), ours in zip(AXIS_ANGLES.items(), found, strict=True)
    ]


def retracted() -> list[NumberComparison]:
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


def main() -> None:
    """Print all of them."""
    for title, rows in (
        ("Table 4.3, directions of the legs", leg_angles()),
        ("Table 6.4, direction of the platform's axis", axis_angles()),
        ("Retracted legs", retracted()),
        ("Chapter 2, initial design", initial_design()),
    ):
        print(f"{title}\n\n{comparison(rows)}\n")


if __name__ == "__main__":
    main()
