"""Which formats programs come in: one line each, loaded when one is asked for."""

from os import PathLike
from pathlib import Path
from typing import Any

from kinematics.errors import MotionError
from planner.plugged import plugged
from planner.sources.source import Imported, Source

SOURCES = {
    "dxf": "planner.sources.dxf:Dxf",
    "gcode": "planner.sources.gcode:Gcode",
    "positions": "planner.sources.positions:Positions",
}
"""Module and class by the name that the command line knows."""


def find_source(name: str) -> type[Source]:
    """The format of a name. Raises MotionError for an unknown one, with the nearest and all known ones."""
    found: type[Source] = plugged("format", SOURCES, name)
    return found


def source_name(path: Path) -> str:
    """The name of the format that a file's suffix stands for. Raises MotionError where it stands for none."""
    known = {suffix: name for name in SOURCES for suffix in find_source(name).suffixes}
    if path.suffix.lower() not in known:
        suffixes = ", ".join(f"{suffix} ({name})" for suffix, name in known.items())
        told = f'suffix "{path.suffix}" stands for no format' if path.suffix else "no suffix says what it is"
        raise MotionError(f"{path}: {told}; name its format, or give it a suffix that is known: {suffixes}")
    return known[path.suffix.lower()]


def import_program(path: str | PathLike[str], format: str | None = None, **options: Any) -> Imported:
    """The program in a file of another format, and what was understood of the file.

    format   its name, as SOURCES has it; None: by the file's suffix
    options  the fields of the format's dataclass, in SI units
    Raises FileError with every fault of the file; MotionError for an unknown format or option.
    """
    kind = find_source(source_name(Path(path)) if format is None else format)
    try:
        source = kind(**options)
    except TypeError as error:
        raise MotionError(f"format {format or source_name(Path(path))}: {error}") from None
    return source.read(Path(path))
