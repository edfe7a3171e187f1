"""The tables that the commands print, of their results."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.foundation.names import count_noun
from kinematics.foundation.table import MAX_SHOWN_ROWS, SCALES, Column, Table
from kinematics.machine.axis import directional_bounds
from pulsepath.output.directory import RECORD, REPORT
from pulsepath.progress import QUIET, VERBOSE, Layout, draw, level, say
from pulsepath.store.files import TRIGGERS

if TYPE_CHECKING:
    from benchmarks.reports.plan_report import PlanReport
    from controllers import Metrics
    from kinematics import Axis, Machine
    from kinematics.foundation.result import Result
    from kinematics.machine.axis import Magnitude
    from planner import Classical, Plan, Standing
    from planner.path.outcome import Blended, FitSummary
    from planner.path.point_to_point import Departure
    from planner.path.shape import Overshoot
    from planner.plan_parts import PlanStanding
    from planner.shaping.shaped_proof import ShapedProof
    from planner.sources.position_list import PositionList


def show(tables: Iterable[Table]) -> None:
    """Print tables."""
    draw(map(lay_out, tables))


def lay_out(table: Table) -> Layout:
    """Return the layout of a table, as data for JSON."""
    columns = [(column.title, column.numeric, column.whole) for column in table.read]
    return {"title": table.title, "columns": columns, "rows": table.cells(), "notes": [*table.notes]}


def of_results(*results: Result) -> list[Table]:
    """Return the tables of results."""
    return [table for result in results for table in result.tables()]


def of_plan(job: PlanReport) -> list[Table]:
    """Return the tables of a plan: duration and saving, segments, proof and pulses."""
    from planner.active_limits import tabulate_segments
    from planner.baselines import missing_limits
    from planner.plan_parts import PlanStanding
    from planner.timing.certified_solve import BEFORE_SHAPERS

    if isinstance(job.plan, PlanStanding):
        return [*job.plan.tables()]
    plan = job.plan
    message = plan.describe_objective()
    message += f"; the fastest motion takes {plan.lower_bound:.6f} s or more" if plan.known else ""
    rows: list[tuple[str, float | None, str]] = [
        ("duration", plan.duration, "" if plan.fastest else message),
        *(() if plan.shaped is None else [(BEFORE_SHAPERS, plan.trajectory.duration, "the rows below refer to this")]),
        *(() if plan.shaped is None else _cost_rows(plan, plan.shaped)),
    ]
    if job.classical is not None:
        percent = 100 * job.time_saved / job.classical.duration
        missing = missing_limits(plan, job.classical)
        unlike = f"; the baseline timing is without {', '.join(missing)}" if missing else ""
        timing = _describe_timing(plan, job.classical, job.classical.kind)
        rows.append(("baseline timing", job.classical.duration, timing))
        rows.append(("time saved", job.time_saved, f"{percent:.2f} %{unlike}"))
    if plan.known:
        rows.append(("lower bound, proved", plan.lower_bound, plan.bound.describe() if plan.fastest else ""))
    if job.worth is not None:
        rows.append(("saved by 1 % more of", None, job.worth.describe()))
    if job.unbounded:
        rows.append((UNBOUNDED, None, job.unbounded))
    if job.left_out:
        rows.append((LEFT_OUT, None, ", ".join(job.left_out)))
    if avoidable := plan.avoidable_stops.describe():
        rows.append(("stops", None, avoidable))
    rows += [(other.kind, other.duration, _describe_timing(plan, other)) for other in job.others]
    what, times, notes = zip(*rows, strict=True)
    first, *rest = plan.tables()
    timed = (Column("what", what), Column("time", times, "s", form=".6f"), Column("note", notes))
    crossed = () if job.crossed is None else job.crossed.tables()
    worth = () if job.worth is None or level() < VERBOSE else job.worth.tables()
    stops = () if job.stops is None else job.stops.tables()
    return [replace(first, columns=timed), tabulate_segments(plan), *rest, *worth, *stops, *crossed]


def _cost_rows(plan: Plan, shaped: ShapedProof) -> list[tuple[str, float | None, str]]:
    """Return rows about the shapers' cost, and the limits that were lowered for them."""
    cost = shaped.cost
    if cost is None or not plan.fastest:
        return []
    rows: list[tuple[str, float | None, str]] = [(COST, cost.total, cost.describe())]
    return rows + ([(LOWERED, cost.lowering, cost.describe_lowered())] if cost.lowered else [])


