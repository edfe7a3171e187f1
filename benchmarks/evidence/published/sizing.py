"""Sizing, deflection and selection beside what was published: `python -m benchmarks.evidence.published.sizing`.

The stepper sizing of [Sasidhar 1981, Appendix B] and the structural deflections of its Appendix D, line by line; and
what the initial design of [Sahbaz 2007, chapter 2] needs of its actuators, from its printed geometry, along its printed
move with the speed of its Appendix B. The thesis prints 47.58 mm and 54.563 N. They do not follow from this geometry;
ours stand beside them.
"""

from math import pi, sqrt

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.evidence.published.compared import PublishedLine, table, text_table
from kinematics.analysis.dynamics import forces
from kinematics.analysis.platform_motion import motion_of_poses
from kinematics.design.catalogue import load_actuators, load_joints
from kinematics.design.deflection import Beam
from kinematics.design.selection import ActuatorNeed, AxisMotion, JointNeed, actuator_need, joint_need, select_parts
from kinematics.design.sizing import Leadscrew, Slide, StepMotor, StepperSizing, Traverse, size_stepper
from kinematics.foundation.arrays import Array
from kinematics.foundation.units import unit_value
from kinematics.kinds.hexapod import Hexapod, joint_circle
from kinematics.machine.axis import Axis

PRINTED = ActuatorNeed(stroke=47.58e-3, force=54.563)

DURATION, MOVE_RAMP, SAMPLES = 3.0, 0.6, 21
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
    omega = np.pi / (2 * MOVE_RAMP)
    top = 1 / (2 / omega + DURATION - 2 * MOVE_RAMP)
    up, down = np.minimum(t, MOVE_RAMP), np.maximum(t - (DURATION - MOVE_RAMP), 0.0)
    rate = top * np.sin(omega * up) * np.cos(omega * down)
    steady = np.clip(t - MOVE_RAMP, 0.0, DURATION - 2 * MOVE_RAMP)
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


def print_initial_design() -> None:
    """Stroke, force, speed and tilt, beside print where there is one."""
    actuator, joint = needs()
    found = (
        ("largest change of a leg's length", "mm", 1e3, actuator.stroke, "47.58"),
        ("largest force of a leg", "N", 1.0, actuator.force, "54.563"),
        ("highest speed of a leg", "mm/s", 1e3, actuator.speed, "-"),
        ("largest tilt of a joint", "deg", np.rad2deg(1.0), joint.tilt, "-"),
    )
    rows = [(what, unit, f"{scale * (value or 0):.3f}", printed) for what, unit, scale, value, printed in found]
    print(text_table(("what", "unit", "ours", "printed"), rows, ("ours", "printed")))
    print("The two printed numbers do not follow from the printed geometry; the legs here have no mass.")


INCH, POUND_FORCE, PSI = unit_value("in", "m"), unit_value("lbf", "N"), unit_value("psi", "Pa")

# As printed: lb, in, psi, in⁴. The load and the modulus are printed twice each, and differently.
LOAD, LOAD_IN_SUM, SPAN, SECOND_MOMENT = 255.0, 225.0, 21.0, 21.8
MODULUS, MODULUS_IN_TEXT = 28e6, 20e6
LEVER = 10.0
CROSS_LOAD, CROSS_SPAN, CROSS_SECOND_MOMENT, CROSS_LENGTH, CROSS_WEIGHT = 245.0, 40.0, 6.0, 45.0, 7.7

FRAME = Beam(SPAN * INCH, MODULUS * PSI, SECOND_MOMENT * INCH**4)
CROSS_MEMBER = Beam(CROSS_SPAN * INCH, MODULUS * PSI, CROSS_SECOND_MOMENT * INCH**4)


