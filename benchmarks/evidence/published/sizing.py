"""Sizing, deflection and selection beside what was published: `python -m benchmarks.evidence.published.sizing`.

The stepper sizing of [Sasidhar 1981, Appendix B] line by line.
"""

from math import pi

from benchmarks.evidence.published.compared import PublishedLine, table
from benchmarks.evidence.published.initial_design import PRINTED, needs
from benchmarks.evidence.published.sasidhar_deflection import appendix_d
from kinematics.design.catalogue import load_actuators, load_joints
from kinematics.design.selection import select_parts
from kinematics.design.sizing import Leadscrew, Slide, StepMotor, StepperSizing, Traverse, size_stepper
from kinematics.foundation.table import align_columns
from kinematics.foundation.units import unit_value

INCH, POUND, POUND_FORCE = unit_value("in", "m"), unit_value("lb", "kg"), unit_value("lbf", "N")
OUNCE_INCH, POUND_INCH2 = unit_value("ozf in", "N m"), unit_value("lb in^2", "kg m^2")

# The vertical axis, as printed: lb, in, s, threads per inch, deg, steps/s, oz in, lb in².
WEIGHT, TRAVEL, TIME, RAMP, ACCURACY = 50.0, 48.0, 40.0, 5.0, 0.010
THREADS, DIAMETER, EFFICIENCY, FRICTION, DRAG = 4.0, 1.0, 0.90, 1.0, 5.0
STEP, ROTOR, HOLDING = 1.8, 2.5, 300.0
SPEED, RATE = 1.5, 1200.0

MOTOR = StepMotor(step=STEP * pi / 180, inertia=ROTOR * POUND_INCH2, holding=HOLDING * OUNCE_INCH)


def size_axis(
    weight: float = WEIGHT, travel: float = TRAVEL, accuracy: float = ACCURACY, lift: float = 1.0, speed: float = SPEED
) -> StepperSizing:
    """Our sizing of one of the axes, from its printed numbers (lb, in, in/s): same screw, ramps and motor for all."""
    return size_stepper(
        Slide(weight * POUND, FRICTION * POUND_FORCE, lift),
        Leadscrew(INCH / THREADS, DIAMETER * INCH, travel * INCH, EFFICIENCY, DRAG * OUNCE_INCH),
        MOTOR,
        Traverse(travel * INCH, TIME, RAMP, accuracy * INCH, speed * INCH),
    )


def appendix_b() -> tuple[PublishedLine, ...]:
    """Every computed number of the vertical axis; `redone` uses the printed inputs of each line, as rounded there."""
    ours = size_axis()
    alpha, gravity = RATE * STEP * pi / 180 / RAMP, WEIGHT / (0.393 * THREADS * EFFICIENCY)
    acceleration, friction = 4.0 * 7.54 / 24, FRICTION / (0.393 * THREADS * EFFICIENCY) + DRAG
    with_rate = {
        f"{rate:g} steps/s in T_A": 4.0 * rate * STEP * pi / 180 / RAMP / 24 for rate in (1000, 1400, 1600, 2000)
    }
    with_ramp = {f"a ramp of {ramp:g} s in T_A": 4.0 * alpha * RAMP / ramp / 24 for ramp in (2.5, 3, 3.75, 4)}
    slide = WEIGHT / THREADS**2 * 0.025
    inch, inertia, torque = INCH, POUND_INCH2, OUNCE_INCH
    return (
        PublishedLine("coarsest step: accuracy / 5", "in", "0.002", ACCURACY / 5, ours.resolution / inch),
        PublishedLine("coarsest lead", "in/rev", "0.4", 360 / STEP * 0.002, ours.coarsest_lead / inch),
        PublishedLine("average speed", "in/s", "1.2", TRAVEL / TIME, ours.average_speed / inch),
        PublishedLine(
            "top speed for that, with ramps",
            "in/s",
            "1.5",
            TRAVEL / (TIME - RAMP),
            ours.least_speed / inch,
            approximate=True,
            note="faster than it need be: on the safe side",
        ),
        PublishedLine("stepping rate", "steps/s", "1200", SPEED / 0.250 * 200, ours.rate),
        PublishedLine("inertia of the slide", "lb in²", "0.078", slide, ours.slide_inertia / inertia),
        PublishedLine(
            "inertia of the screw", "lb in²", "1.344", DIAMETER**4 * TRAVEL * 0.028, ours.screw_inertia / inertia
        ),
        PublishedLine(
            "total inertia", "lb in²", "4.0", 0.078 + 1.344 + ROTOR, ours.inertia / inertia, approximate=True
        ),
        PublishedLine("acceleration", "rad/s²", "7.54", alpha, ours.acceleration),
        PublishedLine("T_A, acceleration", "oz in", "1.26", acceleration, ours.acceleration_torque / torque),
        PublishedLine("T_F, friction", "oz in", "6", friction, ours.friction_torque / torque, approximate=True),
        PublishedLine("T_G, gravity", "oz in", "35.34", gravity, ours.gravity_torque / torque),
        PublishedLine(
            "T_A as it stands in the sum",
            "oz in",
            "1.676",
            acceleration,
            ours.acceleration_torque / torque,
            {**with_rate, **with_ramp},
        ),
        PublishedLine("total torque", "oz in", "43", 1.676 + 6 + 35.34, ours.torque / torque, approximate=True),
        PublishedLine(
            "torque at standstill",
            "oz in",
            "35.34",
            gravity,
            ours.standstill_torque / torque,
            note="printed is the torque that raises the slide; to hold it, the screw's friction need not be overcome",
        ),
    )


def other_axes() -> dict[str, StepperSizing]:
    """The transverse and the longitudinal axis; the appendix prints only < 15 and < 20 oz in, and 40 s, for them."""
    return {
        "transverse": size_axis(weight=140.0, lift=0.0),
        "longitudinal": size_axis(weight=300.0, travel=72.0, accuracy=0.020, lift=0.0),
    }


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
