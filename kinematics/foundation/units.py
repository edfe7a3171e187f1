"""Quantities of files and messages: text with a unit on the outside, SI numbers inside.

Which units there are, what each is in SI, and the nearest one to a mistaken name. Angles are a
dimension of their own here, so "10 deg/s" is no pulse rate and "3000 1/s" no angular speed.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from math import ceil, floor, inf, isfinite, log10
from typing import TYPE_CHECKING, Annotated, Any

from kinematics.foundation.arrays import MIN_MAGNITUDE, most
from kinematics.foundation.errors import BadValue, MotionError
from kinematics.foundation.names import closest, nearest

if TYPE_CHECKING:
    from pint import UnitRegistry
    from pydantic_core import CoreSchema

# Only what machines and programs are measured in: pint's own thousand units would read slips of the
# pen as quantities.
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
micron = 1e-6 * metre = _
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
newton_metre = newton * metre = Nm
joule = newton * metre = J
watt = joule / second = W
"""


@cache
def _registry() -> "UnitRegistry[Decimal]":
    from pint import UnitRegistry

    # Decimal factors make "50.8 mm" the float nearest to 0.0508 and "90 deg" exactly π/2.
    return UnitRegistry(
        _DEFINITIONS.strip().splitlines(), non_int_type=Decimal, on_redefinition="raise"
    )


# What pint says of the units that most files use alone: to load and start it takes longer than to
# read such a file.
_LENGTHS = {"m": "1", "mm": "0.001", "um": "0.000001", "in": "0.0254"}
_ANGLES = {"rad": "1", "deg": "0.01745329251994329576923690768"}
_RATES = {"": "", "/s": " / [time]", "/s^2": " / [time] ** 2", "/s^3": " / [time] ** 3"}
USUAL_UNITS = {
    f"{unit}{per}": (Decimal(size), f"[{kind}]{rate}")
    for kind, units in (("length", _LENGTHS), ("angle", _ANGLES))
    for unit, size in units.items()
    for per, rate in _RATES.items()
} | {
    "s": (Decimal(1), "[time]"),
    "1/s": (Decimal(1), "1 / [time]"),
    "N": (Decimal(1), "[mass] * [length] / [time] ** 2"),
    "Hz": (Decimal(1), "1 / [time]"),
    "kHz": (Decimal(1000), "1 / [time]"),
    "kg": (Decimal(1), "[mass]"),
    "kg*m^2": (Decimal(1), "[mass] * [length] ** 2"),
    "ms": (Decimal("0.001"), "[time]"),
    "us": (Decimal("0.000001"), "[time]"),
    "arcmin": (Decimal("0.0002908882086657215961539484614"), "[angle]"),
    "rpm": (Decimal("0.1047197551196597746154214461"), "[angle] / [time]"),
    "mm/min": (Decimal("0.00001666666666666666666666666667"), "[length] / [time]"),
    "N*m": (Decimal(1), "[mass] * [length] ** 2 / [time] ** 2"),
    "N*m*s/rad": (Decimal(1), "[mass] * [length] ** 2 / [time] / [angle]"),
}


def factor(unit: str, like: str = "") -> tuple[Decimal, str]:
    """(how many SI units one `unit` is, its dimension).

    MotionError names an unknown unit and the nearest known one.

    like  a unit of the dimension that is wanted: of a single unit, the nearest is sought among
          those of that dimension
    """
    return USUAL_UNITS[unit] if unit in USUAL_UNITS else factor_by_pint(unit, like)


@cache
def factor_by_pint(unit: str, like: str = "") -> tuple[Decimal, str]:
    """The same of any unit."""
    from pint.errors import UndefinedUnitError

    registry = _registry()
    try:
        one = registry.Quantity(
            Decimal(1), registry.parse_units(unit.replace("°", "deg"))
        ).to_root_units()
    except UndefinedUnitError as error:
        unknown = (
            error.unit_names if isinstance(error.unit_names, str) else next(iter(error.unit_names))
        )
        known = _unit_names()
        if like and unknown == unit:
            alike = [name for name in known if factor(name)[1] == factor(like)[1]]
            known = tuple(alike) if closest(unknown, alike) else known
        told = f'unknown unit "{unknown}"{nearest(unknown, known)}'
        raise BadValue(told, nearest=closest(unknown, known)) from None
    except ValueError:  # pint reads "nan" and "inf" as numbers
        raise BadValue(f'"{unit}" is not a unit') from None
    return Decimal(one.magnitude), str(one.dimensionality)


