"""Tables of a file's keys, made from its schema and written into the page docs/reference/files.md.

    python docs/_ext/file_keys.py

A table stands between two comments, so that a code host shows it as well as the site:

    <!-- file-keys module:Table [module:Class] -->     keys of a table; Class: its docstring explains them
    <!-- kind-keys -->                                  [geometry] of every kind of machine
    <!-- drive-times -->                                the known drives
    <!-- end -->

The values that a key takes come from its annotation, its meaning from its declaration (`kinematics.files.keys`); or, of
a table that sets the fields of another class, from the docstring of that class, in which a line reads `key  meaning`. A
key that nothing explains raises KeyError.
"""

import re
from collections.abc import Collection, Iterator
from importlib import import_module
from inspect import cleandoc
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic_core import PydanticUndefined

from kinematics.files.keys import Chosen
from kinematics.files.schema import TableSchema
from kinematics.foundation.units import Unit, describe, everyday_unit
from kinematics.machine.axis import DRIVES
from kinematics.machine.machine_file import KINDS

LINE = re.compile(r"^((?:\w+, )*\w+) {2,}(\S.*(?:\n {3,}\S.*)*)", re.MULTILINE)
PROBES: tuple[Any, ...] = (0.0, {}, (), ((),), "", (0.0,) * 3, (0.0,) * 6, "1 1/s")
"""Values of every shape, by which a validator that goes by the shape tells what it takes."""


def named(path: str) -> Any:
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)


def meanings(told: Any) -> dict[str, str]:
    """Key -> meaning, from the lines of a docstring."""
    lines = LINE.findall(cleandoc(told.__doc__ or ""))
    return {key: " ".join(text.split()) for keys, text in lines for key in keys.split(", ")}


def takes(kind: Any, metadata: tuple[Any, ...] = ()) -> str:
    """What values an annotation accepts, in words."""
    for mark in metadata:
        if isinstance(mark, Unit):
            return quantity(mark)
    if get_origin(kind) is Annotated:
        return takes(get_args(kind)[0], kind.__metadata__)
    if get_origin(kind) in (Union, UnionType):
        if any(isinstance(part, type) and issubclass(part, TableSchema) for part in get_args(kind)):
            return " or ".join(
                dict.fromkeys(takes(part) for part in get_args(kind) if part is not NoneType)
            )
        if not any(isinstance(mark, Chosen) for mark in metadata):
            return " or ".join(
                dict.fromkeys(takes(part) for part in get_args(kind) if part is not NoneType)
            )
    for mark in metadata:
        if isinstance(mark, Chosen) and (choices := list(dict.fromkeys(probed(mark)))):
            return ", or ".join(choices)
    if get_origin(kind) is Literal:
        return " or ".join(f"`{value!r}`".replace("'", '"') for value in get_args(kind))
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        if parts[-1] is Ellipsis:
            return f"array of {takes(parts[0])}"
        same = len(set(map(takes, parts))) == 1
        return f"{len(parts)} × {takes(parts[0])}" if same else f"[{', '.join(map(takes, parts))}]"
    if get_origin(kind) is dict:
        return f"table of {takes(get_args(kind)[1])}"
    if isinstance(kind, type) and issubclass(kind, TableSchema):
        return "table"
    return {float: "number", int: "whole number", str: "text", bool: "`true` or `false`"}.get(
        kind, ""
    )


def probed(mark: Chosen) -> Iterator[str]:
    """What the types are that are picked for values of every shape."""
    for probe in PROBES:
        try:
            kind = mark.pick(probe)
        except Exception:  # a shape that it refuses
            continue
        if said := takes(kind):
            yield said


def quantity(unit: Unit) -> str:
    bounds = (("above", unit.above), ("at least", unit.least), ("at most", unit.most))
    near = everyday_unit(unit.unit)
    said = [
        f"{word} {describe(bound, near) if bound else 0}"
        for word, bound in bounds
        if abs(bound) < 1e9
    ]
    text = (
        " ".join(['quantity, as `"', unit.like or f"20 {near}", '"`'])
        .replace('`" ', '`"')
        .replace(' "`', '"`')
    )
    return (
        text
        + (f", or number of `{unit.plain}`" if unit.plain else "")
        + (f"; {', '.join(said)}" if said else "")
    )


