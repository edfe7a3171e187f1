"""Quantities of files and messages: text with a unit on the outside, SI numbers inside.

Angles are a dimension of their own here, so "10 deg/s" is no pulse rate and "3000 1/s" no angular speed.
"""

import math
import re
from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING

from kinematics.errors import MotionError
from kinematics.names import nearest

if TYPE_CHECKING:
    from pint import UnitRegistry

MAX_LENGTH = 80
"""Characters of the longest quantity that is read; the longest sensible ones have about 20."""

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?(?![\d.])|[+-]?(?:nan|inf(?:inity)?)(?![a-z])", re.IGNORECASE)
_FACTOR = r"[A-Za-zµ°]+(?:(?:\^|\*\*)-?\d)?"
_UNIT = re.compile(rf"(?:1 ?/ ?)?{_FACTOR}(?:(?: ?[*/] ?| ){_FACTOR})*")

# Only what machines and programs are measured in: pint's own thousand units would turn slips of the pen into quantities.
_DEFINITIONS = """
nano- = 1e-9 = n-
micro- = 1e-6 = µ- = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
kilo- = 1e3 = k-
mega- = 1e6 = M-
giga- = 1e9 = G-
metre = [length] = m = meter
kilogram = [mass] = kg
second = [time] = s
radian = [angle] = rad
inch = 0.0254 * metre = in
foot = 0.3048 * metre = ft
thou = 0.0000254 * metre = mil
micron = 1e-6 * metre = _ = um = µm
gram = 1e-3 * kilogram = g
pound = 0.45359237 * kilogram = lb
ounce = 0.028349523125 * kilogram = oz
minute = 60 * second = min
hour = 3600 * second = h
degree = 0.01745329251994329576923690768 * radian = deg
arcminute = 0.0002908882086657215961539484614 * radian = arcmin
arcsecond = 0.000004848136811095359935899141024 * radian = arcsec
revolution = 6.283185307179586476925286767 * radian = rev = turn
rpm = 0.1047197551196597746154214461 * radian / second = _
hertz = 1 / second = Hz
newton = kilogram * metre / second ** 2 = N
pound_force = 4.4482216152605 * newton = lbf
ounce_force = 0.27801385095378125 * newton = ozf
pascal = newton / metre ** 2 = Pa
psi = 6894.757293168361336722673445 * pascal = _
joule = newton * metre = J
watt = joule / second = W
"""

_EVERYDAY = {
    "m": "mm",
    "m/s": "mm/s",
    "m/s^2": "mm/s^2",
    "m/s^3": "mm/s^3",
    "rad": "deg",
    "rad/s": "deg/s",
    "rad/s^2": "deg/s^2",
    "rad/s^3": "deg/s^3",
}


def everyday(unit: str) -> str:
    """The unit that files and messages use for an SI unit: "mm/s" for "m/s", "deg" for "rad", else the unit itself."""
    return _EVERYDAY.get(unit, unit)


def quantity(text: object, unit: str) -> float:
    """A quantity such as "50.8 mm", "3000 1/s" or "35°" as the nearest float in SI (m, rad, s, kg).

    unit  any unit of the dimension wanted ("m/s", "deg")
    Raises MotionError for a number without a unit, another dimension, an unknown unit, NaN and infinity. The text is matched
    against a strict pattern first; only its unit ever reaches pint.
    """
    example = f'write e.g. "20 {everyday(unit)}"'
    if isinstance(text, (int, float)) and not isinstance(text, bool):
        raise MotionError(f"{_short(text)}: a number without a unit: {example}")
    if not isinstance(text, str):
        raise MotionError(f"{_short(text)} is not a quantity: {example}")
    if len(text) > MAX_LENGTH:
        raise MotionError(f"{_short(text)} is longer than {MAX_LENGTH} characters: {example}")
    stripped = text.strip().replace("μ", "µ")
    number = _NUMBER.match(stripped)
    if number is None:
        raise MotionError(f'"{text}" does not begin with a number: {example}')
    value, tail = Decimal(number.group()), stripped[number.end() :]
    if not value.is_finite():
        raise MotionError(f'"{text}" is not a finite number: {example}')
    if not tail:
        raise MotionError(f'"{text}": a number without a unit: {example}')
    # "20 1/s" needs the space: "201/s" would be anyone's guess.
    if not _UNIT.fullmatch(tail.strip(" ")) or (tail[0] in "0123456789"):
        raise MotionError(f'"{text}": "{tail.strip()}" is not a unit: {example}')
    try:
        factor, wanted = _factor(tail.strip(" ")), _factor(unit)
    except LookupError as error:
        raise MotionError(f'"{text}": {error.args[0]}; {example}') from None
    if factor[1] != wanted[1]:
        raise MotionError(f'"{text}" is not in units of {everyday(unit)}: {example}')
    result = float(value * factor[0])
    if not math.isfinite(result):
        raise MotionError(f'"{text}" is too large for a number: {example}')
    return result


def describe(value: float, unit: str) -> str:
    """An SI value in the unit asked for, for messages: describe(0.0508, "mm") is "50.8 mm"."""
    return f"{value / float(_factor(unit)[0]):.6g} {unit}"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


@cache
def _registry() -> "UnitRegistry[Decimal]":
    from pint import UnitRegistry

    # Decimal factors make "50.8 mm" the float nearest to 0.0508 and "90 deg" exactly π/2.
    return UnitRegistry(_DEFINITIONS.strip().splitlines(), non_int_type=Decimal, on_redefinition="raise")


@cache
def _factor(unit: str) -> tuple[Decimal, str]:
    """(SI units in one `unit`, its dimension). LookupError names an unknown unit and its nearest."""
    from pint.errors import UndefinedUnitError

    registry = _registry()
    try:
        one = registry.Quantity(Decimal(1), registry.parse_units(unit.replace("°", " deg ").strip())).to_root_units()
    except UndefinedUnitError as error:
        missing = sorted(error.unit_names)[0] if not isinstance(error.unit_names, str) else error.unit_names
        raise LookupError(f'unknown unit "{missing}"{nearest(missing, _unit_names())}') from None
    return Decimal(one.magnitude), str(one.dimensionality)
