"""A commented program file to start from: a bundled one's segments, or some for a kind of machine, and every key.

What each key of a program's file means, in the words of the file to start from (`planner.program.program_starter`).
"""

import tomllib
from collections.abc import Iterator
from typing import Any

from kinematics.files.toml_writer import Key, table_lines
from kinematics.foundation.names import find

HEAD = (
    Key("schema", "of this file"),
    Key("machine", "a bundled one by its name, or a file, from this one's folder; --machine says another"),
    Key("length", "unit of the plain numbers below"),
    Key("angle", "likewise; angles are θx, θy, θz about the moving axes in turn"),
    Key("frame", '"home": positions count from the home pose; "base": from the base frame', '"home"'),
    Key("start", "first pose, if not home: x, y, z, or these and three angles", "[0, 0, 0]"),
    Key("repeat", "how often the segments are run", "2"),
    Key("duration", "of the whole, as smoothly as it can; as fast as it can if not stated", '"60 s"'),
    Key("speed", "most of the tool, for segments that state none", '"100 mm/s"'),
    Key("acceleration", "likewise", '"1000 mm/s^2"'),
    Key("angular_speed", "likewise, of its turning", '"30 deg/s"'),
    Key(
        "tool",
        "what is moved, in the platform's frame",
        '{ to = ["0 mm", "0 mm", "10 mm"], rotate = ["0 deg", "0 deg", "0 deg"] }',
    ),
    Key(
        "work",
        "where positions count from, in the frame above",
        '{ to = ["0 mm", "0 mm", "0 mm"], rotate = ["0 deg", "0 deg", "0 deg"] }',
    ),
    Key("start_speed", "of the tool as it sets out; at rest if not stated", '"5 mm/s"'),
    Key("end_speed", "likewise as it arrives", '"5 mm/s"'),
)

_TURNED = "rotate: orientation at its end, kept if not stated"
SHAPES = {
    "line": Key(
        "line", f"straight; {_TURNED}", '{ to = ["10 mm", "0 mm", "25 mm"], rotate = ["0 deg", "0 deg", "3 deg"] }'
    ),
    "arc": Key(
        "arc",
        f"about a centre, right hand about the normal; rise: along the normal in all; {_TURNED}",
        '{ centre = ["0 mm", "0 mm", "25 mm"], normal = [0, 0, 1], angle = "360 deg", rise = "5 mm" }',
    ),
    "spline": Key(
        "spline",
        "smoothly through points; rotate: an orientation for each, kept if not stated",
        '{ through = [["10 mm", "5 mm", "25 mm"], ["0 mm", "10 mm", "25 mm"]] }',
    ),
    "curve": Key(
        "curve",
        "by equations, in the units above, from where the path stands; rx, ry, rz turn it; constants: numbers by name",
        '{ x = "r*cos(t)", y = "r*sin(t)", z = "25", from = 0, to = "2*pi", constants = { r = 10 } }',
    ),
    "turn": Key(
        "turn",
        "on the spot, to an orientation; or { about = [0, 0, 1], angle = 90 }",
        '{ to = ["5 deg", "0 deg", "0 deg"] }',
    ),
    "synchronised": Key(
        "synchronised",
        f"every axis straight to its place, all together: the tool's way is no line; {_TURNED}",
        '{ to = ["10 mm", "0 mm", "25 mm"], rotate = ["0 deg", "0 deg", "3 deg"] }',
    ),
    "dwell": Key("dwell", "a rest", '"0.2 s"'),
}
"""What a segment is: one of these."""

MODIFIERS = (
    Key("speed", "most of the tool along it", '"20 mm/s"'),
    Key("acceleration", "likewise", '"500 mm/s^2"'),
    Key("angular_speed", "likewise, of its turning", '"30 deg/s"'),
    Key("speed_constant", "exactly that speed, between ramps", "true", needs=("speed",)),
    Key(
        "join",
        'to the next segment: "stop" (if not stated), "through" (where it is smooth), or rounded within a tolerance; '
        'angle = "0.1 deg": of the turning too',
        '{ blend = "0.05 mm" }',
    ),
    Key("trigger", "an event; at: its share of the way, 1 (the end) if not stated", '{ name = "camera", at = 0.5 }'),
    Key(
        "free",
        'orientation that the planner may choose: "yaw", the turn about the tool\'s z; tilt: a lean of it as well',
        '{ yaw = true, tilt = "5 deg" }',
    ),
)
"""What a segment may say beside."""


_FIRST_SEGMENTS = {
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
    x, y, z = _FIRST_SEGMENTS[kind]
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
