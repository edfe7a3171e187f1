"""A commented machine file to start from, made of a bundled one: every key of its kind, with what it means."""

import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.array import Array
from kinematics.commented import Key, table
from kinematics.hexapod import Hexapod
from kinematics.machine_file import toml_of
from kinematics.machine_keys import GEOMETRY, HEAD, LEGS, LINEAR, PLATFORM, ROTARY
from kinematics.registry import beside, find, load_machine
from kinematics.toml_text import millimetres

_LEGGED = ("hexapod", "tripod")


def machine_starter(preset: str) -> str:
    """The text. Raises MotionError for a name that no bundled machine has."""
    data = _data(preset)
    lines = [
        f"# A machine to start from, with the numbers of {_named(preset)}: put your own in their place.",
        "# A line that begins with # and no blank is a key, or a table, that may be given: take the # away.",
        "# Numbers carry their units: mm, in, deg, rad, kg, N, s, Hz and so on.",
    ]
    return "\n".join([*lines, *_tables(preset, data)]) + "\n"


def companions(preset: str) -> dict[str, bytes]:
    """What the file names beside it, such as an arm's URDF: content by name."""
    source, urdf = find("kinematics", "machine", preset), _data(preset)["geometry"].get("urdf")
    return {} if urdf is None else {urdf: (beside("kinematics", source) / urdf).read_bytes()}


def _named(preset: str) -> str:
    source = find("kinematics", "machine", preset)
    return source.name if isinstance(source, Path) and source == Path(preset) else f'the bundled machine "{preset}"'


def _data(preset: str) -> dict[str, Any]:
    return tomllib.loads(toml_of(find("kinematics", "machine", preset)).decode())


def _tables(preset: str, data: dict[str, Any]) -> Iterator[str]:
    kind, axes = data["kind"], ROTARY if data["kind"] == "arm" else LINEAR
    names = [axis.name for axis in load_machine(preset).axes]
    yield from table("", HEAD, data)
    yield from table("[geometry]", _geometry(preset, kind), data["geometry"])
    own = "what all axes have" if kind != "traverser" else "what all slides have"
    yield from table("[axes]", axes, data["axes"], own)
    if kind == "traverser":
        yield from table("[rotary]", ROTARY, data["rotary"], "the same of the turning axis, which needs no travel")
    about = "what one axis has of its own: any key of [axes]; a table for each such axis"
    name = Key("name", f"of the axis: {', '.join(names)}", f'"{names[0]}"')
    for one in data.get("axis", ()):
        yield from table("[[axis]]", [name, *(Key(key, "its own") for key in one if key != "name")], one, about)
    if not data.get("axis"):
        faster = next(key for key in axes if key.name == "max_speed")
        yield from table("[[axis]]", [name, replace(faster, about="its own")], None, about)
    wired = [Key(axis, "card, and which of its axes", f'["PCI-8164", {n}]') for n, axis in enumerate(names)]
    yield from table("[wiring]", wired, data.get("wiring"), "which motion card drives an axis")
    yield from table(
        "[platform]", PLATFORM, data.get("platform"), "masses: with them max_force and torque_speed are kept"
    )
    if kind in _LEGGED:
        yield from table("[legs]", LEGS, data.get("legs"), "the two parts of every leg")


def _geometry(preset: str, kind: str) -> list[Key]:
    """The keys of a kind; where joints lie on circles, the example of joints one by one is the same joints."""
    machine = load_machine(preset)
    if not isinstance(machine, Hexapod):
        return list(GEOMETRY[kind])
    joints = {"base_joints": machine.base, "platform_joints": machine.platform}
    return [replace(key, example=_rows(joints[key.name])) if key.name in joints else key for key in GEOMETRY[kind]]


def _rows(points: Array) -> str:
    """As a comment of several lines, to a tenth of a nanometre."""
    return "[" + "".join(f"\n#    {millimetres(np.round(point, 10) + 0.0)}," for point in points) + "\n#]"
