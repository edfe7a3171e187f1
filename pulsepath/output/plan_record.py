"""A plan as plain data: the content of plan.json."""

from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from math import isnan
from pathlib import Path
from platform import python_version

from benchmarks.reports.plan_content import PlanReport
from benchmarks.reports.plan_summary import list_counts
from kinematics import Axis, Machine
from kinematics.analysis.residual_vibration import find_residuals
from kinematics.foundation.facts import record, record_fields
from planner import Classical, LimitChange, Plan, Triggered, Worth
from planner.active_limits import FILE_LINE, tabulate_segments
from planner.baselines import describe_differences, missing_limits
from planner.certificate.certify import Certificate
from planner.export.line_times import time_lines
from planner.limits import find_unkept_limits
from planner.path.arc_length import measure_travel
from planner.plan_parts import PlanStanding
from planner.pulses import PulseCheck, PulseSchedule
from planner.request import record_request
from planner.shaping.shaped_proof import ShapedProof
from planner.shaping.shaping_cost import ShapingCost
from pulsepath import __version__
from pulsepath.inputs import Inputs
from pulsepath.output.directory import KIND
from pulsepath.output.record import (
    SCHEMA,
    Record,
    record_pose,
    record_realised,
    record_tracking,
)
from pulsepath.store.verify import digest as digest_file


def record_plan(
    report: PlanReport,
    inputs: Inputs,
    digest: str | None,
    standing: PlanStanding | None = None,
) -> Record:
    """Return the record of a plan: SI units, which the keys name where they are not plain.

    digest    of its pulses; None: there is no file of them
    standing  of a plan that was made in parts
    """
    plan = report.plan if standing is None else standing
    pulses = record_pulses(plan.pulses, plan.machine, list_counts(plan), digest, report.verdict)
    common = {
        "schema": SCHEMA,
        "kind": KIND,
        "program": plan.program.name,
        "machine": plan.machine.name,
        "order": plan.order,
        "duration_s": plan.duration,
        "request": record_request(plan.request),
        "certificate": _certificate(plan.certificate),
        "avoidable_stops": record(plan.avoidable_stops),
        "stated_but_not_kept": list(find_unkept_limits(plan.machine)),
        "pulses": pulses,
    }
    special = (
        _parts(plan, report.ending) if isinstance(plan, PlanStanding) else _whole(plan, report)
    )
    results: Record = {}
    if isinstance(report.plan, Plan):
        results = _motion_results(report) | _comparisons(report)
    origin = _origin(inputs, () if report.crossed is None else ("toppra",))
    return common | special | results | origin


def _whole(plan: Plan, report: PlanReport) -> Record:
    """Return the entries that only a plan made as a whole has."""
    path = plan.path
    shaping = None
    if plan.shaped is not None:
        shaping = _shaping(plan.shaped) | {"warning": plan.exceeded or None}
    return {
        "path_length_m": measure_travel(path.pieces),
        "classical": None
        if report.classical is None
        else _baselines(report, plan, report.classical),
        "shaping": shaping,
        "fit": record(path.fit),
        "blends": record(path.blends),
        "synchronised_moves": record(plan.departures),
        "splines": record(path.overshoots),
        "solver": {"rounds": plan.rounds, "methods": list(plan.methods)},
        "constant_speeds": record(plan.constant_speeds),
        "segments": _segments(plan),
        "triggers": [_trigger(event, plan.machine.axes) for event in plan.triggers],
    }


def _parts(standing: PlanStanding, ending: str) -> Record:
    """Return the entries that only a plan made in parts has."""
    return {
        "windows": standing.windows,
        "ends_before": ending or None,
        "path_length_m": standing.start.length,
        "fit": record(standing.fit),
        "joins": {"blends": standing.blends, "stops_instead": standing.stops},
        "solver": {"rounds": standing.rounds, "methods": dict(standing.methods)},
        "trigger_count": standing.triggers,
    }


def _motion_results(report: PlanReport) -> Record:
    """Return the lower bound, the worth of the limits and the stops."""
    plan = report.whole
    return {
        "lower_bound": _lower_bound(plan),
        "worth": None if report.worth is None else _worth(report.worth, report.change),
        "worth_left_out": report.unbounded or None,
        "left_out": list(report.left_out),
        "stops": None
        if report.stops is None
        else {
            "instants": len(report.stops.t),
            "longest_time_to_rest_s": float(report.stops.time.max()),
            "longest_distance_to_rest_m": float(report.stops.distance.max()),
        },
    }


def _lower_bound(plan: Plan) -> Record | None:
    """Return the proved bound, or the estimate that a plan made as a whole has."""
    if plan.known:
        return {
            "kind": "proved",
            "duration_s": plan.lower_bound,
            "gap": record(plan.gap),
            "leaves_out": [*plan.left_out],
        }
    if isnan(plan.lower_estimate):
        return None
    return {
        "kind": "estimate",
        "duration_s": plan.lower_estimate,
        "gap": None,
        "leaves_out": [*plan.left_out, *([] if plan.order == 2 else ["jerk"])],
    }


