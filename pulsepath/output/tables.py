"""The tables that the commands print, of their results."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.foundation.table import MAX_SHOWN_ROWS, SCALES, Column, Table
from kinematics.machine.axis import directional_bounds
from pulsepath.output.directory import RECORD, REPORT
from pulsepath.progress import QUIET, VERBOSE, Layout, draw, level, say

if TYPE_CHECKING:
    from benchmarks.reports.plan_content import PlanReport
    from controllers import Metrics
    from kinematics import Axis, MotionError
    from kinematics.foundation.result import Result
    from kinematics.machine.axis import Magnitude
    from kinematics.machine.machine_file import MachineSummary
    from planner import Classical, Plan, Standing
    from planner.plan_parts import PlanStanding
    from planner.sources.position_list import PositionList


# Axes, or pairs of bodies, that the summary of a check names.
MOST_AXES = 8


def show(tables: Iterable[Table]) -> None:
    """Print tables."""
    draw(map(lay_out, tables))


def lay_out(table: Table) -> Layout:
    """Return the layout of a table, as data for JSON."""
    columns = [(column.title, column.numeric, column.whole) for column in table.read]
    return {
        "title": table.title,
        "columns": columns,
        "rows": table.cells(),
        "notes": [*table.notes],
    }


def list_tables(*results: Result) -> list[Table]:
    """Return the tables of results."""
    return [table for result in results for table in result.tables()]


def tabulate_plan(report: PlanReport) -> list[Table]:
    """Return the tables of a plan: summary, baseline timings, segments, proof and pulses."""
    from benchmarks.reports.plan_summary import summarise
    from planner.active_limits import tabulate_segments
    from planner.plan_parts import PlanStanding

    rows = [(row.label, row.text) for row in summarise(report)]
    if isinstance(report.plan, PlanStanding):
        return [_tabulate_rows(report.plan, rows), *report.plan.tables()[1:]]
    plan = report.plan
    rows += [(timing.kind, _describe_timing(plan, timing)) for timing in report.others]
    return [
        _tabulate_rows(plan, rows),
        tabulate_segments(plan),
        *plan.tables()[1:],
        *(_list_tables(report.worth) if level() >= VERBOSE else ()),
        *_list_tables(report.stops),
        *_list_tables(report.crossed),
    ]


def sum_up(report: PlanReport) -> list[Table]:
    """Return the first screen of a plan: duration, saving, limits, joins and pulses."""
    from benchmarks.reports.plan_summary import summarise

    rows = [(row.label, row.text) for row in summarise(report) if row.brief]
    summary = _tabulate_rows(report.plan, rows)
    return [summary, *_list_tables(report.stops), *_list_tables(report.crossed)]


def _tabulate_rows(plan: Plan | PlanStanding, rows: Sequence[tuple[str, str]]) -> Table:
    labels, texts = zip(*rows, strict=True)
    title = f"{plan.program.name} on {plan.machine.name}, order {plan.order}"
    return Table(title, (Column("what", labels), Column("", texts)))


def _list_tables(result: Result | None) -> tuple[Table, ...]:
    return () if result is None else result.tables()


def sum_up_check(standing: Standing) -> list[Table]:
    """Return the first screen of a check: use of the limits, and a line each for fits, blends and
    moves.
    """
    from planner.path.outcome import describe_blends
    from planner.path.overshoot import describe_overshoot
    from planner.path.point_to_point import describe_departures

    uses, *rest = standing.tables()
    fit = standing.fit
    texts = {
        "blends": describe_blends(standing.blends),
        "fit": fit.describe() if fit is not None and fit.before else "",
        "synchronised moves": describe_departures(standing.departures),
        "splines off their polygons": describe_overshoot(standing.overshoots),
    }
    notes = [f"{label}: {text}" for label, text in texts.items() if text]
    if rest:
        notes.append("with -v: a table of each")
    return [replace(uses, notes=(*uses.notes, *notes))]


def sum_up_violations(violations: Sequence[MotionError]) -> list[MotionError | str]:
    """Return the worst violation of each limit, and a line each on the others."""
    from kinematics.foundation.names import count_noun
    from planner.place import Infeasible

    by_limit: dict[str, list[MotionError]] = {}
    for violation in violations:
        limit = violation.kind if isinstance(violation, Infeasible) else str(violation)
        by_limit.setdefault(limit, []).append(violation)
    lines: list[MotionError | str] = []
    for limit, alike in by_limit.items():
        lines.append(alike[0])
        if len(alike) == 1:
            continue
        axes = sorted({each.axis for each in alike if isinstance(each, Infeasible)})
        if len(axes) > MOST_AXES:
            axes[MOST_AXES:] = [f"{len(axes) - MOST_AXES} more"]
        segments = {each.segment for each in alike if each.segment is not None}
        where = ""
        if segments:
            where = f", in {count_noun(len(segments), 'segment')}, first in segment {min(segments)}"
        lines.append(
            f"{limit}: {len(alike)} violations, at {', '.join(axes)}{where}; -v lists them"
        )
    return lines


def _describe_timing(plan: Plan, timing: Classical) -> str:
    """Describe a baseline timing and its differences from the plan."""
    from planner.baselines import describe_differences

    return "; ".join([f"{timing.duration:.6f} s", *describe_differences(plan, timing)])


def tabulate_records(title: str, listed: Sequence[Mapping[str, Any]]) -> list[Table]:
    """Records of the same keys, a row each."""
    columns = {key: [record[key] for record in listed] for key in listed[0]}
    texts = {
        key: [", ".join(value) if isinstance(value, list | dict) else value for value in values]
        for key, values in columns.items()
    }
    return [Table(title, tuple(Column(key, values) for key, values in texts.items()))]


def tabulate_rules(rules: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """The firing rules, of their record, each with its options and their defaults."""
    rows = []
    for name, rule in rules.items():
        rows.append((name, "", "", rule["about"]))
        for option, facts in rule["options"].items():
            default = (
                "" if facts["default"] is None else f"{facts['default']:g} {facts['unit']}".rstrip()
            )
            rows.append(("", option, default, facts["about"]))
    names, options, defaults, about = zip(*rows, strict=True)
    columns = (
        Column("rule", names),
        Column("option", options),
        Column("default", defaults, right=True),
    )
    return [Table("firing rules", (*columns, Column("", about)))]


def tabulate_tracking(metrics: Iterable[Metrics]) -> list[Table]:
    """Errors of each axis and in space, one table per law."""
    return [law.tables()[0] for law in metrics]


def tabulate_positions(listed: PositionList, file: str) -> list[Table]:
    """Each pose by its number."""
    (table,) = listed.tables()
    return [replace(table, title=f"{file}: {table.title}")]


def tabulate_machines(machines: Iterable[MachineSummary]) -> list[Table]:
    """Axes, travel and limits of each machine; axes that share them share a row."""
    rows = []
    for machine in machines:
        alike: dict[tuple[str, ...], list[str]] = {}
        for axis in machine.axes:
            alike.setdefault(_limits(axis), []).append(axis.name)
        for n, (limits, names) in enumerate(alike.items()):
            some = ", ".join(names) if len(names) <= 3 else f"{names[0]} … {names[-1]}"
            rows.append(
                ("" if n else machine.name, some, "" if n else " ".join(machine.freedom), *limits)
            )
    heads = ("machine", "axes", "freedom", "travel", "pulse", "speed", "acceleration", "jerk")
    columns = zip(heads, zip(*rows, strict=True), strict=True)
    return [
        Table(
            "bundled machines",
            tuple(Column(head, cells, whole=head not in heads[1:3]) for head, cells in columns),
        )
    ]


def _limits(axis: Axis) -> tuple[str, ...]:
    unit, scale = SCALES["human"][axis.unit]
    low, high = axis.travel
    travel = "unlimited" if high == inf else f"{scale * low:g} … {scale * high:g} {unit}"
    pulse = f"{1e6 * axis.pulse:g} µm" if axis.unit == "m" else f"{scale * axis.pulse:.4g} {unit}"
    bounds = ((axis.max_speed, "/s"), (axis.max_acceleration, "/s²"), (axis.max_jerk, "/s³"))
    return travel, pulse, *(_bound(bound, scale, f"{unit}{per}") for bound, per in bounds)


def _bound(bound: Magnitude | None, scale: float, unit: str) -> str:
    """A bound; both ways where they differ, towards smaller positions first."""
    if bound is None:
        return "unlimited"
    return f"{' / '.join(f'{scale * side:g}' for side in dict.fromkeys(directional_bounds(bound)))} {unit}"


def show_plan(
    out: Path,
    as_json: bool,
    all_tables: Callable[[], Sequence[Table]],
    first_screen: Callable[[], Sequence[Table]],
) -> None:
    """Print a plan that was written to a directory, at the requested verbosity."""
    import click

    from pulsepath.output import record
    from pulsepath.output.drive_tables import add_close_drives, tabulate_drives

    report = str(out / REPORT)
    if level() == QUIET and not as_json:
        say(report)
        return
    written = json.loads((out / RECORD).read_bytes())
    if as_json:
        click.echo(record.as_json({**written, "report": report}), nl=False)
        return
    pulses = written["pulses"]
    if level() == VERBOSE:
        draw(
            _lay_out_shown(table, out / RECORD)
            for table in (*all_tables(), *tabulate_drives(pulses))
        )
    else:
        show(add_close_drives(first_screen(), pulses))
    say(f"report: {report}")


def _lay_out_shown(table: Table, record: Path) -> Layout:
    """Lay out a table; for a long one the rows that text shows, and the file that has the
    others.
    """
    layout = lay_out(table)
    if len(table) > MAX_SHOWN_ROWS:
        layout["rows"] = table.shown_cells()
        layout["notes"].insert(0, f"{MAX_SHOWN_ROWS} of {len(table)} rows: all are in {record}")
    return layout
