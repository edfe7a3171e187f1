"""`pulsepath machines`, `programs`, `rigs`, `laws`, `rules`: list the bundled data."""

from typing import Any

import click

from pulsepath.options import json_option
from pulsepath.progress import say


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
    from pulsepath import bundled

    _show("bundled programs", bundled.programs(), as_json)


@click.command()
@json_option
def rigs(as_json: bool) -> None:
    """List the bundled rigs, for "pulsepath compare".

    A rig is a machine with drives, card, host and tasks.

    Example: pulsepath rigs
    """
    from pulsepath import bundled

    _show("bundled rigs", bundled.rigs(), as_json)


@click.command()
@json_option
def laws(as_json: bool) -> None:
    """List the tracking laws and their gains.

    Give a law by number or name. The gains are the grid that "pulsepath compare" runs.

    Example: pulsepath laws --json
    """
    from pulsepath import bundled

    _show("tracking laws", bundled.laws(), as_json)


@click.command()
@json_option
def rules(as_json: bool) -> None:
    """List the firing rules and their options.

    "pulsepath plan --rule" takes a name, with options if needed: "sampled:period=50us", "dda:spacing=5ms,rate=200kHz".

    Example: pulsepath rules
    """
    from pulsepath.output import record, tables

    if as_json:
        click.echo(record.as_json(record.of_rules()), nl=False)
    else:
        tables.show(tables.of_rules())


def _show(title: str, listed: list[dict[str, Any]], as_json: bool) -> None:
    from pulsepath.output import record, tables

    if as_json:
        click.echo(record.as_json(listed), nl=False)
    else:
        tables.show(tables.of_list(title, listed))
