"""`pulsepath hold`: the soonest stop along a plan's path, the way on, and a table of stops."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from planner.request import option
from pulsepath.command_group import FormatCommand
from pulsepath.commands.common import print_json, print_result
from pulsepath.format_options import STOPS
from pulsepath.options import json_option, plan_argument, read_speed_share, unverified_option
from pulsepath.process.intent import writes
from pulsepath.progress import say, step
from pulsepath.request_options import with_request

if TYPE_CHECKING:
    from planner.interruption.hold import Stops
    from planner.interruption.section import Section, Whole

TABLE_SUFFIXES = (".csv", ".json", ".npz")


class Hold(FormatCommand):
    """Options of the export formats that can hold a stop."""

    formats = "STOPS"


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldRequest:
    """A stop of the plan in a directory and the way on from it, or a table of stops."""

    directory: Path
    at: str | None = option(
        None,
        'Instant from which to stop, as "1.2 s" or "40 %".',
        metavar="TIME",
    )
    stops: int | None = option(
        None,
        "Instead of --at: time and distance to rest from COUNT instants; --out writes them as .csv, .json or .npz.",
        least=1,
        metavar="COUNT",
    )
    format: str | None = option(
        None,
        "Write the stop in this export format, listed below, to --out.",
        metavar="FORMAT",
        names="stop_formats",
    )
    out: Path | None = option(None, "Output file of the stop, or the table.", metavar="FILE")
    resume: Path | None = option(
        None,
        "Also write the motion from the stop to the end.",
        metavar="FILE",
    )
    speed: str | None = option(
        None,
        'Of --resume: at this share of the plan\'s speed, as "50 %".',
        metavar="PERCENT",
    )

    def check(self) -> None:
        """Raise BadValue for options that do not go together."""
        from kinematics.foundation.errors import BadValue

        at = self.at
        out = self.out
        resume = self.resume
        if (at is None) == (self.stops is None):
            raise BadValue("give --at TIME, or --stops COUNT")
        if self.format is None and at is not None and (out is not None or resume is not None):
            raise BadValue("--out and --resume write a format: give --format, as --format steps")
        if self.format is not None and (at is None or out is None):
            raise BadValue("--format needs --at TIME and --out FILE")
        if resume is not None and out is None:
            raise BadValue("--resume continues from a written stop: give --out FILE too")
        if resume is not None and resume.resolve() == (out and out.resolve()):
            both = f"--out and --resume are the same file, {out}"
            raise BadValue(f"{both}: give two, one for the stop and one for the way on")
        if self.speed is not None and resume is None:
            raise BadValue("--speed is that of the way on: give --resume FILE too")
        if self.stops is not None and out is not None and out.suffix not in TABLE_SUFFIXES:
            kinds = ", ".join(TABLE_SUFFIXES)
            raise BadValue(
                f"{out}: a table of stops is written as {kinds}; give a name that ends so"
            )


@click.command(cls=Hold)
@plan_argument
@with_request(HoldRequest)
@unverified_option
@click.option("--force", is_flag=True, help="Overwrite existing files.")
@json_option
def hold(
    request: HoldRequest,
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
    from pulsepath.output.directory import read_instant, refuse_no_plan

    request.check()
    share = None if request.speed is None else read_speed_share(request.speed)
    targets = [target for target in (request.out, request.resume) if target is not None]
    refuse_no_plan(request.directory)
    destinations = [Destination(target, force=force) for target in targets]
    writes(*targets)
    instant = None if request.at is None else read_instant(request.directory, request.at)
    from planner.interruption.hold import find_stops
    from pulsepath.output import record
    from pulsepath.sections import read_whole, say_errors, write_section

    plan, whole = read_whole(request.directory, unverified)
    doubts = record.record_doubts(plan.doubts)
    if request.stops is not None:
        with step("computing stops") as progress:
            table = find_stops(whole, request.stops, progress)
        for destination in destinations:
            with destination.stage() as file:
                table.files()[destination.path.suffix](file)
        print_result({**_record_stops(table), **doubts}, table.tables(), as_json)
        return

    assert instant is not None
    stop, onward = _compute(whole, instant, request.resume is not None, share)
    files = []
    if request.format is not None:
        options = STOPS.options_of(request.format, given)
        sections = [section for section in (stop, onward) if section is not None]
        for section, destination in zip(sections, destinations, strict=True):
            files.append(write_section(section, request.format, destination, options))
    if as_json:
        print_json({**_record_sections(stop, onward), "files": files, **doubts})
        return
    from planner.pulses.triggers import trigger_tables
    from pulsepath.output.tables import show

    show(stop.tables())
    if onward is not None:
        pace = "at the plan's own speed"
        if share is not None and share < 1:
            pace = f"at {request.speed} of the plan's speed"
        elif share is None and whole.fastest:
            pace = "the fastest motion"
        say(f"from there to the end: {onward.duration:.6f} s, certified, {pace}")
        show(trigger_tables(onward.triggers, onward.path.names))
    say_errors(files, plan)


def _compute(
    whole: "Whole",
    instant: float,
    resumed: bool,
    share: float | None,
) -> "tuple[Section, Section | None]":
    """Compute the stop from an instant (s), and the way on from it at a share of the plan's
    speed.
    """
    from planner.interruption.hold import hold as stop_at
    from planner.interruption.resume import resume as resume_from

    with step("computing the stop"):
        stop = stop_at(whole, instant)
        return stop, resume_from(whole, stop, share) if resumed else None


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
