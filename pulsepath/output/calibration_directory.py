"""The output of `calibrate`: record, calibrated machine, report, and copies of the input files."""

from dataclasses import asdict
from hashlib import sha256
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from kinematics.calibration import Calibration
from kinematics.calibration.checks import axis_checks
from kinematics.calibration.result import GROUPS, describe_combination, identified_pulses
from kinematics.files.atomic_files import name_file, write_named
from kinematics.files.plain_text import finite_or_none
from kinematics.foundation.arrays import Array
from kinematics.machine.machine_writer import machine_toml
from pulsepath import __version__
from pulsepath.output.directory import CALIBRATION, CALIBRATION_KIND, REPORT
from pulsepath.output.record import SCHEMA, Record, as_json
from pulsepath.store.verify import seal_record

MACHINE = "machine.toml"
SOURCES = {"machine": "nominal.toml", "measurements": "measurements.toml"}


def write(folder: Path, calibration: Calibration, sources: dict[str, bytes]) -> None:
    """Write everything into an empty folder, the record last."""
    from benchmarks.reports.calibration_report import write_calibration_report

    for role, name in SOURCES.items():
        write_named(folder / name, sources[role])
    write_named(folder / MACHINE, machine_toml(calibration.machine, _comment(calibration)))
    with name_file(folder / REPORT):
        write_calibration_report(calibration, folder / REPORT)
    write_named(folder / CALIBRATION, as_json(seal_record(record(calibration, sources), folder)))


def record(calibration: Calibration, sources: dict[str, bytes]) -> Record:
    """Return a calibration as plain data, in SI units. null: not measured"""
    data = calibration.measurements
    stages = {
        "before": calibration.before,
        "after": calibration.after,
        "left_out": calibration.left_out,
    }
    rms: dict[str, Record] = {}
    for group in GROUPS:
        if isfinite(calibration.rms(calibration.before, group)):
            rms[group] = {}
            for name, errors in stages.items():
                rms[group][name] = finite_or_none(calibration.rms(errors, group))
    errors_of_poses = []
    for k, (label, fit) in enumerate(zip(data.labels, data.fit, strict=True)):
        errors_of_pose = {name: _group_errors(errors[k]) for name, errors in stages.items()}
        errors_of_poses.append({"pose": label, "fitted": bool(fit), **errors_of_pose})
    return {
        "schema": SCHEMA,
        "kind": CALIBRATION_KIND,
        "machine": calibration.nominal.name,
        "model": list(calibration.parts),
        "poses": int(data.fit.sum()),
        "values": int(calibration.used.sum()),
        "degrees_of_freedom": calibration.degrees,
        "noise": None if data.noise is None else asdict(data.noise),
        "warnings": list(calibration.warnings),
        "residual_scale": finite_or_none(calibration.scale),
        "rms": rms,
        "parameters": [
            {
                "name": estimate.name,
                "unit": estimate.unit,
                "nominal": estimate.nominal,
                "value": estimate.value,
                "standard_error": finite_or_none(estimate.error),
            }
            for estimate in calibration.parameters
        ],
        "pulses": [
            {**asdict(pulse), "error": finite_or_none(pulse.error)}
            for pulse in identified_pulses(calibration)
        ],
        "observability": _record_observability(calibration),
        "errors": errors_of_poses,
        "skipped_checks": list(calibration.skipped),
        "notes": list(data.notes),
        "checks": [
            {
                **asdict(check),
                "allowed": finite_or_none(check.allowed),
                "explained": check.is_explained,
            }
            for check in axis_checks(calibration)
        ],
        "provenance": {
            "sha256": {role: sha256(content).hexdigest() for role, content in sources.items()},
            "versions": {"pulsepath": __version__, "numpy": np.__version__},
        },
    }


def _record_observability(calibration: Calibration) -> Record:
    """Return which combinations of parameters the measurements determine least, or not at all."""
    observed = calibration.observability
    names = calibration.names
    return {
        **observed.indices,
        "rank": observed.rank,
        "singular_values": observed.singular.tolist(),
        "unseen": [describe_combination(each, names) for each in observed.unobservable_changes],
        "weakest": describe_combination(observed.weakest, names),
    }


def _comment(calibration: Calibration) -> str:
    """Return the comment at the head of the calibrated machine's file."""
    source = Path(calibration.measurements.name).name
    parts = ", ".join(calibration.parts)
    before, after = (
        f"{1e6 * calibration.rms(errors):.1f} um"
        for errors in (calibration.before, calibration.after)
    )
    return (
        f"The machine {calibration.nominal.name}, calibrated from {source}: {parts}.\n"
        f"RMS error of a position's component at the measured poses: {before} before, {after} after.\n"
        "Home is the pose at zero counts; programs in the frame home count from it."
    )


def _group_errors(errors: Array) -> dict[str, Any]:
    """Return the errors of a measured pose, by group. A group that was not measured is left out."""
    groups = {}
    for group, part in GROUPS.items():
        values = [finite_or_none(value) for value in errors[part].tolist()]
        if any(value is not None for value in values):
            groups[group] = values
    return groups
