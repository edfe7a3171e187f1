"""`pulsepath export`: write a plan in the format of another program or controller."""

from pathlib import Path
from typing import Any

import click

from pulsepath import known_names
from pulsepath.command_group import FormatCommand
from pulsepath.known_names import make_completer
from pulsepath.options import refuse_unknown, unverified_option
from pulsepath.process.intent import writes
from pulsepath.progress import say


class Export(FormatCommand):
    """Options of the export formats."""

    formats = "EXPORTS"


@click.command(cls=Export)
@click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "name",
    required=True,
    metavar="FORMAT",
    help="Export format, listed below.",
    shell_complete=make_completer(known_names.exports),
)
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE", help="Output file. Default: DIR/FORMAT with its suffix."
)
@unverified_option
@click.option("--force", is_flag=True, help="Overwrite FILE.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
def export(
    directory: Path, name: str, out: Path | None, unverified: bool, force: bool, as_json: bool, **given: Any
) -> None:
    """Write the plan in DIR in another format.

    Verifies the digests of the plan's files and proves its motion again. Reports the error of the written file against
    the plan. The brackets after an option name the formats that it applies to.

    Example: pulsepath export out/circle --format vcd
    """
    refuse_unknown(format=name)
    from pulsepath.output.directory import refuse_no_plan

    refuse_no_plan(directory)
    from kinematics.files.atomic_files import Destination
    from planner.export.format import ExportSource, export, find_format
    from pulsepath.format_options import EXPORTS
    from pulsepath.output import plan_directory, record
    from pulsepath.progress import step

    target = out or directory / f"{name}{find_format(name).suffix}"
    destination = Destination(target, force=force)
    writes(target)
    format_ = EXPORTS.make(name, given)
    planned = plan_directory.read(directory, unverified)
    with step("generating pulses") as tell:
        pulses = planned.pulses(tell)
    with step(f"writing {target}") as tell, destination.stage() as file:
        source = ExportSource(planned.program.name, planned.machine, planned.trajectory, pulses, tell)
        done = export(format_, name, source, file)
        plan_directory.refuse_own(directory, target, file)
    if as_json:
        click.echo(record.as_json(record.of_export(name, str(target), done, planned.doubts)), nl=False)
    else:
        say(f"{target}: error {done.error:.3g} pulses against {done.against}")
        if made_up := sorted({kind for axis in planned.machine.axes for kind in axis.compensate}):
            say(f"  positions are the motors': {' and '.join(made_up)} made up for")
        for note in (*done.notes, *(f"NOT VERIFIED: {doubt}" for doubt in planned.doubts)):
            say(f"  {note}")
