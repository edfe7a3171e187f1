"""What is plugged in by name: classes that load when they are asked for, with options made from text.

An option is a field of a frozen dataclass that says what it is about.
"""

from collections.abc import Mapping
from dataclasses import Field, field, fields
from importlib import import_module
from typing import Any, get_type_hints

from kinematics.foundation.errors import MotionError, locate_errors
from kinematics.foundation.names import nearest, unknown_name
from kinematics.foundation.units import quantity


def option(default: Any, about: str, unit: str = "") -> Any:
    """A field that the command line offers: what it is about; unit: the SI unit of a quantity, given as "10 ms"."""
    return field(default=default, metadata={"help": about, "unit": unit})


def options(kind: type[Any]) -> dict[str, Field[Any]]:
    """The fields made by `option`, by name."""
    return {field.name: field for field in fields(kind) if "help" in field.metadata}


def read_options(kind: type[Any], given: Mapping[str, str], what: str) -> dict[str, Any]:
    """Values from text: quantities with their unit, else numbers. Raises MotionError, which says what was asked of.

    Unknown names are refused with the nearest.
    """
    known, hints, values = options(kind), get_type_hints(kind), {}
    for name, text in given.items():
        if name not in known:
            offered = ", ".join(known) or "none"
            raise MotionError(f'{what} has no option "{name}"{nearest(name, known)}; its options: {offered}')
        unit = known[name].metadata["unit"]
        try:
            with locate_errors(f"{what}, option {name}"):
                values[name] = quantity(text, unit) if unit else hints[name](text)
        except ValueError:
            number = "a whole number" if hints[name] is int else "a number"
            raise MotionError(f'{what}, option {name}: "{text}" is not {number}') from None
    return values


def split_options(text: str, what: str) -> tuple[str, dict[str, str]]:
    """`name:option=value,option=value` as name and options. Raises MotionError for what is not written so."""
    name, colon, rest = text.partition(":")
    given: dict[str, str] = {}
    for part in rest.split(",") if colon else ():
        key, equals, value = part.partition("=")
        if not equals or key.strip() in given:
            raise MotionError(f'{what} "{text}": write {name}:OPTION=VALUE,OPTION=VALUE, each once')
        given[key.strip()] = value.strip()
    return name.strip(), given


def load_plugin(what: str, table: Mapping[str, str], name: str) -> Any:
    """The class of a name in a table of "module:class". Raises MotionError for an unknown one, with the nearest."""
    if name not in table:
        raise unknown_name(what, name, table)
    module, _, kind = table[name].partition(":")
    return getattr(import_module(module), kind)