@cache
def _unit_names() -> tuple[str, ...]:
    """Every name and symbol of the definitions, with and without prefix."""
    rows = [
        [word.strip() for word in line.split("=")] for line in _DEFINITIONS.strip().splitlines()
    ]
    words = [[word for word in (row[0], *row[2:]) if word != "_"] for row in rows]
    prefixes = [word.removesuffix("-") for row in words for word in row if word.endswith("-")]
    units = [word for row in words for word in row if not word.endswith("-")]
    # Words join words and symbols symbols: "milli" + "metre", "m" + "m".
    joined = [p + u for p in prefixes for u in units if (len(p) > 1) == (len(u) > 2)]
    return (*units, *joined)


MAX_LENGTH = 80
"""Characters of the longest quantity that is read; the longest sensible ones have about 20."""

MAX_DIGITS = 17
"""Significant digits by which any two floats differ."""

_DECIMAL = r"(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d{1,3})?(?![\d.])"
_NUMBER = re.compile(
    rf"[+-]?(?:{_DECIMAL}|(?:nan|inf(?:inity)?)(?![a-z]))", re.ASCII | re.IGNORECASE
)
_FACTOR = r"[A-Za-zµ°]+(?:(?:\^|\*\*)-?[1-9])?"
# how people write units that are none here
_SLIPS = str.maketrans({"\\": "/", "²": "^2", "³": "^3", "·": "*", "×": "*"})
_POWER = re.compile(r"([a-z])([2-9])(?![a-z0-9])")
_COMMA = re.compile(r"[+-]?\d+,\d")
_UNIT = re.compile(rf"(?:1 ?/ ?)?{_FACTOR}(?:(?: ?[*/] ?| ){_FACTOR})*")

_EVERYDAY_UNITS = {
    "m": "mm",
    "m/s": "mm/s",
    "m/s^2": "mm/s^2",
    "m/s^3": "mm/s^3",
    "rad": "deg",
    "rad/s": "deg/s",
    "rad/s^2": "deg/s^2",
    "rad/s^3": "deg/s^3",
}


def everyday_unit(unit: str) -> str:
    """The unit that files and messages use for an SI unit: "mm/s" for "m/s", "deg" for "rad", else
    the unit itself.
    """
    return _EVERYDAY_UNITS.get(unit, unit)


def quantity(text: object, unit: str) -> float:
    """A quantity such as "50.8 mm", "3000 1/s" or "35°" as the nearest float in SI (m, rad, s, kg).

    unit  any unit of the dimension wanted ("m/s", "deg")
    Raises MotionError for a number without a unit, another dimension, an unknown unit, NaN and
    infinity. The text is
    matched against a strict pattern first; only its unit ever reaches pint.
    """
    return Unit(unit).quantity(text)


def unit_value(name: object, unit: str) -> float:
    """SI value of one `name`, which must be a unit of the dimension of `unit`: unit_value("mm",
    "m") is 0.001.
    """
    if not isinstance(name, str) or len(name) > MAX_LENGTH or not _UNIT.fullmatch(name):
        raise MotionError(
            f'{describe_value(name)} is not a unit: write e.g. "{everyday_unit(unit)}"'
        )
    try:
        return _parse(f"1 {name}", unit)
    except BadValue as error:
        raise BadValue(
            f'{describe_value(name)}: {error}: write e.g. "{everyday_unit(unit)}"',
            nearest=error.nearest,
        ) from None


def describe(value: float, unit: str) -> str:
    """An SI value in the unit asked for, for messages: describe(0.0508, "mm") is "50.8 mm"."""
    return f"{value / float(factor(unit)[0]):.6g} {unit}"


