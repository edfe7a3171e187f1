"""Program files, written: the TOML from which `load_program` makes the same program.

Positions are plain numbers in mm, angles in rad. Lengths are read back within a unit in the last place, turns and
directions to rounding, since they are held as rotations and unit vectors; everything else as it is.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from kinematics.files.toml_writer import format_decimal, format_quantity, quote
from kinematics.foundation.arrays import Array
from kinematics.machine.pose import Pose
from planner.program.model import Arc, Curve, Dwell, Line, Program, Segment, Spline, Synchronised, Turn
from planner.program.modifiers import Blend, Stop

_CAPS = {"speed": ("mm/s", 3), "acceleration": ("mm/s^2", 3), "angular_speed": ("rad/s", 0)}
"""Unit in which a cap is written, and its power of ten from SI."""


def program_toml(program: Program, comment: str = "", *, complete: bool = False) -> str:
    """The TOML text of a program, after the lines of a comment; complete: with what holds where nothing is said."""
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += ["schema = 1", *_head(program, complete)]
    for segment in program.segments:
        lines += ["", "[[segment]]", *_segment(segment, complete)]
    return "\n".join(lines) + "\n"


def _head(program: Program, complete: bool) -> Iterator[str]:
    if program.machine is not None:
        yield f"machine = {quote(program.machine)}"
    yield from ('length = "mm"', 'angle = "rad"', f'frame = "{program.frame}"')
    if program.start is not None:
        yield f"start = {_list([*_millimetres(program.start.translation), *_angles(program.start.rotation)])}"
    if complete or program.repeat != 1:
        yield f"repeat = {program.repeat}"
    if program.duration is not None:
        yield f"duration = {format_quantity(program.duration, 's')}"
    yield from _caps(program)
    for name in ("start_speed", "end_speed"):
        if complete or getattr(program, name):
            yield f"{name} = {format_quantity(getattr(program, name), 'mm/s', 3)}"
    for name, frame in (("tool", program.tool), ("work", program.work)):
        if frame is not None:
            yield f"{name} = {_frame(frame)}"


def _segment(segment: Segment, complete: bool) -> Iterator[str]:
    if isinstance(segment, Dwell):
        yield f"dwell = {format_quantity(segment.duration, 's')}"
        return
    yield from _SHAPES[type(segment)](segment)
    yield from _caps(segment)
    constant: bool | None = getattr(segment, "speed_constant", None)  # None: a turn, which has no speed to keep
    if constant or (complete and constant is not None):
        yield f"speed_constant = {str(constant).lower()}"
    if complete or not isinstance(segment.join, Stop):
        yield f"join = {_join(segment.join)}"
    if segment.trigger is not None:
        yield f"trigger = {{ name = {quote(segment.trigger.name)}, at = {segment.trigger.at!r} }}"
    free = getattr(segment, "free", None)
    if free is not None:
        yield f"free = {{ yaw = {str(free.yaw).lower()}, tilt = {free.tilt!r} }}"


def _line(line: Line) -> Iterator[str]:
    yield f"line = {{ to = {_list(_millimetres(line.to))}{_rotate(line.rotate)} }}"


def _arc(arc: Arc) -> Iterator[str]:
    rise = f", rise = {format_decimal(arc.rise, 3)}" if arc.rise else ""
    yield (
        f"arc = {{ centre = {_list(_millimetres(arc.centre))}, normal = {_list(map(repr, arc.normal.tolist()))}, "
        f"angle = {arc.angle!r}{rise}{_rotate(arc.rotate)} }}"
    )


def _spline(spline: Spline) -> Iterator[str]:
    through = _list(_list(_millimetres(point)) for point in spline.through)
    turned = "" if spline.rotate is None else f", rotate = {_list(_list(_angles(turn)) for turn in spline.rotate)}"
    yield f"spline = {{ through = {through}{turned} }}"


def _curve(curve: Curve) -> Iterator[str]:
    """Formulas in metres or degrees are put into mm and radians, which takes a factor before them."""
    lengths = [_scaled(text, format_decimal(curve.length, 3)) for text in curve.position]
    angles = [_scaled(text, repr(curve.angle)) for text in curve.rotate or ()]
    said = [f"{name} = {quote(text)}" for name, text in zip(("x", "y", "z"), lengths, strict=True)]
    said += [f"{name} = {quote(text)}" for name, text in zip(("rx", "ry", "rz"), angles, strict=False)]
    said += [f"from = {curve.begin!r}", f"to = {curve.end!r}"]
    if curve.constants:
        said.append(f"constants = {{ {', '.join(f'{name} = {value!r}' for name, value in curve.constants)} }}")
    yield f"curve = {{ {', '.join(said)} }}"


def _scaled(text: str, factor: str) -> str:
    return text if float(factor) == 1 else f"{factor}*({text})"


def _turn(turn: Turn) -> Iterator[str]:
    if turn.to is not None:
        yield f"turn = {{ to = {_list(_angles(turn.to))} }}"
    elif turn.about is not None:
        yield f"turn = {{ about = {_list(map(repr, turn.about.tolist()))}, angle = {turn.angle!r} }}"


def _synchronised(move: Synchronised) -> Iterator[str]:
    yield f"synchronised = {{ to = {_list(_millimetres(move.to))}{_rotate(move.rotate)} }}"


_SHAPES: dict[type, Callable[[Any], Iterator[str]]] = {
    Line: _line,
    Arc: _arc,
    Spline: _spline,
    Curve: _curve,
    Turn: _turn,
    Synchronised: _synchronised,
}


def _caps(of: Program | Segment) -> Iterator[str]:
    for name, (unit, power) in _CAPS.items():
        value = getattr(of, name, None)
        if value is not None:
            yield f"{name} = {format_quantity(value, unit, power)}"


def _join(join: object) -> str:
    if not isinstance(join, Blend):
        return '"stop"' if isinstance(join, Stop) else '"through"'
    angle = "" if join.angle is None else f", angle = {join.angle!r}"
    return f"{{ blend = {format_decimal(join.tolerance, 3)}{angle} }}"


def _rotate(rotation: Rotation | None) -> str:
    return "" if rotation is None else f", rotate = {_list(_angles(rotation))}"


def _frame(frame: Pose) -> str:
    return f"{{ to = {_list(_millimetres(frame.translation))}{_rotate(frame.rotation)} }}"


def _angles(rotation: Rotation) -> list[str]:
    """θx, θy, θz about the moving axes in turn, as Rx · Ry · Rz has them."""
    return [repr(angle) for angle in rotation.as_euler("XYZ").tolist()]


def _millimetres(point: Array) -> list[str]:
    return [format_decimal(value, 3) for value in np.asarray(point, float).tolist()]


def _list(texts: Iterator[str] | Sequence[str]) -> str:
    return f"[{', '.join(texts)}]"
