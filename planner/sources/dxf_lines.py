"""On which line of a DXF file an entity or a variable of its header stands: ezdxf keeps no places."""

from pathlib import Path

from planner.sources.texts import bytes_of


def line_of(path: Path, code: int, value: str) -> int | None:
    """The first line whose value is this one, behind its group code; None where there is none, as in a binary file.

    A handle stands behind code 5, a variable's name behind 9.
    """
    lines = [line.strip() for line in bytes_of(path).decode("utf-8", "replace").splitlines()]
    for n in range(0, len(lines) - 1, 2):
        if lines[n] == str(code) and lines[n + 1].upper() == value.upper():
            return n + 2
    return None