def appendix_d() -> tuple[PublishedLine, ...]:
    """Every computed number: the frame's long member, its slope and Abbe error, and the cross member."""
    slope = FRAME.largest_slope(LOAD * POUND_FORCE)
    printed_slope, levers = 5.895e-7, (10.0, 50.0, 60.0, 70.0, 80.0)
    return (
        PublishedLine(
            "frame, mid-span deflection",
            "in",
            "8.060e-5",
            _sag(LOAD_IN_SUM, SPAN, MODULUS, SECOND_MOMENT),
            FRAME.largest_deflection(LOAD * POUND_FORCE) / INCH,
            {
                f"{load:g} lb and {modulus / 1e6:g}e6 psi": _sag(load, SPAN, modulus, SECOND_MOMENT)
                for load in (LOAD, LOAD_IN_SUM)
                for modulus in (MODULUS, MODULUS_IN_TEXT)
            },
        ),
        PublishedLine("frame, factor of the largest slope", "", "0.096", sqrt(3) / 18, sqrt(3) / 18),
        PublishedLine(
            "frame, place of the largest slope / span",
            "",
            "0.789",
            1 / (3 - sqrt(3)),
            (3 + sqrt(3)) / 6,
        ),
        PublishedLine(
            "frame, largest slope under the load",
            "rad",
            "5.895e-7",
            _slope(LOAD_IN_SUM),
            slope,
            {
                f"{load:g} lb{text}": factor * _slope(load)
                for load in (LOAD, LOAD_IN_SUM)
                for factor, text in ((1.0, ""), (0.1, " and one power of ten lost"))
            },
        ),
        PublishedLine(
            "frame, Abbe error at the lever of 10 in",
            "in",
            "4.12e-5",
            printed_slope * LEVER,
            slope * LEVER,
            {f"a lever of {lever:g} in with the printed slope": printed_slope * lever for lever in levers},
        ),
        PublishedLine("the same at 70 in", "in", "4.12e-5", printed_slope * 70, slope * 70),
        PublishedLine("long member, weight", "lb", "110", 88 / 12 * 15, None, note="88 in; chapter 2 says 7 ft, 84 in"),
        PublishedLine("its share on one cross member", "lb", "22", 110 / 5, None),
        PublishedLine("cross member, its own weight", "lb", "29", CROSS_LENGTH / 12 * CROSS_WEIGHT, None),
        PublishedLine("cross member, share of the transverse axis", "lb", "53", 160 / 3, None),
        PublishedLine(
            "cross member, total load",
            "lb",
            "245",
            22 + 29 + 53 + 140,
            CROSS_LENGTH / 12 * CROSS_WEIGHT + 110 / 5 + 160 / 3 + 140,
        ),
        PublishedLine(
            "cross member, deflection",
            "in",
            "0.0019",
            _sag(CROSS_LOAD, CROSS_SPAN, 28e3, CROSS_SECOND_MOMENT),
            CROSS_MEMBER.largest_deflection(CROSS_LOAD * POUND_FORCE) / INCH,
            {
                "28e6 psi, as elsewhere, for the 28e3 of the line": _sag(
                    CROSS_LOAD, CROSS_SPAN, 28e6, CROSS_SECOND_MOMENT
                )
            },
        ),
    )


def _sag(load: float, span: float, modulus: float, second_moment: float) -> float:
    """The printed formula (D.1), in."""
    return load * span**3 / (48 * modulus * second_moment)


def _slope(load: float) -> float:
    """The printed formula after (D.5), rad."""
    return 0.096 * load * SPAN**2 / (3 * MODULUS * SECOND_MOMENT)


POUND = unit_value("lb", "kg")
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
    print(text_table(AXES_HEADER, axes_rows(), (*AXES_HEADER[1:2], *AXES_HEADER[3:6])))
    print("\nOur sizing of the vertical axis\n")
    print(size_axis())
    print("\nDeflections [Sasidhar 1981, Appendix D]\n")
    print(table(appendix_d()))
    print("\nThe initial design [Sahbaz 2007, chapter 2]\n")
    print_initial_design()
    actuator, joint = needs()
    print("\nActuators [Sahbaz 2007, Table 3.1], for what its chapter 2 prints\n")
    print(select_parts(load_actuators(), PRINTED))
    print("\nThe same for what follows from the geometry of chapter 2 (the printed two do not)\n")
    print(select_parts(load_actuators(), actuator))
    print("\nJoints [Sahbaz 2007, Tables 3.4 to 3.6] for that\n")
    print(select_parts(load_joints(), joint))


if __name__ == "__main__":
    main()
