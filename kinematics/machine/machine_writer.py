"""Machine files, written: the TOML from which `load_machine` makes the same machine.

Numbers are written so that they are read back as the same floats; turns and directions come back to rounding, since
they are held as matrices and unit vectors, and so do joints about a tool.

The [geometry] tables of machine files, written: one function for each kind.

The tables of what a machine moves, written: gravity, [platform], [legs].
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from math import isfinite, pi
from typing import Any

import numpy as np

from kinematics.analysis.clearance import Disc
from kinematics.files.toml_writer import (
    format_millimetres,
    format_numbers,
    format_quantity,
    format_rows,
    format_vector,
    quote,
)
from kinematics.foundation.errors import MotionError
from kinematics.kinds.hexapod import Hexapod
from kinematics.kinds.legged import Legged
from kinematics.kinds.linkage import Linkage
from kinematics.kinds.traverser import Traverser
from kinematics.kinds.tripod import Tripod
from kinematics.machine.axis import DRIVES, Axis, StepTiming
from kinematics.machine.load import GRAVITY, Body, Load
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose


def geometry(machine: Machine, complete: bool = False) -> tuple[str, Iterator[str]]:
    """The kind of a machine, and the lines of its geometry; complete: with what holds where nothing is said.

    Raises MotionError for what a file cannot say.
    """
    for made, (kind, lines) in _KINDS.items():
        if isinstance(machine, made):
            return kind, lines(machine, complete)
    kinds = ", ".join(kind for kind, _ in _KINDS.values())
    raise MotionError(f"machine {machine.name}: a {type(machine).__name__} is not written; these kinds are: {kinds}")


def _hexapod(machine: Hexapod, complete: bool) -> Iterator[str]:
    yield from _legged(machine, np.zeros(3), complete)


def _tripod(machine: Tripod, complete: bool) -> Iterator[str]:
    yield from _legged(machine, machine.tool, complete)
    if complete or machine.tool.any():
        yield f"tool = {format_millimetres(machine.tool)}"


def _legged(machine: Legged, tool: np.ndarray, complete: bool) -> Iterator[str]:
    """tool (3,): where the machine's own platform frame lies in the file's."""
    for key, points in (("base_joints", machine.base), ("platform_joints", machine.platform + tool)):
        yield f"{key} = {format_rows(format_millimetres(point) for point in points)}"
    yield _home(machine.home)
    for key, rests in (("base_rest", machine.base_rest), ("platform_rest", machine.platform_rest)):
        if complete or (rests != [0.0, 0.0, 1.0]).any():
            yield f"{key} = {format_rows(format_numbers(rest) for rest in rests)}"
    if (machine.max_tilt < pi).any():
        first, last = (format_quantity(machine.max_tilt[k], "rad") for k in (0, -1))
        yield f"max_tilt = [{first}, {last}]"
    if machine.bodies is not None:
        bodies = machine.bodies
        yield f"leg_radius = {format_quantity(bodies.leg_radius, 'mm', 3)}"
        if bodies.leg_ends is not None:
            yield f"leg_ends = {format_quantity(bodies.leg_ends, 'mm', 3)}"
        if bodies.base_disc is not None:
            yield f"base_disc = {_disc(bodies.base_disc, np.zeros(3))}"
        if bodies.platform_disc is not None:
            yield f"platform_disc = {_disc(bodies.platform_disc, tool)}"


def _linkage(machine: Linkage, complete: bool) -> Iterator[str]:
    yield f"base_a = {format_millimetres(machine.base_a)}"
    yield f"base_b = {format_millimetres(machine.base_b)}"
    yield f"offset = {format_quantity(machine.offset, 'mm', 3)}"
    yield f"angle = {format_quantity(machine.angle, 'rad')}"
    yield _home(machine.home)
    if complete or machine.home_q[0] < machine.offset * np.cos(machine.angle):  # else the longer one is meant
        yield f"near = {format_millimetres(machine.home_q)}"


def _traverser(machine: Traverser, complete: bool) -> Iterator[str]:
    yield _home(machine.home)
    if complete or (machine.directions != np.eye(3)).any():
        yield f"directions = {format_rows(format_numbers(direction) for direction in machine.directions)}"
    yield f"length = {format_quantity(machine.characteristic_length, 'mm', 3)}"


def _home(home: Pose) -> str:
    angles = (format_quantity(angle, "rad") for angle in home.rotation.as_euler("XYZ") + 0.0)
    return f"home = {{ to = {format_millimetres(home.translation)}, rotate = [{', '.join(angles)}] }}"


def _disc(disc: Disc, tool: np.ndarray) -> str:
    return (
        f"{{ radius = {format_quantity(disc.radius, 'mm', 3)}, thickness = {format_quantity(disc.thickness, 'mm', 3)}, "
        f"centre = {format_millimetres(np.asarray(disc.centre, float) + tool)}, normal = "
        f"{format_numbers(disc.normal)} }}"
    )


_KINDS: dict[type[Machine], tuple[str, Callable[[Any, bool], Iterator[str]]]] = {
    Hexapod: ("hexapod", _hexapod),
    Tripod: ("tripod", _tripod),
    Linkage: ("linkage", _linkage),
    Traverser: ("traverser", _traverser),
}
"""An arm's geometry is its URDF, which stays as it is: only the axes of its file could change."""


