"""Files to start from: every key of a table with what it means, those that are not given as comments ready to be used.

A line that begins with # and no blank is a key, or a table, that may be given: without its # it is one.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any

from kinematics.toml_text import toml

WIDTH, COLUMN, ROW = 120, 40, 88
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
        text = toml(value) if given else str(self.example)
        line = f"{'' if given else '#'}{self.name} = {text}"
        if len(text) > ROW and isinstance(value, list):
            yield from _comment(about)
            yield f"{self.name} = ["
            yield from (f"    {toml(row)}," for row in value)
            yield "]"
        elif len(told := f"{line:<{COLUMN}}  # {about}") <= WIDTH:
            yield told
        else:
            yield from (*_comment(about), line)


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in wrap(text, WIDTH - 2)]


def table(header: str, keys: Sequence[Key], data: Mapping[str, Any] | None, about: str = "") -> Iterator[str]:
    """A table by its header, such as "[axes]", its keys in order; of one that is not given (None) all as comments."""
    yield from ("", *([f"# {about}"] if about else []))
    if header:
        yield f"{'#' if data is None else ''}{header}"
    given = data or {}
    for key in keys:
        yield from key.lines(given.get(key.name))
