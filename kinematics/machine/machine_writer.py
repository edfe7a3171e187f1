"""Machine files, written: the TOML from which `load_machine` makes the same machine, or one to
start from.

Numbers are written so that they are read back as the same floats; turns and directions come back to
rounding, since they are held as matrices and unit vectors, and so do joints about a tool. What a
key is called, what it means and in which unit its value is written, the schemas of the kinds say
(`kinematics.kinds`).
"""

import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, fields, replace
from importlib.resources.abc import Traversable
from math import ceil, floor, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.files.keys import Key, format_entries, format_value, keys_of, table_lines
from kinematics.files.toml_document import format_millimetres, format_toml, quote
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import add_article, find, source_folder
from kinematics.foundation.options import check_arguments
from kinematics.foundation.units import describe
from kinematics.kinds.axis_keys import LinearAxis, MachineFile, RotaryAxis, TimingTable
from kinematics.kinds.load_keys import Carried, LegsTable
from kinematics.kinds.tripod import ASSUMED, is_basic_lengths
from kinematics.machine.axis import DRIVES, Axis, StepTiming
from kinematics.machine.load import STANDARD_GRAVITY, Body, Load
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import KINDS, load_machine, read_machine
from kinematics.machine.shaper import Shaper, ShaperSeries

LENGTH_STEP = 1e-5
"""Step of leg lengths in a file to start from, m: home, which may lie at an end of the travel,
stays within them.
"""
_SKIPPED_FIELDS = ("name", "kind", "card", "channel")


def toml_of(source: Path | Traversable) -> bytes:
    """The TOML of a machine's file as it stands; of one that is no TOML, one that says the same."""
    if not is_basic_lengths(source):
        return source.read_bytes()
    return machine_toml(read_machine(source), f"from {source.name}; {ASSUMED}").encode()


@check_arguments()
def machine_toml(machine: Machine, comment: str = "", *, complete: bool = False) -> str:
    """The TOML text of a machine, with explicit joint centres.

    Parameters
    ----------
    machine
        The machine.
    comment
        Goes before the text, line by line.
    complete
        Also write keys at their defaults.

    Returns
    -------
    str
        What a machine file holds.

    Raises
    ------
    MotionError
        Machine files cannot say it: an arm's URDF, unlimited travel of a slide, other axis names
        than the kind has.
    """
    kind, schema, names = _file_of(machine)
    given = machine.load
    usual = np.array_equal(machine.gravity, -STANDARD_GRAVITY * machine.vertical)
    gravity = {"gravity": machine.gravity if complete or not usual else None}
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += ["schema = 1", f"kind = {quote(kind)}", *_lines(schema, gravity)]
    geometry = schema.geometry_of(machine, complete) or {}
    table = next(
        each for each in schema.tables_of("geometry") if geometry.keys() <= each.model_fields.keys()
    )
    lines += ["", "[geometry]", *_lines(table, geometry, rows=True)]
    lines += [*_axes(machine, kind, names, complete), *_load(machine.name, given)]
    return "\n".join(lines) + "\n"


def _file_of(machine: Machine) -> tuple[str, type[MachineFile], Sequence[str]]:
    """The kind of a machine, the schema of its files, and what its axes are called.

    Raises MotionError.
    """
    silent = MachineFile.geometry_of
    written = {
        kind: (schema, names)
        for kind, (schema, _, names) in KINDS.items()
        if schema.geometry_of is not silent
    }
    for base in type(machine).__mro__:
        if base.__name__.lower() in written:
            return base.__name__.lower(), *written[base.__name__.lower()]
    kinds = ", ".join(written)
    raise MotionError(
        f"machine {machine.name}: machines of kind {type(machine).__name__.lower()} cannot be written, only "
        f"{kinds}; keep the file or the code that it came from"
    )


def _lines(table: Any, values: Mapping[str, Any], rows: bool = False) -> Iterator[str]:
    return (f"{name} = {text}" for name, text in format_entries(table, values, rows))


