"""A commented program file to start from: a bundled one's segments, or some for a kind of machine, and every key."""

import tomllib
from collections.abc import Iterator
from typing import Any

from kinematics.files.keys import Key, keys_of, table_lines
from kinematics.foundation.names import find
from kinematics.machine.machine_file import KINDS
from planner.program.program_file import SEGMENTS, ProgramFile
from planner.program.segment_tables import PathEntry

HEAD = [one for one in keys_of(ProgramFile) if one.name != "segment"]
SHAPES = {one.name: one for entry in SEGMENTS for one in keys_of(entry) if one.name not in PathEntry.model_fields}
"""What a segment is: one of these."""
_ORDER = ("speed", "acceleration", "angular_speed", "speed_constant", "join", "trigger")
MODIFIERS = sorted(keys_of(PathEntry), key=lambda one: _ORDER.index(one.name) if one.name in _ORDER else len(_ORDER))
"""What a segment may say beside."""
RADIUS = 10
"""mm, of that circle."""


def program_starter(machine: str, kind: str, preset: str | None = None) -> str:
    """The text for a machine by name or path: the segments of a bundled program, or first ones for its kind.

    Raises MotionError for a name that no bundled program has.
    """
    data = (
        _first_segments(kind)
        if preset is None
        else tomllib.loads(find("planner", "program", preset).read_text("utf-8"))
    )
    data = {"length": "mm", "angle": "deg"} | data | {"machine": machine}
    told = f'with the segments of the bundled program "{preset}"' if preset else "with a line, a circle and a way back"
    lines = [
        f"# A program to start from, {told}: put your own in their place.",
        "# A line that begins with # and no blank is a key, or a segment, that may be given: take the # away.",
    ]
    return "\n".join([*lines, *_tables(data)]) + "\n"


def machine_of(preset: str) -> str | None:
    """The machine that a bundled program names."""
    machine = tomllib.loads(find("planner", "program", preset).read_text("utf-8")).get("machine")
    return None if machine is None else str(machine)


def _first_segments(kind: str) -> dict[str, Any]:
    x, y, z = KINDS[kind][0].first_place
    return {
        "schema": 1,
        "frame": "home",
        "segment": [
            {"line": {"to": [x, y, z]}},
            {"arc": {"centre": [x + RADIUS, y, z], "normal": [0, 0, 1], "angle": 360}},
            {"dwell": "0.2 s"},
            {"line": {"to": [0, 0, 0]}},
        ],
    }


def _tables(data: dict[str, Any]) -> Iterator[str]:
    """The head; each segment; every key that a segment may have, once; the kinds of segment that there are none of."""
    yield from table_lines("", HEAD, data)
    told = False
    for segment in data["segment"]:
        shape = next(key for name, key in SHAPES.items() if name in segment)
        full = not told and shape.name in ("line", "arc", "spline", "curve")
        told = told or full
        keys = [key if full else Key(key.name, key.about) for key in MODIFIERS]
        yield from table_lines("[[segment]]", [shape, *keys], segment)
    for name, key in SHAPES.items():
        if not any(name in segment for segment in data["segment"]):
            yield from table_lines("[[segment]]", [key], None)
