"""The command line: options in; tables, or JSON with --json, out. Whatever is slow loads inside the commands."""

from pathlib import Path
from typing import Literal

import click

from pulsepath import __version__
from pulsepath.compare_command import compare
from pulsepath.console_command import console
from pulsepath.exits import BAD_INPUT, INFEASIBLE, INTERNAL, Commands
from pulsepath.export_command import export
from pulsepath.import_command import import_
from pulsepath.positions_command import positions

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")
machine_option = click.option(
    "--machine", metavar="MACHINE", help="Preset or file; default: the one the program names."
)


@click.group(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=f"Exit codes: 0 done, {INFEASIBLE} infeasible, {BAD_INPUT} bad input, {INTERNAL} internal error.",
)
@click.version_option(__version__, prog_name="pulsepath")
def main() -> None:
    """The fastest motion a machine can make along a path, proved to respect every limit, as exact pulse times.

    PROGRAM and MACHINE are names of presets, or paths of TOML files.
    """


@main.command()
@click.argument("program")
@machine_option
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Directory to write.")
@click.option(
    "--order",
    type=click.Choice(["2", "3"]),
    help="2: speed and acceleration; 3: and jerk. Default: 3 if the machine limits jerk.",
)
@click.option(
    "--clock-hz", type=click.IntRange(min=1), default=10_000_000, show_default=True, help="Ticks/s of pulses."
)
@click.option(
    "--duration", metavar="TIME", help='As "12 s": not the fastest motion, but the smoothest that takes so long.'
)
@click.option(
    "--rule",
    default="nearest",
    show_default=True,
    metavar="RULE",
    help='When pulses fire; "pulsepath rules" lists them. With options as sampled:period=50us.',
)
@click.option(
    "--figures/--no-figures",
    default=True,
    show_default=True,
    help="Pictures in the report; without them it has its text and all its tables, and is there sooner.",
)
@click.option("--force", is_flag=True, help="Replace DIR, if an earlier plan is in it.")
@json_option
def plan(
    program: str,
    machine: str | None,
    out: Path,
    order: str | None,
    clock_hz: int,
    duration: str | None,
    rule: str,
    figures: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Plan PROGRAM, and write motion, pulses and report into DIR."""
    from pulsepath.second import second
    from pulsepath.seldom import seldom_collected

    with (
        seldom_collected(),
        second(figures) as other,
    ):  # before what is slow to load, so that both processes load at once
        from kinematics.units import quantity
        from pulsepath import plan_directory, record, tables
        from pulsepath.directory import refuse_overwrite, replacing
        from pulsepath.inputs import read_inputs
        from pulsepath.job import run

        refuse_overwrite(out, force)
        seconds = None if duration is None else quantity(duration, "s")
        inputs = read_inputs(program, machine)
        kind = None if order is None else int(order)
        with replacing(out, force) as folder:  # where nothing can be written, that is said before the work
            job = run(inputs.program, inputs.machine, kind, clock_hz, seconds, rule, other, figures)
            verdict = plan_directory.write(folder, job, inputs)
    report = str(out / plan_directory.REPORT)
    if as_json:
        click.echo(record.as_json({**record.of_plan(job, inputs, verdict), "report": report}), nl=False)
    else:
        tables.show(tables.of_plan(job))
        click.echo(f"report: {report}")


@main.command()
@click.argument("program")
@machine_option
@json_option
def check(program: str, machine: str | None, as_json: bool) -> None:
    """Check what no timing can help: reach, travel and tilt.

    Lists every violation along the path of PROGRAM, or else how near it comes to each limit.
    """
    from planner import check as look
    from pulsepath import record, tables
    from pulsepath.inputs import read_inputs

    inputs = read_inputs(program, machine)
    found = look(inputs.program, inputs.machine)
    if as_json:
        click.echo(record.as_json(record.of_check(found.violations, found.largest, found.blends)), nl=False)
    elif found.violations:
        click.echo("\n".join(map(str, found.violations)))
    else:
        tables.show(tables.of_check(found))
    if found.violations:
        click.get_current_context().exit(INFEASIBLE)


@main.command()
@click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--law", "laws", multiple=True, required=True, metavar="LAW", help='As "6" or "6:gain=0.7"; may be repeated.'
)
@click.option("--force", is_flag=True, help="Replace an earlier track.json.")
@json_option
def track(directory: Path, laws: tuple[str, ...], force: bool, as_json: bool) -> None:
    """Track the plan in DIR on emulated hardware.

    Runs it through an emulated motion card and servo drives under each LAW, and writes the errors into DIR/track.json.
    """
    from benchmarks.sweep import read_setting
    from controllers import evaluate
    from controllers import track as run
    from controllers.metrics.evaluate import PERIOD
    from kinematics import MotionError
    from kinematics.staging import write_whole
    from pulsepath import plan_directory, record, tables
    from pulsepath.progress import step

    target = directory / plan_directory.TRACK
    if target.exists() and not force:
        raise MotionError(f"{target} exists; give --force to replace it")
    chosen = [read_setting(law).made() for law in laws]
    planned = plan_directory.read(directory)
    metrics = []
    for law in chosen:
        with step(f"tracking under {law.name}"):
            tracked = run(planned.trajectory, planned.machine, law, period=PERIOD)
            metrics.append(evaluate(tracked, planned.trajectory, planned.machine))
    text = record.as_json({"schema": record.SCHEMA, "laws": record.of_tracking(metrics)})
    write_whole(target, text)
    if as_json:
        click.echo(text, nl=False)
    else:
        tables.show(tables.of_tracking(metrics))


main.add_command(export)
main.add_command(import_)
main.add_command(compare)
main.add_command(positions)
main.add_command(console)


@main.command()
@click.argument("machine")
@click.argument("measurements")
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Directory to write.")
@click.option(
    "--model",
    default="factor,frame-yaw",
    show_default=True,
    metavar="PARTS",
    help="What to identify, of: factor, factors (one per axis), offsets, joints, frame, frame-yaw.",
)
@click.option(
    "--use",
    type=click.Choice(["position", "all"]),
    help="What of the measurements to fit. Default: positions and rotations, not directions of an axis.",
)
@click.option("--force", is_flag=True, help="Replace DIR, if an earlier calibration is in it.")
@json_option
def calibrate(
    machine: str,
    measurements: str,
    out: Path,
    model: str,
    use: Literal["position", "all"] | None,
    force: bool,
    as_json: bool,
) -> None:
    """Identify MACHINE from MEASUREMENTS of its poses.

    Writes the calibrated machine and a report into DIR. MEASUREMENTS is a TOML file, or the name of a bundled one: cmm.
    """
    from kinematics import load_machine
    from kinematics.calibration import calibrate as identify
    from kinematics.calibration.measurement_file import load_measurements
    from kinematics.registry import find
    from pulsepath import calibration_directory, record, tables
    from pulsepath.directory import CALIBRATION_KIND, refuse_overwrite, replacing
    from pulsepath.progress import step

    refuse_overwrite(out, force, CALIBRATION_KIND)
    nominal, measured = load_machine(machine), load_measurements(measurements)
    sources = {
        "machine": find("kinematics", "machine", machine).read_bytes(),
        "measurements": find("kinematics.calibration", "measurement file", measurements).read_bytes(),
    }
    with step(f"identifying {nominal.name} from {len(measured)} measurements"):
        found = identify(nominal, measured, [part.strip() for part in model.split(",")], use=use)
    with replacing(out, force, CALIBRATION_KIND) as folder, step("writing the files"):
        calibration_directory.write(folder, found, sources)
    report = str(out / calibration_directory.REPORT)
    if as_json:
        click.echo(record.as_json({**calibration_directory.record(found, sources), "report": report}), nl=False)
    else:
        tables.show(tables.of_calibration(found))
        click.echo(f"machine: {out / calibration_directory.MACHINE}\nreport: {report}")


@main.command()
@json_option
def machines(as_json: bool) -> None:
    """List the bundled machines."""
    from kinematics import load_machine, machine_names
    from pulsepath import record, tables

    bundled = [load_machine(name) for name in machine_names()]
    if as_json:
        click.echo(record.as_json([record.of_machine(machine) for machine in bundled]), nl=False)
    else:
        tables.show(tables.of_machines(bundled))


@main.command()
@json_option
def rules(as_json: bool) -> None:
    """List the firing rules and their options.

    `plan --rule` takes a name, or a name and options: "sampled:period=50us", "dda:spacing=5ms,rate=200kHz".
    """
    from pulsepath import record, tables

    if as_json:
        click.echo(record.as_json(record.of_rules()), nl=False)
    else:
        tables.show(tables.of_rules())
