"""The plug point of the formats that programs come in: what each says of itself, and what it makes of a file."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

from kinematics.result import Result
from kinematics.table import Column, Table
from planner.option import option as option
from planner.program import Program
from planner.sources.outline import Outline, outline
from planner.sources.tidy import tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class Imported(Result):
    """What a file was understood to be; what rounding left of zeros in its program is taken away.

    entities  how many of each kind, in the format's own words: {"G1": 120, "G2": 8}
    warnings  what its user has to know: what was left out of the program, or taken to mean something
    """

    program: Program
    entities: Mapping[str, int]
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "program", tidy(self.program))

    @property
    def outline(self) -> Outline:
        """Where the tool goes, in the program's frame: its extents and its length, and what there is to draw."""
        return outline(self.program)

    def tables(self) -> tuple[Table, ...]:
        """How many of each kind were read, and the warnings; the segments that became of them."""
        read = (Column("read", [*self.entities]), Column("times", [*self.entities.values()]))
        return Table(f"{self.program.name}: what was read", read, tuple(self.warnings)), *self.program.tables()

    def files(self) -> Mapping[str, Callable[[Path], None]]:
        """.toml: the program; .csv and .json: the tables."""
        return {**self.program.files(), ".csv": self._csv, ".json": self._json}

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """The tool's way in the program's coordinates."""
        return self.program.plot(ax)


class Source(Protocol):
    """A file format: a frozen dataclass whose fields, made by `option`, are its options.

    The first line of its docstring is what the command's help says of it; the rest states what is taken, and how.
    Registered by one line in planner/sources/registry.py.
    """

    suffixes: ClassVar[tuple[str, ...]]

    def read(self, path: Path, /) -> Imported:
        """The program that a file describes.

        Raises FileError with every fault of it (a bounded list, each with its line), MotionError for an option that
        does not fit. What it does not understand is a fault; what it leaves out or takes to mean something, a warning.
        """
