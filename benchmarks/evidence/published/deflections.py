"""Structural deflections of [Sasidhar 1981, Appendix D], line by line."""

from itertools import product
from math import sqrt

from benchmarks.evidence.published.compared import PublishedLine
from kinematics.design.deflection import Beam
from kinematics.foundation.units import unit_value

INCH = unit_value("in", "m")
POUND_FORCE = unit_value("lbf", "N")
PSI = unit_value("psi", "Pa")

# As printed: lb, in, psi, in⁴. The load and the modulus are printed twice each, and differently.
LOAD, LOAD_IN_SUM = 255.0, 225.0
MODULUS, MODULUS_IN_TEXT = 28e6, 20e6
SPAN, SECOND_MOMENT = 21.0, 21.8
CROSS_LOAD, CROSS_SPAN, CROSS_SECOND_MOMENT = 245.0, 40.0, 6.0
PRINTED_SLOPE = 5.895e-7

FRAME = Beam(SPAN * INCH, MODULUS * PSI, SECOND_MOMENT * INCH**4)
CROSS_MEMBER = Beam(CROSS_SPAN * INCH, MODULUS * PSI, CROSS_SECOND_MOMENT * INCH**4)


def frame_sag(load: float, modulus: float) -> float:
    """Return the deflection (in) by the printed formula (D.1)."""
    return load * SPAN**3 / (48 * modulus * SECOND_MOMENT)


def cross_sag(modulus: float) -> float:
    """Return the deflection (in) of the cross member by the same formula."""
    return CROSS_LOAD * CROSS_SPAN**3 / (48 * modulus * CROSS_SECOND_MOMENT)


def frame_slope(load: float) -> float:
    """Return the slope (rad) by the printed formula after (D.5)."""
    return 0.096 * load * SPAN**2 / (3 * MODULUS * SECOND_MOMENT)


def appendix_d() -> tuple[PublishedLine, ...]:
    """Return every computed number: frame, its slope and Abbe error, and cross member."""
    sag = FRAME.largest_deflection(LOAD * POUND_FORCE) / INCH
    slope = FRAME.largest_slope(LOAD * POUND_FORCE)
    cross = CROSS_MEMBER.largest_deflection(CROSS_LOAD * POUND_FORCE) / INCH
    own_weight = 45 / 12 * 7.7
    loads = (LOAD, LOAD_IN_SUM)
    sags = {
        f"{load:g} lb and {modulus / 1e6:g}e6 psi": frame_sag(load, modulus)
        for load, modulus in product(loads, (MODULUS, MODULUS_IN_TEXT))
    }
    slopes = {
        f"{load:g} lb{text}": factor * frame_slope(load)
        for load, (factor, text) in product(loads, ((1, ""), (0.1, " and one power of ten lost")))
    }
    abbe = {
        f"a lever of {lever} in with the printed slope": PRINTED_SLOPE * lever
        for lever in (10, 50, 60, 70, 80)
    }
    moduli = {"28e6 psi, as elsewhere, for the 28e3 of the line": cross_sag(28e6)}
    return (
        PublishedLine(
            "frame, mid-span deflection",
            "in",
            "8.060e-5",
            frame_sag(LOAD_IN_SUM, MODULUS),
            sag,
            sags,
        ),
        PublishedLine(
            "frame, factor of the largest slope", "", "0.096", sqrt(3) / 18, sqrt(3) / 18
        ),
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
            frame_slope(LOAD_IN_SUM),
            slope,
            slopes,
        ),
        PublishedLine(
            "frame, Abbe error at the lever of 10 in",
            "in",
            "4.12e-5",
            PRINTED_SLOPE * 10,
            slope * 10,
            abbe,
        ),
        PublishedLine("the same at 70 in", "in", "4.12e-5", PRINTED_SLOPE * 70, slope * 70),
        PublishedLine(
            "long member, weight",
            "lb",
            "110",
            88 / 12 * 15,
            None,
            note="88 in; chapter 2 says 7 ft, 84 in",
        ),
        PublishedLine("its share on one cross member", "lb", "22", 110 / 5, None),
        PublishedLine("cross member, its own weight", "lb", "29", own_weight, None),
        PublishedLine("cross member, share of the transverse axis", "lb", "53", 160 / 3, None),
        PublishedLine(
            "cross member, total load",
            "lb",
            "245",
            22 + 29 + 53 + 140,
            own_weight + 110 / 5 + 160 / 3 + 140,
        ),
        PublishedLine("cross member, deflection", "in", "0.0019", cross_sag(28e3), cross, moduli),
    )
