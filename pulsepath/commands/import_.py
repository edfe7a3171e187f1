"""`pulsepath import`: convert a file of another format to a TOML program."""

from pathlib import Path
from typing import Any

import click

from pulsepath import known_names
from pulsepath.command_group import FormatCommand
from pulsepath.known_names import make_completer
from pulsepath.options import FIGURE_SUFFIXES, refuse_missing
from pulsepath.process.intent import writes
from pulsepath.progress import say


class Import(FormatCommand):
    """Options of the formats that programs come in."""

    formats = "IMPORTS"


@click.command("import", cls=Import)
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="PROGRAM", help="Output TOML file.")
@click.option(
    "--format",
    "name",
    metavar="FORMAT",
    help="Input format, listed below. Default: by the suffix of FILE.",
    shell_complete=make_completer(known_names.imports),
)
@click.option(
    "--figure",
    type=click.Path(path_type=Path),
    metavar="IMAGE",
    help="Drawing of the path: PNG, SVG or PDF. Default: PROGRAM with suffix .png.",
)
@click.option("--force", is_flag=True, help="Overwrite PROGRAM and IMAGE.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
def import_(
    file: Path, out: Path, name: str | None, figure: Path | None, force: bool, as_json: bool, **given: Any
) -> None:
    """Convert FILE to a program, and draw it.

    Prints a summary of what was read. The formats in brackets are those that an option applies to.

    Example: pulsepath import part.dxf --out part.toml
    """
    image = figure or out.with_suffix(".png")
    writes(out, image)
    from kinematics.files.atomic_files import Destination, name_file, stage_files
    from kinematics.foundation.errors import MotionError
    from kinematics.foundation.names import count_noun
    from pulsepath.format_options import IMPORTS
    from pulsepath.progress import step

    if image.suffix.lower() not in FIGURE_SUFFIXES:
        raise MotionError(f"{image}: a figure is one of {', '.join(FIGURE_SUFFIXES)}; give --figure such a suffix")
    if len({path.absolute() for path in (file, out, image)}) < 3:
        raise MotionError(f"{file}, {out} and {image} must be three different files; give another --out or --figure")
    destinations = [Destination(target, force=force) for target in (out, image)]
    refuse_missing(file)
    if name is None:
        name = IMPORTS.suffixes().get(file.suffix.lower())
    if name is None:
        from planner.sources.source import source_name

        name = source_name(file)
    source = IMPORTS.make(name, given)
    from planner.sources.source import stream_program

    with step(f"reading {file}"):
        imported = stream_program(file, source)
    # loaded after the faults of the file have been found, which then show sooner
    import numpy as np

    from planner.avoidable_stops import find_stops_of_import
    from planner.program.program_writer import program_lines
    from planner.program.validation import MOST_SEGMENTS
    from planner.sources.outline import Outliner
    from pulsepath.output import record

    with step("counting stops"):
        stops = find_stops_of_import(imported.program)
    count = len(imported.program.segments)
    if count > MOST_SEGMENTS:
        raise MotionError(
            f"{file}: {count_noun(count, 'segment')}; a TOML program has at most {MOST_SEGMENTS}: plan the file as it "
            f"is (pulsepath plan {file.name}), or split it"
        )
    with step(f"writing {out} and {image}"), stage_files(destinations) as (written, drawn):
        from planner.sources.figures import program_path

        title = f"{imported.program.name}, imported from {file.name} ({name})"
        outliner = Outliner(imported.program)
        segments = outliner.follow(imported.program.segments)
        with name_file(written), written.open("w", encoding="utf-8") as target:
            lines = program_lines(imported.program, title, source=file.name, segments=segments)
            target.writelines(f"{line}\n" for line in lines)
        way = outliner.finish()
        axes = program_path(way, title=f"{count_noun(count, 'segment')}, {1e3 * way.length:.6g} mm")
        figure_of = axes.get_figure(root=True)
        if figure_of is not None:
            figure_of.savefig(drawn, dpi=150)
    about = record.of_import(name, imported, way, str(out), str(image))
    about |= {"avoidable_stops": stops.record()}
    if as_json:
        click.echo(record.as_json(about), nl=False)
        return
    say(f"{out}: {count_noun(about['segments'], 'segment')} from {file}, read as {name}; drawn in {image}")
    say("  entities: " + ", ".join(f"{count} {kind}" for kind, count in imported.entities.items()))
    ranges = zip("xyz", *(np.round(corner * 1e3, 9) + 0.0 for corner in (way.low, way.high)), strict=True)
    say("  extents: " + ", ".join(f"{axis} {low:.6g} to {high:.6g} mm" for axis, low, high in ranges))
    say(f"  length: {way.length * 1e3:.7g} mm")
    if stops.count:
        say(f"  stops: {stops.describe()}")
    for warning in imported.warnings:
        say(f"  warning: {warning}")
