"""`pulsepath machines`, `programs`, `rigs`, `laws`, `rules`, `figures`: print lists."""

from functools import partial
from typing import Any

import click

from pulsepath.commands.common import print_result
from pulsepath.docstrings import first_paragraph
from pulsepath.options import json_option

Record = dict[str, Any]
UNITS = {
    "path": "m or rad",
    "axis": "m or rad",
    "axis²": "m² or rad²",
    "axis/s³": "m/s³ or rad/s³",
    "1": "share",
}
"""Units of figures that depend on the axis, in words."""


@click.command()
@json_option
def machines(as_json: bool) -> None:
    """List the bundled machines.

    Shows the travel and limits of their axes.

    In a machine file, timing = "DRV8825" names the drive of an axis: plans then keep its timing
    on STEP and DIR, and plan -v shows it. Known drives: A4988, DRV8825, LV8729, DRV8884, TMC2209,
    Pacific-6410, Pacific-6410-filtered, servo-differential, servo-open-collector, servo-high-speed.

    Example: pulsepath machines --json
    """
    from kinematics.foundation.names import presets
    from kinematics.machine.machine_file import read_summary
    from pulsepath.output import record, tables

    known = [read_summary(file) for file in presets("kinematics").values()]
    print_result(
        [record.record_machine(machine) for machine in known],
        tables.tabulate_machines(known),
        as_json,
    )


@click.command()
@json_option
def programs(as_json: bool) -> None:
    """List the bundled programs.

    Example: pulsepath programs
    """
    listed = [
        {
            "name": name,
            "machine": data.get("machine"),
            "segments": len(data["segment"]),
            "about": about,
        }
        for name, data, about in _read_presets("planner")
    ]
    _show_list("bundled programs", listed, as_json)


@click.command()
@json_option
def rigs(as_json: bool) -> None:
    """List the bundled rigs, for "pulsepath compare".

    A rig is a machine with drives, card, host and tasks.

    Example: pulsepath rigs
    """
    listed = [
        {
            "name": name,
            "machine": data["machine"],
            "tasks": list(dict.fromkeys(task["name"] for task in data.get("task", []))),
            "about": about,
        }
        for name, data, about in _read_presets("controllers")
    ]
    _show_list("bundled rigs", listed, as_json)


@click.command()
@json_option
def laws(as_json: bool) -> None:
    """List the tracking laws and their gains.

    Give a law by number or name. The gains are the grid that "pulsepath compare" runs.

    Example: pulsepath laws --json
    """
    from controllers.laws.registry import LAWS

    listed = []
    for (number, name), make in LAWS.items():
        law = make()
        fixed = make.keywords if isinstance(make, partial) else {}
        about_law = first_paragraph(make.func if isinstance(make, partial) else make)
        options = "".join(f" ({key}: {value})" for key, value in fixed.items())
        # a class with several laws writes the formula of each
        about = getattr(law, "formula", about_law + options)
        gains = {gain: [float(value) for value in values] for gain, values in law.grid.items()}
        listed.append({"number": number, "name": name, "gains": gains, "about": about})
    _show_list("tracking laws", listed, as_json)


@click.command()
@json_option
def rules(as_json: bool) -> None:
    """List the firing rules and their options.

    "pulsepath plan --rule" takes a name, with options if needed: "sampled:period=50us",
    "dda:spacing=5ms,rate=200kHz".

    Example: pulsepath rules
    """
    from pulsepath.output import record, tables

    listed = record.record_rules()
    print_result(listed, tables.tabulate_rules(listed), as_json)


@click.command()
@json_option
def figures(as_json: bool) -> None:
    """List the figures of tracked runs, for "pulsepath compare --fail-if".

    A figure of axes is that of the worst axis. Add a dot and a name for one axis:
    following_max.leg1.

    Example: pulsepath figures
    """
    from controllers.metrics import FIGURES

    listed = [
        {
            "name": figure.name,
            "unit": UNITS.get(figure.unit, figure.unit),
            "each axis": figure.per_axis,
            "about": figure.meaning,
        }
        for figure in FIGURES
    ]
    _show_list("figures of a run", listed, as_json)


def _show_list(title: str, records: list[Record], as_json: bool) -> None:
    from pulsepath.output import tables

    print_result(records, tables.tabulate_records(title, records), as_json)


def _read_presets(package: str) -> list[tuple[str, Record, str]]:
    """Return name, data and the first sentence of each preset of a package."""
    import tomllib

    from kinematics.foundation.names import presets

    texts = {name: file.read_text(encoding="utf-8") for name, file in presets(package).items()}
    return [(name, tomllib.loads(text), _sentence(text)) for name, text in texts.items()]


def _sentence(text: str) -> str:
    """Return the first sentence of the comment at the head of a file."""
    lines: list[str] = []
    for line in text.splitlines():
        if not line.startswith("# "):
            break
        lines.append(line[2:])
    first, stop, _ = " ".join(lines).partition(". ")
    return first.rstrip(".") + (stop.strip() or ".")
