"""What every result can do: print itself as tables, draw itself, become a data frame, and be saved."""

from __future__ import annotations

import csv
import io
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.destination import Destination
from kinematics.errors import MotionError
from kinematics.registry import nearest
from kinematics.table import Table

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


class Result(ABC):
    """A result: it states its `tables` and draws itself by `plot`; the rest follows from these.

    A terminal prints the tables, a notebook shows them; `to_pandas` gives `data()`, raw and in SI, and `save` writes.
    """

    __slots__ = ()

    @abstractmethod
    def tables(self) -> tuple[Table, ...]:
        """What it tells, the main thing first."""

    @abstractmethod
    def plot(self, ax: Axes | None = None) -> Axes:
        """The figure that tells most of it, on `ax` or a figure of its own; the axes, which a notebook shows."""

    def data(self) -> Table:
        """The table that `to_pandas` gives and CSV holds: the first one, or a series over time."""
        return self.tables()[0]

    def files(self) -> Mapping[str, Callable[[Path], None]]:
        """How it is written, by the suffix of the file."""
        return {".csv": self._csv, ".json": self._json}

    def __str__(self) -> str:
        return "\n\n".join(map(str, self.tables()))

    def _repr_mimebundle_(self, **_: Any) -> dict[str, str]:
        """In IPython, and beside a notebook's HTML, the tables instead of the fields.

        `_repr_pretty_` would not do: IPython prefers the __repr__ that a dataclass gets.
        """
        return {"text/plain": str(self)}

    def _repr_html_(self) -> str:
        return "".join(table._repr_html_() for table in self.tables())

    def to_pandas(self) -> pd.DataFrame:
        """`data()` as a frame: raw SI values, units in the columns' names.

        Raises MotionError where pandas is not installed.
        """
        return self.data().to_pandas()

    def save(self, path: str | PathLike[str], *, force: bool = False) -> None:
        """Write a file, whole or not at all; its suffix says what: .csv holds `data()`, .json all tables.

        Some results have others, or more of them. Raises MotionError for a suffix that the result does not have, a
        file that is there already (unless forced), and a folder that is not.
        """
        place, known = Path(path), self.files()
        what = f"save {place}"
        if place.suffix not in known:
            raise MotionError(
                f'{what}: "{place.suffix}" is no suffix of what a {type(self).__name__} is saved as'
                f"{nearest(place.suffix, known)}; there are {', '.join(known)}"
            )
        if not place.parent.is_dir():
            raise MotionError(f"{what}: there is no folder {place.parent}; make it first")
        if place.is_dir():
            raise MotionError(f"{what}: it is a folder; give the name of a file")
        with Destination(place, force=force, remedy="give another name, or force=True to replace it").staged() as file:
            known[place.suffix](file)

    def _csv(self, path: Path) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(self.data().csv_rows())
        path.write_bytes(text.getvalue().encode())

    def _json(self, path: Path) -> None:
        """Numbers as Python's json has them: shortest decimals that read back as the same floats."""
        tables = [
            {
                "title": table.title,
                "columns": [{"name": c.name, "unit": "" if c.mixed else c.unit} for c in table.full],
                "rows": [[_strict(value) for value in row] for row in zip(*(c.raw for c in table.full), strict=True)],
                "notes": list(table.notes),
            }
            for table in self.tables()
        ]
        told = {"result": type(self).__name__, "tables": tables}
        path.write_bytes((json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode())


def _strict(value: Any) -> Any:
    """JSON has no infinities and no NaN: texts, which float() reads."""
    return str(value) if isinstance(value, float) and (value != value or abs(value) == float("inf")) else value
