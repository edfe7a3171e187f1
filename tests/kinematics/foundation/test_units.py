"""Quantities: exact conversions, and refusal of everything that is not one."""

import math
import subprocess
import sys
from fractions import Fraction

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from kinematics import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.units import (
    MAX_LENGTH,
    USUAL_UNITS,
    Unit,
    describe,
    describe_value,
    everyday_unit,
    factor_by_pint,
    floor_percent,
    format_distinct,
    quantity,
    unit_value,
)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("50.8 mm", "m", 0.0508),
        ("0.25 in", "m", 0.00635),
        ("2 in", "mm", 0.0508),
        ("76 mm/s", "m/s", 0.076),
        ("3000 1/s", "1/s", 3000.0),
        ("10 MHz", "1/s", 1e7),
        ("220 N", "N", 220.0),
        ("0.75 um", "m", 0.75e-6),
        ("0.75 µm", "m", 0.75e-6),  # U+00B5, the sign on keyboards
        ("0.75 μm", "m", 0.75e-6),  # U+03BC, the Greek letter
        ("90 deg", "rad", math.pi / 2),
        ("-180°", "rad", -math.pi),
        ("1 rev", "rad", 2 * math.pi),
        ("30 rpm", "rad/s", math.pi),
        ("225 mm/s^2", "m/s^2", 0.225),
        ("225 mm/s**2", "m/s^2", 0.225),
        ("225 mm s^-2", "m/s^2", 0.225),
        ("4000mm/s^3", "m/s^3", 4.0),
        ("+1.5e-3 m", "m", 0.0015),
        (".5 lb", "kg", 0.226796185),
        ("1 ozf*in", "N*m", 0.27801385095378125 * 0.0254),
        ("1 ozf in", "Nm", 0.27801385095378125 * 0.0254),
        ("1 psi", "Pa", 4.4482216152605 / 0.0254**2),
        ("  7 s  ", "s", 7.0),
    ],
)
def test_conversions_are_right_to_the_last_bit_but_one(text, unit, value):
    # the expected values are products of at most three floats here: one unit in the last place each
    assert quantity(text, unit) == pytest.approx(value, rel=4e-16, abs=0)


@given(st.floats(-1e300, 1e300, allow_nan=False))
def test_a_decimal_in_mm_is_the_float_nearest_to_its_metres(value):
    assert quantity(f"{value!r} mm", "m") == float(Fraction(repr(value)) / 1000)


@given(
    st.floats(1e-12, 1e12),
    st.sampled_from([("mm/s", "m/s"), ("deg", "rad"), ("in", "m"), ("ozf*in", "N*m")]),
)
def test_describe_and_quantity_are_inverse_to_the_digits_shown(value, units):
    shown_unit, unit = units
    # six significant digits: half of the last is at most 5e-6 of the value
    assert quantity(describe(value, shown_unit), unit) == pytest.approx(value, rel=5.1e-6)


def test_describe_reads_like_the_file():
    assert describe(0.0508, "mm") == "50.8 mm"
    assert describe(math.radians(35), "deg") == "35 deg"
    assert everyday_unit("m/s^2") == "mm/s^2"
    assert everyday_unit("N") == "N"


