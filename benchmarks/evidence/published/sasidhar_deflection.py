"""The structural deflections of [Sasidhar 1981, Appendix D], line by line beside ours."""

from math import sqrt

from benchmarks.evidence.published.compared import PublishedLine
from kinematics.design.deflection import Beam
from kinematics.foundation.units import unit_value

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