def _load(machine: str, stated: Load) -> Iterator[str]:
    """As far as the machine states any. Raises MotionError for legs that differ."""
    if stated.platform.mass > 0 or stated.wrench.any():
        pushed = {"force": stated.wrench[:3], "moment": stated.wrench[3:]}
        yield from ("", "[platform]", *_lines(Carried, _body(stated.platform) | pushed))
    if len(stated.legs) > 1:
        raise MotionError(
            f"machine {machine}: legs of different masses have no place in a machine file"
        )
    for leg in stated.legs:
        parts = {"barrel": _body(leg.barrel), "rod": _body(leg.rod), "first_axis": leg.first_axis}
        yield from ("", "[legs]", *_lines(LegsTable, parts))


def _body(body: Body) -> dict[str, Any]:
    return {"mass": body.mass, "centre": body.centre, "inertia": body.inertia}


def _axes(machine: Machine, kind: str, known: Sequence[str], complete: bool) -> Iterator[str]:
    """What most axes of a kind share, then what each has of its own."""
    names = tuple(axis.name for axis in machine.axes)
    if known and names != tuple(known):
        raise MotionError(
            f"machine {machine.name}: its axes are called {', '.join(names)}; in a file of {add_article(kind)} "
            f"they are {', '.join(known)}: name them so"
        )
    for table, sort in (("axes", "linear"), ("rotary", "rotary")):
        some = [axis for axis in machine.axes if axis.kind == sort]
        if some:
            yield from ("", f"[{table}]", *_tables(machine.name, some, complete))
    wired = {axis.name: (axis.card, axis.channel) for axis in machine.axes if axis.card is not None}
    if wired:
        yield from (
            "",
            "[wiring]",
            *(f"{name} = {format_value(None, place)}" for name, place in wired.items()),
        )


def _tables(machine: str, axes: Sequence[Axis], complete: bool) -> Iterator[str]:
    written = [dict(_fields(machine, axis, complete)) for axis in axes]
    # an absent limit cannot be stated for one axis alone, so only keys that all have become common
    shared = [key for key in written[0] if all(key in entry for entry in written)]
    common = {key: Counter(entry[key] for entry in written).most_common(1)[0][0] for key in shared}
    yield from (f"{key} = {text}" for key, text in common.items())
    for axis, entry in zip(axes, written, strict=True):
        own = {key: text for key, text in entry.items() if common.get(key) != text}
        if own:
            yield from (
                "",
                "[[axis]]",
                f'name = "{axis.name}"',
                *(f"{key} = {text}" for key, text in own.items()),
            )


def _fields(machine: str, axis: Axis, complete: bool) -> Iterator[tuple[str, str]]:
    """Key and text of every field of an axis that says something."""
    values = {}
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
        values[field.name] = _plain(value)
    return format_entries(LinearAxis if axis.kind == "linear" else RotaryAxis, values)


def _plain(value: Any) -> Any:
    """A value as its table says it."""
    if isinstance(value, ShaperSeries):
        return tuple(map(_plain, value.parts))
    if isinstance(value, Shaper):
        return {
            name: told
            for name, told in asdict(value).items()
            if name != "tolerance" or value.kind == "ei"
        }
    return _timing(value) if isinstance(value, StepTiming) else value


def _timing(timing: StepTiming) -> str | dict[str, Any]:
    """By the drive's name where it has one."""
    times = {name: getattr(timing, name) for name in TimingTable.model_fields}
    return next((name for name, known in DRIVES.items() if known == timing), times)


def machine_starter(preset: str, name: str | None = None) -> str:
    """Return a machine file with every key, unset ones as comments.

    name  of the machine; None: that of the file it is written to
    Raises MotionError for a preset that no bundled machine has.
    """
    data = read_preset(preset)
    if name is not None:
        data["name"] = name
    lines = [
        f"# A machine with the numbers of {describe_source(preset)}: replace them by yours.",
        "# A line that begins with # and no space is a key or a table that is not set: remove the # to set it.",
        "# Quantities carry their units: mm, in, deg, rad, kg, N, s, Hz and so on.",
    ]
    return "\n".join([*lines, *_starter_tables(preset, data)]) + "\n"


def companions(preset: str) -> dict[str, bytes]:
    """Return the files that a machine file names, such as an arm's URDF: content by name."""
    source, urdf = (
        find("kinematics", "machine", preset),
        read_preset(preset)["geometry"].get("urdf"),
    )
    return {} if urdf is None else {urdf: (source_folder("kinematics", source) / urdf).read_bytes()}


