"""Stepper sizing of [Sasidhar 1981, Appendix B], line by line."""

from math import pi

from benchmarks.evidence.published.compared import PublishedLine
from benchmarks.evidence.table import Table
from kinematics.design.sizing import (
    Leadscrew,
    Slide,
    StepMotor,
    StepperSizing,
    Traverse,
    size_stepper,
)
from kinematics.foundation.units import unit_value

INCH, POUND = unit_value("in", "m"), unit_value("lb", "kg")
OUNCE_INCH, POUND_INCH2 = unit_value("ozf in", "N m"), unit_value("lb in^2", "kg m^2")

# The vertical axis, as printed: lb, in, s, threads per inch, deg, steps/s, lbf, in/s.
WEIGHT, TRAVEL, TIME, RAMP, ACCURACY = 50.0, 48.0, 40.0, 5.0, 0.010
THREADS, DIAMETER, EFFICIENCY, FRICTION = 4.0, 1.0, 0.90, 1.0
STEP, RATE, SPEED = 1.8, 1200.0, 1.5
# Friction of the screw (oz in) and inertia of the rotor (lb in²).
DRAG, ROTOR = 5.0, 2.5

MOTOR = StepMotor(step=STEP * pi / 180, inertia=ROTOR * POUND_INCH2, holding=300 * OUNCE_INCH)


def size_axis(
    weight: float = WEIGHT,
    travel: float = TRAVEL,
    accuracy: float = ACCURACY,
    lift: float = 1.0,
) -> StepperSizing:
    """Return our sizing of an axis, from its printed numbers (lb, in); the vertical one by default.

    All axes have the same screw, ramps and motor.
    """
    return size_stepper(
        Slide(weight * POUND, FRICTION * unit_value("lbf", "N"), lift),
        Leadscrew(INCH / THREADS, DIAMETER * INCH, travel * INCH, EFFICIENCY, DRAG * OUNCE_INCH),
        MOTOR,
        Traverse(travel * INCH, TIME, RAMP, accuracy * INCH, SPEED * INCH),
    )


def other_axes() -> dict[str, StepperSizing]:
    """Return our sizing of the other two axes, of which the appendix prints only torque and
    time.
    """
    return {
        "transverse": size_axis(weight=140.0, lift=0.0),
        "longitudinal": size_axis(weight=300.0, travel=72.0, accuracy=0.020, lift=0.0),
    }


def acceleration_torque(rate: float = RATE, ramp: float = RAMP) -> float:
    """Return T_A (oz in) by the printed formula, for an inertia of 4.0 lb in²."""
    return 4.0 * rate * STEP * pi / 180 / ramp / 24


def appendix_b() -> tuple[PublishedLine, ...]:
    """Return every computed number of the vertical axis; redone with inputs as rounded there."""
    ours = size_axis()
    accelerating = ours.acceleration_torque / OUNCE_INCH
    gravity = WEIGHT / (0.393 * THREADS * EFFICIENCY)
    friction = FRICTION / (0.393 * THREADS * EFFICIENCY) + DRAG
    screw = DIAMETER**4 * TRAVEL * 0.028
    readings = {
        f"{rate} steps/s in T_A": acceleration_torque(rate=rate)
        for rate in (1000, 1400, 1600, 2000)
    } | {f"a ramp of {ramp} s in T_A": acceleration_torque(ramp=ramp) for ramp in (2.5, 3, 3.75, 4)}
    return (
        PublishedLine(
            "coarsest step: accuracy / 5",
            "in",
            "0.002",
            ACCURACY / 5,
            ours.resolution / INCH,
        ),
        PublishedLine(
            "coarsest lead", "in/rev", "0.4", 360 / STEP * 0.002, ours.coarsest_lead / INCH
        ),
        PublishedLine("average speed", "in/s", "1.2", TRAVEL / TIME, ours.average_speed / INCH),
        PublishedLine(
            "top speed for that, with ramps",
            "in/s",
            "1.5",
            TRAVEL / (TIME - RAMP),
            ours.least_speed / INCH,
            approximate=True,
            note="faster than it need be: on the safe side",
        ),
        PublishedLine("stepping rate", "steps/s", "1200", SPEED / 0.250 * 200, ours.rate),
        PublishedLine(
            "inertia of the slide",
            "lb in²",
            "0.078",
            WEIGHT / THREADS**2 * 0.025,
            ours.slide_inertia / POUND_INCH2,
        ),
        PublishedLine(
            "inertia of the screw",
            "lb in²",
            "1.344",
            screw,
            ours.screw_inertia / POUND_INCH2,
        ),
        PublishedLine(
            "total inertia",
            "lb in²",
            "4.0",
            0.078 + 1.344 + ROTOR,
            ours.inertia / POUND_INCH2,
            approximate=True,
        ),
        PublishedLine(
            "acceleration", "rad/s²", "7.54", RATE * MOTOR.step / RAMP, ours.acceleration
        ),
        PublishedLine("T_A, acceleration", "oz in", "1.26", 4.0 * 7.54 / 24, accelerating),
        PublishedLine(
            "T_F, friction",
            "oz in",
            "6",
            friction,
            ours.friction_torque / OUNCE_INCH,
            approximate=True,
        ),
        PublishedLine("T_G, gravity", "oz in", "35.34", gravity, ours.gravity_torque / OUNCE_INCH),
        PublishedLine(
            "T_A as it stands in the sum",
            "oz in",
            "1.676",
            4.0 * 7.54 / 24,
            accelerating,
            readings,
        ),
        PublishedLine(
            "total torque",
            "oz in",
            "43",
            1.676 + 6 + 35.34,
            ours.torque / OUNCE_INCH,
            approximate=True,
        ),
        PublishedLine(
            "torque at standstill",
            "oz in",
            "35.34",
            gravity,
            ours.standstill_torque / OUNCE_INCH,
            note="printed is the torque that raises the slide; to hold it, the screw's friction need not be overcome",
        ),
    )


def compare_axes() -> Table:
    """Return torque and time of the whole travel of the three axes, with the same screw and
    motor.
    """
    columns = (
        "axis",
        "torque (oz in)",
        "printed",
        "end to end (s)",
        "allowed (s)",
        "speed for that (in/s)",
        "remark",
    )
    printed = ("43", "< 15", "< 20")
    sizings = {"vertical": size_axis()} | other_axes()
    rows = [
        [
            name,
            f"{sizing.torque / OUNCE_INCH:.2f}",
            torque,
            f"{sizing.duration:.1f}",
            f"{TIME:.1f}",
            f"{sizing.least_speed / INCH:.3f}",
            "" if sizing.duration <= TIME else f"too slow at {SPEED:g} in/s",
        ]
        for torque, (name, sizing) in zip(printed, sizings.items(), strict=True)
    ]
    return Table("", columns, rows)