def round_up_digits(value: float, digits: int = 4) -> str:
    """A positive number that a message advises, rounded up to so many digits: 0.0339801 is
    "0.03399".
    """
    scale = 10.0 ** (digits - 1 - floor(log10(value)))
    return f"{ceil(value * scale) / scale:.{digits}g}"


def floor_percent(share: float) -> str:
    """A share of a limit in per cent, two decimals, rounded down: 0.99996 is "99.99", not all of
    it.
    """
    return f"{floor(1e4 * share + 1e-6) / 100:.2f}"  # 0.9989 times 1e4 is below 9989


def format_distinct(*values: float, digits: int = 6) -> tuple[str, ...]:
    """Numbers that a message holds against each other, with so many digits, or as many more as tell
    them apart.

    A value that is beyond its limit by rounding reads so: apart(5000.0000001, 5000) is
    "5000.0000001", "5000".
    """
    texts: tuple[str, ...] = ()
    for some in range(digits, MAX_DIGITS + 1):
        texts = tuple(f"{value:.{some}g}" for value in values)
        # near powers of ten, two texts may read as the same number
        if len({float(text) for text in texts}) == len(set(values)):
            break
    return texts


@dataclass(frozen=True, slots=True)
class Unit:
    """What a float of a file's schema accepts: text with a unit of this dimension, in SI, within
    bounds.

    above        the value is greater, SI
    least, most  the value is no smaller, no greater, SI
    plain        the file's key that declares the unit of plain numbers ("length"); None: every
                 number needs its own
    like         a usual value, for messages; None: 20 of the everyday unit
    file_unit    in which files are written; empty: mm for m, mm/s for m/s and so on, else the unit
                 itself
    unit_written  files are written with the unit, even where plain numbers are read
    """

    unit: str
    above: float = -inf
    least: float = -inf
    most: float = inf
    plain: str | None = None
    like: str | None = None
    file_unit: str = ""
    unit_written: bool = False

    @property
    def written_unit(self) -> tuple[str, int]:
        """The unit in which files are written, and its power of ten from SI."""
        length = self.unit.split("/")[0] == "m"
        name = self.file_unit or (f"m{self.unit}" if length else self.unit)
        return name, 0 if name == self.unit else {"m": 3, "u": 6}[name[0]]

    @property
    def example(self) -> str:
        return f'write e.g. "{self.like or f"20 {everyday_unit(self.unit)}"}"'

    @property
    def range_text(self) -> str:
        """The range, in words: "above 0 mm/s"; of what has no bounds, its unit."""
        unit = everyday_unit(self.unit)
        sides = (("above", self.above), ("at least", self.least), ("at most", self.most))
        bounds = " and ".join(
            f"{side} {describe(bound, unit)}" for side, bound in sides if isfinite(bound)
        )
        return bounds or f"a quantity in {unit}, or in a unit that converts to it"

    def read(self, value: object, declared: Mapping[str, float]) -> float:
        """The value in SI; `declared` holds the SI value of one plain number by name.

        Raises MotionError.
        """
        if (
            self.plain is not None
            and isinstance(value, (int, float))
            and not isinstance(value, bool)
        ):
            number = self._plain(self.plain, value, declared)
        else:
            number = self.quantity(value)
        if not (number > self.above and self.least <= number <= self.most):
            unit = everyday_unit(self.unit)
            other = isinstance(value, str) and unit not in value and number
            converted = f", which is {describe(number, unit)}," if other else ""
            raise BadValue(
                f"{describe_value(value)}{converted} must be {self.range_text}",
                allowed=self.range_text,
            )
        self._refuse_size(value, number)
        return number

    def _refuse_size(self, value: object, number: float) -> None:
        """What no machine has and no computation bears: too large, or of what must be above 0, too
        small.
        """
        unit, largest = everyday_unit(self.unit), most(self.unit)
        if abs(number) > largest:
            allowed = f"at most {describe(largest, unit)}"
            raise BadValue(
                f"{describe_value(value)}: too large: {allowed} can be taken", allowed=allowed
            )
        if self.above == 0 and number < MIN_MAGNITUDE:
            allowed = f"at least {describe(MIN_MAGNITUDE, unit)}"
            raise BadValue(
                f"{describe_value(value)}: too small: {allowed} can be taken", allowed=allowed
            )

    def quantity(self, text: object) -> float:
        """A quantity with its unit, in SI, whatever its bounds. Raises MotionError."""
        try:
            return _parse(text, self.unit)
        except BadValue as error:
            told = f"{describe_value(text)}: {error}: {self.example}"
            raise BadValue(told, allowed=self.range_text, nearest=error.nearest) from None

    def _plain(self, name: str, value: float, declared: Mapping[str, float]) -> float:
        try:
            number = float(value) * declared.get(name, 1.0)
        except OverflowError:  # an integer beyond any float
            number = inf
        if not isfinite(number):
            raise BadValue(f"{describe_value(value)}: not a finite number", allowed=self.range_text)
        if name not in declared:
            unit = everyday_unit(self.unit)
            remedy = f'add the line {name} = "{unit}" at the top, or write "{describe_value(value)} {unit}"'
            raise BadValue(
                f"{describe_value(value)}: a number without a unit: {remedy}",
                allowed=self.range_text,
            )
        return number

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> "CoreSchema":
        from pydantic_core import core_schema

        from kinematics.foundation.errors import validation_error

        def validate(value: object, info: core_schema.ValidationInfo[Any]) -> float:
            try:
                return self.read(value, info.context or {})
            except MotionError as error:
                raise validation_error(error) from None

        return core_schema.with_info_plain_validator_function(validate)


