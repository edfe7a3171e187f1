"""Tables of results: raw SI values in columns, from which come text, HTML, data frames and files,
all telling the same.

What people read is scaled (mm, µm, °) and rounded; what a data frame or a file holds is not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import zip_longest
from math import ceil, degrees, isfinite, isnan
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from kinematics.files.plain_text import plain, plain_line
from kinematics.foundation.errors import MotionError, NotInstalled

if TYPE_CHECKING:
    import pandas as pd

Scale = Literal["", "human", "milli", "micro"]
SCALES: dict[str, dict[str, tuple[str, float]]] = {
    "": {},
    "human": {"m": ("mm", 1e3), "rad": ("°", degrees(1)), "kg": ("g", 1e3)},
    "milli": {"s": ("ms", 1e3)},
    "micro": {
        "m": ("µm", 1e6),
        "rad": ("µrad", 1e6),
        "m or rad": ("µm or µrad", 1e6),
        "s": ("µs", 1e6),
    },
}
"""What is read instead of an SI unit, and how many of it make one."""
MAX_SHOWN_ROWS = 60
"""Rows that text and HTML show of a longer table: its first and its last."""
MIN_INTEGRAL_FLOAT = 2.0**53
"""From here on all floats are whole numbers: there is nothing to round."""
GAP = "…"


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """One column: its values as they are, in SI, and how they are shown.

    values  numbers, texts, bools, None where there is nothing
    unit    SI, powers as "m/s^2"; or one for each row, which a column then names or the cells do
    form    format of what is shown, after scaling
    up      rounded upwards, so that the text of a bound is a bound too: `form` counts decimals, as
            ".7f"
    words   what is shown instead of some values, by their `str`: {"None": "not stated", "inf":
            "unlimited"}
    right   texts of numbers, aligned as these; whole: never broken over lines, where there is too
            little room
    """

    name: str
    values: Sequence[Any] | np.ndarray
    unit: str | Sequence[str] = ""
    scale: Scale = ""
    form: str = ".6g"
    up: bool = False
    words: Mapping[str, str] = field(default_factory=dict)
    right: bool = False
    whole: bool = False

    def __post_init__(self) -> None:
        alike = self.unit if isinstance(self.unit, str) else tuple(self.unit)
        if not isinstance(alike, str) and len(set(alike)) == 1:
            alike = alike[0]
        object.__setattr__(self, "unit", alike)

    def __len__(self) -> int:
        return len(self.values)

    @property
    def has_row_units(self) -> bool:
        """Its rows have units of their own."""
        return not isinstance(self.unit, str)

    @property
    def numeric(self) -> bool:
        """It holds numbers, or texts of them, and is aligned at the right."""
        if self.right:
            return True
        if isinstance(self.values, np.ndarray):
            return self.values.dtype.kind in "iuf"
        told = [value for value in self.values if value is not None]
        return bool(told) and all(
            isinstance(value, Real) and not isinstance(value, bool) for value in told
        )

    @property
    def raw(self) -> list[Any]:
        """The values as Python's own: full precision, SI."""
        return (
            np.asarray(self.values).tolist()
            if isinstance(self.values, np.ndarray)
            else [*map(_python_number, self.values)]
        )

    @property
    def heading(self) -> str:
        """Name and SI unit, of data frames and files."""
        return f"{self.name} [{self.unit}]" if self.unit and not self.has_row_units else self.name

    @property
    def title(self) -> str:
        """Name and the unit that is shown."""
        unit = "" if self.has_row_units else _shown_unit(str(self.unit), self.scale)[0]
        return plain_line(f"{self.name} ({unit})" if unit else self.name)

    def cell(self, row: int, named: bool = False) -> str:
        """A value as it is read, with its unit where rows have their own and they are to be
        named.
        """
        value, text = _python_number(self.values[row]), self._text(row)
        told = (
            named
            and self.has_row_units
            and text
            and isinstance(value, (int, float))
            and str(value) not in self.words
        )
        return f"{text} {_shown_unit(self.unit[row], self.scale)[0]}".rstrip() if told else text

    def _text(self, row: int) -> str:
        value = _python_number(self.values[row])
        if str(value) in self.words:
            return self.words[str(value)]
        if value is None or isinstance(value, str):
            return plain_line(value or "")
        if isinstance(value, bool):
            return "yes" if value else "no"
        factor = _shown_unit(
            self.unit if isinstance(self.unit, str) else self.unit[row], self.scale
        )[1]
        if isinstance(value, int) and factor == 1:
            return f"{value}"
        number = value * factor
        if not isfinite(number):
            return "–" if isnan(number) else "∞" if number > 0 else "−∞"
        if self.up:
            fine = 10.0 ** int(self.form[1:-1])
            number = ceil(number * fine) / fine if abs(number) < MIN_INTEGRAL_FLOAT else number
        return format(number + 0.0, self.form)  # no −0


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of one length under a title; notes stand below.

    Raises MotionError for columns that do not fit.
    """

    title: str
    columns: tuple[Column, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names, lengths = (
            [column.heading for column in self.columns],
            {len(column) for column in self.columns},
        )
        if len(set(names)) < len(names) or len(lengths) != 1:
            raise MotionError(
                f"table {self.title}: columns {names} need names of their own and one length: {lengths}"
            )
        object.__setattr__(self, "title", plain(self.title))
        object.__setattr__(self, "notes", tuple(map(plain, self.notes)))

    def __len__(self) -> int:
        return len(self.columns[0])

    @property
    def full(self) -> tuple[Column, ...]:
        """With a column of SI units after each stretch of columns whose rows have their own."""
        return tuple(_add_unit_columns(self.columns))

    @property
    def read(self) -> tuple[Column, ...]:
        """The columns that people read: units that rows have in common get one column, others stand
        in the cells.
        """
        return self.columns if self._has_mixed_columns else self.full

    @property
    def _has_mixed_columns(self) -> bool:
        return (
            len({(column.unit, column.scale) for column in self.columns if column.has_row_units})
            > 1
        )

    def cells(self, rows: Sequence[int] | None = None) -> list[list[str]]:
        """Every row, or some, as `read`."""
        shown, named = self.read, self._has_mixed_columns
        return [
            [column.cell(row, named) for column in shown]
            for row in (range(len(self)) if rows is None else rows)
        ]

    def shown_cells(self) -> list[list[str]]:
        """The rows to show: of too many, the first and the last with a gap between."""
        half = MAX_SHOWN_ROWS // 2
        if len(self) <= MAX_SHOWN_ROWS:
            return self.cells()
        gap = [GAP for _ in self.read]
        return [*self.cells(range(half)), gap, *self.cells(range(len(self) - half, len(self)))]

    def __str__(self) -> str:
        rows = [[column.title for column in self.read], *self.shown_cells()]
        lines = _align(rows, [column.numeric for column in self.read])
        return "\n".join([*filter(None, [self.title]), *lines, *self.notes])

    def _repr_html_(self) -> str:
        """In the notebook's own colours, dark or light: nothing is set but lines, alignment and
        room.
        """
        aligned = [
            f"text-align:{'right' if column.numeric else 'left'};padding:0.1em 0.6em"
            for column in self.read
        ]
        head = "".join(
            f'<th style="{style};border-bottom:1px solid currentColor">{escape(column.title)}</th>'
            for style, column in zip(aligned, self.read, strict=True)
        )
        body = "".join(
            "<tr>"
            + "".join(
                f'<td style="{style}">{escape(cell)}</td>'
                for style, cell in zip(aligned, row, strict=True)
            )
            + "</tr>"
            for row in self.shown_cells()
        )
        # a title is as wide as it is: a narrow table would break it
        return (
            '<table style="color:inherit;border-collapse:collapse;font-variant-numeric:tabular-nums">'
            '<caption style="caption-side:top;text-align:left;color:inherit;white-space:nowrap">'
            f"{escape(self.title)}</caption>"
            f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
            + "".join(f"<div>{escape(note)}</div>" for note in self.notes)
        )

    def to_pandas(self) -> pd.DataFrame:
        """The raw values, units in the columns' names.

        Raises MotionError where pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise NotInstalled(
                "to_pandas", "pandas", "notebooks", 'save("name.csv") does without'
            ) from None
        return pd.DataFrame({column.heading: column.raw for column in self.full})

    def csv_rows(self) -> Iterator[list[Any]]:
        """The header and the raw values; nothing where there is nothing."""
        yield [column.heading for column in self.full]
        yield from map(list, zip(*(column.raw for column in self.full), strict=True))