def gravity(load: Load, complete: bool = False) -> Iterator[str]:
    if complete or tuple(load.gravity) != GRAVITY:
        yield f"gravity = {format_vector(load.gravity, 'm/s^2')}"


def load(machine: str, stated: Load) -> Iterator[str]:
    """As far as the machine states any. Raises MotionError for legs that differ."""
    if stated.platform.mass > 0 or stated.wrench.any():
        yield from ("", "[platform]", *(f"{key} = {text}" for key, text in _body(stated.platform)))
        yield f"force = {format_vector(stated.wrench[:3], 'N')}"
        yield f"moment = {format_vector(stated.wrench[3:], 'N*m')}"
    if len(stated.legs) > 1:
        raise MotionError(f"machine {machine}: legs of different masses have no place in a machine file")
    for leg in stated.legs:
        yield from ("", "[legs]")
        for name, body in (("barrel", leg.barrel), ("rod", leg.rod)):
            yield f"{name} = {{ {', '.join(f'{key} = {text}' for key, text in _body(body))} }}"
        if leg.first_axis is not None:
            yield f"first_axis = {format_numbers(leg.first_axis)}"


def _body(body: Body) -> Iterator[tuple[str, str]]:
    yield "mass", format_quantity(body.mass, "kg")
    yield "centre", format_millimetres(body.centre)
    yield "inertia", f"[{', '.join(format_vector(row, 'kg*m^2') for row in body.inertia)}]"


# The unit in which a field is written, and its power of ten from SI: of linear axes, and of rotary ones.
_UNITS = {
    "travel": (("mm", 3), ("rad", 0)),
    "pulse": (("um", 6), ("rad", 0)),
    "max_speed": (("mm/s", 3), ("rad/s", 0)),
    "max_acceleration": (("mm/s^2", 3), ("rad/s^2", 0)),
    "max_jerk": (("mm/s^3", 3), ("rad/s^3", 0)),
    "max_force": (("N", 0), ("N*m", 0)),
    "max_pulse_rate": (("1/s", 0), ("1/s", 0)),
    "friction": (("N*s/m", 0), ("N*m*s/rad", 0)),
    "reflected": (("kg", 0), ("kg*m^2", 0)),
    "backlash": (("mm", 3), ("rad", 0)),
    "take_up_acceleration": (("mm/s^2", 3), ("rad/s^2", 0)),
    "resonance_time": (("ms", 3), ("ms", 3)),
}
# Fields of points: the fields whose units their first and second numbers have.
_POINTS = {
    "torque_speed": ("max_speed", "max_force"),
    "lead_error": ("travel", "travel"),
    "resonance": ("max_speed", "max_speed"),
}

_SKIPPED_FIELDS = ("name", "kind", "card", "channel")


def machine_toml(machine: Machine, comment: str = "", *, complete: bool = False) -> str:
    """The TOML text of a machine, with explicit joint centres, after the lines of a comment.

    complete  with the keys that say what holds without them too

    Raises MotionError for what machine files cannot say: an arm's URDF, unlimited travel of a slide, other names of
    axes than the kind has.
    """
    kind, own = geometry(machine, complete)
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += ["schema = 1", f'kind = "{kind}"', *gravity(machine.load, complete), "", "[geometry]", *own]
    lines += [*_axes(machine, kind, complete), *load(machine.name, machine.load)]
    return "\n".join(lines) + "\n"


