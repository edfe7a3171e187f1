"""The machine file of a first hour: the keys that matter, with the numbers of a bundled machine.

`machine_writer.machine_starter` writes the file with every key.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import ceil, log10
from shlex import quote
from typing import Any

import numpy as np

from kinematics.files.keys import Key, short_table_lines, wrap_comment
from kinematics.foundation.arrays import Array
from kinematics.foundation.units import unit_value
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
    "direction",
    "max_speed",
    "max_acceleration",
    "max_jerk",
    "max_force",
    "torque_speed",
    "friction",
    "reflected",
    "max_pulse_rate",
    "start_stop_rate",
    "resonance",
    "resonance_time",
)
"""Keys of axes, in the order of the file: what pulses and limits depend on. Backlash can wait."""
MASS_TABLES = ("platform", "legs")
"""Tables without which `max_force` limits nothing."""
JOINT_KEYS = ("base_joints", "platform_joints")
LATER_TABLES = ("gravity", "vibration", "wiring")
JOINT_PRECISION = 1e-7
"""Step of joint coordinates, m: finer than any machine is measured."""
EQUAL_LENGTHS = 1e-7
"""Lengths of legs at home (m) that differ by less count as equal."""


def short_machine_starter(preset: str, name: str | None = None) -> str:
    """Return the text of a machine file with few keys.

    name  of the machine; None: that of the file it is written to

    Joint centres are plain numbers, one row for each leg, to be replaced by the rows of a table.
    Raises MotionError for a name that no bundled machine has.
    """
    data = read_preset(preset)
    keys = known_keys(data["kind"])
    machine = load_machine(preset)
    head: dict[str, Any] = _pick(data, ("schema", "kind", "length"))
    if name is not None:
        head["name"] = name
    geometry = dict(data["geometry"])
    axes = data.get("axes")
    joints = _joint_rows(machine, data)
    if joints:
        head["length"] = _length_unit(data)
        stating = [one for one in keys["geometry"] if one.name in joints]
        geometry = _omit(geometry, {other for one in stating for other in one.instead})
        geometry |= joints | {"home": _plain_home(machine, data)}
        axes = _with_leg_length(data, machine)

    lines = [f"# A machine with the numbers of {describe_source(preset)}: replace them by yours."]
    lines += ["# Quantities carry their units: mm, in, deg, rad, s and so on."]
    lines += short_table_lines("", _shorten_kind(keys[""]), head)
    lines += short_table_lines("[geometry]", keys["geometry"], geometry)
    for table, values in (("axes", axes), ("rotary", data.get("rotary"))):
        if values is not None:
            lines += short_table_lines(f"[{table}]", _order_axis_keys(keys[table]), values)
    for table in MASS_TABLES:
        if table in data:
            lines += short_table_lines(f"[{table}]", keys[table], data[table])
    for stated in data.get("axis", ()):
        lines += _single_axis_table(keys, stated, machine)
    lines += ["", *wrap_comment(_describe_missing(preset, data))]
    return "\n".join(lines) + "\n"


def _pick(values: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name in names}


def _omit(values: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name not in names}


def _shorten_kind(keys: Sequence[Key]) -> list[Key]:
    """Return the keys, `kind` without the list of all kinds."""
    about = "kind of machine"
    return [replace(one, about=about) if one.name == "kind" else one for one in keys]


def _describe_missing(preset: str, data: Mapping[str, Any]) -> str:
    """Return the comment that names the keys of a machine that its short file leaves out."""
    names: list[str] = []
    for table in (data.get("axes", {}), data.get("rotary", {}), *data.get("axis", ())):
        names += [name for name in table if name not in AXIS_KEYS]
    names += [name if name == "gravity" else f"[{name}]" for name in LATER_TABLES if name in data]
    left_out = f"Left out: {', '.join(dict.fromkeys(names))}. " if names else ""
    command = f"pulsepath init all-keys --all --machine {quote(preset)}"
    return f"{left_out}All keys, with wiring, backlash and input shapers: {command}"


def _length_unit(data: Mapping[str, Any]) -> str:
    """Return the unit of plain numbers: that of the machine's file, else mm."""
    return str(data.get("length", "mm"))


def _joint_rows(machine: Machine, data: Mapping[str, Any]) -> dict[str, list[list[float]]]:
    """Return the joint centres by their keys; empty for machines that have none."""
    stated = KINDS[data["kind"]][0].geometry_of(machine, False) or {}
    unit = _length_unit(data)
    return {name: _plain_numbers(stated[name], unit) for name in JOINT_KEYS if name in stated}


def _plain_numbers(points: Array, unit: str) -> list[Any]:
    """Return coordinates in a unit as nested lists of short numbers, to `JOINT_PRECISION`."""
    size = unit_value(unit, "m")
    decimals = max(0, ceil(log10(size / JOINT_PRECISION)))

    def shorten(value: Any) -> Any:
        if isinstance(value, list):
            return [shorten(each) for each in value]
        return int(value) if value == int(value) else value

    rows: list[Any] = shorten(np.round(np.asarray(points) / size, decimals).tolist())
    return rows


def _plain_home(machine: Machine, data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the home pose with its position as plain numbers, and its rotation if there is one."""
    (home,) = machine.home_numbers
    turned = not np.array_equal(home[3:], np.eye(3).ravel())
    position = {"to": _plain_numbers(home[:3], _length_unit(data))}
    return position | ({"rotate": data["geometry"]["home"]["rotate"]} if turned else {})


def _with_leg_length(data: Mapping[str, Any], machine: Machine) -> dict[str, Any]:
    """Return the values of [axes], with leg lengths for the travel where all legs are alike."""
    axes = dict(data["axes"])
    differing = any("travel" in table for table in data.get("axis", ()))
    if "travel" in axes and not differing and np.ptp(machine.home_q) < EQUAL_LENGTHS:
        del axes["travel"]
        axes["leg_length"] = leg_lengths(machine)
    return axes


def _order_axis_keys(keys: Sequence[Key]) -> list[Key]:
    by_name = {one.name: one for one in keys}
    return [by_name[name] for name in AXIS_KEYS if name in by_name]


def _single_axis_table(
    keys: Mapping[str, list[Key]],
    stated: Mapping[str, Any],
    machine: Machine,
) -> list[str]:
    """Return the [[axis]] table of one axis; nothing if it states no key of a short file."""
    values = _pick(stated, AXIS_KEYS)
    if len(values) < 2:
        return []
    kinds = {axis.name: axis.kind for axis in machine.axes}
    table = "rotary" if kinds[stated["name"]] == "rotary" and "rotary" in keys else "axes"
    name = Key("name", "name of the axis to which these values apply")
    return [*short_table_lines("[[axis]]", [name, *_order_axis_keys(keys[table])], values)]