COST, LOWERED = "cost of the shapers", "lowered for them"
"""Labels of the shapers' cost."""


def _describe_cost(plan: Plan, shaped: ShapedProof) -> list[tuple[str, str]]:
    """Return rows of the first screen about the shapers' cost and the remaining vibration."""
    from kinematics.analysis.residual_vibration import find_residuals

    message = [(what, note) for what, _, note in _cost_rows(plan, shaped)]
    if shaped.cost is not None and shaped.cost.lowered and not plan.fastest:
        message.append((LOWERED, shaped.cost.describe_lowered()))
    left = "; ".join(each.describe() for each in find_residuals(shaped.axes))
    return [*message, ("vibration left", left)]


UNBOUNDED = "gap, worth of limits"
LEFT_OUT = "left out"
MOST_TOLD = 3
"""Number of stops at blends up to which each is listed with its reason."""
NEARLY = 0.999
"""Proven share of a limit from which a motion is said to use it up."""


def sum_up(job: PlanReport) -> list[Table]:
    """Return the first screen of a plan: duration, saving, limits, joins and pulses."""
    from planner.baselines import describe_differences, missing_limits
    from planner.limits.registry import geometric_limits
    from planner.plan_parts import PlanStanding
    from planner.timing.certified_solve import BEFORE_SHAPERS

    if isinstance(job.plan, PlanStanding):
        return _sum_up_parts(job.plan)
    plan = job.plan
    proof = plan.certificate
    message = plan.describe_objective()
    rows = [("duration", f"{plan.duration:.6f} s{f', {message}' if message else ''}")]
    if plan.shaped is not None:
        rows.append((BEFORE_SHAPERS, f"{plan.trajectory.duration:.6f} s; saving and gap refer to this"))
        rows.append(("input shapers", plan.shaped.describe()))
        rows += _describe_cost(plan, plan.shaped)
    if plan.fastest and job.classical is not None and not missing_limits(plan, job.classical):  # else they are unlike
        percent = 100 * job.time_saved / job.classical.duration
        unlike = "".join(f", but it {each}" for each in describe_differences(plan, job.classical))
        message = f"{percent:.2f} %: {job.time_saved:.3f} s less than {job.classical.kind}, the same limits{unlike}"
        rows.append(("saved", message))
    if stops := plan.avoidable_stops.describe():
        rows.append(("stops", stops))
    if plan.fastest and plan.known:
        rows.append(("gap", plan.bound.describe().removeprefix("the duration is ")))
    still = geometric_limits()  # of which a motion may reach the end, as home may be one
    lowered = {} if plan.shaped is None or plan.shaped.cost is None else plan.shaped.cost.lowered
    used = [
        f"{name} ({proof.where[name].axis})"
        for name, share in proof.worst.items()
        if (share > NEARLY or name in lowered) and name not in still
    ]
    rows.append(("limits", f"{len(proof.worst)} proved at every instant; used up: {', '.join(used) or 'none'}"))
    if job.worth is not None and job.worth.best is not None:
        rows.append(("saved by 1 % more of", job.worth.describe()))
    if job.unbounded:
        rows.append((UNBOUNDED, job.unbounded))
    if job.left_out:
        rows.append((LEFT_OUT, ", ".join(job.left_out)))
    if plan.path.fit is not None and plan.path.fit.before:
        rows.append(("fit", _sum_up_fit(plan.path.fit)))
    if plan.departures:
        rows.append(("off the line", _sum_up_departures(plan.departures)))
    if plan.path.overshoots:
        rows.append(("splines off their polygons", _sum_up_overshoots(plan.path.overshoots)))
    if plan.path.blends:
        rows.append(("blends", _sum_up_blends(plan.path.blends)))
    tolerances = [blend.tolerance for blend in plan.path.blends]
    tolerances += [] if plan.path.fit is None else [plan.path.fit.tolerance]
    if tolerances and max(tolerances) > (length := float(plan.path.breaks[-1])):
        message = (
            f"{1e3 * max(tolerances):.6g} mm, more than the whole path of {1e3 * length:.6g} mm: is the unit as meant?"
        )
        rows.append(("tolerance", message))
    bound = max(axis.bound for axis in plan.pulses.axes)
    rows.append(("pulses", f"{plan.pulses.total} by the rule {plan.pulses.rule}, within {bound:.3f} of the motion"))
    what, values = zip(*rows, strict=True)
    summed = Table(
        f"{plan.program.name} on {plan.machine.name}, order {plan.order}", (Column("what", what), Column("", values))
    )
    crossed = () if job.crossed is None else job.crossed.tables()
    stops_tables = () if job.stops is None else job.stops.tables()
    return [summed, *stops_tables, *crossed]


