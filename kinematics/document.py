"""TOML documents: the data, and the line on which each key stands, which tomllib itself does not keep."""

import re
import tomllib
from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from kinematics.errors import Fault, FileError
from kinematics.units import shown

MAX_BYTES = 16 * 2**20
"""Size of the largest file that is read."""

Key = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Document:
    """The data of a TOML file (arrays as tuples), and the line of each of its keys."""

    file: str
    data: dict[str, Any]
    lines: Mapping[Key, int]

    def line(self, key: Key) -> int | None:
        """The line of a key, else of the nearest table or array around it; None for what is nowhere in the text."""
        while key and key not in self.lines:
            key = key[:-1]
        return self.lines.get(key)

    def fault(self, key: Key, message: str) -> Fault:
        """What is wrong at a key, with its line; the key path counts arrays from 1, as "segment 2" does elsewhere."""
        names = (f"[{k + 1}]" if isinstance(k, int) else f".{k if _BARE.fullmatch(k) else shown(k)}" for k in key)
        return Fault("".join(names).removeprefix("."), message, self.line(key))


def read(source: Path | Traversable) -> Document:
    """The document in a file. Raises FileError: missing, unreadable, too large, not UTF-8, not TOML (with its line)."""
    file = str(source)
    try:
        with source.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a path that no file can have
        raise FileError(file, [Fault("", getattr(error, "strerror", None) or str(error))]) from None
    if len(raw) > MAX_BYTES:
        raise FileError(file, [Fault("", f"larger than {MAX_BYTES >> 20} MB")])
    text, line = "", None
    try:
        text = raw.decode("utf-8-sig").replace("\r\n", "\n")
        return Document(file, _with_tuples(tomllib.loads(text)), _Scanner(text).scan())
    except UnicodeDecodeError as error:
        message, line = "not UTF-8 text", raw.count(b"\n", 0, error.start) + 1
    except RecursionError:
        message = "tables or arrays nested too deeply"
    except ValueError as error:  # tomllib's own error, or an integer of thousands of digits
        message = f"not TOML: {error}"
        if place := re.search(r" \(at (?:line (\d+), column \d+|end of document)\)$", message):
            line = int(place[1] or text.count("\n") + 1)
    raise FileError(file, [Fault("", message, line)])


def _with_tuples(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _with_tuples(entry) for key, entry in value.items()}
    return tuple(map(_with_tuples, value)) if isinstance(value, list) else value


_SPACE = re.compile(r"(?:[ \t\n]|#[^\n]*)*")
_STRING = re.compile(r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\])*"|\'[^\']*\'', re.DOTALL)
_SCALAR = re.compile(r"[^,\]}\n#]+")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_STEP = re.compile(rf"[ \t]*({_STRING.pattern}|{_BARE.pattern})[ \t]*", re.DOTALL)


class _Scanner:
    """Finds the line of every key and array entry, in text that tomllib has accepted (which itself keeps no places)."""

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
        """The key of a header's table: every array of tables on the way stands for its newest entry."""
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
            steps.append(tomllib.loads(f"step = {step[1]}")["step"] if step[1][0] in "\"'" else step[1])
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
