"""Sizing, deflection and selection beside what was published: `python -m benchmarks.evidence.published.sizing`."""

from benchmarks.evidence.published.initial_design import PRINTED, needs
from benchmarks.evidence.published.published_lines import table
from benchmarks.evidence.published.sasidhar_deflection import appendix_d
from benchmarks.evidence.published.sasidhar_sizing import INCH, OUNCE_INCH, appendix_b, other_axes, size_axis
from kinematics.design.catalogue import load_actuators, load_joints
from kinematics.design.selection import select_parts
from kinematics.foundation.table import align_columns

AXES_HEADER = (
    "axis",
    "torque (oz in)",
    "printed",
    "end to end (s)",
    "allowed (s)",
    "speed for that (in/s)",
    "remark",
)


def axes_rows() -> list[list[str]]:
    """What the same screw and motor mean for the three axes: torque, and the time of the whole travel."""
    printed = {"vertical": "43", "transverse": "< 15", "longitudinal": "< 20"}
    rows = []
    for name, sizing in {"vertical": size_axis(), **other_axes()}.items():
        time = next(check for check in sizing.checks if check.name == "time")
        rows.append(
            [
                name,
                f"{sizing.torque / OUNCE_INCH:.2f}",
                printed[name],
                f"{sizing.duration:.1f}",
                f"{time.needed:.1f}",
                f"{sizing.least_speed / INCH:.3f}",
                "" if time.holds else f"too slow at {sizing.speed / INCH:g} in/s",
            ]
        )
    return rows


def main() -> None:
    print("Stepper sizing [Sasidhar 1981, Appendix B], vertical axis\n")
    print(table(appendix_b()))
    print("\nAll axes at 1200 steps/s\n")
    print(align_columns(AXES_HEADER, axes_rows()))
    print("\nOur sizing of the vertical axis\n")
    print(size_axis())
    print("\nDeflections [Sasidhar 1981, Appendix D]\n")
    print(table(appendix_d()))
    actuator, joint = needs()
    print("\nActuators [Sahbaz 2007, Table 3.1], for what its chapter 2 prints\n")
    print(select_parts(load_actuators(), PRINTED))
    print("\nThe same for what follows from the geometry of chapter 2 (the printed two do not)\n")
    print(select_parts(load_actuators(), actuator))
    print("\nJoints [Sahbaz 2007, Tables 3.4 to 3.6] for that\n")
    print(select_parts(load_joints(), joint))


if __name__ == "__main__":
    main()
