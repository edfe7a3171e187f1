"""`pulsepath override`: a plan at less of its speed, as a whole or from an instant on."""

from pathlib import Path
from typing import Any

import click

from pulsepath import known_names
from pulsepath.command_group import FormatCommand
from pulsepath.known_names import make_completer
from pulsepath.options import json_option, read_speed_share, unverified_option
from pulsepath.process.intent import writes
from pulsepath.progress import say, step


class Override(FormatCommand):
    """Options of the export formats."""

    formats = "EXPORTS"


@click.command(cls=Override)
@click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
@click.option("--speed", metavar="PERCENT", required=True, help='Share of the plan\'s speed, as "50 %", up to 100 %.')
@click.option(
    "--at", metavar="TIME", help='Instant to change the speed from, as "1.2 s" or "40 %". Default: all of it.'
)
@click.option("--format", "name", metavar="FORMAT", shell_complete=make_completer(known_names.exports),
              help="Write the motion in this export format, listed below, to --out.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="Output file.")
@unverified_option
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
@json_option
def override(
    directory: Path,
    speed: str,
    at: str | None,
    name: str | None,
    out: Path | None,
    unverified: bool,
    force: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Run the plan in DIR at less of its speed, certified.

    With --at the speed changes as soon as the limits allow, and the file goes on with the plan's pulses from there,
    at time 0. Reads the plan and proves it again. Dwells last as long as before; constant speeds that segments require
    are not kept.

    Example: pulsepath override out/circle --speed "50 %" --at "1.2 s" --format steps --out slow.bin
    """
    from kinematics.files.atomic_files import Destination
    from kinematics.foundation.errors import BadValue
    from pulsepath.output.directory import read_instant, refuse_no_plan

    if (name is None) != (out is None):
        raise BadValue("--format and --out go together: give both to write the motion, or none to see what it takes")
    share = read_speed_share(speed)
    refuse_no_plan(directory)
    destination = None
    if out is not None:
        destination = Destination(out, force=force)
        writes(out)
    instant = None if at is None else read_instant(directory, at)
    from planner.interruption.override import override as change_speed
    from pulsepath.format_options import EXPORTS
    from pulsepath.output import record
    from pulsepath.output.tables import show
    from pulsepath.sections import list_triggers, read_whole, say_errors, write_section

    planned, whole = read_whole(directory, unverified)
    with step("computing the motion"):
        made = change_speed(whole, share, instant)
    files = []
    if name is not None and destination is not None:
        files.append(write_section(made, name, destination, EXPORTS.options_of(name, given)))
    if as_json:
        told = {
            "speed": share,
            "at_s": made.at,
            "duration_s": made.duration,
            "certified": made.certificate.holds,
            "triggers": list_triggers(made),
            "files": files,
            **record.of_doubts(planned.doubts),
        }
        click.echo(record.as_json(told), nl=False)
        return
    show(made.tables())
    say(f"at {speed} of the plan's speed" + ("" if instant is None else ", as soon as the limits allow"))
    say_errors(files, planned)