def _comparisons(report: PlanReport) -> Record:
    """Return the tracking errors, the cross-check and the quantization error."""
    return {
        "tracking": None if report.rig is None else record_tracking(report.rig, report.metrics),
        "cross_check": record(report.crossed),
        "realised": None if report.realised is None else record_realised(report.realised),
    }


def _baselines(report: PlanReport, plan: Plan, baseline: Classical) -> Record:
    return {
        "kind": baseline.kind,
        "duration_s": baseline.duration,
        "saved_s": report.time_saved if plan.fastest else None,
        "leaves_out": list(missing_limits(plan, baseline)),
        "kinds": {
            one.kind: {
                "duration_s": one.duration,
                "order": one.order,
                "certified": one.certificate.holds,
                "deviation_m": None if one.deviation is None else one.deviation.distance,
                "leaves_out": list(missing_limits(plan, one)),
                "differences": list(describe_differences(plan, one)),
            }
            for one in (baseline, *report.others)
        },
    }


def _certificate(certificate: Certificate) -> Record:
    return {
        "holds": certificate.holds,
        "limits": {
            name: {
                "worst_ratio": worst,
                "attained_ratio": float(certificate.attained[name].max()),
                "where": record(certificate.where[name]),
            }
            for name, worst in certificate.worst.items()
        },
    }


def _shaping(shaped: ShapedProof) -> Record:
    """Return the record of the shaped motion: its proof, and upper bounds of its distance from the
    path.
    """
    return {
        "duration_before_s": shaped.motion.base.duration,
        "cost": None if shaped.cost is None else _shaping_cost(shaped.cost),
        "delay_s": shaped.delay,
        "axes": {
            axis.name: {
                "shapers": []
                if axis.shaper is None
                else [asdict(part) for part in axis.shaper.parts],
                "deviation": float(off),
                "unit": axis.unit,
            }
            for axis, off in zip(shaped.axes, shaped.axis_deviation, strict=True)
        },
        "residual_vibration": [
            {"shaper": asdict(each.mode), "axes": list(each.axes)}
            | {
                "at_90_percent": each.below,
                "at_frequency": each.stated,
                "at_110_percent": each.above,
            }
            for each in find_residuals(shaped.axes)
        ],
        "tool_contour_um": 1e6 * shaped.contour,
        "tool_deviation_um": 1e6 * shaped.deviation,
        "turn_deviation_rad": shaped.turn,
        "contour_at": record(shaped.contour_at),
        "deviates_at": record(shaped.deviates_at),
        "holds": shaped.holds,
        "limits": {
            name: {
                "worst_ratio": worst,
                "by_convexity": name in shaped.convex,
                "where": record(shaped.where[name]),
            }
            for name, worst in shaped.worst.items()
        },
    }


def _shaping_cost(cost: ShapingCost) -> Record:
    """Return the record of the time that the shapers cost, and of the limits that were lowered for
    them.
    """
    return {
        "total_s": cost.total,
        "length_s": cost.length,
        "lowering_s": cost.lowering,
        "unshaped_duration_s": cost.unlowered,
        "everywhere": cost.everywhere,
        "lowered": record(cost.stretches),
    }


def record_pulses(
    pulses: PulseSchedule,
    machine: Machine,
    counted: Sequence[tuple[int, int]],
    digest: str | None,
    verdict: PulseCheck | None,
) -> Record:
    """Return the record of a schedule, its verdict, and the times on the lines of each axis.

    counted: number of pulses and net count of each axis
    """
    return {
        "clock_hz": pulses.clock_hz,
        "total": sum(number for number, _ in counted),
        "rule": pulses.rule,
        "sha256": digest,
        "compensations": [asdict(one) for one in pulses.compensations],
        "moved_for_drives": [asdict(moved) for moved in pulses.moves],
        "axes": {
            axis.name: {
                "pulses": number,
                "start_count": axis.start,
                "final_count": axis.start + net,
                "net_count": net,
                "pulse": axis.pulse,
                "unit": driven.unit,
                "bound_pulses": axis.bound,
                **drive,
            }
            for axis, driven, (number, net), drive in zip(
                pulses.axes,
                machine.axes,
                counted,
                _drive_times(verdict, pulses.clock_hz, machine),
                strict=True,
            )
        },
        "check": None
        if verdict is None
        else {
            "holds": verdict.holds,
            "faults": verdict.fault_count,
            "time_error_ticks": verdict.time_error,
            "position_error_pulses": verdict.position_error,
            "highest_rate_hz": verdict.highest_rate,
        },
    }