def _sum_up_parts(standing: PlanStanding) -> list[Table]:
    """A plan made in parts on a screen, as `sum_up` does."""
    from planner.limits.registry import geometric_limits

    proof, still = standing.certificate, geometric_limits()
    used = [name for name, share in proof.worst.items() if share > NEARLY and name not in still]
    windows = count_noun(standing.windows, "window")
    rows = [
        ("duration", f"{standing.duration:.6f} s, {1e3 * standing.start.length:.3f} mm of path"),
        ("limits", f"{len(proof.worst)} proved at every instant; used up: {', '.join(used) or 'none'}"),
    ]
    if standing.fit is not None and standing.fit.before:
        rows.append(("fit", _sum_up_fit(standing.fit)))
    if standing.avoidable_stops is not None and standing.avoidable_stops.count:
        rows.append(("stops", standing.avoidable_stops.describe()))
    if standing.blends:
        rows.append(("blends", f"{standing.blends}, {standing.stops} of them replaced by stops"))
    total = sum(number for number, _ in standing.counted)
    bound = max(axis.bound for axis in standing.pulses.axes)
    rows.append(("pulses", f"{total} by the rule {standing.pulses.rule}, within {bound:.3f} of the motion"))
    if standing.triggers:
        rows.append(("triggers", f"{standing.triggers} in {TRIGGERS}"))
    what, values = zip(*rows, strict=True)
    title = f"{standing.program.name} on {standing.machine.name}, order {standing.order}, in {windows}"
    return [Table(title, (Column("what", what), Column("", values)))]


def sum_up_check(found: Standing) -> list[Table]:
    """Return the first screen of a check: use of the limits, and a line each for fits, blends and moves."""
    uses, *rest = found.tables()
    message = [("blends", _sum_up_blends(found.blends))] if found.blends else []
    if found.fit is not None and found.fit.before:
        message.append(("fit", _sum_up_fit(found.fit)))
    if found.departures:
        message.append(("off the line", _sum_up_departures(found.departures)))
    if found.overshoots:
        message.append(("splines off their polygons", _sum_up_overshoots(found.overshoots)))
    more = ["with -v: a table of each"] if rest else []
    return [replace(uses, notes=(*uses.notes, *(f"{what}: {text}" for what, text in message), *more))]


def _sum_up_blends(blends: Sequence[Blended]) -> str:
    stops = sum(bool(blend.stop) for blend in blends)
    message = f"{stops} of them replaced by stops" if stops else "all passed without a stop"
    where = [f"after segment {blend.segment}: {blend.stop}" for blend in blends if blend.stop]
    places = f" ({'; '.join(where)})" if 0 < stops <= MOST_TOLD else ""
    return f"{len(blends)}, {message}{places}"


