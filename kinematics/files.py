"""TOML files, read with all their faults in one pass: where each key stands, typed tables, messages with the remedy.

A file's schema is a `Table` whose fields are annotated with what they accept, so that it reads like the file:

    class Leg(Table):
        travel: tuple[Length, Length]
        max_speed: Annotated[float, Unit("m/s", above=0)] | None = None

Key paths in messages count arrays from 1, as "segment 2" does elsewhere.
"""

import re
import tomllib
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import (
    AfterValidator,
    AllowInfNan,
    BaseModel,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    PlainValidator,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from kinematics.errors import Fault, FileError
from kinematics.registry import nearest
from kinematics.units import Unit, shown

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
        """What is wrong at a key, with its line."""
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


class Table(BaseModel):
    """A table of a file: every key known and of its exact type, else a fault that names the nearest or the remedy."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    @model_validator(mode="wrap")
    @classmethod
    def _explain(cls, data: object, handler: ModelWrapValidatorHandler[Self]) -> Self:
        try:
            return handler(data)
        except ValidationError as error:
            explained = [cls._explained(e) for e in error.errors()]
            raise ValidationError.from_exception_data(cls.__name__, explained) from None

    @classmethod
    def _explained(cls, error: ErrorDetails) -> InitErrorDetails:
        """The error in words that only its own table can find, since only it knows its keys; outer tables keep them."""
        keys = {field.alias or name: field for name, field in cls.model_fields.items()}
        last, value = str(error["loc"][-1]) if error["loc"] else "", error["input"]
        match error["type"]:
            case "fault":
                message = error["msg"]
            case "extra_forbidden":
                message = f"unknown key{nearest(last, keys)}; valid keys: {', '.join(keys)}"
            case "missing" if last in keys:
                examples = [unit.example for unit in keys[last].metadata if isinstance(unit, Unit)]
                message = ": ".join(["missing", *(examples or filter(None, [keys[last].description]))])
            case "missing":
                message = "missing: the array is too short"
            case "literal_error":
                expected = error["ctx"]["expected"].replace("'", '"')
                choices = re.findall('"(.*?)"', expected)
                message = f"{shown(value)} is not {expected}{nearest(str(value), choices)}"
            case "model_type" | "tuple_type" as kind:
                message = f"{shown(value)} is not {'a table' if kind == 'model_type' else 'an array'}"
            case _:
                message = f"{shown(value)}: {error['msg'][0].lower()}{error['msg'][1:]}"
        return {"type": wrong(message), "loc": error["loc"], "input": value}


class File(Table):
    """What every file says first."""

    version: Literal[1] = Field(alias="schema", description="write schema = 1")


Model = TypeVar("Model", bound=File)
Rule = Callable[[dict[str, Any]], Iterable[tuple[Key, str]]]


def build(document: Document, model: type[Model], *rules: Rule, plain: Mapping[str, float] | None = None) -> Model:
    """The document as a model; raises FileError with every fault, in the order of the lines.

    rules  find what no single value shows, in the raw data: (key, message) of each fault
    plain  SI value of a number without unit, by the name that `Unit.plain` gives (nothing: such numbers are faults)
    """
    faults = [document.fault(key, message) for rule in rules for key, message in rule(document.data)]
    try:
        made = model.model_validate(document.data, context=plain)
    except ValidationError as error:
        faults += [document.fault(e["loc"], e["msg"]) for e in error.errors()]
    if faults:
        raise FileError(document.file, sorted(faults, key=lambda fault: fault.line or 0))
    return made


def wrong(message: str) -> PydanticCustomError:
    """What a validator raises; the message becomes the fault's."""
    return PydanticCustomError("fault", "{message}", {"message": message})


def not_zero(value: Any) -> Any:
    """Validator of a number or a vector."""
    if not any(value if isinstance(value, tuple) else (value,)):
        raise wrong(f"{shown(value)} must not be zero")
    return value


Number = Annotated[float, AllowInfNan(False)]
Direction = Annotated[tuple[Number, Number, Number], AfterValidator(not_zero)]


_adapter = cache(TypeAdapter[Any])


def chosen(pick: Callable[[Any], Any]) -> PlainValidator:
    """Annotation of a value whose own shape says which type it has to fit: `pick` maps the raw value to that type."""

    def validate(value: object, info: ValidationInfo) -> Any:
        return _adapter(pick(value)).validate_python(value, strict=True, context=info.context)

    return PlainValidator(validate)


def either(*tables: type[Table]) -> PlainValidator:
    """Annotation of a table that is exactly one of the given: the one whose own keys (in no other) are present."""
    counts = Counter(key for table in tables for key in table.model_fields)
    own = {table: [key for key in table.model_fields if counts[key] == 1] for table in tables}

    def pick(value: Any) -> type[Table]:
        given = list(value) if isinstance(value, dict) else own[tables[0]]  # what is no table fits none, and is told so
        present = {table: found for table, keys in own.items() if (found := [key for key in given if key in keys])}
        if len(present) == 1:
            return next(iter(present))
        asked = " or ".join(", ".join(keys) for keys in own.values())
        if present:
            clash = " and ".join(", ".join(keys) for keys in present.values())
            raise wrong(f"{clash} exclude each other: give {asked}")
        unknown = [f"; unknown key {shown(key)}{nearest(key, counts)}" for key in given if key not in counts]
        raise wrong(f"incomplete: give {asked}{''.join(unknown[:1])}")

    return chosen(pick)


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