Length = Annotated[float, Unit("m")]
Dimension = Annotated[float, Unit("m", plain="length", unit_written=True)]
"""A length of a machine's geometry, also as a plain number in the unit that the file declares."""
Angle = Annotated[float, Unit("rad")]
Duration = Annotated[float, Unit("s")]
Speed = Annotated[float, Unit("m/s")]
Acceleration = Annotated[float, Unit("m/s^2")]
Jerk = Annotated[float, Unit("m/s^3")]
AngularSpeed = Annotated[float, Unit("rad/s")]


def describe_value(value: object) -> str:
    """A value of a file as a message shows it: one line, of bounded length, nothing that a terminal
    would obey.
    """
    text = _describe_raw(value)
    return text if len(text) <= MAX_LENGTH else f"{text[:40]} ..."


def _describe_raw(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return f'"{repr(value)[1:-1]}"'
        case tuple() | list():
            return f"[{', '.join(map(describe_value, value[:MAX_LENGTH]))}]"
        case dict():
            return (
                "{ "
                + ", ".join(
                    f"{key} = {describe_value(entry)}"
                    for key, entry in [*value.items()][:MAX_LENGTH]
                )
                + " }"
            )
    try:
        return repr(value)
    except ValueError:  # Python prints no integer of more than 4300 digits
        return "a number of thousands of digits"


def _parse(text: object, unit: str) -> float:
    if isinstance(text, (int, float)) and not isinstance(text, bool):
        raise BadValue("a number without a unit")
    if not isinstance(text, str):
        raise BadValue("not a quantity")
    if len(text) > MAX_LENGTH:
        raise BadValue(f"longer than {MAX_LENGTH} characters")
    stripped = text.strip().replace("μ", "µ")
    if _COMMA.match(stripped):
        raise BadValue("a comma in a number: decimals follow a point, and thousands have no sign")
    number = _NUMBER.match(stripped)
    if number is None:
        raise BadValue("does not begin with a number")
    value, tail = Decimal(number.group()), stripped[number.end() :].strip(" ")
    if not value.is_finite():
        raise BadValue("not a finite number")
    if not tail:
        raise BadValue("a number without a unit")
    if not _UNIT.fullmatch(tail):
        meant = _POWER.sub(r"\1^\2", tail.translate(_SLIPS))
        like = meant if _UNIT.fullmatch(meant) else ""
        raise BadValue(
            f"{describe_value(tail)} is not a unit" + (f', nearest is "{like}"' if like else ""),
            nearest=like,
        )
    (scale, dimension), (_, wanted) = factor(tail, unit), factor(unit)
    if dimension != wanted:
        raise BadValue(f"not convertible to {everyday_unit(unit)}")
    result = float(value * scale)
    if not isfinite(result):
        raise BadValue("too large for a number")
    return result
