"""Program files, written: the TOML from which `load_program` makes the same program, or a commented
one to start from.

Positions are plain numbers in mm, angles in rad. Lengths are read back within a unit in the last
place, turns and directions to rounding, since they are held as rotations and unit vectors;
everything else as it is.
"""

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from kinematics.files.keys import Key, format_entries, keys_of, short_table_lines, table_lines
from kinematics.files.plain_text import plain_line
from kinematics.files.toml_document import format_decimal
from kinematics.foundation.arrays import Array
from kinematics.foundation.names import find
from kinematics.machine.machine_file import KINDS
from planner.program.model import Curve, Dwell, Program, Segment, Turn
from planner.program.modifiers import CORNER_ANGLE, Blend, Fit, Free, Stop, Trigger
from planner.program.program_file import SEGMENTS, ProgramFile
from planner.program.segment_tables import PathEntry
from planner.program.validation import CAPS

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from kinematics.machine.pose import Pose


def program_toml(
    program: Program, comment: str = "", *, complete: bool = False, source: str = ""
) -> str:
    """Return the TOML text of a program, after the lines of a comment.

    complete  also state the values that hold by default
    source    file of the segments' lines, which a comment of each segment names
    """
    return "\n".join(program_lines(program, comment, complete=complete, source=source)) + "\n"


def program_lines(
    program: Program,
    comment: str = "",
    *,
    complete: bool = False,
    source: str = "",
    segments: Iterable[Segment] | None = None,
) -> Iterator[str]:
    """Yield the lines of `program_toml`, segment by segment: a stream of segments is read once, and
    not held.

    segments  those of the program, if the caller iterates over them too
    """
    yield from (f"# {line}".rstrip() for line in comment.splitlines())
    yield "schema = 1"
    yield from _lines(ProgramFile, _head(program, complete))
    last_name, last, texts = "", dict[str, Any](), list[str]()
    for segment in program.segments if segments is None else segments:
        name = type(segment).__name__.lower()
        entry = next(table for table in SEGMENTS if name in table.model_fields)
        shape: Callable[[Any], Any] = _SHAPES.get(name, _place)
        known = source and segment.line_number is not None
        place = f"  # line {segment.line_number} of {plain_line(source)}" if known else ""
        yield ""
        yield f"[[segment]]{place}"
        yield from _lines(entry, {name: shape(segment)})
        modifiers = _modifiers(segment, complete)
        if (name, modifiers) != (last_name, last):  # most segments state the same as the one before
            last_name, last, texts = name, modifiers, list(_lines(entry, modifiers))
        yield from texts


def _lines(table: Any, values: Mapping[str, Any]) -> Iterator[str]:
    return (f"{name} = {text}" for name, text in format_entries(table, values))


def _head(program: Program, complete: bool) -> dict[str, Any]:
    start = program.start
    ends = {name: getattr(program, name) for name in ("start_speed", "end_speed")}
    return {
        "machine": program.machine,
        "length": "mm",
        "angle": "rad",
        "frame": program.frame,
        "start": None
        if start is None
        else np.concatenate([start.translation, _angles(start.rotation)]),
        "repeat": program.repeat if complete or program.repeat != 1 else None,
        "duration": program.duration,
        **_caps(program),
        **{name: speed if complete or speed else None for name, speed in ends.items()},
        "tool": _frame(program.tool),
        "work": _frame(program.work),
    }


def _modifiers(segment: Segment, complete: bool) -> dict[str, Any]:
    """What a segment says beside its shape."""
    if isinstance(segment, Dwell):
        return {"trigger": segment.trigger and _trigger(segment.trigger)}
    constant: bool | None = getattr(
        segment, "speed_constant", None
    )  # None: a turn, which has no speed to keep
    trigger: Trigger | None = segment.trigger
    free: Free | None = getattr(segment, "free", None)
    return {
        **_caps(segment),
        "speed_constant": constant if complete or constant else None,
        "join": _join(segment.join) if complete or _is_stated(segment.join) else None,
        "trigger": trigger and _trigger(trigger),
        "free": free and {"yaw": free.yaw, "tilt": free.tilt},
    }


def _trigger(trigger: Trigger) -> dict[str, object]:
    return {"name": trigger.name, "at": trigger.at} | (
        {"after_rest": True} if trigger.after_rest else {}
    )


def _caps(of: Program | Segment) -> dict[str, float | None]:
    return {name: getattr(of, name, None) for name in CAPS}


def _is_stated(join: object) -> bool:
    """Return whether a file states the join: any but the stop of a segment without the key."""
    return not isinstance(join, Stop) or join.stated


def _join(join: object) -> str | dict[str, float | None]:
    if isinstance(join, Blend):
        return {"blend": join.tolerance, "angle": join.angle}
    if isinstance(join, Fit):
        corner = None if join.corner == CORNER_ANGLE else join.corner
        return {
            "fit": join.tolerance,
            "angle": join.angle,
            "corner": corner,
            "stop": join.stop or None,
        }
    return type(join).__name__.lower()