@pytest.mark.parametrize(
    ("text", "unit", "reason"),
    [
        (20, "m/s", 'a number without a unit: write e.g. "20 mm/s"'),
        (20.5, "rad", 'a number without a unit: write e.g. "20 deg"'),
        ("20", "m/s", 'a number without a unit: write e.g. "20 mm/s"'),
        ("20 mm", "m/s", "not convertible to mm/s"),
        ("20 kg", "m", "not convertible to mm"),
        ("10 deg/s", "1/s", "not convertible to 1/s"),  # an angle is a dimension here
        ("3000 1/s", "rad/s", "not convertible to deg/s"),
        ("nan mm", "m", "not a finite number"),
        ("-inf mm", "m", "not a finite number"),
        ("Infinity mm", "m", "not a finite number"),
        ("1e999 mm", "m", "too large"),
        ("3 mmm", "m", 'unknown unit "mmm", nearest is "mm"'),
        ("3 milimetre", "m", 'nearest is "millimetre"'),
        ("3 MM/S", "m/s", 'unknown unit "MM", nearest is "mm"'),
        ("3 furlong", "m", 'unknown unit "furlong"'),
        ("", "m", "does not begin with a number"),
        ("mm", "m", "does not begin with a number"),
        ("1.2.3 mm", "m", "does not begin with a number"),
        ("٣ mm", "m", "does not begin with a number"),
        (True, "m", "true: not a quantity"),
        (None, "m", "not a quantity"),
        ([1], "m", "not a quantity"),
    ],
)
def test_what_is_no_quantity_is_refused_with_the_reason(text, unit, reason):
    with pytest.raises(MotionError) as refusal:
        quantity(text, unit)
    assert reason in str(refusal.value)


@pytest.mark.parametrize(
    "text",
    [
        "3 __import__('os').system('true')",
        "3 m.__class__",
        "9 m**9**9**9",
        "2 m^99999",
        "3 (m)",
        "3 m; m",
        "3 {0.__init__}",
        "3 m\nm",
        "3 m^0",
        "3 /s",
        "3 m//s",
        "20 1/1",
        "3 " + "m" * MAX_LENGTH,
        "3" * 10_000 + " mm",
    ],
)
def test_hostile_text_never_reaches_pint(text, monkeypatch):
    monkeypatch.setattr(
        "kinematics.foundation.units.factor",
        lambda unit: pytest.fail(f"pint would be handed {unit!r}"),
    )
    with pytest.raises(MotionError) as refusal:
        quantity(text, "m")
    assert len(str(refusal.value)) < 400
    assert str(refusal.value).isprintable()


@settings(deadline=None)
@example("NaN")
@example("inf")
@given(
    st.one_of(
        st.text(max_size=100),
        st.text("0123456789.eE+-*/^ µ°mkgsdegradinN1()_\n\0\x1b", max_size=40),
    )
)
def test_any_text_is_a_finite_number_or_a_motion_error(text):
    for candidate in (text, f"1 {text}", f"{text} mm"):
        try:
            found = quantity(candidate, "m")
        except MotionError as refusal:
            found, message = 0.0, str(refusal)
        else:
            message = ""
        assert math.isfinite(found)
        assert message.isprintable()  # one line, no terminal codes


def test_any_value_is_shown_on_one_short_line():
    for value in (10**5000, "x" * 5000, list(range(5000)), (1, 2), "\x1b[2J", True, float("nan")):
        assert len(describe_value(value)) <= MAX_LENGTH
        assert describe_value(value).isprintable()


def test_unit_value_is_the_si_value_of_one():
    assert unit_value("mm", "m") == 0.001
    assert unit_value("deg", "rad") == pytest.approx(math.radians(1), rel=1e-15)
    for wrong in ("3 mm", "", "deg", 3, "MM", "m" * 1000):
        with pytest.raises(MotionError):
            unit_value(wrong, "m")


@pytest.mark.parametrize(
    ("unit", "good", "bad", "reason"),
    [
        (Unit("m", above=0), "1e-9 mm", "0 mm", "must be above 0 mm"),
        (Unit("m", least=0), "0 mm", "-1e-9 mm", "must be at least 0 mm"),
        (Unit("rad", most=math.pi), "180 deg", "180.001 deg", "must be at most 180 deg"),
        (
            Unit("m", least=-1, most=1),
            "-1 m",
            "1.1 m",
            "must be at least -1000 mm and at most 1000 mm",
        ),
    ],
)
def test_bounds_belong_to_the_range_unless_above(unit, good, bad, reason):
    assert unit.read(good, {}) == quantity(good, unit.unit)
    with pytest.raises(MotionError) as refusal:
        unit.read(bad, {})
    assert reason in str(refusal.value)


