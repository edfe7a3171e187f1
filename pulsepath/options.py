"""Arguments and options that several commands share."""

from math import inf
from pathlib import Path

import click

from pulsepath import known_names
from pulsepath.known_names import completing

LAWS = ("3", "6")
"""Tracking laws by default: open and closed loop."""
program_argument = click.argument("program", shell_complete=completing(known_names.programs, files=True))
dump_option = click.option(
    "--dump-config",
    "dumped",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Write machine and program with all defaults there (-: print them), print the options, and do nothing else.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")
unverified_option = click.option(
    "--unverified",
    is_flag=True,
    help="Go on with a plan that was changed or is not proved; the output says so.",
)
machine_option = click.option(
    "--machine",
    metavar="MACHINE",
    help="Preset or file; default: the one the program names.",
    shell_complete=completing(known_names.machines, files=True),
)


def quantity_of(flag: str, text: str, unit: str, above: float = -inf, least: float = -inf) -> float:
    """The SI value of a quantity that an option gives. Raises BadValue, which names the option."""
    from kinematics.errors import BadValue
    from kinematics.units import Unit

    try:
        return Unit(unit, above=above, least=least).read(text, {})
    except BadValue as error:
        raise BadValue(f"option {flag}: {error}", allowed=error.allowed, nearest=error.nearest) from None
