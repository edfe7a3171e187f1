"""A commented program file to start from: a bundled one's segments, or some for a kind of machine, and every key."""

import tomllib
from collections.abc import Iterator
from typing import Any

from kinematics.commented import Key, table
from kinematics.registry import find
from planner.program_keys import HEAD, MODIFIERS, SHAPES

_BEGIN = {
    "hexapod": (0, 0, 25),
    "tripod": (0, 0, -20),
    "linkage": (0, 20, 0),
    "traverser": (20, 20, 20),
    "arm": (0, 0, 20),
}
"""mm from home where the circle of the first program begins, within the reach of the bundled machines of each kind."""
RADIUS = 10
"""mm, of that circle."""


def program_starter(machine: str, kind: str, preset: str | None = None) -> str:
    """The text for a machine by name or path: the segments of a bundled program, or first ones for its kind.

    Raises MotionError for a name that no bundled program has.
    """
    data = _first(kind) if preset is None else tomllib.loads(find("planner", "program", preset).read_text("utf-8"))
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


def _first(kind: str) -> dict[str, Any]:
    x, y, z = _BEGIN[kind]
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
    yield from table("", HEAD, data)
    told = False
    for segment in data["segment"]:
        shape = next(key for name, key in SHAPES.items() if name in segment)
        full = not told and shape.name in ("line", "arc", "spline", "curve")
        told = told or full
        keys = [key if full else Key(key.name, key.about) for key in MODIFIERS]
        yield from table("[[segment]]", [shape, *keys], segment)
    for name, key in SHAPES.items():
        if not any(name in segment for segment in data["segment"]):
            yield from table("[[segment]]", [key], None)
