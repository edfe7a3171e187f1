"""Quantities of files and messages: text with a unit on the outside, SI numbers inside.

Angles are a dimension of their own here, so "10 deg/s" is no pulse rate and "3000 1/s" no angular speed.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from math import ceil, floor, inf, isfinite, log10
from typing import TYPE_CHECKING, Annotated, Any

from kinematics.errors import BadValue, MotionError
from kinematics.magnitudes import LEAST, most
from kinematics.unit_table import factor

if TYPE_CHECKING:
    from pydantic_core import CoreSchema

MAX_LENGTH = 80
"""Characters of the longest quantity that is read; the longest sensible ones have about 20."""

EVERY_DIGIT = 17
"""Significant digits by which any two floats differ."""

_DECIMAL = r"(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d{1,3})?(?![\d.])"
_NUMBER = re.compile(rf"[+-]?(?:{_DECIMAL}|(?:nan|inf(?:inity)?)(?![a-z]))", re.ASCII | re.IGNORECASE)
_FACTOR = r"[A-Za-zµ°]+(?:(?:\^|\*\*)-?[1-9])?"
# how people write units that are none here
_SLIPS = str.maketrans({"\\": "/", "²": "^2", "³": "^3", "·": "*", "×": "*"})
_POWER = re.compile(r"([a-z])([2-9])(?![a-z0-9])")
_COMMA = re.compile(r"[+-]?\d+,\d")
_UNIT = re.compile(rf"(?:1 ?/ ?)?{_FACTOR}(?:(?: ?[*/] ?| ){_FACTOR})*")

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
    Raises MotionError for a number without a unit, another dimension, an unknown unit, NaN and infinity. The text is
    matched against a strict pattern first; only its unit ever reaches pint.
    """
    return Unit(unit).quantity(text)


def unit_value(name: object, unit: str) -> float:
    """SI value of one `name`, which must be a unit of the dimension of `unit`: unit_value("mm", "m") is 0.001."""
    if not isinstance(name, str) or len(name) > MAX_LENGTH or not _UNIT.fullmatch(name):
        raise MotionError(f'{shown(name)} is not a unit: write e.g. "{everyday(unit)}"')
    try:
        return _parse(f"1 {name}", unit)
    except BadValue as error:
        raise BadValue(f'{shown(name)}: {error}: write e.g. "{everyday(unit)}"', nearest=error.nearest) from None


def describe(value: float, unit: str) -> str:
    """An SI value in the unit asked for, for messages: describe(0.0508, "mm") is "50.8 mm"."""
    return f"{value / float(factor(unit)[0]):.6g} {unit}"


def at_least(value: float, digits: int = 4) -> str:
    """A positive number that a message advises, rounded up to so many digits: 0.0339801 is "0.03399"."""
    scale = 10.0 ** (digits - 1 - floor(log10(value)))
    return f"{ceil(value * scale) / scale:.{digits}g}"


def apart(*values: float, digits: int = 6) -> tuple[str, ...]:
    """Numbers that a message holds against each other, with so many digits, or as many more as tell them apart.

    A value that is beyond its limit by rounding reads so: apart(5000.0000001, 5000) is "5000.0000001", "5000".
    """
    texts: tuple[str, ...] = ()
    for some in range(digits, EVERY_DIGIT + 1):
        texts = tuple(f"{value:.{some}g}" for value in values)
        if len(set(texts)) == len(set(values)):
            break
    return texts


