"""One declaration for each key of a file: its annotation says what it takes, `key` what it means
and how it may look.

Reader, writer, file to start from and reference page are derived from it.

In a file to start from, a line that begins with # and no blank is a key, or a table, that may be
given: without its # it is one.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from textwrap import wrap
from types import NoneType
from typing import Annotated, Any, get_args, get_origin

import numpy as np
from pydantic import BaseModel, Field, GetCoreSchemaHandler, TypeAdapter, ValidationInfo
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, core_schema

from kinematics.files.toml_document import (
    format_decimal,
    format_quantity,
    format_rows,
    format_toml,
    quote,
)
from kinematics.foundation.units import Unit

MAX_LINE_CHARS, COMMENT_COLUMN, MAX_ROW_CHARS = 120, 40, 88
"""Longest line; where its comment begins; longest array that stays on one line."""


def key(
    about: str = "",
    example: str = "",
    default: Any = ...,
    *,
    alias: str | None = None,
    remedy: str = "",
    instead: Sequence[str] = (),
    needs: Sequence[str] = (),
) -> Any:
    """The declaration of a key: a field of a `TableSchema`.

    about    what it means
    example  as TOML; empty: nothing fits all files, and each has its own
    default  of the field; without one the key is needed
    alias    the key, where it is no name of a field
    remedy   what to say where it is missing; empty: what its annotation suggests
    instead  keys that it takes the place of;  needs  keys that have to be there with it
    """
    more: dict[str, Any] = {"remedy": remedy, "instead": list(instead), "needs": list(needs)}
    return Field(
        default,
        alias=alias,
        description=about,
        examples=[example] * bool(example),
        json_schema_extra=more,
    )


def remedy_of(field: FieldInfo) -> str:
    """What the declaration of a field says where it is missing."""
    return str(_extra(field).get("remedy", ""))


def _extra(field: FieldInfo) -> Mapping[str, Any]:
    return field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}


@dataclass(frozen=True, slots=True)
class Chosen:
    """Annotation of a value whose own shape says which type it has to fit: `pick` maps the raw
    value to that type.
    """

    pick: Callable[[Any], Any]

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        def validate(value: object, info: ValidationInfo) -> Any:
            return _adapter(self.pick(value)).validate_python(
                value, strict=True, context=info.context
            )

        return core_schema.with_info_plain_validator_function(validate)


_adapter = cache(TypeAdapter[Any])


def format_entries(
    table: type[BaseModel], values: Mapping[str, Any], rows: bool = False
) -> Iterator[tuple[str, str]]:
    """Key and text of the values of a table, in their order, as its schema reads them; of None
    nothing.

    rows  arrays of arrays have each of these on a line of its own
    """
    fields = _fields_of(table)
    for name, value in values.items():
        if value is not None:
            yield (
                name,
                format_value(fields[name].annotation, _tuples(value), fields[name].metadata, rows),
            )


@cache
def _fields_of(table: type[BaseModel]) -> Mapping[str, FieldInfo]:
    """Return the fields of a table by their keys."""
    return {field.alias or name: field for name, field in table.model_fields.items()}


def format_value(kind: Any, value: Any, marks: Sequence[Any] = (), rows: bool = False) -> str:
    """The text of a value (SI) as an annotation, and the marks beside it, have it read."""
    if get_origin(kind) is Annotated:
        kind, marks = get_args(kind)[0], (*kind.__metadata__, *marks)
    for mark in marks:
        if isinstance(mark, Chosen):
            return format_value(mark.pick(value), value, rows=rows)
        if isinstance(mark, Unit):
            return _format_number(mark, value)
    if NoneType in get_args(kind):
        return format_value(
            next(part for part in get_args(kind) if part is not NoneType), value, rows=rows
        )
    if isinstance(value, str):
        return quote(value)
    if isinstance(value, Mapping):
        table = next((part for part in (kind, *get_args(kind)) if isinstance(part, type)), None)
        if table is not None and issubclass(table, BaseModel):
            value = dict(format_entries(table, value))
        else:
            value = {name: format_value(None, entry) for name, entry in value.items()}
        return f"{{ {', '.join(f'{name} = {text}' for name, text in value.items())} }}"
    if isinstance(value, tuple):
        kinds = get_args(kind) or (None, ...)
        kinds = kinds[:1] * len(value) if kinds[-1] is ... else kinds
        texts = [format_value(part, entry) for part, entry in zip(kinds, value, strict=True)]
        return (
            format_rows(texts) if rows and isinstance(value[0], tuple) else f"[{', '.join(texts)}]"
        )
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _format_number(unit: Unit, value: float) -> str:
    name, power = unit.written_unit
    if unit.plain is None or unit.unit_written:
        return format_quantity(value, name, power)
    return format_decimal(value, power) if power else repr(value)


def _tuples(value: Any) -> Any:
    """Arrays and lists as the tuples that a document has."""
    value = value.tolist() if isinstance(value, np.ndarray) else value
    if isinstance(value, Mapping):
        return {name: _tuples(entry) for name, entry in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list | tuple) else value


@dataclass(frozen=True, slots=True)
class Key:
    """A key of a file to start from: see `key`."""

    name: str
    about: str
    example: str = ""
    instead: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()

    def lines(self, value: Any = None) -> Iterator[str]:
        """Set to a value, or without one as a comment."""
        if value is None and not self.example:
            return
        given = value is not None
        about = self.about
        if not given and self.instead:
            some = (
                self.instead if len(self.instead) <= 3 else (self.instead[0], "…", self.instead[-1])
            )
            about += f"; instead of {', '.join(some)}"
        if not given and self.needs:
            about += f"; with {', '.join(self.needs)}"
        text = format_toml(value) if given else self.example
        line = f"{'' if given else '#'}{self.name} = {text}"
        if not about:
            yield line
        elif len(text) > MAX_ROW_CHARS and isinstance(value, list):
            yield from wrap_comment(about)
            yield f"{self.name} = ["
            yield from (f"    {format_toml(row)}," for row in value)
            yield "]"
        elif len(told := f"{line:<{COMMENT_COLUMN}}  # {about}") <= MAX_LINE_CHARS:
            yield told
        else:
            yield from (*wrap_comment(about), line)


def wrap_comment(text: str) -> list[str]:
    """Return the lines of a comment."""
    return [f"# {line}" for line in wrap(text, MAX_LINE_CHARS - 2)]


def keys_of(*tables: type[BaseModel], own_first: bool = False) -> list[Key]:
    """The keys that a schema declares, in order: what it inherits first, or what it declares
    itself.

    Of several schemas, of which a file has one, the keys of each before those that they share; the
    keys of one take the place of those of the others.
    """
    found = [
        {one.name: one for one in map(_declaration(table), _order(table, own_first))}
        for table in tables
    ] or [{}]
    shared = [name for name in found[0] if all(name in each for each in found)]
    own = [[name for name in each if name not in shared] for each in found]
    keys = []
    for k, names in enumerate(own):
        others = tuple(name for n, other in enumerate(own) if n != k for name in other)
        for name in names:
            with_it = tuple(other for other in names if other != name)
            keys.append(replace(found[k][name], instead=others, needs=with_it))
    return [*keys, *(found[0][name] for name in shared)]


def _declaration(table: type[BaseModel]) -> Callable[[str], Key]:
    def declare_key(name: str) -> Key:
        field = table.model_fields[name]
        example = str((field.examples or [""])[0])
        instead, needs = (tuple(_extra(field).get(what, ())) for what in ("instead", "needs"))
        return Key(field.alias or name, field.description or "", example, instead, needs)

    return declare_key


def _order(table: type[BaseModel], own_first: bool) -> list[str]:
    """Names of the fields."""
    inherited = [
        name
        for base in table.__mro__[1:2]
        if issubclass(base, BaseModel)
        for name in base.model_fields
    ]
    if not own_first or not inherited:
        return list(table.model_fields)
    own = [name for name in table.model_fields if name not in inherited]
    return [*own, *_order(table.__mro__[1], own_first)]


def short_table_lines(header: str, keys: Sequence[Key], data: Mapping[str, Any]) -> Iterator[str]:
    """Yield a table with its set keys only, each with the first clause of its help.

    Tables in it that would need a long line, or several, follow as tables of their own.
    """
    yield ""
    if header:
        yield header
    stated = [replace(one, about=one.about.partition(";")[0]) for one in keys if one.name in data]
    nested = [one for one in stated if header.count("[") == 1 and _needs_tables(data[one.name])]
    for one in stated:
        if one not in nested:
            yield from one.lines(data[one.name])
    for one in nested:
        value = data[one.name]
        name = f"{header[1:-1]}.{one.name}"
        yield from ("", *wrap_comment(one.about))
        if isinstance(value, Mapping):
            yield from _nested_lines(f"[{name}]", value)
            continue
        for n, entry in enumerate(value):
            yield from ([""] if n else [])
            yield from _nested_lines(f"[[{name}]]", entry)


def _needs_tables(value: Any) -> bool:
    """Return whether a value is a table, or an array of tables, that does not fit a line each."""
    entries = value if isinstance(value, list) else [value]
    tables = bool(entries) and all(isinstance(entry, Mapping) for entry in entries)
    return tables and any(len(format_toml(entry)) > MAX_ROW_CHARS for entry in entries)


def _nested_lines(header: str, values: Mapping[str, Any]) -> Iterator[str]:
    yield header
    yield from (f"{name} = {format_toml(value)}" for name, value in values.items())


def table_lines(
    header: str, keys: Sequence[Key], data: Mapping[str, Any] | None, about: str = ""
) -> Iterator[str]:
    """A table by its header, such as "[axes]", its keys in order; of one that is not given (None)
    all as comments.
    """
    yield from ("", *([f"# {about}"] if about else []))
    if header:
        yield f"{'#' if data is None else ''}{header}"
    given = data or {}
    for one in keys:
        yield from one.lines(given.get(one.name))