def _axes(machine: Machine, kind: str, complete: bool) -> Iterator[str]:
    """What most axes of a kind share, then what each has of its own."""
    from kinematics.kinds.hexapod import LEGS
    from kinematics.kinds.linkage import NAMES
    from kinematics.kinds.traverser import ROTARY, SLIDES
    from kinematics.kinds.tripod import ARMS

    known = {"hexapod": LEGS, "tripod": ARMS, "linkage": NAMES, "traverser": (*SLIDES, ROTARY)}[kind]
    names = tuple(axis.name for axis in machine.axes)
    if names != tuple(known):
        raise MotionError(
            f"machine {machine.name}: its axes are called {', '.join(names)}; in a file of a {kind} "
            f"they are {', '.join(known)}: name them so"
        )
    for table, sort in (("axes", "linear"), ("rotary", "rotary")):
        chosen = [axis for axis in machine.axes if axis.kind == sort]
        if chosen:
            yield from ("", f"[{table}]", *_tables(machine.name, chosen, complete))
    wired = [axis for axis in machine.axes if axis.card is not None and axis.channel is not None]
    if wired:
        yield from ("", "[wiring]", *(f"{axis.name} = [{quote(axis.card or '')}, {axis.channel}]" for axis in wired))


def _tables(machine: str, axes: Sequence[Axis], complete: bool) -> Iterator[str]:
    written = [dict(_fields(machine, axis, complete)) for axis in axes]
    # an absent limit cannot be stated for one axis alone, so only keys that all have become common
    shared = [key for key in written[0] if all(key in entry for entry in written)]
    common = {key: Counter(entry[key] for entry in written).most_common(1)[0][0] for key in shared}
    yield from (f"{key} = {text}" for key, text in common.items())
    for axis, entry in zip(axes, written, strict=True):
        own = {key: text for key, text in entry.items() if common.get(key) != text}
        if own:
            yield from ("", "[[axis]]", f'name = "{axis.name}"', *(f"{key} = {text}" for key, text in own.items()))


def _fields(machine: str, axis: Axis, complete: bool) -> Iterator[tuple[str, str]]:
    """Key and text of every field of an axis that says something."""
    for field in fields(axis):
        value = getattr(axis, field.name)
        if field.name in _SKIPPED_FIELDS or value is None:
            continue
        if not complete and field.default in (0, "+", ()) and value == field.default:
            continue
        if field.name == "travel" and not all(map(isfinite, value)):
            if axis.kind == "rotary":
                continue
            raise MotionError(
                f"machine {machine}: axis {axis.name} has unlimited travel, which a machine file cannot say; "
                "give it bounds"
            )
        yield field.name, _text(field.name, value, 0 if axis.kind == "linear" else 1)


def _timing(timing: StepTiming) -> str:
    """By the drive's name where it has one."""
    for name, known in DRIVES.items():
        if known == timing:
            return quote(name)
    times = [f"{name} = {format_quantity(getattr(timing, name), 'us', 6)}" for name in ("high", "low", "setup", "hold")]
    rate = [] if timing.max_rate is None else [f"max_rate = {format_quantity(timing.max_rate, '1/s', 0)}"]
    return f"{{ {', '.join(times + rate)} }}"


def _text(field: str, value: Any, sort: int) -> str:
    """sort: 0 in the units of a linear axis, 1 in those of a rotary one."""
    if isinstance(value, StepTiming):
        return _timing(value)
    if field == "compensate":
        return f"[{', '.join(map(quote, value))}]"
    if field == "pushed":
        return quote(value)
    if field in _POINTS:
        x, y = (_UNITS[unit][sort] for unit in _POINTS[field])
        return f"[{', '.join(f'[{format_quantity(a, *x)}, {format_quantity(b, *y)}]' for a, b in value)}]"
    if field in _UNITS:
        unit = _UNITS[field][sort]
        return format_vector(value, *unit) if isinstance(value, tuple) else format_quantity(value, *unit)
    return f"{value}"
