"""`pulsepath view`: animate a plan in a browser, in a file, or as still images."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pulsepath.options import FIGURE_SUFFIXES, json_option, unverified_option
from pulsepath.process.intent import writes
from pulsepath.progress import say

if TYPE_CHECKING:
    from benchmarks.animation.frames import DrawnPlan


@click.command()
@click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--html", type=click.Path(path_type=Path), metavar="FILE", help="Write the page to FILE; do not serve it."
)
@click.option(
    "--stills",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write the four views at one instant: .pdf, .png or .svg.",
)
@click.option("--at", metavar="TIME", help='Time of the still images, as "1.2 s" or "40 %". Default: mid-motion.')
@click.option("--frames", type=click.IntRange(min=2), default=240, show_default=True, help="Frames of the animation.")
@click.option(
    "--magnify",
    type=click.FloatRange(min=0, min_open=True),
    metavar="FACTOR",
    help="Magnification of the quantization error; 1: true scale. Default: large enough to be seen.",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    metavar="PORT",
    help="Local port to serve on. Default: a free one.",
)
@click.option("--no-browser", is_flag=True, help="Print the address only.")
@unverified_option
@click.option("--force", is_flag=True, help="Replace FILE.")
@json_option
def view(
    directory: Path,
    html: Path | None,
    stills: Path | None,
    at: str | None,
    frames: int,
    magnify: float | None,
    port: int,
    no_browser: bool,
    unverified: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Animate the plan in DIR in 3-D and real time.

    Without --html and --stills, the page is served on loopback (127.0.0.1) only, until Ctrl-C. It needs no network.

    Example: pulsepath view out/circle --html circle.html
    """
    targets = [target for target in (stills, html) if target is not None]
    writes(*targets)
    from pulsepath.output.directory import read_instant, refuse_no_plan

    refuse_no_plan(directory)
    from kinematics import MotionError
    from kinematics.files.atomic_files import Destination
    from pulsepath.output import record
    from pulsepath.progress import step

    if at is not None and stills is None:
        raise MotionError("--at is the time of the still images: give --stills FILE too")
    destinations = {target: Destination(target, force=force) for target in targets}
    if stills is not None and stills.suffix.lower() not in FIGURE_SUFFIXES:
        raise MotionError(f"{stills}: still images are {', '.join(sorted(FIGURE_SUFFIXES))}; give a name that ends so")
    when = None if at is None else read_instant(directory, at)
    plan, doubts = _load_drawn_plan(directory, unverified)
    told: dict[str, Any] = {"program": plan.program.name, "machine": plan.machine.name, **record.of_doubts(doubts)}
    if stills is not None:
        from benchmarks.animation.stills import write_four_views

        with step(f"drawing {stills}"):
            write_four_views(plan, destinations[stills], when, magnify)
        told["stills"] = str(stills)
    if html is not None or stills is None:
        from benchmarks.animation.animate import document

        with step(f"drawing {frames} frames"):
            page = document(plan, frames, magnify)
        if html is None:
            for doubt in doubts:
                say(f"NOT VERIFIED: {doubt}", err=True)
            from pulsepath.page_server import answer_page, serve_until_interrupted

            serve_until_interrupted(answer_page(page), port, told, no_browser, as_json)
            return
        destinations[html].write(page)
        told |= {"html": str(html), "frames": frames, "bytes": html.stat().st_size}
    if as_json:
        click.echo(record.as_json(told), nl=False)
    else:
        for line in (*targets, *(f"NOT VERIFIED: {doubt}" for doubt in doubts)):
            say(str(line))


def _load_drawn_plan(directory: Path, unverified: bool) -> "tuple[DrawnPlan, tuple[str, ...]]":
    from benchmarks.animation.frames import DrawnPlan
    from pulsepath.sections import read_pulses
    from pulsepath.store.read import read

    planned = read(directory, unverified)
    with read_pulses(planned) as tell:
        pulses = planned.source.read_pulses(tell)
    drawn = DrawnPlan(planned.program, planned.machine, planned.trajectory, planned.limits, pulses)
    return drawn, planned.doubts
