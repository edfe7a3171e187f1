"""Results of the commands as plain data: the content of plan.json, track.json and `--json`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from math import isnan, pi
from typing import TYPE_CHECKING, Any

from kinematics.files.plain_text import finite_or_none
from kinematics.foundation.facts import record, record_fields
from kinematics.foundation.options import options
from planner.place import Infeasible
from pulsepath.docstrings import first_paragraph
from pulsepath.process.exits import SCHEMA as SCHEMA
from pulsepath.progress import as_json as as_json

if TYPE_CHECKING:
    from pathlib import Path

    from controllers import Metrics, Rig
    from kinematics import Axis, MotionError, Pose, Posture
    from kinematics.machine.machine_file import MachineSummary
    from planner import Standing
    from planner.export.format import Exported
    from planner.pulses import RealisedPath
    from planner.sources.arm_simulation import ArmSimulation
    from planner.sources.outline import Outline
    from planner.sources.position_list import PositionList
    from planner.sources.source import Imported

Record = dict[str, Any]


def record_realised(path: RealisedPath) -> Record:
    """The path that the pulses make: its errors, in m or rad, under their bounds; "one_in": how
    thinly it was seen.
    """
    return {
        "of": path.mover,
        "instants": path.instants,
        "one_in": path.stride,
        "mechanics": list(path.mechanics),
        "errors": {
            error.name: record_fields(error, "rms", "max", "bound", "unit", "where")
            for error in path.errors
        },
    }


def record_tracking(rig: Rig, metrics: Iterable[Metrics]) -> Record:
    """The rig, and under each law the errors in m or rad, and the full steps that steppers lost."""
    laws = {
        law.law: {
            series.name: record_fields(series, "rms", "p95", "max", "unit", "where")
            for series in law.series
        }
        for law in metrics
    }
    lost = {law.law: 0 if law.lost_steps is None else int(law.lost_steps.sum()) for law in metrics}
    return {"rig": rig.name, "about": rig.about, "laws": laws, "lost_steps": lost}


def record_check(result: Standing) -> Record:
    """Return the record of a geometric check: violations or use of each limit, and joins."""
    largest = result.largest.items()
    return {
        "feasible": not result.violations,
        "fit": record(result.fit),
        "blends": record(result.blends),
        "avoidable_stops": record(result.avoidable),
        "synchronised_moves": record(result.departures),
        "splines": record(result.overshoots),
        "violations": [record_violation(violation) for violation in result.violations],
        "conditioning": None
        if result.conditioning is None
        else {"value": result.conditioning.value, "where": record(result.conditioning.place)},
        "largest_use": {
            name: {"ratio": use, "where": record(place)} for name, (use, place) in largest
        },
    }


def record_export(name: str, file: str, done: Exported, doubts: Sequence[str] = ()) -> Record:
    """Return the record of an exported file, with its error against the plan."""
    return {
        "format": name,
        "file": file,
        "error_pulses": done.error,
        "against": done.against,
        "error_pulses_by_axis": list(done.by_axis),
        "notes": list(done.notes),
        **record_doubts(doubts),
    }


def record_doubts(doubts: Sequence[str]) -> Record:
    """Return whether a loaded plan is verified, and if not, why."""
    return {"verified": not doubts, "doubts": list(doubts)}


def record_import(
    name: str, result: Imported, way: Outline, out: Path, image: Path | None
) -> Record:
    """Return the record of an imported program; lengths in m."""
    return {
        "format": name,
        "file": str(out),
        "figure": None if image is None else str(image),
        "segments": len(result.program.segments),
        "entities": dict(result.entities),
        "low": way.low.tolist(),
        "high": way.high.tolist(),
        "length": way.length,
        "warnings": list(result.warnings),
    }


def record_posture(result: Posture) -> Record:
    """Return the record of one pose: axes, joints, margins and proof."""
    margins = result.margins
    from_home, in_base = result.places.tolist()
    return {
        "machine": result.machine.name,
        "pose": {"home": record_place(from_home), "base": record_place(in_base)},
        "directions_rad": result.directions.tolist(),
        "axes": [
            {
                "name": axis.name,
                "position": q,
                "from_home": away,
                "pulses": count,
                "unit": axis.unit,
                "travel_use": use,
            }
            for axis, q, away, count, use in zip(
                result.machine.axes,
                result.q.tolist(),
                result.travel.tolist(),
                result.counts.tolist(),
                margins.travel[0].tolist(),
                strict=True,
            )
        ],
        "joints": [
            {"name": name, "tilt_rad": tilt, "limit_rad": limit if limit < pi else None}
            for name, tilt, limit in zip(
                margins.tilt_names, result.tilt.tolist(), margins.max_tilt.tolist(), strict=True
            )
        ],
        "clearance_m": dict(
            zip(margins.clearance_names, margins.clearance[0].tolist(), strict=True)
        ),
        "room_use": dict(zip(margins.room_names, margins.room[0].tolist(), strict=True)),
        "conditioning": float(margins.conditioning[0]),
        "singularity": float(margins.singularity[0]),
        "use": float(margins.use[0]),
        "worst": margins.worst(),
        "ok": bool(margins.ok[0]),
        "violations": list(result.violations),
        "certified": result.certified,
        "residual": result.residual,
    }


def record_place(place: Sequence[float]) -> Record:
    """Return the record of x, y, z (m) and θx, θy, θz (rad)."""
    return {"position_m": list(place[:3]), "angles_rad": list(place[3:])}


def record_pose(pose: Pose) -> Record:
    angles = pose.rotation.as_euler("XYZ", suppress_warnings=True)
    return {"position_m": pose.translation.tolist(), "angles_rad": angles.tolist()}


def record_positions(listed: PositionList, file: str) -> Record:
    """A position list; m and rad."""
    poses = {"poses": listed.poses.tolist(), "dwells_s": listed.rests.tolist()}
    return {"file": file, "rotation": listed.order, "frame": listed.frame, **poses}


def record_arms(result: ArmSimulation, file: str) -> Record:
    """Arm lengths at poses, turned ones simulated only; m and rad. off: null where no held plate
    has the lengths.
    """
    return {
        "file": file,
        "machine": result.machine,
        "rotation": result.listed.order,
        "frame": result.listed.frame,
        "poses": result.listed.poses.tolist(),
        "arm_lengths": result.lengths.tolist(),
        "within_travel": result.within.tolist(),
        "turned": result.turned.tolist(),
        "off_if_held": [None if isnan(off) else off for off in result.off.tolist()],
        "notes": list(result.notes),
    }


def record_rules() -> Record:
    """Return the firing rules by name, with their options in SI units."""
    from planner.pulses import RULES

    return {
        name: {
            "about": first_paragraph(rule),
            "options": {
                field.name: {
                    "about": field.metadata["help"],
                    "default": field.default,
                    "unit": field.metadata["unit"],
                }
                for field in options(rule).values()
            },
        }
        for name, rule in RULES.items()
    }


def record_machine(machine: MachineSummary) -> Record:
    """Return the record of a machine; None: unlimited."""
    return {
        "name": machine.name,
        "kind": machine.kind,
        "freedom": list(machine.freedom),
        "axes": [_axis(axis) for axis in machine.axes],
    }


def record_violation(violation: MotionError) -> Record:
    """Return the record of a violation: place, excess and remedy."""
    if not isinstance(violation, Infeasible):
        return {"kind": "reach", "message": str(violation)}
    names = ("kind", "axis", "value", "limit", "unit", "remedy", "relaxation")
    return {
        **{name: record(getattr(violation, name)) for name in names},
        "where": record(violation.place),
        "message": str(violation),
    }


def _axis(axis: Axis) -> Record:
    return {**asdict(axis), "travel": tuple(map(finite_or_none, axis.travel)), "unit": axis.unit}
