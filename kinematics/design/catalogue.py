"""Catalogues of actuators and joints: CSV files whose columns carry their units."""

import csv
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from math import inf
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from kinematics.files.toml_document import MAX_BYTES, bytes_of, refuse_utf16, utf8_fault
from kinematics.foundation.errors import Fault, FileError, MotionError
from kinematics.foundation.names import count_noun, nearest
from kinematics.foundation.options import check_arguments, check_fields
from kinematics.foundation.units import (
    describe,
    describe_value,
    everyday_unit,
    quantity,
    unit_value,
)


@dataclass(frozen=True, slots=True)
class Actuator:
    """Catalogue data of a linear actuator, SI; None: not stated.

    name, line        of the part, and of the catalogue's file in which it is
    stroke, speed     m, m/s
    force             N, the largest
    precision         m, the smallest step
    size              m, outer dimensions
    mass              kg, of all its parts
    type              in the catalogue's words
    cost              (lowest, highest) in the catalogue's currency
    Raises MotionError for a property that is not above 0.
    """

    name: str
    line: int
    stroke: float | None = None
    force: float | None = None
    precision: float | None = None
    speed: float | None = None
    size: tuple[float, ...] = ()
    mass: float | None = None
    type: str = ""
    cost: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        _check_part(self)


@dataclass(frozen=True, slots=True)
class Joint:
    """Catalogue data of a spherical or universal joint, SI; None: not stated.

    tilt     rad to each side of its rest axis
    name, line, force, precision, size, mass, type, cost  as of an `Actuator`
    """

    name: str
    line: int
    tilt: float | None = None
    force: float | None = None
    precision: float | None = None
    size: tuple[float, ...] = ()
    mass: float | None = None
    type: str = ""
    cost: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        _check_part(self)


def _check_part(part: Actuator | Joint) -> None:
    """Raise MotionError for a property of a wrong kind, or one that is not above 0."""
    check_fields(part)
    for name, unit in _PROPERTIES.items():
        value = getattr(part, name, None)
        if value is not None and not 0 < value < inf:
            raise MotionError(
                f"{type(part).__name__.lower()} {part.name}: {name} {value} {unit} must be above 0"
            )


@check_arguments()
def load_actuators(path: str | PathLike[str] | None = None) -> tuple[Actuator, ...]:
    """Load actuators from a CSV file, or the bundled catalogue [Sahbaz 2007, Table 3.1].

    Columns: company, model, stroke, force, precision, speed, size, mass, type, cost, in any order;
    a unit follows the name (stroke_mm, speed_mm_s, stroke_in) or the number ("2 in"). An empty cell
    or "-" is not stated. Lines that begin with # are comments.

    Parameters
    ----------
    path
        Of the CSV file. None: the bundled catalogue.

    Returns
    -------
    tuple
        An Actuator for each row, SI.

    Raises
    ------
    FileError
        The file has faults; all of them are told, with line, column, value and unit.
    """
    return tuple(_rows(_source(path, "actuators.csv"), Actuator, {"stroke": "m", "speed": "m/s"}))


@check_arguments()
def load_joints(path: str | PathLike[str] | None = None) -> tuple[Joint, ...]:
    """Load joints from a CSV file, or the bundled catalogue [Sahbaz 2007, Tables 3.4 to 3.6].

    As `load_actuators`, with the columns company, model, tilt, force, precision, size, mass, type,
    cost.

    Parameters
    ----------
    path
        Of the CSV file. None: the bundled catalogue.

    Returns
    -------
    tuple
        A Joint for each row, SI.

    Raises
    ------
    FileError
        The file has faults; all of them are told, with line, column, value and unit.
    """
    return tuple(_rows(_source(path, "joints.csv"), Joint, {"tilt": "rad"}))


Part = TypeVar("Part", bound=Actuator | Joint)

_COMMON = {"force": "N", "precision": "m", "size": "m", "mass": "kg"}
_PROPERTIES = {
    "stroke": "m",
    "speed": "m/s",
    "tilt": "rad",
    "force": "N",
    "precision": "m",
    "mass": "kg",
}
_TEXT_FIELDS = ("company", "model", "type")
_EMPTY_CELLS = ("", "-", "–")
_COST = re.compile(r"(\d+(?:\.\d+)?)(?:\s*[-–]\s*(\d+(?:\.\d+)?))?")


@dataclass(frozen=True, slots=True)
class _Column:
    """A header's cell: the field it fills, the unit of the numbers below it, and how one of them is
    read.
    """

    header: str
    field: str
    unit: str
    read: Callable[[str, "_Column"], Any]


def _source(path: str | PathLike[str] | None, bundled: str) -> Path | Traversable:
    return files("kinematics") / "catalogues" / bundled if path is None else Path(path)


