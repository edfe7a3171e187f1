"""TOML files: their data, with the line on which each key stands, which tomllib itself does not
keep.

Text is bounded, and what is no text is told what it is. Values in SI are written so that they are
read back as the same floats.
"""

import re
import tomllib
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from importlib.resources.abc import Traversable
from json import dumps
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinematics.files.plain_text import describe_control_character
from kinematics.foundation.errors import BadValue, Fault, FileError, MotionError
from kinematics.foundation.names import closest
from kinematics.foundation.units import describe_value

_MARKS = (b"\xff\xfe", b"\xfe\xff")
"""How UTF-16 begins, as a rule."""
_BYTES_PER_NUL = 3
"""One NUL in so many bytes is no text with single bytes for its letters."""


def bytes_of(source: Path | Traversable, most: int) -> bytes:
    """All of a file of at most so many bytes.

    Raises FileError for one that is missing, unreadable or larger.
    """
    file = str(source)
    try:
        with source.open("rb") as stream:
            raw = stream.read(most + 1)
    except (OSError, ValueError) as error:  # ValueError: a path that no file can have
        raise unreadable_error(source, error) from None
    if len(raw) > most:
        raise FileError(file, [Fault("", f"larger than {most >> 20} MB")])
    return raw


def unreadable_error(source: Path | Traversable, error: OSError | ValueError) -> FileError:
    """What to raise of a file that cannot be opened; of one that is missing, with the nearest that
    is there.
    """
    told = getattr(error, "strerror", None) or str(error)
    near = (
        _suggest_file(source)
        if isinstance(error, FileNotFoundError) and isinstance(source, Path)
        else ""
    )
    return FileError(str(source), [Fault("", f"{told}{near}")])


def refuse_utf16(file: str, raw: bytes) -> None:
    """Raise FileError for text that has two bytes for every letter."""
    if raw[:2] in _MARKS or (
        len(raw) > 2 * _BYTES_PER_NUL and raw.count(b"\0") * _BYTES_PER_NUL >= len(raw)
    ):
        raise FileError(file, [Fault("", "UTF-16 text: save it as UTF-8", 1)])


def utf8_fault(raw: bytes, error: UnicodeDecodeError) -> Fault:
    """What is wrong with bytes that are some other text, or none."""
    if b"\0" in raw:  # which no text has
        return Fault("", "a binary file, as of an image or a program: give a text file", 1)
    wrong = f"byte 0x{raw[error.start]:02x}"
    return Fault(
        "", f"not UTF-8 text ({wrong}): save it as UTF-8", raw.count(b"\n", 0, error.start) + 1
    )


def _suggest_file(path: Path) -> str:
    """The clause that names the nearest name in the folder of a file that is not there."""
    if not path.parent.is_dir():
        return f": there is no folder {path.parent}"
    there = {
        entry.stem: entry.name for entry in path.parent.iterdir() if entry.suffix == path.suffix
    }
    near = closest(path.stem, there)
    return f', nearest is "{there[near]}"' if near else ""


MAX_BYTES = 16 * 2**20
"""Size of the largest file that is read."""

Key = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Document:
    """The data of a TOML file (arrays as tuples), and the line of each of its keys."""

    file: str
    data: dict[str, Any]
    lines: Mapping[Key, int]

    def line(self, key: Key) -> int:
        """The line of a key, else of the nearest table or array around it; the first of what is not
        there.
        """
        while key and key not in self.lines:
            key = key[:-1]
        return self.lines.get(key, 1)

    def fault(self, key: Key, told: str | MotionError) -> Fault:
        """What is wrong at a key, with its line; the key path counts arrays from 1, as "segment 2"
        does elsewhere.
        """
        names = (
            f"[{k + 1}]"
            if isinstance(k, int)
            else f".{k if _BARE.fullmatch(k) else describe_value(k)}"
            for k in key
        )
        known = (told.allowed, told.nearest) if isinstance(told, BadValue) else ()
        return Fault(
            "".join(names).removeprefix("."), str(told), self.line(key), self._written(key), *known
        )

    def _written(self, key: Key) -> Any:
        """The value of a key, None for what is not there."""
        value: Any = self.data
        for step in key:
            try:
                value = value[step]
            except (KeyError, IndexError, TypeError):
                return None
        return value


def unify_line_ends(text: str) -> str:
    """Return a text with \\n for CR LF, and for CR CR LF, which a transfer in text mode makes of
    it.

    tomllib replaces CR LF once more, and the text that it accepts must be the text whose lines are
    counted.
    """
    return re.sub(r"\r+\n", "\n", text) if "\r" in text else text


def read(source: Path | Traversable) -> Document:
    """The document in a file.

    Raises FileError: missing, unreadable, too large, not UTF-8, not TOML (with its line).
    """
    file = str(source)
    raw = bytes_of(source, MAX_BYTES)
    refuse_utf16(file, raw)
    text = ""
    try:
        text = unify_line_ends(raw.decode("utf-8-sig"))
        document = Document(file, _to_tuples(tomllib.loads(text)), _Scanner(text).scan())
    except UnicodeDecodeError as error:
        fault = utf8_fault(raw, error)
    except RecursionError:
        fault = Fault("", "tables or arrays nested too deeply")
    except ValueError as error:  # tomllib's own error, or an integer of thousands of digits
        fault = _toml_fault(text, str(error))
    else:
        if faults := [document.fault(key, told) for key, told in _find_controls(document.data, ())]:
            raise FileError(file, faults)
        return document
    raise FileError(file, [fault])