def _origin(inputs: Inputs, packages: Sequence[str]) -> Record:
    """Return the record of the inputs, and of the versions of pulsepath and packages."""
    return {
        "inputs": {
            "program": inputs.program_file,
            "format": None if inputs.origin is None else inputs.origin.format,
            "suffix": None if inputs.origin is None else inputs.origin.suffix,
            "options": {} if inputs.origin is None else dict(inputs.origin.options),
            "fit_m": inputs.fit,
        },
        "provenance": {
            "sha256": inputs.digests,
            "versions": {
                "pulsepath": __version__,
                "python": python_version(),
                **_versions("casadi", "numba", "numpy", "scipy", *packages),
            },
        },
    }


def _segments(plan: Plan) -> list[Record]:
    """Return the time of each segment, its limit, and its line in the file if known."""
    columns = {column.name: column.raw for column in tabulate_segments(plan).columns}
    columns.setdefault(FILE_LINE, [None] * len(columns["segment"]))
    keys = {
        "segment": "segment", FILE_LINE: "line", "kind": "kind", "length": "length_m", "time": "time_s",
        "mean speed": "mean_speed_m_s", "held back by": "held_back_by", "for": "held_back_for_percent",
    }  # fmt: skip
    return [
        dict(zip(keys.values(), row, strict=True))
        for row in zip(*(columns[key] for key in keys), strict=True)
    ]


def _trigger(event: Triggered, axes: Sequence[Axis]) -> Record:
    """An event; the pose is the platform's in the base frame, its angles about the moving axes in
    turn.
    """
    return {
        "name": event.name,
        "where": record(event.where),
        **record_pose(event.pose),
        "counts": {axis.name: int(count) for axis, count in zip(axes, event.counts, strict=True)},
    }


def _versions(*packages: str) -> dict[str, str | None]:
    """Return installed versions; None: not installed."""
    installed: dict[str, str | None] = {}
    for package in packages:
        try:
            installed[package] = version(package)
        except PackageNotFoundError:
            installed[package] = None
    return installed


def record_pulse_file(
    path: Path | None,
    pulses: PulseSchedule,
    machine: Machine,
    verdict: PulseCheck,
    counted: Sequence[tuple[int, int]] | None = None,
) -> Record:
    """Return the verdict on a file of pulses, or on the pulses themselves; times in s, None: not
    measured.

    counted: number of pulses and net count of each axis, for a schedule without its pulses
    """
    counted = counted or [(len(axis), axis.final - axis.start) for axis in pulses.axes]
    return {
        "schema": SCHEMA,
        "kind": "pulsepath pulse certificate",
        "file": None if path is None else path.name,
        "sha256": None if path is None else digest_file(path),
        "clock_hz": pulses.clock_hz,
        "rule": pulses.rule,
        "duration_s": pulses.duration,
        "holds": verdict.holds,
        "faults": [asdict(fault) for fault in verdict.faults],
        "axes": {
            one.name: {
                "pulses": one.pulses,
                "start_count": axis.start,
                "final_count": axis.start + net,
                "final_error_pulses": record(one.final_error),
                "bound_pulses": axis.bound,
                "time_error_ticks": record(one.time_error),
                "position_error_beyond_bound_pulses": record(one.position_error),
                "error_behind_play_and_screw_pulses": record(one.behind),
                "smallest_interval_s": record(one.smallest_interval),
                **drive,
            }
            for one, axis, drive, (_, net) in zip(
                verdict.axes,
                pulses.axes,
                _drive_times(verdict, pulses.clock_hz, machine),
                counted,
                strict=True,
            )
        },
    }


def _drive_times(verdict: PulseCheck | None, clock_hz: int, machine: Machine) -> list[Record]:
    """Return the highest rate of each axis, the shortest times on its lines, and its drive's
    needs.
    """
    if verdict is None:
        return [{}] * len(machine.axes)
    return [
        {
            "highest_rate_hz": 1 / one.smallest_interval if one.smallest_interval > 0 else None,
            "max_pulse_rate_hz": axis.max_pulse_rate,
            "lines_s": record_fields(lines, "high", "low", "setup", "hold"),
            "drive_needs_s": record_fields(axis.timing, "high", "low", "setup", "hold", "max_rate"),
        }
        for one, axis, lines in zip(
            verdict.axes, machine.axes, time_lines(verdict, clock_hz, machine.axes), strict=True
        )
    ]


def _worth(worth: Worth, change: LimitChange | None) -> Record:
    """Return the saving by one per cent more of each limit, and the plan with more of one limit."""
    rows = zip(worth.limits, worth.axes, worth.saved.tolist(), worth.together.tolist(), strict=True)
    keys = ("limit", "axis", "saved_s", "saved_with_what_binds_beside_it_s")
    return {
        "of_more": 0.01,
        "limits": [dict(zip(keys, row, strict=True)) for row in rows],
        "not_known": list(worth.unknown),
        "explained": record(worth.explained),
        "planned_again": record(change),
    }
