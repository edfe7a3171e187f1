"""`pulsepath export`: write a plan in the format of another program or controller."""

import json
import re
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Any

import click

from planner.request import option
from pulsepath.command_group import FormatCommand
from pulsepath.commands.common import print_json, read_plan_with_pulses
from pulsepath.options import json_option, plan_argument, refuse_unknown, unverified_option
from pulsepath.process.intent import writes
from pulsepath.request_options import with_request


class Export(FormatCommand):
    """Options of the export formats."""

    formats = "EXPORTS"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportRequest:
    """A plan, and the format and file to write it to."""

    directory: Path
    format: str = option(
        MISSING,
        "Export format, listed below.",
        metavar="FORMAT",
        names="exports",
    )
    out: Path | None = option(
        None,
        "Output file. Default: named after program and format, in DIR, as DIR/circle.steps or DIR/circle.zaber.csv.",
        metavar="FILE",
    )


@click.command(cls=Export)
@plan_argument
@with_request(ExportRequest)
@unverified_option
@click.option("--force", is_flag=True, help="Overwrite FILE.")
@json_option
def export(
    request: ExportRequest,
    unverified: bool,
    force: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Write the plan in DIR in another format.

    Verifies the digests of the plan's files and proves its motion again. Reports the error of the
    written file against the plan. The brackets after an option name the formats that it applies to.

    Example: pulsepath export out/circle --format vcd
    """
    name = request.format
    directory = request.directory
    refuse_unknown(format=name)
    from pulsepath.output.directory import refuse_no_plan

    refuse_no_plan(directory)
    from kinematics.files.atomic_files import Destination
    from planner.export.format import ExportSource, export, find_format
    from pulsepath.format_options import EXPORTS
    from pulsepath.output import record
    from pulsepath.progress import step
    from pulsepath.sections import say_errors
    from pulsepath.store.verify import refuse_own

    target = request.out or directory / _name_file(directory, name, find_format(name).suffix)
    destination = Destination(target, force=force)
    writes(target)
    format_ = EXPORTS.make(name, given)
    plan, pulses = read_plan_with_pulses(directory, unverified)
    with step(f"writing {target}") as tell, destination.stage() as file:
        source = ExportSource(
            plan.program.name,
            plan.machine,
            plan.trajectory,
            pulses,
            tell,
            triggers=plan.triggers,
        )
        exported = export(format_, name, source, file)
        refuse_own(directory, target, file)
    written = record.record_export(name, str(target), exported, plan.doubts)
    if as_json:
        print_json(written)
    else:
        say_errors([written], plan)


def _name_file(directory: Path, name: str, suffix: str) -> str:
    """Return the name of the file: "circle.steps", and with a suffix of several formats
    "circle.zaber.csv"."""
    from pulsepath.output.directory import RECORD

    program = str(
        json.loads((directory / RECORD).read_bytes()).get("program") or directory.resolve().name,
    )
    stem = re.sub(r"[^\w.-]+", "_", program).strip("._") or "plan"
    return f"{stem}{suffix}" if suffix == f".{name}" else f"{stem}.{name}{suffix}"