def _find_controls(value: Any, key: Key) -> Iterator[tuple[Key, str]]:
    """Keys and texts with a character that no name has, and a terminal would obey; with what to say
    of it.
    """
    match value:
        case str() if told := describe_control_character(value):
            yield key, told
        case dict():
            for name, entry in value.items():
                if told := describe_control_character(name):
                    yield (*key, name), told
                yield from _find_controls(entry, (*key, name))
        case tuple():
            for k, entry in enumerate(value):
                yield from _find_controls(entry, (*key, k))


_PARSER_MEANINGS = {
    "Illegal character '\\n'": "a text has no closing quote on its line",
    "Unclosed array": "an array has no comma between two entries, or no closing ]",
    "Unclosed inline table": "a table in { } has no comma between two entries, or does not end on its line",
    "Expected newline or end of document": 'text behind a value: a quantity is in quotes, as "30 deg"',
    "Invalid value": 'no value: a text is in quotes, as "30 deg"',
    "Expected '=' after a key in a key/value pair": "no = behind a key",
    "Cannot overwrite a value": "a key appears twice: keep one",
    "Cannot declare": "a table appears twice: keep one",
    "Exceeds the limit": "a number of thousands of digits",
}
"""What the parser's messages mean, by how they begin."""


_DECIMAL_COMMA = re.compile(r"\d,\d")


def _toml_fault(text: str, error: str) -> Fault:
    """The fault of text that is no TOML: with the line that the parser stopped in, behind which it
    looks at nothing.
    """
    place = re.search(r" \(at (?:line (\d+), (column \d+)|end of document)\)$", error)
    said = error[: place.start()] if place else error
    meant = next(
        (meaning for begin, meaning in _PARSER_MEANINGS.items() if said.startswith(begin)), said
    )
    long = re.search(r"\d{4301}", text)
    at = text.count("\n", 0, long.start()) + 1 if long and not place else text.count("\n") + 1
    line = int(place[1]) if place and place[1] else at
    written = text.split("\n")[line - 1].strip()
    where = f" at {place[2]}" if place and place[2] else " at the end of the file" if place else ""
    if said.startswith("Unclosed array") and _DECIMAL_COMMA.search(written):
        meant += "; a decimal comma is written as a point"
    told = f"not TOML{where}: {meant}: {describe_value(written)}; the rest was not checked"
    return Fault("", told, line, written)


def _to_tuples(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _to_tuples(entry) for key, entry in value.items()}
    return tuple(map(_to_tuples, value)) if isinstance(value, list) else value


_SPACE = re.compile(r"(?:[ \t\n]|#[^\n]*)*")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\])*"|\'[^\']*\'', re.DOTALL
)
_SCALAR = re.compile(r"[^,\]}\n#]+")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_STEP = re.compile(rf"[ \t]*({_STRING.pattern}|{_BARE.pattern})[ \t]*", re.DOTALL)


class _Scanner:
    """Finds the line of every key and array entry, in text that tomllib has accepted (which itself
    keeps no places).
    """

    def __init__(self, text: str) -> None:
        self.text, self.at = text, 0
        self.line_ends = [match.start() for match in re.finditer("\n", text)]
        self.lines: dict[Key, int] = {}
        self.lengths: dict[Key, int] = {}  # entries so far of each array of tables

    def scan(self) -> dict[Key, int]:
        table: Key = ()
        while self._skip():
            if self.text[self.at] == "[":
                header, brackets = self.at, 2 if self.text.startswith("[[", self.at) else 1
                self.at += brackets
                table = self._table(self._key(), brackets == 2)
                self.at += brackets
                self._mark(table, header)
            else:
                self._pair(table)
        return self.lines

    def _table(self, steps: Key, array: bool) -> Key:
        """The key of a header's table: every array of tables on the way stands for its newest
        entry.
        """
        key: Key = ()
        for n, step in enumerate(steps, 1):
            key += (step,)
            if array and n == len(steps):
                self.lengths[key] = self.lengths.get(key, 0) + 1
            if key in self.lengths:
                key += (self.lengths[key] - 1,)
        return key

    def _pair(self, table: Key) -> None:
        start = self.at
        key = table + self._key()
        self.at += 1  # the equals sign
        self._mark(key, start)
        self._value(key)

    def _value(self, key: Key) -> None:
        self._skip()
        bracket = self.text[self.at]
        if bracket not in "[{":
            end = _STRING.match(self.text, self.at) or _SCALAR.match(self.text, self.at)
            self.at = end.end() if end else len(self.text)
            return
        self.at += 1
        entry = 0
        while self._skip() not in "]}":
            if bracket == "{":
                self._pair(key)
            else:
                self._mark((*key, entry), self.at)
                self._value((*key, entry))
                entry += 1
            if self._skip() == ",":
                self.at += 1
        self.at += 1

    def _key(self) -> Key:
        steps: list[str] = []
        while step := _STEP.match(self.text, self.at):
            self.at = step.end()
            steps.append(
                tomllib.loads(f"step = {step[1]}")["step"] if step[1][0] in "\"'" else step[1]
            )
            if self.text[self.at] != ".":
                break
            self.at += 1
        return tuple(steps)

    def _skip(self) -> str:
        """The next character after space and comments; empty at the end."""
        space = _SPACE.match(self.text, self.at)
        self.at = space.end() if space else self.at
        return self.text[self.at : self.at + 1]

    def _mark(self, key: Key, at: int) -> None:
        line = bisect_left(self.line_ends, at) + 1
        for n in range(1, len(key) + 1):
            self.lines.setdefault(key[:n], line)


def format_quantity(value: float, unit: str, power: int = 0) -> str:
    """The shortest text of an SI value in a unit 10^power times smaller; exact, as the point only
    moves.
    """
    return f'"{format_decimal(value, power)} {unit}"'


def quote(value: str) -> str:
    """A string; TOML knows the escapes of JSON, but for surrogate pairs, and wants one for DEL
    too.
    """
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
