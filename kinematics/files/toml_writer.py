"""SI values as the texts of TOML files, which are read back as the same floats."""

from collections.abc import Iterable
from decimal import Decimal
from json import dumps
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def format_quantity(value: float, unit: str, power: int = 0) -> str:
    """The shortest text of an SI value in a unit 10^power times smaller; exact, as the point only moves."""
    return f'"{format_decimal(value, power)} {unit}"'


def quote(value: str) -> str:
    """A string; TOML knows the escapes of JSON, but for surrogate pairs, and wants one for DEL too."""
    return dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def format_decimal(value: float, power: int = 0) -> str:
    """The shortest text of value · 10^power; exact, as the point only moves."""
    number = Decimal(repr(float(value))).scaleb(power).normalize()
    return f"{number:{'' if 0 < abs(number) < 1e-6 else 'f'}}"


def format_millimetres(values: ArrayLike) -> str:
    """An array of lengths."""
    return format_vector(values, "mm", 3)


def format_vector(values: ArrayLike, unit: str, power: int = 0) -> str:
    return f"[{', '.join(format_quantity(value, unit, power) for value in np.asarray(values, float).tolist())}]"


def format_numbers(values: ArrayLike) -> str:
    """An array of numbers without a unit."""
    return f"[{', '.join(repr(value) for value in np.asarray(values, float).tolist())}]"


def format_rows(texts: Iterable[str]) -> str:
    """Arrays, one on each line."""
    return "[" + "".join(f"\n    {text}," for text in texts) + "\n]"


def format_toml(value: Any) -> str:
    """What tomllib has read, as a value on one line: texts, numbers, arrays, tables."""
    if isinstance(value, str):
        return quote(value)
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {format_toml(entry)}' for key, entry in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(format_toml, value))}]"
    return str(value).lower() if isinstance(value, bool) else repr(value)
