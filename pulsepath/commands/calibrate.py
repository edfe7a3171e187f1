"""`pulsepath calibrate`: identify a machine's parameters from measurements, and write a report."""

import json
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Literal

import click

from planner.request import option
from pulsepath import known_names
from pulsepath.commands.common import print_json
from pulsepath.known_names import make_completer
from pulsepath.options import json_option, machine_argument, refuse_unknown
from pulsepath.process.intent import writes
from pulsepath.progress import say
from pulsepath.request_options import with_request


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateRequest:
    """A machine, its measured poses, and the parameters to identify from them."""

    machine: str
    measurements: str
    out: Path = option(MISSING, "Output directory.", metavar="DIR")
    model: str = option(
        "factor,frame-yaw",
        "Parameters to identify, from: factor, factors (one per axis), offsets, joints, frame, frame-yaw.",
        metavar="PARTS",
    )
    use: Literal["position", "all"] | None = option(
        None,
        "Measurements to fit. Default: positions and rotations, without axis directions.",
        choices=("position", "all"),
    )
    other_machine: bool = option(
        False,
        "Fit measurements although they state another machine's name than MACHINE's.",
    )


@click.command()
@machine_argument
@click.argument("measurements", shell_complete=make_completer(known_names.measurements, files=True))
@with_request(CalibrateRequest)
@click.option("--force", is_flag=True, help="Replace DIR if it holds an earlier calibration.")
@json_option
def calibrate(request: CalibrateRequest, force: bool, as_json: bool) -> None:
    """Identify the parameters of MACHINE from MEASUREMENTS.

    MEASUREMENTS are measured poses: a TOML file, or the bundled set cmm. They are refused if they
    state the name of another machine. Writes the calibrated machine and a report to DIR.

    Example: pulsepath calibrate hexapod cmm --out out/calibrated
    """
    out = request.out
    writes(out)
    refuse_unknown(machine=request.machine)
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
    # An unknown name of measurements is refused before the rest loads.
    files = {
        "machine": find("kinematics", "machine", request.machine),
        "measurements": find("kinematics.calibration", "measurement file", request.measurements),
    }
    from kinematics.calibration.measurement_file import load_measurements
    from kinematics.machine.machine_file import validate_machine_file

    make_machine = validate_machine_file(files["machine"])
    measured = load_measurements(request.measurements)
    nominal = make_machine()
    from kinematics import calibration
    from pulsepath.output import calibration_directory, tables

    sources = {role: file.read_bytes() for role, file in files.items()}
    # A directory that cannot be written is reported before the work.
    with replace_directory(out, force, CALIBRATION_KIND, before) as folder:
        with step(f"identifying {nominal.name} from {count_noun(len(measured), 'measurement')}"):
            parts = [part.strip() for part in request.model.split(",")]
            result = calibration.calibrate(
                nominal,
                measured,
                parts,
                use=request.use,
                other_machine=request.other_machine,
            )
        identified = count_noun(len(result.parameters), "parameter")
        detail(f"{identified}, {result.observability.rank} combinations of them identifiable")
        with step("writing files"):
            calibration_directory.write(folder, result, sources)
    report = str(out / REPORT)
    if as_json:
        print_json({**json.loads((out / CALIBRATION).read_bytes()), "report": report})
        return
    tables.show(tables.list_tables(result))
    say(f"machine: {out / calibration_directory.MACHINE}\nreport: {report}")