def _sum_up_fit(fit: FitSummary) -> str:
    at = fit.deviates_at
    near = f"within {1e3 * fit.deviation:.3g} mm of them, proved; farthest at {1e3 * at.s:.3f} mm, segment {at.segment}"
    return f"{count_noun(fit.before, 'piece')} made {fit.after}, {near}"


def _sum_up_departures(departures: Sequence[Departure]) -> str:
    return f"up to {1e3 * max(one.distance for one in departures):.3f} mm, as moves are synchronised"


def _sum_up_overshoots(overshoots: Sequence[Overshoot]) -> str:
    from planner.path.overshoot import describe_overshoot

    return describe_overshoot(overshoots)


def _describe_timing(plan: Plan, timing: Classical, *first: str) -> str:
    """Describe a baseline timing and its differences from the plan."""
    from planner.baselines import describe_differences

    return "; ".join([*first, *describe_differences(plan, timing)])


def of_list(title: str, listed: Sequence[Mapping[str, Any]]) -> list[Table]:
    """Records of the same keys, a row each."""
    columns = {key: [record[key] for record in listed] for key in listed[0]}
    texts = {
        key: [", ".join(value) if isinstance(value, list | dict) else value for value in values]
        for key, values in columns.items()
    }
    return [Table(title, tuple(Column(key, values) for key, values in texts.items()))]


def of_rules(rules: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """The firing rules, of their record, each with its options and their defaults."""
    rows = []
    for name, rule in rules.items():
        rows.append((name, "", "", rule["about"]))
        for option, said in rule["options"].items():
            default = "" if said["default"] is None else f"{said['default']:g} {said['unit']}".rstrip()
            rows.append(("", option, default, said["about"]))
    names, options, defaults, about = zip(*rows, strict=True)
    columns = (Column("rule", names), Column("option", options), Column("default", defaults, right=True))
    return [Table("firing rules", (*columns, Column("", about)))]


def of_tracking(metrics: Iterable[Metrics]) -> list[Table]:
    """Errors of each axis and in space, one table per law."""
    return [law.tables()[0] for law in metrics]


def of_positions(listed: PositionList, file: str) -> list[Table]:
    """Each pose by its number."""
    (table,) = listed.tables()
    return [replace(table, title=f"{file}: {table.title}")]


def of_machines(machines: Iterable[Machine]) -> list[Table]:
    """Axes, travel and limits of each machine; axes that share them share a row."""
    rows = []
    for machine in machines:
        alike: dict[tuple[str, ...], list[str]] = {}
        for axis in machine.axes:
            alike.setdefault(_limits(axis), []).append(axis.name)
        for n, (limits, names) in enumerate(alike.items()):
            some = ", ".join(names) if len(names) <= 3 else f"{names[0]} … {names[-1]}"
            rows.append(("" if n else machine.name, some, "" if n else " ".join(machine.freedom), *limits))
    heads = ("machine", "axes", "freedom", "travel", "pulse", "speed", "acceleration", "jerk")
    columns = zip(heads, zip(*rows, strict=True), strict=True)
    return [
        Table("bundled machines", tuple(Column(head, cells, whole=head not in heads[1:3]) for head, cells in columns))
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
    out: Path, as_json: bool, all_tables: Callable[[], Sequence[Table]], first_screen: Callable[[], Sequence[Table]]
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
        draw(_lay_out_shown(table, out / RECORD) for table in (*all_tables(), *tabulate_drives(pulses)))
    else:
        show(add_close_drives(first_screen(), pulses))
    say(f"report: {report}")


def _lay_out_shown(table: Table, record: Path) -> Layout:
    """Lay out a table; for a long one the rows that text shows, and the file that has the others."""
    layout = lay_out(table)
    if len(table) > MAX_SHOWN_ROWS:
        layout["rows"] = table.shown_cells()
        layout["notes"].insert(0, f"{MAX_SHOWN_ROWS} of {len(table)} rows: all are in {record}")
    return layout
