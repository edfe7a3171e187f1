"""Program files, written: the TOML from which `load_program` makes the same program.

Positions are plain numbers in mm, angles in rad. Lengths are read back within a unit in the last place, turns and
directions to rounding, since they are held as rotations and unit vectors; everything else as it is.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from kinematics.files.keys import format_entries
from kinematics.files.toml_writer import format_decimal
from kinematics.foundation.arrays import Array
from kinematics.machine.pose import Pose
from planner.program.model import Curve, Dwell, Program, Segment, Turn
from planner.program.modifiers import Blend, Free, Stop, Trigger
from planner.program.program_file import SEGMENTS, ProgramFile
from planner.program.validation import CAPS


def program_toml(program: Program, comment: str = "", *, complete: bool = False) -> str:
    """The TOML text of a program, after the lines of a comment; complete: with what holds where nothing is said."""
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += ["schema = 1", *_lines(ProgramFile, _head(program, complete))]
    for segment in program.segments:
        name = type(segment).__name__.lower()
        entry = next(table for table in SEGMENTS if name in table.model_fields)
        shape: Callable[[Any], Any] = _SHAPES.get(name, _place)
        lines += ["", "[[segment]]", *_lines(entry, {name: shape(segment)} | _modifiers(segment, complete))]
    return "\n".join(lines) + "\n"


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
        "start": None if start is None else np.concatenate([start.translation, _angles(start.rotation)]),
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
        return {}
    constant: bool | None = getattr(segment, "speed_constant", None)  # None: a turn, which has no speed to keep
    trigger: Trigger | None = segment.trigger
    free: Free | None = getattr(segment, "free", None)
    return {
        **_caps(segment),
        "speed_constant": constant if complete or constant else None,
        "join": _join(segment.join) if complete or not isinstance(segment.join, Stop) else None,
        "trigger": trigger and {"name": trigger.name, "at": trigger.at},
        "free": free and {"yaw": free.yaw, "tilt": free.tilt},
    }


def _caps(of: Program | Segment) -> dict[str, float | None]:
    return {name: getattr(of, name, None) for name in CAPS}


def _join(join: object) -> str | dict[str, float | None]:
    if isinstance(join, Blend):
        return {"blend": join.tolerance, "angle": join.angle}
    return type(join).__name__.lower()


def _frame(frame: Pose | None) -> dict[str, Any] | None:
    return None if frame is None else {"to": frame.translation, "rotate": _angles(frame.rotation)}


def _place(segment: Any) -> dict[str, Any]:
    """Of a line, and of a synchronised move."""
    return {"to": segment.to, "rotate": _angles(segment.rotate)}


def _curve(curve: Curve) -> dict[str, Any]:
    """Formulas in metres or degrees are put into mm and radians, which takes a factor before them."""
    lengths = [_scaled(text, format_decimal(curve.length, 3)) for text in curve.position]
    angles = [_scaled(text, repr(curve.angle)) for text in curve.rotate or ()]
    formulas = dict(zip(("x", "y", "z", "rx", "ry", "rz"), [*lengths, *angles], strict=False))
    return {**formulas, "from": curve.begin, "to": curve.end, "constants": dict(curve.constants) or None}


def _scaled(text: str, factor: str) -> str:
    return text if float(factor) == 1 else f"{factor}*({text})"


def _turn(turn: Turn) -> dict[str, Any]:
    return {"about": turn.about, "angle": turn.angle} if turn.to is None else {"to": _angles(turn.to)}


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


def _angles(rotation: Rotation | None) -> Array | None:
    """θx, θy, θz about the moving axes in turn, as Rx · Ry · Rz has them."""
    return None if rotation is None else rotation.as_euler("XYZ")
