"""Machine files, written: the TOML from which `load_machine` makes the same machine.

Numbers are written so that they are read back as the same floats; turns and directions come back to rounding, since
they are held as matrices and unit vectors, and so do joints about a tool.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import fields
from math import isfinite
from typing import Any

from kinematics.axis import Axis
from kinematics.errors import MotionError
from kinematics.geometry_writer import geometry
from kinematics.load_writer import gravity, load
from kinematics.machine import Machine
from kinematics.step_timing import DRIVES, StepTiming
from kinematics.toml_text import quantity, quoted, vector

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

_ELSEWHERE = ("name", "kind", "card", "channel")


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
        yield from ("", "[wiring]", *(f"{axis.name} = [{quoted(axis.card or '')}, {axis.channel}]" for axis in wired))


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
        if field.name in _ELSEWHERE or value is None:
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
            return quoted(name)
    times = [f"{name} = {quantity(getattr(timing, name), 'us', 6)}" for name in ("high", "low", "setup", "hold")]
    rate = [] if timing.max_rate is None else [f"max_rate = {quantity(timing.max_rate, '1/s', 0)}"]
    return f"{{ {', '.join(times + rate)} }}"


def _text(field: str, value: Any, sort: int) -> str:
    """sort: 0 in the units of a linear axis, 1 in those of a rotary one."""
    if isinstance(value, StepTiming):
        return _timing(value)
    if field == "compensate":
        return f"[{', '.join(map(quoted, value))}]"
    if field == "pushed":
        return quoted(value)
    if field in _POINTS:
        x, y = (_UNITS[unit][sort] for unit in _POINTS[field])
        return f"[{', '.join(f'[{quantity(a, *x)}, {quantity(b, *y)}]' for a, b in value)}]"
    if field in _UNITS:
        unit = _UNITS[field][sort]
        return vector(value, *unit) if isinstance(value, tuple) else quantity(value, *unit)
    return f"{value}"
