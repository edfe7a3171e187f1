"""The units that files know: what each is in SI, and the nearest one to a mistaken name."""

from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING

from kinematics.errors import BadValue
from kinematics.registry import closest, nearest

if TYPE_CHECKING:
    from pint import UnitRegistry

# Only what machines and programs are measured in: pint's own thousand units would read slips of the pen as quantities.
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
    return UnitRegistry(_DEFINITIONS.strip().splitlines(), non_int_type=Decimal, on_redefinition="raise")


# What pint says of the units that most files use alone: to load and start it takes longer than to read such a file.
_LENGTHS = {"m": "1", "mm": "0.001", "um": "0.000001", "in": "0.0254"}
_ANGLES = {"rad": "1", "deg": "0.01745329251994329576923690768"}
_RATES = {"": "", "/s": " / [time]", "/s^2": " / [time] ** 2", "/s^3": " / [time] ** 3"}
USUAL = {
    f"{unit}{per}": (Decimal(size), f"[{kind}]{rate}")
    for kind, units in (("length", _LENGTHS), ("angle", _ANGLES))
    for unit, size in units.items()
    for per, rate in _RATES.items()
} | {
    "s": (Decimal(1), "[time]"),
    "1/s": (Decimal(1), "1 / [time]"),
    "N": (Decimal(1), "[mass] * [length] / [time] ** 2"),
}


def factor(unit: str, like: str = "") -> tuple[Decimal, str]:
    """(how many SI units one `unit` is, its dimension). MotionError names an unknown unit and the nearest known one.

    like  a unit of the dimension that is wanted: of a single unit, the nearest is sought among those of that dimension
    """
    return USUAL[unit] if unit in USUAL else by_pint(unit, like)


@cache
def by_pint(unit: str, like: str = "") -> tuple[Decimal, str]:
    """The same of any unit."""
    from pint.errors import UndefinedUnitError

    registry = _registry()
    try:
        one = registry.Quantity(Decimal(1), registry.parse_units(unit.replace("°", "deg"))).to_root_units()
    except UndefinedUnitError as error:
        unknown = error.unit_names if isinstance(error.unit_names, str) else next(iter(error.unit_names))
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
    rows = [[word.strip() for word in line.split("=")] for line in _DEFINITIONS.strip().splitlines()]
    words = [[word for word in (row[0], *row[2:]) if word != "_"] for row in rows]
    prefixes = [word.removesuffix("-") for row in words for word in row if word.endswith("-")]
    units = [word for row in words for word in row if not word.endswith("-")]
    # Words join words and symbols symbols: "milli" + "metre", "m" + "m".
    joined = [p + u for p in prefixes for u in units if (len(p) > 1) == (len(u) > 2)]
    return (*units, *joined)
