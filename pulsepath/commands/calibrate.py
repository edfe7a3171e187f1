"""`pulsepath calibrate`: identify a machine's parameters from measurements, and write a report."""

import json
from pathlib import Path
from typing import Literal

import click

from pulsepath import known_names
from pulsepath.known_names import make_completer
from pulsepath.options import json_option, refuse_unknown
from pulsepath.process.intent import writes
from pulsepath.progress import say


@click.command()
@click.argument("machine", shell_complete=make_completer(known_names.machines, files=True))
@click.argument("measurements", shell_complete=make_completer(known_names.measurements, files=True))
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Output directory.")
@click.option(
    "--model",
    default="factor,frame-yaw",
    show_default=True,
    metavar="PARTS",
    help="Parameters to identify, from: factor, factors (one per axis), offsets, joints, frame, frame-yaw.",
)
@click.option(
    "--use",
    type=click.Choice(["position", "all"]),
    help="Measurements to fit. Default: positions and rotations, without axis directions.",
)
@click.option(
    "--other-machine", is_flag=True, help="Fit measurements although they state another machine's name than MACHINE's."
)
@click.option("--force", is_flag=True, help="Replace DIR if it holds an earlier calibration.")
@json_option
def calibrate(
    machine: str,
    measurements: str,
    out: Path,
    model: str,
    use: Literal["position", "all"] | None,
    other_machine: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Identify the parameters of MACHINE from MEASUREMENTS.

    MEASUREMENTS are measured poses: a TOML file, or the bundled set cmm. They are refused if they state the name of
    another machine. Writes the calibrated machine and a report to DIR.

    Example: pulsepath calibrate hexapod cmm --out out/calibrated
    """
    writes(out)
    refuse_unknown(machine=machine)
    from kinematics.foundation.names import count_noun, find
    from pulsepath.output.directory import (
        CALIBRATION,
        CALIBRATION_KIND,
        REPORT,
        list_replaceable,
        replace_directory,
    )
    from pulsepath.progress import detail, step

    before = list_replaceable(out, force, CALIBRATION_KIND)
    find("kinematics.calibration", "measurement file", measurements)  # refuses an unknown name
    from kinematics.calibration.measurement_file import load_measurements
    from kinematics.machine.machine_file import validate_machine_file

    make = validate_machine_file(find("kinematics", "machine", machine))
    measured, nominal = load_measurements(measurements), make()
    from kinematics import calibration
    from pulsepath.output import calibration_directory, record, tables

    sources = {
        "machine": find("kinematics", "machine", machine).read_bytes(),
        "measurements": find("kinematics.calibration", "measurement file", measurements).read_bytes(),
    }
    # Where nothing can be written, that is said before the work.
    with replace_directory(out, force, CALIBRATION_KIND, before) as folder:
        with step(f"identifying {nominal.name} from {count_noun(len(measured), 'measurement')}"):
            parts = [part.strip() for part in model.split(",")]
            result = calibration.calibrate(nominal, measured, parts, use=use, other_machine=other_machine)
        detail(
            f"{count_noun(len(result.parameters), 'parameter')}, {result.observability.rank} "
            "combinations of them identifiable"
        )
        with step("writing files"):
            calibration_directory.write(folder, result, sources)
    report = str(out / REPORT)
    if as_json:
        written = json.loads((out / CALIBRATION).read_bytes())
        click.echo(record.as_json({**written, "report": report}), nl=False)
    else:
        tables.show(tables.of_results(result))
        say(f"machine: {out / calibration_directory.MACHINE}\nreport: {report}")
