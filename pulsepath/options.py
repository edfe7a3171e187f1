"""Arguments and options that several commands share."""

from pathlib import Path

import click

from pulsepath import known_names
from pulsepath.known_names import completing

program_argument = click.argument("program", shell_complete=completing(known_names.programs, files=True))
dump_option = click.option(
    "--dump-config",
    "dumped",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Write machine and program with all defaults there, print the options, and do nothing else.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")
machine_option = click.option(
    "--machine",
    metavar="MACHINE",
    help="Preset or file; default: the one the program names.",
    shell_complete=completing(known_names.machines, files=True),
)