def describe_source(preset: str) -> str:
    """Return what comments call a machine: its file, or the bundled machine of this name."""
    source = find("kinematics", "machine", preset)
    return (
        source.name
        if isinstance(source, Path) and source == Path(preset)
        else f'the bundled machine "{preset}"'
    )


def read_preset(preset: str) -> dict[str, Any]:
    """Return the data of a machine's file."""
    return tomllib.loads(toml_of(find("kinematics", "machine", preset)).decode())


def known_keys(kind: str) -> dict[str, list[Key]]:
    """The keys of a kind's file, in their order: of its tables by name, and of "", what stands
    above them.
    """
    schema = KINDS[kind][0]
    *some, last = map(quote, KINDS)
    keys = {one.name: one for one in keys_of(schema)}
    kind_key = replace(keys["kind"], about=f"{', '.join(some)} or {last}")
    head = [keys[name] for name in ("schema", "name", "kind", "length", "gravity")]
    head[2] = kind_key
    tables = {
        name: keys_of(*schema.tables_of(name)) for name in ("axes", "rotary", "platform", "legs")
    }
    geometry = keys_of(*schema.tables_of("geometry"), own_first=True)
    return {"": head, "geometry": geometry} | {
        name: table for name, table in tables.items() if table
    }


def _starter_tables(preset: str, data: dict[str, Any]) -> Iterator[str]:
    machine, schema = load_machine(preset), KINDS[data["kind"]][0]
    names = [axis.name for axis in machine.axes]
    keys = known_keys(data["kind"])
    geometry = schema.geometry_of(machine, False) or {}
    keys["geometry"] = [_with_example(one, geometry.get(one.name)) for one in keys["geometry"]]
    if "axes" in keys:  # an example that suits the machine's home
        length = next((one for one in keys["axes"] if one.name == "leg_length"), None)
        fitting = length and replace(length, example=format_toml(leg_lengths(machine)))
        keys["axes"] = [fitting if fitting and one is length else one for one in keys["axes"]]
    about = {name: field.description or "" for name, field in schema.model_fields.items()}
    yield from table_lines("", keys[""], data)
    yield from table_lines("[geometry]", keys["geometry"], data["geometry"])
    for table in ("axes", "rotary"):
        if table in keys:
            yield from table_lines(f"[{table}]", keys[table], data.get(table), about[table])
    name = Key("name", f"name of the axis: {', '.join(names)}", f'"{names[0]}"')
    for one in data.get("axis", ()):
        others = [Key(key, "value of this axis") for key in one if key != "name"]
        yield from table_lines("[[axis]]", [name, *others], one, about["axis"])
    if not data.get("axis"):
        own_table = "rotary" if machine.axes[0].kind == "rotary" and "rotary" in keys else "axes"
        faster = next(key for key in keys[own_table] if key.name == "max_speed")
        yield from table_lines(
            "[[axis]]", [name, replace(faster, about="value of this axis")], None, about["axis"]
        )
    yield from table_lines(
        "[[vibration]]", keys_of(*schema.tables_of("vibration")), None, about["vibration"]
    )
    wired = [
        Key(axis, "motion card and channel", f'["PCI-8164", {n}]') for n, axis in enumerate(names)
    ]
    yield from table_lines("[wiring]", wired, data.get("wiring"), about["wiring"])
    for table in ("platform", "legs"):
        if table in keys:
            yield from table_lines(f"[{table}]", keys[table], data.get(table), about[table])


def leg_lengths(machine: Machine) -> list[str]:
    """Return the shortest and the longest leg within travel, rounded outwards to `LENGTH_STEP`."""
    ends = machine.home_q[:, None] + np.array([axis.travel for axis in machine.axes])
    shortest = floor(ends.min() / LENGTH_STEP) * LENGTH_STEP
    longest = ceil(ends.max() / LENGTH_STEP) * LENGTH_STEP
    return [describe(shortest, "mm"), describe(longest, "mm")]


def _with_example(one: Key, points: Any) -> Key:
    """A key that has no example shows the machine's own points: so where joints lie on circles,
    them one by one.
    """
    return one if one.example or np.ndim(points) != 2 else replace(one, example=_rows(points))


def _rows(points: Array) -> str:
    """As a comment of several lines, to a tenth of a nanometre."""
    return (
        "["
        + "".join(f"\n#    {format_millimetres(np.round(point, 10) + 0.0)}," for point in points)
        + "\n#]"
    )
