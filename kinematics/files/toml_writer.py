"""SI values as the texts of TOML files, which are read back as the same floats.

Files to start from: every key of a table with what it means, those that are not given as comments ready to be used.

A line that begins with # and no blank is a key, or a table, that may be given: without its # it is one.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from json import dumps
from textwrap import wrap
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


MAX_LINE_CHARS, COMMENT_COLUMN, MAX_ROW_CHARS = 120, 40, 88
"""Longest line; where its comment begins; longest array that stays on one line."""


@dataclass(frozen=True, slots=True)
class Key:
    """A key of a file: what it means, and an example as TOML.

    example  None: nothing fits all files, and each has its own
    instead  keys that it takes the place of;  needs  keys that have to be there with it
    """

    name: str
    about: str
    example: str | None = None
    instead: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()

    def lines(self, value: Any = None) -> Iterator[str]:
        """Set to a value, or without one as a comment."""
        if value is None and self.example is None:
            return
        given = value is not None
        about = self.about
        if not given and self.instead:
            some = self.instead if len(self.instead) <= 3 else (self.instead[0], "…", self.instead[-1])
            about += f"; instead of {', '.join(some)}"
        if not given and self.needs:
            about += f"; with {', '.join(self.needs)}"
        text = format_toml(value) if given else str(self.example)
        line = f"{'' if given else '#'}{self.name} = {text}"
        if len(text) > MAX_ROW_CHARS and isinstance(value, list):
            yield from _comment(about)
            yield f"{self.name} = ["
            yield from (f"    {format_toml(row)}," for row in value)
            yield "]"
        elif len(told := f"{line:<{COMMENT_COLUMN}}  # {about}") <= MAX_LINE_CHARS:
            yield told
        else:
            yield from (*_comment(about), line)


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in wrap(text, MAX_LINE_CHARS - 2)]


def table_lines(header: str, keys: Sequence[Key], data: Mapping[str, Any] | None, about: str = "") -> Iterator[str]:
    """A table by its header, such as "[axes]", its keys in order; of one that is not given (None) all as comments."""
    yield from ("", *([f"# {about}"] if about else []))
    if header:
        yield f"{'#' if data is None else ''}{header}"
    given = data or {}
    for key in keys:
        yield from key.lines(given.get(key.name))
