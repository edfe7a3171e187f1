"""`pulsepath studio`: the reports below a folder in a browser, shown again when they are written again."""

import shlex
from collections.abc import Sequence
from pathlib import Path

import click

from pulsepath.options import json_option, machine_option


@click.command()
@click.argument("directory", metavar="[DIR]", type=click.Path(path_type=Path, file_okay=False), default="out")
@click.option(
    "--program",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    metavar="FILE",
    help="Plan FILE to a folder of its name in DIR, and again whenever it or the machine's file is saved.",
)
@machine_option
@click.option(
    "--options",
    default="",
    metavar="OPTIONS",
    help='With --program: options of pulsepath plan, as "--order 2 --rule dda".',
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    metavar="PORT",
    help="Local port to serve on; give one to bookmark comparisons. Default: a free one.",
)
@click.option("--no-browser", is_flag=True, help="Print the address only.")
@json_option
def studio(
    directory: Path,
    program: Path | None,
    machine: str | None,
    options: str,
    port: int,
    no_browser: bool,
    as_json: bool,
) -> None:
    """Show the reports below DIR side by side.

    DIR defaults to out. Opens a browser with the list of plans, comparisons and calibrations. Two beside each other,
    with the differences between plans, have an address of their own: /compare?left=NAME&right=NAME. A report reloads
    when it is rewritten. With --program, the program is planned again whenever you save it. The pages are served on
    loopback (127.0.0.1) only, until Ctrl-C.

    Example: pulsepath studio out --program program.toml
    """
    from contextlib import nullcontext

    from kinematics.foundation.errors import MotionError
    from pulsepath.output.studio import Replanner, Studio
    from pulsepath.page_server import serve_until_interrupted

    arguments = _split(options)
    if program is None and (machine is not None or arguments):
        raise click.UsageError("--machine and --options are for --program: give that too.", click.get_current_context())
    if program is None and not directory.is_dir():
        raise MotionError(f"{directory}: there is no such folder; give that of a plan, or one above several")
    replanner = None if program is None else Replanner(program, machine, arguments, directory)
    with replanner or nullcontext():
        told = {"folder": str(directory)}
        serve_until_interrupted(Studio(directory, replanner).answer, port, told, no_browser, as_json)


def _split(options: str) -> Sequence[str]:
    """Return the options of a plan, split as a shell does, without options of its directory."""
    try:
        arguments = shlex.split(options)
    except ValueError as error:
        raise click.UsageError(f"--options: {error}.", click.get_current_context()) from None
    for argument in arguments:
        name = argument.partition("=")[0]
        if name in ("--out", "--machine", "--dump-config") or not (arguments[0].startswith("-")):
            raise click.UsageError(
                f"--options: {argument} cannot stand here; write options of pulsepath plan other than --out, --machine "
                "and --dump-config.",
                click.get_current_context(),
            )
    return arguments
