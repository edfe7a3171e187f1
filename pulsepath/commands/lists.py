"""`pulsepath machines`, `programs`, `rigs`, `laws`, `rules`, `figures`: list what is there.

What is listed is kept on disk (`known_names.recall`), since the modules that tell it take seconds to load.
"""

from collections.abc import Callable, Iterable
from functools import partial
from inspect import getdoc
from typing import TYPE_CHECKING, Any

import click

from pulsepath.known_names import recall
from pulsepath.options import json_option
from pulsepath.progress import as_json as to_json
from pulsepath.progress import draw, say

if TYPE_CHECKING:
    from kinematics.foundation.table import Table

Record = dict[str, Any]


@click.command()
@json_option
def machines(as_json: bool) -> None:
    """List the bundled machines.

    Shows the travel and limits of their axes.

    In a machine file, timing = "DRV8825" names the drive of an axis: plans then keep what it needs on STEP and DIR, and
    plan -v shows it. Known drives: A4988, DRV8825, LV8729, DRV8884, TMC2209, Pacific-6410, Pacific-6410-filtered,
    servo-differential, servo-open-collector, servo-high-speed.

    Example: pulsepath machines --json
    """
    _show("machines", _list_machines, as_json)


@click.command()
@json_option
def programs(as_json: bool) -> None:
    """List the bundled programs.

    Example: pulsepath programs
    """
    _show("programs", _list_programs, as_json)


@click.command()
@json_option
def rigs(as_json: bool) -> None:
    """List the bundled rigs, for "pulsepath compare".

    A rig is a machine with drives, card, host and tasks.

    Example: pulsepath rigs
    """
    _show("rigs", _list_rigs, as_json)


@click.command()
@json_option
def laws(as_json: bool) -> None:
    """List the tracking laws and their gains.

    Give a law by number or name. The gains are the grid that "pulsepath compare" runs.

    Example: pulsepath laws --json
    """
    _show("laws", _list_laws, as_json)


@click.command()
@json_option
def rules(as_json: bool) -> None:
    """List the firing rules and their options.

    "pulsepath plan --rule" takes a name, with options if needed: "sampled:period=50us", "dda:spacing=5ms,rate=200kHz".

    Example: pulsepath rules
    """
    _show("rules", _list_rules, as_json)


@click.command()
@json_option
def figures(as_json: bool) -> None:
    """List the figures of tracked runs, for "pulsepath compare --fail-if".

    A figure of axes is the worst axis', and with an axis' name behind a dot that axis' own: following_max.leg1.

    Example: pulsepath figures
    """
    _show("figures", _list_figures, as_json)


def _show(what: str, make: Callable[[], Record], as_json: bool) -> None:
    listed = recall(what, make)
    for note in listed.get("notes", ()):
        say(note, err=True)
    if as_json:
        click.echo(to_json(listed["records"]), nl=False)
    else:
        draw(listed["tables"])


def _lay_out(records: object, tables: "Iterable[Table]", notes: Iterable[str] = ()) -> Record:
    """A list as it is kept: its records, and its tables as they are drawn."""
    from pulsepath.output.tables import lay_out

    return {"records": records, "tables": [lay_out(table) for table in tables], "notes": [*notes]}


def _lay_out_list(title: str, listed: list[Record]) -> Record:
    from pulsepath.output import tables

    return _lay_out(listed, tables.of_list(title, listed))


def _list_machines() -> Record:
    from kinematics import NotInstalled, load_machine, machine_names
    from pulsepath.output import record, tables

    known, absent = [], []
    for name in machine_names():
        try:
            known.append(load_machine(name))
        except NotInstalled as reason:  # the others are there all the same
            absent.append(f"note: {name} is left out: {reason}")
    return _lay_out([record.of_machine(machine) for machine in known], tables.of_machines(known), absent)


def _list_programs() -> Record:
    return _lay_out_list(
        "bundled programs",
        [
            {"name": name, "machine": data.get("machine"), "segments": len(data["segment"]), "about": about}
            for name, data, about in _read_presets("planner")
        ],
    )


def _list_rigs() -> Record:
    return _lay_out_list(
        "bundled rigs",
        [
            {
                "name": name,
                "machine": data["machine"],
                "tasks": list(dict.fromkeys(task["name"] for task in data.get("task", []))),
                "about": about,
            }
            for name, data, about in _read_presets("controllers")
        ],
    )


def _list_laws() -> Record:
    from controllers.laws.registry import LAWS

    found = []
    for (number, name), make in LAWS.items():
        law = make()
        own = make.keywords if isinstance(make, partial) else {}
        text = getdoc(make.func if isinstance(make, partial) else make) or ""
        options = "".join(f" ({key}: {value})" for key, value in own.items())
        # a class with several laws writes the formula of each
        about = getattr(law, "formula", text.partition("\n")[0] + options)
        gains = {gain: [float(value) for value in values] for gain, values in law.grid.items()}
        found.append({"number": number, "name": name, "gains": gains, "about": about})
    return _lay_out_list("tracking laws", found)


def _list_figures() -> Record:
    from controllers.metrics import FIGURES

    units = {"path": "m or rad", "axis": "m or rad", "axis²": "m² or rad²", "axis/s³": "m/s³ or rad/s³", "1": "share"}
    return _lay_out_list(
        "figures of a run",
        [
            {
                "name": one.name,
                "unit": units.get(one.unit, one.unit),
                "each axis": one.per_axis,
                "about": one.meaning,
            }
            for one in FIGURES
        ],
    )


def _list_rules() -> Record:
    from pulsepath.output import record, tables

    found = record.of_rules()
    return _lay_out(found, tables.of_rules(found))


def _read_presets(package: str) -> list[tuple[str, Record, str]]:
    """Name, data and the first sentence of each preset of a package."""
    import tomllib

    from kinematics.foundation.names import presets

    texts = {name: file.read_text(encoding="utf-8") for name, file in presets(package).items()}
    return [(name, tomllib.loads(text), _sentence(text)) for name, text in texts.items()]


def _sentence(text: str) -> str:
    """The first of a comment at the head of a file."""
    lines: list[str] = []
    for line in text.splitlines():
        if not line.startswith("# "):
            break
        lines.append(line[2:])
    first, stop, _ = " ".join(lines).partition(". ")
    return first.rstrip(".") + (stop.strip() or ".")