def _rows(source: Path | Traversable, part: type[Part], own: dict[str, str]) -> Iterator[Part]:
    file, lines = str(source), list(_lines(source))
    if not lines:
        raise FileError(
            file,
            [
                Fault(
                    "", "empty: the first line names the columns, e.g. company,stroke_mm,force_N", 1
                )
            ],
        )
    faults: list[Fault] = []
    columns = _columns(lines[0], {**own, **_COMMON}, faults)
    if faults:
        raise FileError(file, faults)
    parts = [_part(line, cells, columns, part, faults) for line, cells in lines[1:]]
    if not parts:
        faults.append(Fault("", "no parts: every line after the first is one part", lines[0][0]))
    if faults:
        raise FileError(file, faults)
    yield from (found for found in parts if found is not None)


def _lines(source: Path | Traversable) -> Iterator[tuple[int, list[str]]]:
    """Line number and stripped cells of every line that is neither empty nor a comment."""
    file = str(source)
    raw = bytes_of(source, MAX_BYTES)
    refuse_utf16(file, raw)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(file, [utf8_fault(raw, error)]) from None
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            yield number, [cell.strip() for cell in next(csv.reader([line], strict=True))]
        except csv.Error as error:
            raise FileError(file, [Fault("", f"not CSV: {error}", number)]) from None


def _columns(
    header: tuple[int, list[str]], units: dict[str, str], faults: list[Fault]
) -> list[_Column]:
    line, cells = header
    found = []
    for cell in cells:
        field, _, suffix = cell.partition("_")
        if field in _TEXT_FIELDS and not suffix:
            found.append(_Column(cell, field, "", lambda text, column: text))
        elif field == "cost":
            found.append(_Column(cell, field, suffix.upper(), _cost))
        elif field in units:
            unit = suffix.replace("_", "/", 1) or ""
            try:
                if unit:
                    unit_value(unit, units[field])
            except MotionError as error:
                faults.append(Fault(cell, f"no unit of a {field}: {error}", line))
            read = {"size": _lengths, "mass": _sum}.get(field, _number)
            found.append(_Column(cell, field, unit, _quantity_reader(units[field], read)))
        else:
            known = (*_TEXT_FIELDS, *units, "cost")
            faults.append(
                Fault(
                    cell,
                    f"unknown column{nearest(field, known)}; columns: {', '.join(known)}",
                    line,
                )
            )
    fields = [column.field for column in found]
    for field in dict.fromkeys(field for field in fields if fields.count(field) > 1):
        faults.append(Fault(field, "two columns of this name: leave one", line))
    if "company" not in fields and not faults:
        faults.append(Fault("company", "missing: the column of the makers' names", line))
    return found


def _part(
    line: int, cells: list[str], columns: list[_Column], part: type[Part], faults: list[Fault]
) -> Part | None:
    if len(cells) != len(columns):
        faults.append(
            Fault(
                "",
                f"{count_noun(len(cells), 'cell')} for {count_noun(len(columns), 'column')}; an empty "
                "cell is not stated",
                line,
            )
        )
        return None
    values: dict[str, Any] = {}
    for cell, column in zip(cells, columns, strict=True):
        if cell in _EMPTY_CELLS:
            continue
        try:
            values[column.field] = column.read(cell, column)
        except MotionError as error:
            faults.append(Fault(column.header, str(error), line))
    name = " ".join(filter(None, [values.pop("company", ""), values.pop("model", "")]))
    if not name:
        faults.append(Fault("company", "empty: every part needs a name", line))
    return part(name=name, line=line, **values)


def _quantity_reader(
    unit: str, read: Callable[[str, str, str], Any]
) -> Callable[[str, _Column], Any]:
    return lambda text, column: read(text, column.unit, unit)


def _number(text: str, plain: str, unit: str) -> float:
    """One positive quantity in SI: a plain number in the column's unit, or with a unit of its
    own.
    """
    try:
        float(text)
    except ValueError:
        written = text
    else:
        if not plain:
            raise MotionError(
                f"{describe_value(text)}: a number without a unit: name it in the column, as stroke_mm"
            )
        written = f"{text} {plain}"
    try:
        value = quantity(written, unit)
    except MotionError as error:
        raise MotionError(f"no number of {plain or everyday_unit(unit)}: {error}") from None
    if not value > 0:
        raise MotionError(
            f"{describe_value(written)} must be above {describe(0.0, plain or everyday_unit(unit))}"
        )
    return value


def _sum(text: str, plain: str, unit: str) -> float:
    """Of a part in several pieces: "740+460"."""
    return sum(_number(piece.strip(), plain, unit) for piece in re.split(r"(?<![eE])\+", text))


def _lengths(text: str, plain: str, unit: str) -> tuple[float, ...]:
    return tuple(_number(piece.strip(), plain, unit) for piece in re.split("[x×]", text))


def _cost(text: str, column: _Column) -> tuple[float, float]:
    match = _COST.fullmatch(text)
    low, high = (float(match[1]), float(match[2] or match[1])) if match else (1.0, 0.0)
    if low > high:
        raise MotionError(
            f"{describe_value(text)} is not a price in {column.unit or 'money'}: write e.g. 120, or a range 1700-2000"
        )
    return low, high