def _add_unit_columns(columns: Sequence[Column]) -> Iterator[Column]:
    """With a column of units after each stretch of columns whose rows share units of their own."""
    for column, following in zip_longest(columns, columns[1:]):
        yield column
        if column.has_row_units and (
            following is None or following.unit != column.unit or following.scale != column.scale
        ):
            named = {unit: _shown_unit(unit, column.scale)[0] for unit in column.unit}
            taken = [
                other for other in columns if other.has_row_units and other.unit != column.unit
            ]
            yield Column(f"unit of {column.name}" if taken else "unit", column.unit, words=named)


def _shown_unit(unit: str, scale: Scale) -> tuple[str, float]:
    """The unit that is read instead of an SI unit, and how many of it make one."""
    head, per, rest = unit.partition("/")
    name, factor = SCALES[scale].get(head, (head, 1.0))
    return f"{name}{per}{rest}".replace("^2", "²").replace("^3", "³"), factor


def _python_number(value: Any) -> Any:
    """Python's own number: bools, ints and floats of numpy are not told from theirs."""
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, Integral):
        return int(value)
    return float(value) if isinstance(value, Real) else value


def _align(rows: Sequence[Sequence[str]], right: Sequence[bool]) -> Iterator[str]:
    """Rows as lines, each cell as wide as its column, some columns from the right."""
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
    for row in rows:
        cells = zip(row, widths, right, strict=True)
        yield "  ".join(
            cell.rjust(width) if far else cell.ljust(width) for cell, width, far in cells
        ).rstrip()