def test_plain_numbers_need_their_declaration():
    unit = Unit("m", plain="length")
    assert unit.read(25, {"length": 0.001}) == 0.025
    assert unit.read("25 mm", {}) == 0.025
    with pytest.raises(MotionError) as refusal:
        unit.read(25, {})
    assert 'add the line length = "mm" at the top, or write "25 mm"' in str(refusal.value)
    for value in (math.nan, math.inf, 10**400, True):
        with pytest.raises(MotionError):
            unit.read(value, {"length": 0.001})
    with pytest.raises(MotionError):
        unit.read(1e308, {"length": 1000.0})


def test_pint_is_not_loaded_before_a_quantity_is_read():
    code = "import sys, kinematics.foundation.units; sys.exit('pint' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@given(st.floats(-1e300, 1e300), st.integers(2, 9))
@example(5000.0, 6)
@example(0.0, 6)
@settings(derandomize=True)
def test_neighbours_read_apart_and_equals_do_not(value, digits):
    above = math.nextafter(value, math.inf)
    one, two = format_distinct(value, above, digits=digits)
    assert float(one) < float(two)
    assert format_distinct(value, value, digits=digits) == (f"{value:.{digits}g}",) * 2


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ((1.1, 1.0), ("1.1", "1")),
        ((5000.0000001, 5000.0), ("5000.0000001", "5000")),
        ((2.4e6, 2.4e6, 6.55e6), ("2.4e+06", "2.4e+06", "6.55e+06")),
        ((math.inf, 1.0), ("inf", "1")),
        ((math.nan, 1.0), ("nan", "1")),
    ],
)
def test_numbers_have_the_digits_that_tell_them_apart(values, texts):
    assert format_distinct(*values) == texts


@pytest.mark.parametrize(
    ("text", "unit", "told"),
    [
        ("149,5 mm", "m", "a comma in a number: decimals follow a point"),
        ("1,200 mm", "m", "thousands have no sign"),
        ("225 mm/s2", "m/s^2", 'nearest is "mm/s^2"'),
        ("4000 mm/s3", "m/s^3", 'nearest is "mm/s^3"'),
        ("2 kg m2", "kg m^2", 'nearest is "kg m^2"'),
    ],
)
def test_habits_of_writing_are_told_what_is_written_here(text, unit, told):
    with pytest.raises(MotionError) as refusal:
        quantity(text, unit)
    assert told in str(refusal.value)


@pytest.mark.parametrize("unit", sorted(USUAL_UNITS))
def test_what_is_known_without_pint_is_what_pint_says(unit):
    assert factor_by_pint(unit) == USUAL_UNITS[unit]


def test_the_usual_units_are_read_without_pint():
    code = "import sys, kinematics.foundation.units as u; u.quantity('2.5 mm/s', 'm/s'); assert 'pint' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("count", "noun", "form", "words"),
    [
        (0, "pulse", "", "0 pulses"),
        (1, "axis", "", "1 axis"),
        (2, "axis", "", "2 axes"),
        (3, "entry", "", "3 entries"),
        (2, "entity", "", "2 entities"),
        (3, "equal stretch", "", "3 equal stretches"),
        (1.0, "pulse", ".3g", "1 pulse"),
        (0.5, "pulse", ".3g", "0.5 pulses"),
        (1.0004, "pulse", ".3g", "1 pulse"),
    ],
)
def test_a_number_and_its_noun_agree(count, noun, form, words):
    assert count_noun(count, noun, form) == words


def test_a_share_in_per_cent_is_never_rounded_up():
    assert [floor_percent(share) for share in (1.0, 0.99996, 0.9989, 0.998951, 0.8)] == [
        "100.00",
        "99.99",
        "99.89",
        "99.89",
        "80.00",
    ]
    assert all(floor_percent(n / 1e4) == f"{n / 100:.2f}" for n in range(10_001))
