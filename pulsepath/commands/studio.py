"""`pulsepath studio`: the reports below a folder in a browser, which reload when rewritten."""

import shlex
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import click

from planner.request import option
from pulsepath.options import MAX_PORT, json_option
from pulsepath.request_options import with_request
from pulsepath.requests import MACHINE_HELP


@dataclass(frozen=True, slots=True, kw_only=True)
class StudioRequest:
    """A folder of plans to show, and a program that is planned whenever it is saved."""

    directory: Path
    program: Path | None = option(
        None,
        "Plan FILE to a folder of its name in DIR, and again whenever it or the machine's file is saved.",
        metavar="FILE",
    )
    machine: str | None = option(
        None,
        MACHINE_HELP,
        metavar="MACHINE",
        names="machines",
        files=True,
        needs="program",
    )
    options: str | None = option(
        None,
        'With --program: options of pulsepath plan, as "--order 2 --rule dda".',
        metavar="OPTIONS",
        needs="program",
    )
    port: int = option(
        0,
        "Local port to serve on; give one to bookmark comparisons. Default: a free one.",
        least=0,
        most=MAX_PORT,
        metavar="PORT",
    )
    no_browser: bool = option(False, "Print the address only.")


# Options of `pulsepath plan` that the studio gives itself.
DIRECTORY_OPTIONS = ("--out", "--machine", "--dump-config")
FOLDER = click.Path(path_type=Path, file_okay=False)


@click.command()
@click.argument("directory", metavar="[DIR]", type=FOLDER, default="out")
@with_request(StudioRequest)
@json_option
def studio(request: StudioRequest, as_json: bool) -> None:
    """Show the reports below DIR side by side.

    DIR defaults to out. Opens a browser with the list of plans, comparisons and calibrations. The
    address /compare?left=NAME&right=NAME shows two side by side, with the differences between
    plans. A report reloads when it is rewritten. With --program, the program is planned again
    whenever you save it. The pages are served on loopback (127.0.0.1) only, until Ctrl-C.

    Example: pulsepath studio out --program program.toml
    """
    from kinematics.files.toml_document import read
    from kinematics.foundation.errors import MotionError
    from pulsepath.output.studio import Replanner, Studio
    from pulsepath.page_server import serve_until_interrupted

    folder = request.directory
    replanner = None
    if request.program is not None:
        arguments = _split(request.options or "")
        if not request.program.is_file():
            read(request.program)  # reports why not
        replanner = Replanner(request.program, request.machine, arguments, folder)
    elif not folder.is_dir():
        raise MotionError(
            f"{folder}: there is no such folder; give that of a plan, or one above several",
        )
    with replanner or nullcontext():
        answer = Studio(folder, replanner).answer
        about = {"folder": str(folder)}
        serve_until_interrupted(answer, request.port, about, request.no_browser, as_json)


def _split(options: str) -> Sequence[str]:
    """Return the options of a plan, split as a shell does, without options of its directory."""
    try:
        arguments = shlex.split(options)
    except ValueError as error:
        raise click.UsageError(f"--options: {error}.", click.get_current_context()) from None
    for argument in arguments:
        name = argument.partition("=")[0]
        if name in DIRECTORY_OPTIONS or not arguments[0].startswith("-"):
            raise click.UsageError(
                f"--options: {argument} cannot stand here; write options of pulsepath plan other "
                "than --out, --machine and --dump-config.",
                click.get_current_context(),
            )
    return arguments
