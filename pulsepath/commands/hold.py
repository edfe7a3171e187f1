"""`pulsepath hold`: the soonest stop along a plan's path, the way on, and a table of stops."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pulsepath.command_group import FormatCommand
from pulsepath.format_options import STOPS
from pulsepath.known_names import make_completer
from pulsepath.options import json_option, read_speed_share, unverified_option
from pulsepath.process.intent import writes
from pulsepath.progress import say, step

if TYPE_CHECKING:
    from planner.interruption.hold import Stops
    from planner.interruption.section import Section

TABLE_SUFFIXES = (".csv", ".json", ".npz")


class Hold(FormatCommand):
    """Options of the export formats that can hold a stop."""

    formats = "STOPS"


@click.command(cls=Hold)
@click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
@click.option("--at", metavar="TIME", help='Instant from which to stop, as "1.2 s" or "40 %".')
@click.option(
    "--stops",
    type=click.IntRange(min=1),
    metavar="COUNT",
    help="Instead of --at: time and distance to rest from COUNT instants; --out writes them as .csv, .json or .npz.",
)
@click.option(
    "--format",
    "name",
    metavar="FORMAT",
    shell_complete=make_completer(STOPS.names),
    help="Write the stop in this export format, listed below, to --out.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Output file of the stop, or the table.",
)
@click.option(
    "--resume",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Also write the motion from the stop to the end.",
)
@click.option(
    "--speed",
    metavar="PERCENT",
    help='Of --resume: at this share of the plan\'s speed, as "50 %".',
)
@unverified_option
@click.option("--force", is_flag=True, help="Overwrite existing files.")
@json_option
def hold(
    directory: Path,
    at: str | None,
    stops: int | None,
    name: str | None,
    out: Path | None,
    resume: Path | None,
    speed: str | None,
    unverified: bool,
    force: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Stop the plan in DIR along its path, certified.

    The stop is as soon as the limits allow, and has pulses. Reads the plan and proves it again.
    The stop continues the plan's motion and pulses from TIME; its file starts there, at time 0.
    Constant speeds that segments require are not kept. At a rest the stop is empty: it takes no
    time and has no pulses.

    Example: pulsepath hold out/circle --at "1.2 s" --format steps --out stop.bin
    """
    from kinematics.files.atomic_files import Destination
    from kinematics.foundation.errors import BadValue
    from pulsepath.output.directory import read_instant, refuse_no_plan

    if (at is None) == (stops is None):
        raise BadValue("give --at TIME, or --stops COUNT")
    _refuse_files(at, name, out, resume)
    if speed is not None and resume is None:
        raise BadValue("--speed is that of the way on: give --resume FILE too")
    share = None if speed is None else read_speed_share(speed)
    if stops is not None and out is not None and out.suffix not in TABLE_SUFFIXES:
        kinds = ", ".join(TABLE_SUFFIXES)
        raise BadValue(f"{out}: a table of stops is written as {kinds}; give a name that ends so")
    targets = [target for target in (out, resume) if target is not None]
    refuse_no_plan(directory)
    destinations = [Destination(target, force=force) for target in targets]
    writes(*targets)
    instant = None if at is None else read_instant(directory, at)
    from planner.interruption.hold import find_stops
    from planner.interruption.hold import hold as stop_at
    from planner.interruption.resume import resume as resume_from
    from planner.pulses.triggers import trigger_tables
    from pulsepath.output import record
    from pulsepath.output.tables import show
    from pulsepath.sections import read_whole, say_errors, write_section

    planned, whole = read_whole(directory, unverified)
    if stops is not None:
        with step("computing stops") as progress:
            table = find_stops(whole, stops, progress)
        for destination in destinations:
            with destination.stage() as file:
                table.files()[destination.path.suffix](file)
        if as_json:
            data = {**_record_stops(table), **record.record_doubts(planned.doubts)}
            click.echo(record.as_json(data), nl=False)
        else:
            show(table.tables())
        return

    assert instant is not None
    with step("computing the stop"):
        stop = stop_at(whole, instant)
        onward = None if resume is None else resume_from(whole, stop, share)
    files = []
    if name is not None:
        options = STOPS.options_of(name, given)
        sections = [section for section in (stop, onward) if section is not None]
        for section, destination in zip(sections, destinations, strict=True):
            files.append(write_section(section, name, destination, options))
    if as_json:
        data = {
            **_record_sections(stop, onward),
            "files": files,
            **record.record_doubts(planned.doubts),
        }
        click.echo(record.as_json(data), nl=False)
        return
    show(stop.tables())
    if onward is not None:
        pace = "at the plan's own speed"
        if share is not None and share < 1:
            pace = f"at {speed} of the plan's speed"
        elif share is None and whole.fastest:
            pace = "the fastest motion"
        say(f"from there to the end: {onward.duration:.6f} s, certified, {pace}")
        show(trigger_tables(onward.triggers, onward.path.names))
    say_errors(files, planned)


def _refuse_files(at: str | None, name: str | None, out: Path | None, resume: Path | None) -> None:
    """Raise BadValue for output files that do not go with the other options."""
    from kinematics.foundation.errors import BadValue

    if name is None and at is not None and (out is not None or resume is not None):
        raise BadValue("--out and --resume write a format: give --format, as --format steps")
    if name is not None and (at is None or out is None):
        raise BadValue("--format needs --at TIME and --out FILE")
    if resume is not None and out is None:
        raise BadValue("--resume continues from a written stop: give --out FILE too")
    if resume is not None and resume.resolve() == (out and out.resolve()):
        raise BadValue(
            f"--out and --resume are the same file, {out}: give two, one for the stop and one for the way on"
        )


def _record_stops(stops: "Stops") -> dict[str, Any]:
    """Return the record of a table of stops."""
    return {
        "t_s": stops.t.tolist(),
        "s_m": stops.place.tolist(),
        "time_to_rest_s": stops.time.tolist(),
        "distance_to_rest_m": stops.distance.tolist(),
        "refused": [{"t_s": t, "reason": reason} for t, reason in stops.refused],
    }


def _record_sections(stop: "Section", onward: "Section | None") -> dict[str, Any]:
    """Return the record of a stop and of the way on from it."""
    from pulsepath.sections import list_triggers

    return {
        "held_at_s": stop.at,
        "duration_s": stop.duration,
        "distance_m": stop.distance,
        "certified": stop.certificate.holds,
        "triggers": list_triggers(stop),
        "resumed_s": None if onward is None else onward.duration,
        "resumed_triggers": None if onward is None else list_triggers(onward),
    }
