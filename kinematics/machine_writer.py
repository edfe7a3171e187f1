"""Machine files, written: the TOML from which `load_machine` makes the same machine.

Numbers are written so that they are read back as the same floats; turns and directions come back to rounding, since
they are held as matrices and unit vectors.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import fields
from decimal import Decimal
from math import isfinite, pi

import numpy as np

from kinematics.array import Array
from kinematics.axis import Axis
from kinematics.body import Body
from kinematics.clearance import Disc
from kinematics.errors import MotionError
from kinematics.hexapod import Hexapod
from kinematics.load import GRAVITY, Load
from kinematics.machine import Machine

# Power of ten from SI to the unit in which a field is written.
_UNITS = {
    "travel": ("mm", 3),
    "pulse": ("um", 6),
    "max_speed": ("mm/s", 3),
    "max_acceleration": ("mm/s^2", 3),
    "max_jerk": ("mm/s^3", 3),
    "max_force": ("N", 0),
    "max_pulse_rate": ("1/s", 0),
    "friction": ("N*s/m", 0),
    "reflected": ("kg", 0),
}


def machine_toml(machine: Machine, comment: str = "") -> str:
    """The TOML text of a machine, with explicit joint centres, after the lines of a comment.

    Raises MotionError for what machine files cannot say: kinds other than hexapods, unlimited travel.
    """
    if not isinstance(machine, Hexapod):
        raise MotionError(f"machine {machine.name}: only hexapods are written so far, not {type(machine).__name__}")
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += ["schema = 1", 'kind = "hexapod"', *_gravity(machine.load), ""]
    lines += ["[geometry]", *_geometry(machine), "", *_axes(machine), *_load(machine.name, machine.load)]
    return "\n".join(lines) + "\n"


def _geometry(machine: Hexapod) -> Iterator[str]:
    for key, points in (("base_joints", machine.base), ("platform_joints", machine.platform)):
        yield f"{key} = [{_rows(_vector(point, 'mm', 3) for point in points)}]"
    home = machine.home
    angles = [f'"{float(angle)!r} rad"' for angle in home.rotation.as_euler("XYZ") + 0.0]
    yield f"home = {{ to = {_vector(home.translation, 'mm', 3)}, rotate = [{', '.join(angles)}] }}"
    for key, rests in (("base_rest", machine.base_rest), ("platform_rest", machine.platform_rest)):
        if (rests != [0.0, 0.0, 1.0]).any():
            yield f"{key} = [{_rows(_direction(rest) for rest in rests)}]"
    if (machine.max_tilt < pi).any():
        yield f'max_tilt = ["{float(machine.max_tilt[0])!r} rad", "{float(machine.max_tilt[6])!r} rad"]'
    if machine.bodies is not None:
        bodies = machine.bodies
        yield f"leg_radius = {_quantity(bodies.leg_radius, 'mm', 3)}"
        if bodies.leg_ends is not None:
            yield f"leg_ends = {_quantity(bodies.leg_ends, 'mm', 3)}"
        for key, disc in (("base_disc", bodies.base_disc), ("platform_disc", bodies.platform_disc)):
            if disc is not None:
                yield f"{key} = {_disc(disc)}"


def _gravity(load: Load) -> Iterator[str]:
    if tuple(load.gravity) != GRAVITY:
        yield f"gravity = {_vector(load.gravity, 'm/s^2', 0)}"


def _load(machine: str, load: Load) -> Iterator[str]:
    """Tables of what the machine moves, as far as it states any."""
    if load.platform.mass > 0 or load.wrench.any():
        yield from ("", "[platform]", *(f"{key} = {text}" for key, text in _body(load.platform)))
        yield f"force = {_vector(load.wrench[:3], 'N', 0)}"
        yield f"moment = {_vector(load.wrench[3:], 'N*m', 0)}"
    if len(load.legs) > 1:
        raise MotionError(f"machine {machine}: legs of different masses have no place in a machine file")
    for leg in load.legs:
        yield from ("", "[legs]")
        for name, body in (("barrel", leg.barrel), ("rod", leg.rod)):
            yield f"{name} = {{ {', '.join(f'{key} = {text}' for key, text in _body(body))} }}"
        if leg.first_axis is not None:
            yield f"first_axis = {_direction(leg.first_axis)}"


def _body(body: Body) -> Iterator[tuple[str, str]]:
    yield "mass", _quantity(body.mass, "kg", 0)
    yield "centre", _vector(body.centre, "mm", 3)
    yield "inertia", f"[{', '.join(_vector(row, 'kg*m^2', 0) for row in body.inertia)}]"


def _axes(machine: Machine) -> Iterator[str]:
    """What most axes share, then what each has of its own."""
    written = [dict(_fields(machine.name, axis)) for axis in machine.axes]
    # an absent limit cannot be stated for one axis alone, so only keys that all have become common
    shared = [key for key in written[0] if all(key in entry for entry in written)]
    common = {key: Counter(entry[key] for entry in written).most_common(1)[0][0] for key in shared}
    yield "[axes]"
    yield from (f"{key} = {text}" for key, text in common.items())
    for axis, entry in zip(machine.axes, written, strict=True):
        own = {key: text for key, text in entry.items() if common.get(key) != text}
        if own:
            yield from ("", "[[axis]]", f'name = "{axis.name}"', *(f"{key} = {text}" for key, text in own.items()))


def _fields(machine: str, axis: Axis) -> Iterator[tuple[str, str]]:
    """Key and text of every field of an axis that says something."""
    for field in fields(axis):
        value = getattr(axis, field.name)
        if field.name in ("name", "kind") or value is None or (field.default == 0 and value == 0):
            continue
        if field.name == "direction":
            yield field.name, f"{value}"
        elif field.name == "torque_speed":
            points = (f"[{_quantity(v, 'mm/s', 3)}, {_quantity(f, 'N', 0)}]" for v, f in value)
            yield field.name, f"[{', '.join(points)}]"
        elif field.name not in _UNITS:
            if value != field.default:
                raise MotionError(f"machine {machine}: axis {axis.name}: {field.name} has no place in a machine file")
        elif field.name == "travel":
            if not all(map(isfinite, value)):
                raise MotionError(
                    f"machine {machine}: axis {axis.name} has unlimited travel, which a machine file cannot say; "
                    "give it bounds"
                )
            yield field.name, _vector(value, *_UNITS[field.name])
        else:
            yield field.name, _quantity(value, *_UNITS[field.name])


def _quantity(value: float, unit: str, power: int) -> str:
    """The shortest text of an SI value in a unit 10^power times smaller; exact, as the point only moves."""
    number = Decimal(repr(float(value))).scaleb(power).normalize()
    return f'"{number:{"" if 0 < abs(number) < 1e-6 else "f"}} {unit}"'


def _vector(values: Array | Iterable[float], unit: str, power: int) -> str:
    return f"[{', '.join(_quantity(value, unit, power) for value in values)}]"


def _direction(values: Array) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"


def _rows(texts: Iterable[str]) -> str:
    return "".join(f"\n    {text}," for text in texts) + "\n"


def _disc(disc: Disc) -> str:
    return (
        f"{{ radius = {_quantity(disc.radius, 'mm', 3)}, thickness = {_quantity(disc.thickness, 'mm', 3)}, "
        f"centre = {_vector(np.asarray(disc.centre), 'mm', 3)}, normal = {_direction(np.asarray(disc.normal))} }}"
    )
