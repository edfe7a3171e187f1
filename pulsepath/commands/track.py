"""`pulsepath track`: run a plan on emulated hardware under tracking laws."""

from pathlib import Path

import click

from pulsepath import known_names
from pulsepath.known_names import make_completer
from pulsepath.options import LAWS, json_option, refuse_unknown, unverified_option
from pulsepath.process.intent import writes
from pulsepath.progress import say


@click.command()
@click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--rig",
    metavar="RIG",
    help='Drives of the axes: preset or file; "pulsepath rigs" lists them. Default: the bundled rig that fits.',
    shell_complete=make_completer(known_names.rigs, files=True),
)
@click.option(
    "--law",
    "laws",
    multiple=True,
    default=LAWS,
    show_default=True,
    metavar="LAW",
    help='Tracking law, as "6" or "6:gain=0.7"; repeatable.',
    shell_complete=make_completer(known_names.laws),
)
@unverified_option
@click.option("--force", is_flag=True, help="Overwrite an earlier track.json.")
@json_option
def track(
    directory: Path, rig: str | None, laws: tuple[str, ...], unverified: bool, force: bool, as_json: bool
) -> None:
    """Track the plan in DIR on an emulated motion card and drives.

    Runs the plan on RIG under each LAW and writes the errors to DIR/track.json. RIG is a bundled rig or a TOML file
    whose machine has the plan's axes. The default is the one bundled rig that fits, and its name is printed. If none
    fits, no rig is assumed and the plan is not tracked.

    Example: pulsepath track out/circle --rig hexapod-steppers --law 3 --law 6:gain=0.7
    """
    writes(directory / "track.json")
    refuse_unknown(rig=rig, laws=laws)
    from pulsepath.output.directory import refuse_no_plan

    refuse_no_plan(directory)
    import controllers
    from benchmarks.reports.gain.laws_outcome import describe_blind
    from benchmarks.sweep import read_setting
    from benchmarks.sweep.run import reads_encoder
    from controllers.metrics.evaluate import PERIOD
    from controllers.rig_choice import choose_rig
    from kinematics.files.atomic_files import Destination
    from planner.shaping.shaped_motion import shape_motion
    from pulsepath.output import record, tables
    from pulsepath.progress import note, step
    from pulsepath.store.files import TRACK
    from pulsepath.store.read import read

    target = Destination(directory / TRACK, force=force)
    settings = [read_setting(law) for law in laws]
    planned = read(directory, unverified)
    behind = choose_rig(planned.machine, rig)
    if rig is None:
        note(f"on rig {behind.about}: the bundled rig that fits {planned.machine.name}; choose another with --rig")
    metrics, motion = [], shape_motion(planned.trajectory, planned.machine.axes) or planned.trajectory
    for law in [setting.make_law(behind) for setting in settings]:
        with step(f"tracking under {law.name}"):
            tracked = controllers.track(motion, planned.machine, law, rig=behind, period=PERIOD)
            metrics.append(controllers.evaluate(tracked, motion, planned.machine))
    found = {**record.of_doubts(planned.doubts), **record.of_tracking(behind, metrics)}
    text = record.as_json({"schema": record.SCHEMA, **found})
    target.write(text)
    if as_json:
        click.echo(text, nl=False)
    else:
        say(f"rig {behind.about}")
        tables.show(tables.of_tracking(metrics))
        blind = [behind.name] if not all(map(reads_encoder, behind.drives)) else []
        for sentence in describe_blind([setting.law for setting in settings], blind):
            say(sentence)
        for doubt in planned.doubts:
            say(f"NOT VERIFIED: {doubt}")
