"""A commented machine file to start from, made of a bundled one: every key of its kind, with what it means."""

import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.files.keys import Key, keys_of, table_lines
from kinematics.files.toml_writer import format_millimetres, quote
from kinematics.foundation.arrays import Array
from kinematics.foundation.names import find, source_folder
from kinematics.machine.machine_file import KINDS, load_machine
from kinematics.machine.machine_writer import toml_of


def machine_starter(preset: str) -> str:
    """The text. Raises MotionError for a name that no bundled machine has."""
    data = _data(preset)
    lines = [
        f"# A machine to start from, with the numbers of {_describe_source(preset)}: put your own in their place.",
        "# A line that begins with # and no blank is a key, or a table, that may be given: take the # away.",
        "# Numbers carry their units: mm, in, deg, rad, kg, N, s, Hz and so on.",
    ]
    return "\n".join([*lines, *_tables(preset, data)]) + "\n"


def companions(preset: str) -> dict[str, bytes]:
    """What the file names beside it, such as an arm's URDF: content by name."""
    source, urdf = find("kinematics", "machine", preset), _data(preset)["geometry"].get("urdf")
    return {} if urdf is None else {urdf: (source_folder("kinematics", source) / urdf).read_bytes()}


def _describe_source(preset: str) -> str:
    source = find("kinematics", "machine", preset)
    return source.name if isinstance(source, Path) and source == Path(preset) else f'the bundled machine "{preset}"'


def _data(preset: str) -> dict[str, Any]:
    return tomllib.loads(toml_of(find("kinematics", "machine", preset)).decode())


def known_keys(kind: str) -> dict[str, list[Key]]:
    """The keys of a kind's file, in their order: of its tables by name, and of "", what stands above them."""
    schema = KINDS[kind][0]
    *some, last = map(quote, KINDS)
    keys = {one.name: one for one in keys_of(schema)}
    head = [keys["schema"], replace(keys["kind"], about=f"{', '.join(some)} or {last}"), keys["gravity"]]
    tables = {name: keys_of(*schema.tables_of(name)) for name in ("axes", "rotary", "platform", "legs")}
    geometry = keys_of(*schema.tables_of("geometry"), own_first=True)
    return {"": head, "geometry": geometry} | {name: table for name, table in tables.items() if table}


def _tables(preset: str, data: dict[str, Any]) -> Iterator[str]:
    machine, schema = load_machine(preset), KINDS[data["kind"]][0]
    names = [axis.name for axis in machine.axes]
    keys = known_keys(data["kind"])
    geometry = schema.geometry_of(machine, False) or {}
    keys["geometry"] = [_with_example(one, geometry.get(one.name)) for one in keys["geometry"]]
    about = {name: field.description or "" for name, field in schema.model_fields.items()}
    yield from table_lines("", keys[""], data)
    yield from table_lines("[geometry]", keys["geometry"], data["geometry"])
    for table in ("axes", "rotary"):
        if table in keys:
            yield from table_lines(f"[{table}]", keys[table], data[table], about[table])
    name = Key("name", f"of the axis: {', '.join(names)}", f'"{names[0]}"')
    for one in data.get("axis", ()):
        own = [Key(key, "its own") for key in one if key != "name"]
        yield from table_lines("[[axis]]", [name, *own], one, about["axis"])
    if not data.get("axis"):
        faster = next(key for key in keys["axes"] if key.name == "max_speed")
        yield from table_lines("[[axis]]", [name, replace(faster, about="its own")], None, about["axis"])
    wired = [Key(axis, "card, and which of its axes", f'["PCI-8164", {n}]') for n, axis in enumerate(names)]
    yield from table_lines("[wiring]", wired, data.get("wiring"), "which motion card drives an axis")
    for table in ("platform", "legs"):
        if table in keys:
            yield from table_lines(f"[{table}]", keys[table], data.get(table), about[table])


def _with_example(one: Key, points: Any) -> Key:
    """A key that has no example shows the machine's own points: so where joints lie on circles, them one by one."""
    return one if one.example or np.ndim(points) != 2 else replace(one, example=_rows(points))


def _rows(points: Array) -> str:
    """As a comment of several lines, to a tenth of a nanometre."""
    return "[" + "".join(f"\n#    {format_millimetres(np.round(point, 10) + 0.0)}," for point in points) + "\n#]"
