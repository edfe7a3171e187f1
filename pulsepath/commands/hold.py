"""`pulsepath hold`: the soonest stop along a plan's path, the way on from there, and how soon from anywhere."""

from pathlib import Path
from typing import Any

import click

from pulsepath.command_group import FormatCommand
from pulsepath.format_options import STOPS
from pulsepath.known_names import make_completer
from pulsepath.options import json_option, read_speed_share, unverified_option
from pulsepath.process.intent import writes
from pulsepath.progress import say, step

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
@click.option("--format", "name", metavar="FORMAT", shell_complete=make_completer(STOPS.names),
              help="Write the stop in this export format, listed below, to --out.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="Output file of the stop, or the table.")
@click.option(
    "--resume", type=click.Path(path_type=Path), metavar="FILE", help="Also write the motion from the stop to the end."
)
@click.option("--speed", metavar="PERCENT", help='Of --resume: at this share of the plan\'s speed, as "50 %".')
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

    The stop is as soon as the limits allow, and has pulses. Reads the plan and proves it again. The stop continues
    the plan's motion and pulses from TIME; its file starts there, at time 0. Constant speeds that segments require
    are not kept. At a rest the stop is empty: it takes no time and has no pulses.

    Example: pulsepath hold out/circle --at "1.2 s" --format steps --out stop.bin
    """
    from kinematics.files.atomic_files import Destination
    from kinematics.foundation.errors import BadValue
    from pulsepath.output.directory import read_instant, refuse_no_plan

    if (at is None) == (stops is None):
        raise BadValue("give --at TIME, or --stops COUNT")
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
    if speed is not None and resume is None:
        raise BadValue("--speed is that of the way on: give --resume FILE too")
    share = None if speed is None else read_speed_share(speed)
    if stops is not None and out is not None and out.suffix not in TABLE_SUFFIXES:
        raise BadValue(f"{out}: a table of stops is written as {', '.join(TABLE_SUFFIXES)}; give a name that ends so")
    targets = [target for target in (out, resume) if target is not None]
    refuse_no_plan(directory)
    destinations = [Destination(target, force=force) for target in targets]
    writes(*targets)
    instant = None if at is None else read_instant(directory, at)
    from planner.interruption.hold import find_stops
    from planner.interruption.hold import hold as stop_at
    from planner.interruption.resume import resume as go_on
    from planner.pulses.triggers import trigger_tables
    from pulsepath.output import record
    from pulsepath.output.tables import show
    from pulsepath.sections import list_triggers, read_whole, say_errors, write_section

    planned, whole = read_whole(directory, unverified)
    if stops is not None:
        with step("computing stops") as tell:
            found = find_stops(whole, stops, tell)
        for destination in destinations:
            with destination.stage() as file:
                found.files()[destination.path.suffix](file)
        if as_json:
            rows = {name: values.tolist() for name, values in (("t_s", found.t), ("s_m", found.place))}
            rests = {"time_to_rest_s": found.time.tolist(), "distance_to_rest_m": found.distance.tolist()}
            rests["refused"] = [{"t_s": t, "reason": why} for t, why in found.refused]
            click.echo(record.as_json({**rows, **rests, **record.of_doubts(planned.doubts)}), nl=False)
        else:
            show(found.tables())
        return
    assert instant is not None
    with step("computing the stop"):
        made = [stop_at(whole, instant)]
        if resume is not None:
            made.append(go_on(whole, made[0], share))
    options = {} if name is None else STOPS.options_of(name, given)
    files = [
        write_section(each, name, destination, options)
        for each, destination in zip(made, destinations, strict=False)
        if name
    ]
    if as_json:
        told = {
            "held_at_s": made[0].at,
            "duration_s": made[0].duration,
            "distance_m": made[0].distance,
            "certified": made[0].certificate.holds,
            "triggers": list_triggers(made[0]),
            "resumed_s": made[1].duration if len(made) > 1 else None,
            "resumed_triggers": list_triggers(made[1]) if len(made) > 1 else None,
            "files": files,
            **record.of_doubts(planned.doubts),
        }
        click.echo(record.as_json(told), nl=False)
        return
    show(made[0].tables())
    if len(made) > 1:
        pace = "the fastest motion" if share is None and whole.fastest else "at the plan's own speed"
        if share is not None and share < 1:
            pace = f"at {speed} of the plan's speed"
        say(f"from there to the end: {made[1].duration:.6f} s, certified, {pace}")
        show(trigger_tables(made[1].triggers, made[1].path.names))
    say_errors(files, planned)
