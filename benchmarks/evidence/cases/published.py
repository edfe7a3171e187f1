"""Published numbers next to ours: the page docs/evidence.md.

The text is in benchmarks/evidence/published/page.md, where {NAME} is replaced by a table.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.evidence.published import compared, conformance
from benchmarks.evidence.published.compared import NumberComparison, compare_lines, compare_numbers
from benchmarks.evidence.published.deflections import appendix_d
from benchmarks.evidence.published.initial_design import compare_needs
from benchmarks.evidence.published.stepper_sizing import appendix_b, compare_axes
from benchmarks.evidence.table import Table
from benchmarks.reports.calibration_report import explain_pulse
from kinematics import load_machine
from kinematics.calibration import Calibration, calibrate
from kinematics.calibration.checks import axis_checks
from kinematics.calibration.measurement_file import load_measurements
from kinematics.calibration.result import identified_pulses

PAGE = Path(compared.__file__).with_name("page.md")


def measure() -> Iterator[Table | str]:
    """Yield the paragraphs and tables of the page."""
    tables = {
        "leg directions": compare_numbers(conformance.leg_angles()),
        "reference voltage": compare_numbers(conformance.reference_voltage()),
        "axis angles": compare_numbers(conformance.axis_angles()),
        "retracted legs": compare_numbers(conformance.retracted_lengths()),
        "initial design": compare_numbers(compare_needs()),
        "appendix B": compare_lines(appendix_b()),
        "axes": compare_axes(),
        "appendix D": compare_lines(appendix_d()),
        "length changes": compare_numbers(conformance.length_changes()),
        "home lengths": compare_numbers(conformance.home_lengths()),
        "assembly modes": compare_numbers(conformance.modes()),
        "pulses": compare_numbers(conformance.pulse_count()),
        **explain_calibration(),
    }
    for paragraph in PAGE.read_text(encoding="utf-8").strip().split("\n\n"):
        yield tables[paragraph[1:-1]] if paragraph.startswith("{") else paragraph


def explain_calibration() -> dict[str, Table | str]:
    """Return the five parameters, the errors before and after, and the check by Table 6.4."""
    result = calibrate(load_machine("hexapod"), load_measurements("cmm"))
    before, after, left_out = (
        1e6 * result.rms(errors) for errors in (result.before, result.after, result.left_out)
    )
    numbers = [
        NumberComparison("RMS position error before, per component", "µm", "183", before),
        NumberComparison("the same after", "µm", "13.3", after),
        NumberComparison("pulse-length factor", "", "1.0178", result["factor"].value),
    ]
    return {
        "calibration": compare_numbers(numbers),
        "left out": f"Each pose predicted from the others alone: {left_out:.1f} µm RMS per component.",
        # all legs have the common factor: the first one shows it
        "pulse length": explain_pulse(identified_pulses(result)[0]),
        "rotations": compare_rotations(result),
        "rotation parts": divide_rotations(result),
    }


def compare_rotations(result: Calibration) -> Table:
    """Return what remains of each rotation that was not fitted to."""
    columns = (
        "pose",
        "commanded − measured (deg)",
        "predicted − measured (deg)",
        "repetition (deg)",
        "explained",
    )
    words = {True: "yes", False: "no", None: "unknown"}
    rows = []
    for check in axis_checks(result):
        angles = np.rad2deg([check.before, check.after, check.allowed])
        texts = [f"{angle:.4f}" for angle in angles]
        rows.append([check.label, *texts, words[check.is_explained]])
    return Table("", columns, rows)


def divide_rotations(result: Calibration) -> Table:
    """Return the tilt and the heading of each such rotation, as measured and as predicted."""
    columns = ("pose", "", "measured − commanded (deg)", "predicted − commanded (deg)")
    rows = []
    for check in axis_checks(result):
        directions = {"tilt from z": check.tilt, "heading of the tilt about z": check.heading}
        for name, angles in directions.items():
            commanded, *others = np.rad2deg(angles)
            rows.append([check.label, name, *(f"{angle - commanded:.3f}" for angle in others)])
    return Table("", columns, rows)
