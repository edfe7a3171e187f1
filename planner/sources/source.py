"""The plug point of the formats that programs come in: what a format says of itself, what it reads;
and those by name.

Each is one line of `SOURCES`, loaded when it is asked for. What readers share: a file's text,
bounded, with whatever bytes it has; its faults, gathered in one pass and bounded; and zeros, of
which rounding leaves -0 or 4.3e-16 m.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from kinematics.files import toml_document
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import BadValue, Fault, FileError, MotionError
from kinematics.foundation.options import check_arguments, load_plugin, make_with
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.program.model import Arc, Line, Program, Segment, SegmentStream, Spline

if TYPE_CHECKING:
    from planner.sources.outline import Outline

ZERO_ROUNDING = 1e-15
"""m, and share of a unit vector: no machine tells it from 0."""
_POINTS: dict[type, tuple[str, ...]] = {
    Line: ("to",),
    Arc: ("centre", "normal"),
    Spline: ("through",),
}


def zero_small_numbers(program: Program) -> Program:
    """The same program, its coordinates below LEAST and its negative zeros made 0."""
    if isinstance(program.segments, SegmentStream):  # which does so itself
        return program
    held = [
        (k, getattr(part, name))
        for k, part in enumerate(program.segments)
        for name in _POINTS.get(type(part), ())
    ]
    if not held:
        return program
    flat = np.concatenate([values.ravel() for _, values in held])
    owner = np.repeat([k for k, _ in held], [values.size for _, values in held])
    changed = set(owner[(abs(flat) < ZERO_ROUNDING) & ((flat != 0) | np.signbit(flat))].tolist())
    changed |= {
        k
        for k, part in enumerate(program.segments)
        if isinstance(part, Arc) and 0 < abs(part.rise) < ZERO_ROUNDING
    }
    if not changed:
        return program
    segments = tuple(
        _tidy_part(part) if k in changed else part for k, part in enumerate(program.segments)
    )
    return replace(program, segments=segments)


def zero_segment(part: Segment) -> Segment:
    """The same of one segment."""
    points = [getattr(part, name) for name in _POINTS.get(type(part), ())]
    small = any(
        ((abs(own) < ZERO_ROUNDING) & ((own != 0) | np.signbit(own))).any() for own in points
    )
    return (
        _tidy_part(part)
        if small or (isinstance(part, Arc) and 0 < abs(part.rise) < ZERO_ROUNDING)
        else part
    )


def _tidy_part(part: Segment) -> Segment:
    changes: dict[str, Array | float] = {
        name: _zero_small(getattr(part, name)) for name in _POINTS[type(part)]
    }
    if isinstance(part, Arc) and abs(part.rise) < ZERO_ROUNDING:
        changes["rise"] = 0.0
    return replace(part, **changes)  # type: ignore[arg-type]  # each name has the type of its own field


def _zero_small(values: Array) -> Array:
    return np.where(abs(values) < ZERO_ROUNDING, 0.0, values)


@dataclass(frozen=True, slots=True)
class Imported(Result):
    """What a file was understood to be; what rounding left of zeros in its program is taken away.

    entities  how many of each kind, in the format's own words: {"G1": 120, "G2": 8}
    turned    angles of the tool's orientation that change: of rx, ry and rz
    warnings  what its user has to know: what was left out of the program, or taken to mean
              something
    """

    program: Program
    entities: Mapping[str, int]
    warnings: tuple[str, ...] = ()
    turned: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        object.__setattr__(self, "program", zero_small_numbers(self.program))

    @property
    def outline(self) -> "Outline":
        """Where the tool goes, in the program's frame: its extents and its length, and what there
        is to draw.
        """
        from planner.sources.outline import outline

        return outline(self.program)

    def tables(self) -> tuple[Table, ...]:
        """How many of each kind were read, and the warnings; the segments that became of them."""
        read = (Column("read", [*self.entities]), Column("times", [*self.entities.values()]))
        return Table(
            f"{self.program.name}: what was read", read, tuple(self.warnings)
        ), *self.program.tables()

    def files(self) -> Mapping[str, Callable[[Path], None]]:
        """.toml: the program; .csv and .json: the tables."""
        return {**self.program.files(), ".csv": self._csv, ".json": self._json}


class Source(Protocol):
    """A file format: a frozen dataclass whose fields, made by `option`, are its options.

    The first line of its docstring is what the command's help says of it; the rest states what is
    taken, and how. Registered by one line in planner/sources/source.py.
    """

    suffixes: ClassVar[tuple[str, ...]]

    def read(self, path: Path, /) -> Imported:
        """The program that a file describes.

        Raises FileError with every fault of it (a bounded list, each with its line), MotionError
        for an option that does not fit. What it does not understand is a fault; what it leaves out
        or takes to mean something, a warning.
        """


@runtime_checkable
class Streaming(Protocol):
    """A format whose files may be longer than what is to be held of them."""

    def stream(self, path: Path, /) -> Imported:
        """As `read`, but with segments that are read anew whenever they are asked for."""


SOURCES = {
    "dxf": "planner.sources.dxf:Dxf",
    "gcode": "planner.sources.gcode:Gcode",
    "positions": "planner.sources.positions:Positions",
}
"""Module and class by the name that the command line knows."""


def find_source(name: str) -> type[Source]:
    """The format of a name.

    Raises MotionError for an unknown one, with the nearest and all known ones.
    """
    found: type[Source] = load_plugin("format", SOURCES, name)
    return found


def suffix_formats() -> dict[str, str]:
    """The names of the formats by the suffixes of their files."""
    return {suffix: name for name in SOURCES for suffix in find_source(name).suffixes}


def source_name(path: Path) -> str:
    """The name of the format that a file's suffix stands for.

    Raises MotionError where it stands for none.
    """
    known = suffix_formats()
    if path.suffix.lower() not in known:
        suffixes = ", ".join(f"{suffix} ({name})" for suffix, name in known.items())
        told = (
            f'suffix "{path.suffix}" is not a known format' if path.suffix else "it has no suffix"
        )
        raise MotionError(f"{path}: {told}; give its format, or a known suffix: {suffixes}")
    return known[path.suffix.lower()]


def stream_program(path: Path, source: Source) -> Imported:
    """The program of a file, which of a format that can is not held: its segments are read whenever
    they are asked for.

    All of the file is checked first. Raises FileError with every fault of it.
    """
    return source.stream(path) if isinstance(source, Streaming) else source.read(path)


@check_arguments()
def import_program(
    path: str | PathLike[str], format: str | None = None, **options: Any
) -> Imported:
    """Import a program from a file of another format, with a summary of what was read.

    Parameters
    ----------
    path
        Of the file.
    format
        Its name, as SOURCES has it. None: by the file's suffix.
    options
        The fields of the format's dataclass, in SI units.

    Returns
    -------
    Imported
        The program, what was read, and warnings.

    Raises
    ------
    FileError
        The file has faults; all of them are told.
    MotionError
        The format or an option is unknown.
    """
    name = source_name(Path(path)) if format is None else format
    return make_with(find_source(name), f"format {name}", options).read(Path(path))


MAX_FAULTS = 100
"""Faults that are told; a file with more is another format as a rule, or broken."""


class Faults:
    """The faults of a file, in the order in which they are found.

    unread  whether lines were left out for theirs, so that what seems to be missing may stand there
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self.unread = False
        self._found: list[Fault] = []

    def add(
        self, told: str | MotionError, line: int | None = 1, key: str = "", value: str | None = None
    ) -> None:
        """One fault; key says where on its line, or in which entity, value what stands there.

        Raises FileError where there are too many.
        """
        known = (told.allowed, told.nearest) if isinstance(told, BadValue) else ()
        fault = Fault(key, str(told), line, value, *known)
        if fault in self._found:  # of a line that runs again
            return
        self._found.append(fault)
        if len(self._found) == MAX_FAULTS:
            last = Fault("", f"{MAX_FAULTS} faults; the rest was not checked", line)
            raise FileError(self.file, [*self._found, last])

    @contextmanager
    def collect(self, line: int | None, key: str, value: str) -> Iterator[None]:
        """What is refused inside is one fault."""
        try:
            yield
        except MotionError as told:
            self.add(told, line, key, value)

    def __bool__(self) -> bool:
        return bool(self._found)

    def refuse(self) -> None:
        """Raise FileError if there is any, with the faults in the order of their lines."""
        if self._found:
            raise FileError(self.file, sorted(self._found, key=lambda fault: fault.line or 0))


MAX_BYTES = 64 * 2**20
"""Size of the largest file that is read."""


def read_all_bytes(path: Path) -> bytes:
    """All of a file. Raises FileError for one that is missing, unreadable or too large."""
    return toml_document.bytes_of(path, MAX_BYTES)


def decode_text(path: Path) -> str:
    """Return a file's text with line ends as \\n.

    Bytes that are not UTF-8 become lone surrogates, for its reader to refuse.
    Raises FileError for a file that is missing, unreadable, too large or UTF-16.
    """
    raw = read_all_bytes(path)
    toml_document.refuse_utf16(str(path), raw)
    text = raw.decode("utf-8", "surrogateescape").removeprefix("\ufeff")
    return toml_document.unify_line_ends(text).replace("\r", "\n")
