"""`pulsepath track`: run a plan on emulated hardware under tracking laws."""

from dataclasses import dataclass
from pathlib import Path

import click

from planner.request import option
from pulsepath.commands.common import say_doubts
from pulsepath.options import LAWS, json_option, plan_argument, refuse_unknown, unverified_option
from pulsepath.process.intent import writes
from pulsepath.progress import say
from pulsepath.request_options import with_request


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackRequest:
    """A plan, the rig that runs it, and the laws that control the drives."""

    directory: Path
    rig: str | None = option(
        None,
        'Drives of the axes: preset or file; "pulsepath rigs" lists them. Default: the bundled rig that fits.',
        metavar="RIG",
        names="rigs",
        files=True,
    )
    laws: tuple[str, ...] = option(
        LAWS,
        'Tracking law, as "6" or "6:gain=0.7"; repeatable.',
        flag="--law",
        metavar="LAW",
        names="laws",
    )


@click.command()
@plan_argument
@with_request(TrackRequest)
@unverified_option
@click.option("--force", is_flag=True, help="Overwrite an earlier track.json.")
@json_option
def track(request: TrackRequest, unverified: bool, force: bool, as_json: bool) -> None:
    """Track the plan in DIR on an emulated motion card and drives.

    Runs the plan on RIG under each LAW and writes the errors to DIR/track.json. RIG is a bundled
    rig or a TOML file whose machine has the plan's axes. The default is the one bundled rig that
    fits, and its name is printed. If none fits, no rig is assumed and the plan is not tracked.

    Example: pulsepath track out/circle --rig hexapod-steppers --law 3 --law 6:gain=0.7
    """
    directory = request.directory
    writes(directory / "track.json")
    refuse_unknown(rig=request.rig, laws=request.laws)
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
    settings = [read_setting(law) for law in request.laws]
    plan = read(directory, unverified)
    rig = choose_rig(plan.machine, request.rig)
    if request.rig is None:
        fits = f"the bundled rig that fits {plan.machine.name}"
        note(f"on rig {rig.about}: {fits}; choose another with --rig")
    motion = shape_motion(plan.trajectory, plan.machine.axes) or plan.trajectory
    metrics = []
    for law in [setting.make_law(rig) for setting in settings]:
        with step(f"tracking under {law.name}"):
            tracked = controllers.track(motion, plan.machine, law, rig=rig, period=PERIOD)
            metrics.append(controllers.evaluate(tracked, motion, plan.machine))
    doubts = record.record_doubts(plan.doubts)
    text = record.as_json(
        {"schema": record.SCHEMA, **doubts, **record.record_tracking(rig, metrics)}
    )
    target.write(text)
    if as_json:
        click.echo(text, nl=False)
        return
    say(f"rig {rig.about}")
    tables.show(tables.tabulate_tracking(metrics))
    blind = [] if all(map(reads_encoder, rig.drives)) else [rig.name]
    for sentence in describe_blind([setting.law for setting in settings], blind):
        say(sentence)
    say_doubts(plan.doubts)