def unit_in(kind: Any, metadata: tuple[Any, ...] = ()) -> Unit | None:
    """The unit of an annotation, or of the numbers of its array; None where there is none."""
    marks = (*metadata, *getattr(kind, "__metadata__", ()))
    inner = (unit_in(part) for part in get_args(kind))
    return next((mark for mark in marks if isinstance(mark, Unit)), None) or next(
        filter(None, inner), None
    )


def default(field: Any) -> str:
    if field.is_required():
        return "**needed**"
    value = field.default
    if value is PydanticUndefined or value is None or value == () or isinstance(value, TableSchema):
        return ""
    unit = unit_in(field.annotation, tuple(field.metadata))
    if unit is not None:
        near = everyday_unit(unit.unit)
        values = [
            describe(each, near) if each else "0"
            for each in (value if isinstance(value, tuple) else (value,))
        ]
        return ", ".join(values if len(set(values)) > 1 else values[:1])
    if isinstance(value, tuple):
        return f"`{[int(each) for each in value]}`"
    return f"`{str(value).lower() if isinstance(value, bool) else value!r}`".replace("'", '"')


def rows(
    table: type[TableSchema], told: dict[str, str], without: Collection[str] = ()
) -> Iterator[str]:
    """The Markdown table of a schema's keys; raises KeyError for one that nothing explains."""
    yield from ("| key | takes | default | what it is |", "| --- | --- | --- | --- |")
    for name, field in table.model_fields.items():
        key = field.alias or name
        if key not in without:
            taken = takes(field.annotation, tuple(field.metadata))
            cells = (f"`{key}`", taken, default(field), told.get(key) or about(field))
            yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def about(field: Any) -> str:
    if not field.description:
        raise KeyError(f"nothing says what {field} is")
    return str(field.description)


def file_keys(table: str, told: str = "") -> list[str]:
    """Return the lines of the table of one schema, by its name."""
    return list(rows(named(table), meanings(named(told)) if told else {}))


def kind_keys() -> list[str]:
    """Return the [geometry] of each kind of machine, one after the other."""
    lines: list[str] = []
    for kind, (schema, *_) in KINDS.items():
        lines += [f"### geometry of {'an' if kind[0] in 'aeiou' else 'a'} {kind}", ""]
        first, *others = schema.tables_of("geometry")
        lines += [cleandoc(first.__doc__ or ""), "", *rows(first, {}), ""]
        for table in others:
            shared = first.model_fields.keys() & table.model_fields.keys()
            lines += [f"or: {cleandoc(table.__doc__ or '')} The other keys are the same.", ""]
            lines += [*rows(table, {}, shared), ""]
    return lines[:-1]


def drive_times() -> list[str]:
    """Return the table of the drives that machine files may name, with the times that each needs."""
    lines = [
        "| drive | STEP high, at least | STEP low | DIR set-up | DIR hold | pulse rate, at most |"
    ]
    lines.append("|" + " --- |" * 6)
    for name, drive in DRIVES.items():
        times = [f"{1e6 * time:g} us" for time in (drive.high, drive.low, drive.setup, drive.hold)]
        lines.append(f"| {' | '.join([f'`{name}`', *times, f'{drive.rate / 1e3:.4g} kHz'])} |")
    return lines


TABLES = {"file-keys": file_keys, "kind-keys": kind_keys, "drive-times": drive_times}
BLOCK = re.compile(rf"<!-- ({'|'.join(TABLES)})((?: \S+)*) -->\n.*?<!-- end -->", re.DOTALL)
PAGE = Path(__file__).parents[1] / "reference" / "files.md"


def fill(text: str) -> str:
    """Return the text of a page with its tables made anew."""

    def make(block: re.Match[str]) -> str:
        begin = block[0].partition("\n")[0]
        lines = TABLES[block[1]](*block[2].split())
        return "\n".join([begin, "", *lines, "", "<!-- end -->"])

    return BLOCK.sub(make, text)


if __name__ == "__main__":
    PAGE.write_text(fill(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
