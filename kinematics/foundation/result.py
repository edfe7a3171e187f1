"""What every result can do: print itself as tables, draw itself, become a data frame, and be saved.

Its figure and its file formats are registered by its type in the modules `figures` and `saving` of
its top-level package. A result imports neither: they stand above it, and are loaded when a figure
or a file is first asked for.
"""

from __future__ import annotations

import csv
import io
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from kinematics.files.atomic_files import Destination, require_folder
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import add_article, nearest
from kinematics.foundation.options import check_arguments
from kinematics.foundation.short_repr import short_repr
from kinematics.foundation.table import Table

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

F = TypeVar("F", bound=Callable[..., Any])
Made = TypeVar("Made")


class _Registry(Generic[Made]):
    """Functions of results, by the type of the result; module: where a top-level package registers
    its own.
    """

    def __init__(self, module: str) -> None:
        self.module = module
        self.functions: dict[type, Callable[..., Made]] = {}

    def register(self, kind: type) -> Callable[[F], F]:
        def register(function: F) -> F:
            self.functions[kind] = function
            return function

        return register

    def find(self, kind: type) -> Callable[..., Made] | None:
        """What is registered for a type or the nearest of its bases; None where nothing is."""
        for base in kind.__mro__:
            self._load(base.__module__.partition(".")[0])
            if base in self.functions:
                return self.functions[base]
        return None

    def _load(self, package: str) -> None:
        try:
            found = find_spec(f"{package}.{self.module}")
        except (ModuleNotFoundError, ValueError):  # a module that is no package, or a script
            return
        if found is not None:
            import_module(f"{package}.{self.module}")


_FIGURES: _Registry[Axes] = _Registry("figures")
_FILES: _Registry[Mapping[str, Callable[[Path], None]]] = _Registry("saving")


def draws(kind: type) -> Callable[[F], F]:
    """Register a function (result, ax=None, **options) -> axes as the figure of a type of
    result.
    """
    return _FIGURES.register(kind)


def saves(kind: type) -> Callable[[F], F]:
    """Register a function result -> {suffix: function of a path} as the file formats of a type of
    result.
    """
    return _FILES.register(kind)


class Result(ABC):
    """A result: it states its `tables` and draws itself by `plot`; the rest follows from these.

    A terminal prints the tables, a notebook shows them; `to_pandas` gives `data()`, raw and in SI,
    and `save` writes.
    """

    __slots__ = ()

    def __init_subclass__(cls, **of: Any) -> None:
        """A short repr, which `dataclass` leaves as it is; of a class that has none of its own."""
        super().__init_subclass__(**of)
        if "__repr__" not in cls.__dict__ and cls.__repr__ in (object.__repr__, short_repr):
            cls.__repr__ = short_repr  # type: ignore[method-assign]

    saved_as: ClassVar[str] = ""
    """What files and messages call it, where that is not the class' name."""

    @abstractmethod
    def tables(self) -> tuple[Table, ...]:
        """What it tells, the main thing first."""

    def plot(self, ax: Axes | None = None, *args: Any, **options: Any) -> Axes:
        """The figure that tells most of it, on `ax` or a figure of its own; the axes, which a
        notebook shows.

        It is the one registered for the type (`kinematics.foundation.result`), which says what
        options it has. Raises MotionError where there is none.
        """
        if ax is not None and not hasattr(ax, "get_figure"):
            raise MotionError(f"plot: ax is {ax!r:.60}; expected axes of Matplotlib, or None")
        draw = _FIGURES.find(type(self))
        if draw is None:
            raise MotionError(
                f"{add_article(self._kind)} has no figure; print it, or draw its data()"
            )
        return draw(self, ax, *args, **options)

    def data(self) -> Table:
        """The table that `to_pandas` gives and CSV holds: the first one, or a series over time."""
        return self.tables()[0]

    def files(self) -> Mapping[str, Callable[[Path], None]]:
        """How it is written, by the suffix: as tables, and as is registered for the type beside
        them or instead.
        """
        saved = _FILES.find(type(self))
        own = saved(self) if saved else {}
        return {**own, ".csv": self._csv, ".json": self._json, **own}

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

    @check_arguments()
    def save(self, path: str | PathLike[str], *, force: bool = False) -> None:
        """Write a file, whole or not at all; its suffix says what: .csv holds `data()`, .json all
        tables.

        Some results have others, or more of them. Raises MotionError for a suffix that the result
        does not have, a file that is there already (unless forced), and a folder that is not.
        """
        place, known = Path(path), self.files()
        what = f"save {place}"
        if place.suffix not in known:
            raise MotionError(
                f'{what}: "{place.suffix}" is no suffix of what {add_article(self._kind)} is saved as'
                f"{nearest(place.suffix, known)}; there are {', '.join(known)}"
            )
        require_folder(what, place)
        with Destination(
            place, force=force, remedy="give another name, or force=True to replace it"
        ).stage() as file:
            known[place.suffix](file)

    @property
    def _kind(self) -> str:
        return self.saved_as or type(self).__name__

    def _csv(self, path: Path) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(self.data().csv_rows())
        path.write_bytes(text.getvalue().encode())

    def _json(self, path: Path) -> None:
        """Numbers as Python's json has them: shortest decimals that read back as the same
        floats.
        """
        tables = [
            {
                "title": table.title,
                "columns": [
                    {"name": c.name, "unit": "" if c.has_row_units else c.unit} for c in table.full
                ],
                "rows": [
                    [_json_value(value) for value in row]
                    for row in zip(*(c.raw for c in table.full), strict=True)
                ],
                "notes": list(table.notes),
            }
            for table in self.tables()
        ]
        told = {"result": self._kind, "tables": tables}
        path.write_bytes(
            (json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()
        )


def _json_value(value: Any) -> Any:
    """JSON has no infinities and no NaN: texts, which float() reads."""
    return (
        str(value)
        if isinstance(value, float) and (value != value or abs(value) == float("inf"))
        else value
    )