@dataclass(frozen=True, slots=True)
class Unit:
    """What a float of a file's schema accepts: text with a unit of this dimension, in SI, within bounds.

    above        the value is greater, SI
    least, most  the value is no smaller, no greater, SI
    plain        the file's key that declares the unit of plain numbers ("length"); None: every number needs its own
    like         a usual value, for messages; None: 20 of the everyday unit
    """

    unit: str
    above: float = -inf
    least: float = -inf
    most: float = inf
    plain: str | None = None
    like: str | None = None

    @property
    def example(self) -> str:
        return f'write e.g. "{self.like or f"20 {everyday(self.unit)}"}"'

    @property
    def allowed(self) -> str:
        """The range, in words: "above 0 mm/s"; of what has no bounds, its unit."""
        unit = everyday(self.unit)
        sides = (("above", self.above), ("at least", self.least), ("at most", self.most))
        bounds = " and ".join(f"{side} {describe(bound, unit)}" for side, bound in sides if isfinite(bound))
        return bounds or f"a quantity in {unit}, or in a unit that converts to it"

    def read(self, value: object, declared: Mapping[str, float]) -> float:
        """The value in SI; `declared` holds the SI value of one plain number by name. Raises MotionError."""
        if self.plain is not None and isinstance(value, (int, float)) and not isinstance(value, bool):
            number = self._plain(self.plain, value, declared)
        else:
            number = self.quantity(value)
        if not (number > self.above and self.least <= number <= self.most):
            unit = everyday(self.unit)
            other = isinstance(value, str) and unit not in value and number
            converted = f", which is {describe(number, unit)}," if other else ""
            raise BadValue(f"{shown(value)}{converted} must be {self.allowed}", allowed=self.allowed)
        self._refuse_size(value, number)
        return number

    def _refuse_size(self, value: object, number: float) -> None:
        """What no machine has and no computation bears: too large, or of what must be above 0, too small."""
        unit, largest = everyday(self.unit), most(self.unit)
        if abs(number) > largest:
            allowed = f"at most {describe(largest, unit)}"
            raise BadValue(f"{shown(value)}: too large: {allowed} can be taken", allowed=allowed)
        if self.above == 0 and number < LEAST:
            allowed = f"at least {describe(LEAST, unit)}"
            raise BadValue(f"{shown(value)}: too small: {allowed} can be taken", allowed=allowed)

    def quantity(self, text: object) -> float:
        """A quantity with its unit, in SI, whatever its bounds. Raises MotionError."""
        try:
            return _parse(text, self.unit)
        except BadValue as error:
            told = f"{shown(text)}: {error}: {self.example}"
            raise BadValue(told, allowed=self.allowed, nearest=error.nearest) from None

    def _plain(self, name: str, value: float, declared: Mapping[str, float]) -> float:
        try:
            number = float(value) * declared.get(name, 1.0)
        except OverflowError:  # an integer beyond any float
            number = inf
        if not isfinite(number):
            raise BadValue(f"{shown(value)}: not a finite number", allowed=self.allowed)
        if name not in declared:
            unit = everyday(self.unit)
            remedy = f'add the line {name} = "{unit}" at the top, or write "{shown(value)} {unit}"'
            raise BadValue(f"{shown(value)}: a number without a unit: {remedy}", allowed=self.allowed)
        return number

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> "CoreSchema":
        from pydantic_core import core_schema

        from kinematics.schema import wrong

        def validate(value: object, info: core_schema.ValidationInfo[Any]) -> float:
            try:
                return self.read(value, info.context or {})
            except MotionError as error:
                raise wrong(error) from None

        return core_schema.with_info_plain_validator_function(validate)


Length = Annotated[float, Unit("m")]
Angle = Annotated[float, Unit("rad")]


def shown(value: object) -> str:
    """A value of a file as a message shows it: one line, of bounded length, nothing that a terminal would obey."""
    text = _written(value)
    return text if len(text) <= MAX_LENGTH else f"{text[:40]} ..."


def _written(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return f'"{repr(value)[1:-1]}"'
        case tuple() | list():
            return f"[{', '.join(map(shown, value[:MAX_LENGTH]))}]"
        case dict():
            return "{ " + ", ".join(f"{key} = {shown(entry)}" for key, entry in [*value.items()][:MAX_LENGTH]) + " }"
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
        raise BadValue(f"{shown(tail)} is not a unit" + (f', nearest is "{like}"' if like else ""), nearest=like)
    (scale, dimension), (_, wanted) = factor(tail, unit), factor(unit)
    if dimension != wanted:
        raise BadValue(f"not convertible to {everyday(unit)}")
    result = float(value * scale)
    if not isfinite(result):
        raise BadValue("too large for a number")
    return result
