"""`pulsepath track`: a plan on emulated hardware, under tracking laws."""

from pathlib import Path

import click

from pulsepath import known_names
from pulsepath.intent import writes
from pulsepath.known_names import completing
from pulsepath.options import json_option, unverified_option


@click.command()
@click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--law",
    "laws",
    multiple=True,
    required=True,
    metavar="LAW",
    help='As "6" or "6:gain=0.7"; may be repeated.',
    shell_complete=completing(known_names.laws),
)
@unverified_option
@click.option("--force", is_flag=True, help="Replace an earlier track.json.")
@json_option
def track(directory: Path, laws: tuple[str, ...], unverified: bool, force: bool, as_json: bool) -> None:
    """Track the plan in DIR on emulated hardware.

    Runs it through an emulated motion card and servo drives under each LAW, and writes the errors into DIR/track.json.

    Example: pulsepath track out/circle --law 3 --law 6:gain=0.7
    """
    writes(directory / "track.json")
    from benchmarks.sweep import read_setting
    from controllers import evaluate
    from controllers import track as run
    from controllers.metrics.evaluate import PERIOD
    from kinematics.destination import Destination
    from pulsepath import plan_directory, record, tables
    from pulsepath.progress import step

    target = Destination(directory / plan_directory.TRACK, force=force)
    chosen = [read_setting(law).made() for law in laws]
    planned = plan_directory.read(directory, unverified)
    metrics = []
    for law in chosen:
        with step(f"tracking under {law.name}"):
            tracked = run(planned.trajectory, planned.machine, law, period=PERIOD)
            metrics.append(evaluate(tracked, planned.trajectory, planned.machine))
    text = record.as_json(
        {"schema": record.SCHEMA, **record.of_doubts(planned.doubts), "laws": record.of_tracking(metrics)}
    )
    target.write(text)
    if as_json:
        click.echo(text, nl=False)
    else:
        tables.show(tables.of_tracking(metrics))
        for doubt in planned.doubts:
            click.echo(f"NOT VERIFIED: {doubt}")
