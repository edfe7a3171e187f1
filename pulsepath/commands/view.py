"""`pulsepath view`: animate a plan in a browser, in a file, or as still images."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from planner.request import option
from pulsepath.commands.common import print_json, read_plan_with_pulses, refuse_suffix, say_doubts
from pulsepath.options import MAX_PORT, json_option, plan_argument, unverified_option
from pulsepath.process.intent import writes
from pulsepath.progress import say
from pulsepath.request_options import with_request


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewRequest:
    """An animation or still images of the plan in a directory."""

    directory: Path
    html: Path | None = option(
        None,
        "Write the page to FILE; do not serve it.",
        metavar="FILE",
    )
    stills: Path | None = option(
        None,
        "Write the four views at one instant: .pdf, .png or .svg.",
        metavar="FILE",
    )
    at: str | None = option(
        None,
        'Time of the still images, as "1.2 s" or "40 %". Default: mid-motion.',
        metavar="TIME",
        needs="stills",
    )
    frames: int = option(240, "Frames of the animation.", least=2)
    magnify: float | None = option(
        None,
        "Magnification of the quantization error; 1: true scale. Default: large enough to be seen.",
        above=0,
        metavar="FACTOR",
    )
    port: int = option(
        0,
        "Local port to serve on. Default: a free one.",
        least=0,
        most=MAX_PORT,
        metavar="PORT",
    )
    no_browser: bool = option(False, "Print the address only.")


@click.command()
@plan_argument
@with_request(ViewRequest)
@unverified_option
@click.option("--force", is_flag=True, help="Replace FILE.")
@json_option
def view(request: ViewRequest, unverified: bool, force: bool, as_json: bool) -> None:
    """Animate the plan in DIR in 3-D and real time.

    Without --html and --stills, the page is served on loopback (127.0.0.1) only, until Ctrl-C. It
    needs no network.

    Example: pulsepath view out/circle --html circle.html
    """
    html = request.html
    stills = request.stills
    targets = [target for target in (stills, html) if target is not None]
    writes(*targets)
    from pulsepath.output.directory import read_instant, refuse_no_plan

    refuse_no_plan(request.directory)
    from kinematics.files.atomic_files import Destination
    from pulsepath.output import record
    from pulsepath.progress import step

    destinations = {target: Destination(target, force=force) for target in targets}
    if stills is not None:
        refuse_suffix(stills, "still images are")
    instant = None if request.at is None else read_instant(request.directory, request.at)
    plan, pulses = read_plan_with_pulses(request.directory, unverified)
    from benchmarks.animation.frames import DrawnPlan

    drawn = DrawnPlan(plan.program, plan.machine, plan.trajectory, plan.limits, pulses)
    result: dict[str, Any] = {
        "program": plan.program.name,
        "machine": plan.machine.name,
        **record.record_doubts(plan.doubts),
    }
    if stills is not None:
        from benchmarks.animation.stills import write_four_views

        with step(f"drawing {stills}"):
            write_four_views(drawn, destinations[stills], instant, request.magnify)
        result["stills"] = str(stills)
    if html is not None or stills is None:
        from benchmarks.animation.animate import document

        with step(f"drawing {request.frames} frames"):
            page = document(drawn, request.frames, request.magnify)
        if html is None:
            say_doubts(plan.doubts, err=True)
            _serve(request, page, result, as_json)
            return
        destinations[html].write(page)
        result |= {"html": str(html), "frames": request.frames, "bytes": html.stat().st_size}
    if as_json:
        print_json(result)
        return
    for target in targets:
        say(target)
    say_doubts(plan.doubts)


def _serve(request: ViewRequest, page: str, result: dict[str, Any], as_json: bool) -> None:
    from pulsepath.page_server import answer_page, serve_until_interrupted

    answer = answer_page(page)
    serve_until_interrupted(answer, request.port, result, request.no_browser, as_json)
