"""`pulsepath machines`, `programs`, `rigs`, `laws`, `rules`: list the bundled data; what each is, its own file says."""

from functools import partial
from inspect import getdoc
from typing import Any

import click

from pulsepath.options import json_option
from pulsepath.progress import say

Record = dict[str, Any]


@click.command()
@json_option
def machines(as_json: bool) -> None:
    """List the bundled machines.

    Shows the travel and limits of their axes.

    Example: pulsepath machines --json
    """
    from kinematics import NotInstalled, load_machine, machine_names
    from pulsepath.output import record, tables

    known = []
    for name in machine_names():
        try:
            known.append(load_machine(name))
        except NotInstalled as absent:  # the others are there all the same
            say(f"note: {name} is left out: {absent}", err=True)
    if as_json:
        click.echo(record.as_json([record.of_machine(machine) for machine in known]), nl=False)
    else:
        tables.show(tables.of_machines(known))


@click.command()
@json_option
def programs(as_json: bool) -> None:
    """List the bundled programs.

    Example: pulsepath programs
    """
    _show(
        "bundled programs",
        [
            {"name": name, "machine": data.get("machine"), "segments": len(data["segment"]), "about": about}
            for name, data, about in _read_presets("planner")
        ],
        as_json,
    )


@click.command()
@json_option
def rigs(as_json: bool) -> None:
    """List the bundled rigs, for "pulsepath compare".

    A rig is a machine with drives, card, host and tasks.

    Example: pulsepath rigs
    """
    _show(
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
        as_json,
    )


@click.command()
@json_option
def laws(as_json: bool) -> None:
    """List the tracking laws and their gains.

    Give a law by number or name. The gains are the grid that "pulsepath compare" runs.

    Example: pulsepath laws --json
    """
    from controllers.laws.registry import LAWS

    found = []
    for (number, name), make in LAWS.items():
        told = getdoc(make.func if isinstance(make, partial) else make) or ""
        own = make.keywords if isinstance(make, partial) else {}
        about = told.splitlines()[0] + "".join(f" ({key}: {value})" for key, value in own.items())
        gains = {gain: [float(value) for value in values] for gain, values in make().grid.items()}
        found.append({"number": number, "name": name, "gains": gains, "about": about})
    _show("tracking laws", found, as_json)


@click.command()
@json_option
def rules(as_json: bool) -> None:
    """List the firing rules and their options.

    "pulsepath plan --rule" takes a name, with options if needed: "sampled:period=50us", "dda:spacing=5ms,rate=200kHz".

    Example: pulsepath rules
    """
    from pulsepath.output import record, tables

    found = record.of_rules()
    if as_json:
        click.echo(record.as_json(found), nl=False)
    else:
        tables.show(tables.of_rules(found))


def _show(title: str, listed: list[Record], as_json: bool) -> None:
    from pulsepath.output import record, tables

    if as_json:
        click.echo(record.as_json(listed), nl=False)
    else:
        tables.show(tables.of_list(title, listed))


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