def _frame(frame: "Pose | None") -> dict[str, Any] | None:
    return None if frame is None else {"to": frame.translation, "rotate": _angles(frame.rotation)}


def _place(segment: Any) -> dict[str, Any]:
    """Of a line, and of a synchronised move."""
    return {"to": segment.to, "rotate": _angles(segment.rotate)}


def _curve(curve: Curve) -> dict[str, Any]:
    """Formulas in metres or degrees are put into mm and radians, which takes a factor before
    them.
    """
    lengths = [_scale_text(text, format_decimal(curve.length, 3)) for text in curve.position]
    angles = [_scale_text(text, repr(curve.angle)) for text in curve.rotate or ()]
    formulas = dict(zip(("x", "y", "z", "rx", "ry", "rz"), [*lengths, *angles], strict=False))
    return {
        **formulas,
        "from": curve.begin,
        "to": curve.end,
        "constants": dict(curve.constants) or None,
    }


def _scale_text(text: str, factor: str) -> str:
    return text if float(factor) == 1 else f"{factor}*({text})"


def _turn(turn: Turn) -> dict[str, Any]:
    return (
        {"about": turn.about, "angle": turn.angle} if turn.to is None else {"to": _angles(turn.to)}
    )


_SHAPES: dict[str, Callable[[Any], Any]] = {
    "arc": lambda arc: {
        "centre": arc.centre,
        "normal": arc.normal,
        "angle": arc.angle,
        "rise": arc.rise or None,
        "rotate": _angles(arc.rotate),
    },
    "spline": lambda spline: {"through": spline.through, "rotate": _angles(spline.rotate)},
    "curve": _curve,
    "turn": _turn,
    "dwell": lambda dwell: dwell.duration,
}


def _angles(rotation: "Rotation | None") -> Array | None:
    """θx, θy, θz about the moving axes in turn, as Rx · Ry · Rz has them."""
    return None if rotation is None else rotation.as_euler("XYZ")


HEAD = [one for one in keys_of(ProgramFile) if one.name != "segment"]
SHAPES = {
    one.name: one
    for entry in SEGMENTS
    for one in keys_of(entry)
    if one.name not in PathEntry.model_fields
}
"""What a segment is: one of these."""
_ORDER = (
    "speed",
    "acceleration",
    "angular_speed",
    "max_tool_jerk",
    "speed_constant",
    "join",
    "trigger",
)
MODIFIERS = sorted(
    keys_of(PathEntry),
    key=lambda one: _ORDER.index(one.name) if one.name in _ORDER else len(_ORDER),
)
"""What a segment may say beside."""
EXAMPLE_RADIUS = 10
"""mm, of that circle."""


def program_starter(
    machine: str,
    kind: str,
    preset: str | None = None,
    *,
    name: str | None = None,
    short: bool = False,
) -> str:
    """Return a program file for a machine by name or path: segments of a bundled program, or first
    ones for its kind.

    name   of the program; None: that of the file it is written to
    short  only keys that are set; else every key, unset ones as comments

    Raises MotionError for a name that no bundled program has.
    """
    data = (
        _first_segments(kind)
        if preset is None
        else tomllib.loads(find("planner", "program", preset).read_text("utf-8"))
    )
    data = {"length": "mm", "angle": "deg"} | data | {"machine": machine}
    if name is not None:
        data["name"] = name
    segments = (
        f'the segments of the bundled program "{preset}"'
        if preset
        else "a line, a circle and a line back"
    )
    lines = [f"# A program with {segments}: replace them by yours."]
    if short:
        more = (
            "# Further lines under [[segment]] limit its speed and round the corner at its end:",
            '# speed = "20 mm/s"',
            '# join = { blend = "0.05 mm" }',
            "# All keys, with tool, triggers and other segments: pulsepath init all-keys --all",
        )
        return "\n".join([*lines, *_short_tables(data), "", *more]) + "\n"
    lines += [
        "# A line that begins with # and no space is a key or a segment that is not set: remove the # to set it."
    ]
    return "\n".join([*lines, *_tables(data)]) + "\n"


def _short_tables(data: dict[str, Any]) -> Iterator[str]:
    """Yield the set keys of the head and of each segment, with the help of a key where it occurs
    first.
    """
    yield from short_table_lines("", HEAD, data)
    explained: set[str] = set()
    for segment in data["segment"]:
        shape = next(key for name, key in SHAPES.items() if name in segment)
        keys = [
            replace(key, about="") if key.name in explained else key for key in (shape, *MODIFIERS)
        ]
        yield from short_table_lines("[[segment]]", keys, segment)
        explained |= segment.keys()


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
            {"arc": {"centre": [x + EXAMPLE_RADIUS, y, z], "normal": [0, 0, 1], "angle": 360}},
            {"dwell": "0.2 s"},
            {"line": {"to": [0, 0, 0]}},
        ],
    }


def _tables(data: dict[str, Any]) -> Iterator[str]:
    """The head; each segment; every key that a segment may have, once; the kinds of segment that
    there are none of.
    """
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
