"""The machine file of a first hour: the keys that matter, with the numbers of a bundled machine.

`machine_writer.machine_starter` writes the file with every key.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from kinematics.files.keys import Key, short_table_lines
from kinematics.foundation.arrays import Array
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import KINDS, load_machine
from kinematics.machine.machine_writer import describe_source, known_keys, leg_lengths, read_preset

AXIS_KEYS = (
    "name",
    "leg_length",
    "travel",
    "pulse",
    "drive",
    "electronic_gear",
    "pulse_factor",
    "max_speed",
    "max_acceleration",
    "max_jerk",
)
"""Keys of axes, in the order of the file. Forces, wiring, backlash and the like can wait."""
COLLISION_KEYS = ("leg_radius", "leg_ends", "base_disc", "platform_disc")
JOINT_KEYS = ("base_joints", "platform_joints")
JOINT_DECIMALS = 4
"""Decimals of joint coordinates in mm: 0.1 µm is finer than any machine is measured."""
EQUAL_LENGTHS = 1e-7
"""Lengths of legs at home (m) that differ by less count as equal."""


def short_machine_starter(preset: str) -> str:
    """Return the text of a machine file with few keys.

    Joint centres are plain numbers in mm, one row for each leg, to be replaced by the rows of a table.
    Raises MotionError for a name that no bundled machine has.
    """
    data = read_preset(preset)
    keys = known_keys(data["kind"])
    machine = load_machine(preset)
    head = {name: data[name] for name in ("schema", "kind")}
    geometry = {name: value for name, value in data["geometry"].items() if name not in COLLISION_KEYS}
    axes = data.get("axes")
    joints = _joint_rows(machine, data["kind"])
    if joints:
        head["length"] = "mm"
        replaced = {other for one in keys["geometry"] if one.name in joints for other in one.instead}
        geometry = {name: value for name, value in geometry.items() if name not in replaced}
        geometry |= joints | {"home": _plain_home(data["geometry"]["home"], machine)}
        axes = _with_leg_length(data, machine)

    lines = [f"# A machine with the numbers of {describe_source(preset)}: replace them by yours."]
    lines += ["# Quantities carry their units: mm, in, deg, rad, s and so on."]
    kind = [replace(one, about="kind of machine") if one.name == "kind" else one for one in keys[""]]
    lines += short_table_lines("", kind, head)
    lines += short_table_lines("[geometry]", keys["geometry"], geometry)
    for table, values in (("axes", axes), ("rotary", data.get("rotary"))):
        if values is not None:
            lines += short_table_lines(f"[{table}]", _order_axis_keys(keys[table]), values)
    for own in data.get("axis", ()):
        lines += _own_table(keys, own, machine)
    lines += ["", "# More keys (collisions, forces, wiring, backlash, input shapers): pulsepath init --all"]
    return "\n".join(lines) + "\n"


def _joint_rows(machine: Machine, kind: str) -> dict[str, list[list[float]]]:
    """Return the joint centres in mm by their keys; empty for machines that have none."""
    stated = KINDS[kind][0].geometry_of(machine, False) or {}
    return {name: _millimetres(stated[name]) for name in JOINT_KEYS if name in stated}


def _millimetres(points: Array) -> list[Any]:
    """Return coordinates in mm as nested lists of the shortest numbers."""

    def shorten(value: Any) -> Any:
        if isinstance(value, list):
            return [shorten(each) for each in value]
        return int(value) if value == int(value) else value

    rows: list[Any] = shorten(np.round(1e3 * np.asarray(points), JOINT_DECIMALS).tolist())
    return rows


def _plain_home(stated: Mapping[str, Any], machine: Machine) -> dict[str, Any]:
    """Return the home pose with its position in mm, and its rotation if there is one."""
    turned = bool(machine.home.rotation.magnitude() > 0)
    position = {"to": _millimetres(machine.home.translation)}
    return position | ({"rotate": stated["rotate"]} if turned else {})


def _with_leg_length(data: Mapping[str, Any], machine: Machine) -> dict[str, Any]:
    """Return the values of [axes], with leg lengths for the travel where one pair of lengths fits all legs."""
    axes = dict(data["axes"])
    differing = any("travel" in own for own in data.get("axis", ()))
    if "travel" in axes and not differing and np.ptp(machine.home_q) < EQUAL_LENGTHS:
        del axes["travel"]
        axes["leg_length"] = leg_lengths(machine)
    return axes


def _order_axis_keys(keys: Sequence[Key]) -> list[Key]:
    by_name = {one.name: one for one in keys}
    return [by_name[name] for name in AXIS_KEYS if name in by_name]


def _own_table(keys: Mapping[str, list[Key]], own: Mapping[str, Any], machine: Machine) -> list[str]:
    """Return the [[axis]] table of one axis; nothing if it states no key of a short file."""
    values = {name: value for name, value in own.items() if name in AXIS_KEYS}
    if len(values) < 2:
        return []
    kinds = {axis.name: axis.kind for axis in machine.axes}
    table = "rotary" if kinds[own["name"]] == "rotary" and "rotary" in keys else "axes"
    name = Key("name", "name of the axis to which these values apply")
    return [*short_table_lines("[[axis]]", [name, *_order_axis_keys(keys[table])], values)]
