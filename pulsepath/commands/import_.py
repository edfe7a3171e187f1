"""`pulsepath import`: convert a file of another format to a TOML program."""

from collections.abc import Iterator
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from planner.request import option
from pulsepath.command_group import FormatCommand
from pulsepath.commands.common import print_json, refuse_suffix
from pulsepath.options import json_option, refuse_missing
from pulsepath.process.intent import writes
from pulsepath.progress import say
from pulsepath.request_options import with_request

if TYPE_CHECKING:
    from planner.sources.outline import Outline


class Import(FormatCommand):
    """Options of the formats that programs come in."""

    formats = "IMPORTS"


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportRequest:
    """A file of another format, the program to make of it, and a drawing if one is requested."""

    file: Path
    out: Path = option(MISSING, "Output TOML file.", metavar="PROGRAM")
    format: str | None = option(
        None,
        "Input format, listed below. Default: by the suffix of FILE.",
        metavar="FORMAT",
        names="imports",
    )
    figure: Path | None = option(
        None,
        "Also draw the path: PNG, SVG or PDF.",
        metavar="IMAGE",
    )


@click.command("import", cls=Import)
@click.argument("file", type=click.Path(path_type=Path))
@with_request(ImportRequest)
@click.option("--force", is_flag=True, help="Overwrite PROGRAM and IMAGE.")
@json_option
def import_(request: ImportRequest, force: bool, as_json: bool, **given: Any) -> None:
    """Convert FILE to a program.

    Prints a summary of what was read. The formats in brackets are those that an option applies to.

    Example: pulsepath import part.dxf --out part.toml
    """
    file = request.file
    out = request.out
    image = request.figure
    targets = [out] if image is None else [out, image]
    writes(*targets)
    from kinematics.files.atomic_files import Destination, name_file, stage_files
    from kinematics.foundation.errors import MotionError
    from kinematics.foundation.names import count_noun
    from pulsepath.format_options import IMPORTS
    from pulsepath.progress import step

    if image is not None:
        refuse_suffix(image, "a figure is")
    if len({path.absolute() for path in (file, *targets)}) <= len(targets):
        files = ", ".join(map(str, (file, *targets)))
        raise MotionError(f"{files} must be different files; give another --out or --figure")
    destinations = [Destination(target, force=force) for target in targets]
    refuse_missing(file)
    name = request.format or IMPORTS.suffixes().get(file.suffix.lower())
    if name is None:
        from planner.sources.source import source_name

        name = source_name(file)
    source = IMPORTS.make(name, given)
    from planner.sources.source import stream_program

    with step(f"reading {file}"):
        imported = stream_program(file, source)
    # These load after the faults of the file have been reported.
    from planner.avoidable_stops import find_stops_of_import
    from planner.program.program_writer import program_lines
    from planner.program.validation import MOST_SEGMENTS
    from planner.sources.outline import Outliner
    from pulsepath.output import record

    program = imported.program
    with step("counting stops"):
        stops = find_stops_of_import(program)
    count = len(program.segments)
    segments = count_noun(count, "segment")
    if count > MOST_SEGMENTS:
        raise MotionError(
            f"{file}: {segments}; a TOML program has at most {MOST_SEGMENTS}: plan the file as it "
            f"is (pulsepath plan {file.name}), or split it",
        )
    with step(f"writing {' and '.join(map(str, targets))}"), stage_files(destinations) as staged:
        title = f"{program.name}, imported from {file.name} ({name})"
        outliner = Outliner(program)
        followed = outliner.follow(program.segments)
        with name_file(staged[0]), staged[0].open("w", encoding="utf-8") as target:
            lines = program_lines(program, title, source=file.name, segments=followed)
            target.writelines(f"{line}\n" for line in lines)
        outline = outliner.finish()
        if image is not None:
            _draw(outline, segments, staged[1])
    if as_json:
        about = record.record_import(name, imported, outline, out, image)
        print_json({**about, "avoidable_stops": stops.record()})
        return
    drawing = "" if image is None else f"; drawn in {image}"
    say(f"{out}: {segments} from {file}, read as {name}{drawing}")
    entities = (f"{amount} {kind}" for kind, amount in imported.entities.items())
    say(f"  entities: {', '.join(entities)}")
    say(f"  extents: {', '.join(_list_extents(outline))}")
    say(f"  length: {outline.length * 1e3:.7g} mm")
    if stops.count:
        say(f"  stops: {stops.describe()}")
    for warning in imported.warnings:
        say(f"  warning: {warning}")


def _draw(outline: "Outline", segments: str, image: Path) -> None:
    """Draw a path in a file.

    Only here matplotlib loads, which takes longer than all else together.
    """
    from planner.sources.figures import program_path

    axes = program_path(outline, title=f"{segments}, {1e3 * outline.length:.6g} mm")
    figure = axes.get_figure(root=True)
    if figure is not None:
        figure.savefig(image, dpi=150)


def _list_extents(outline: "Outline") -> Iterator[str]:
    """Describe the range of a path along each axis."""
    for axis, low, high in zip("xyz", outline.low, outline.high, strict=True):
        # Rounding and adding 0 turn -1e-17 into 0 instead of -0.
        first, last = (round(1e3 * float(bound), 9) + 0.0 for bound in (low, high))
        yield f"{axis} {first:.6g} to {last:.6g} mm"
