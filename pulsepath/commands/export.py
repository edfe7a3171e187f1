"""`pulsepath export`: write a plan in the format of another program or controller."""

import json
import re
from pathlib import Path
from typing import Any

import click

from pulsepath import known_names
from pulsepath.command_group import FormatCommand
from pulsepath.known_names import make_completer
from pulsepath.options import refuse_unknown, unverified_option
from pulsepath.process.intent import writes


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
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Output file. Default: named after program and format, in DIR, as DIR/circle.steps or DIR/circle.zaber.csv.",
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
    from pulsepath.output import record
    from pulsepath.progress import step
    from pulsepath.sections import read_pulses, say_errors
    from pulsepath.store.read import read
    from pulsepath.store.verify import refuse_own

    target = out or directory / _name_file(directory, name, find_format(name).suffix)
    destination = Destination(target, force=force)
    writes(target)
    format_ = EXPORTS.make(name, given)
    planned = read(directory, unverified)
    with read_pulses(planned) as tell:
        pulses = planned.source.read_pulses(tell)
    with step(f"writing {target}") as tell, destination.stage() as file:
        source = ExportSource(
            planned.program.name,
            planned.machine,
            planned.trajectory,
            pulses,
            tell,
            triggers=planned.triggers,
        )
        done = export(format_, name, source, file)
        refuse_own(directory, target, file)
    written = record.of_export(name, str(target), done, planned.doubts)
    if as_json:
        click.echo(record.as_json(written), nl=False)
    else:
        say_errors([written], planned)


def _name_file(directory: Path, name: str, suffix: str) -> str:
    """The program, the format unless the suffix says it, and the suffix: "circle.steps", "circle.zaber.csv"."""
    from pulsepath.output.directory import RECORD

    program = str(json.loads((directory / RECORD).read_bytes()).get("program") or directory.resolve().name)
    stem = re.sub(r"[^\w.-]+", "_", program).strip("._") or "plan"
    return f"{stem}{suffix}" if suffix == f".{name}" else f"{stem}.{name}{suffix}"
