"""The report of a plan: one self-contained HTML page, and its figures as PNG files.

The figures of a plan in parts show the extremes over windows of time.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from math import floor, isfinite
from pathlib import Path

from benchmarks.animation.animate import POLICY as PLAYER_POLICY
from benchmarks.reports.page import Picture, group_digits, render, save_figures
from benchmarks.reports.plan_content import PlanReport
from benchmarks.reports.plan_figures import (
    draw_axes,
    draw_baseline,
    draw_path,
    draw_realised,
    draw_stops,
    draw_tracking,
    draw_worth,
)
from benchmarks.reports.plan_summary import list_counts, list_headline, summarise
from benchmarks.reports.timeline import (
    list_segments,
    list_window_segments,
    make_band,
    make_window_band,
)
from kinematics.foundation.table import MAX_SHOWN_ROWS, Column, Table
from planner.active_limits import ACTIVE_SHARE, tabulate_segments
from planner.activity import MOST_SEGMENTS, Activity
from planner.baselines import describe_differences, missing_limits
from planner.bounds.limit_worth import Worth
from planner.certificate.certify import CROSSING, Certificate
from planner.certificate.constant_speed import CONSTANT_SPEED, SPEED_TOLERANCE
from planner.limits import Limit
from planner.limits.limit import AxisLimit
from planner.plan import Plan
from planner.plan_parts import PlanStanding
from planner.pulses.schedule import RATE_WINDOWS
from planner.pulses.triggers import trigger_tables

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""Content policy of the page: a browser loads only the content of the page itself."""
MOST_WORTH = 5
"""Limits on the first screen."""

# Proved claims besides the limits, and the bound of each.
CLAIMS = {
    CROSSING: "the time of its axis",
    CONSTANT_SPEED: f"{SPEED_TOLERANCE:g} off the speed",
}


def write_report(report: PlanReport, path: Path) -> None:
    """Write the page of a plan, and its figures as `figures/*.png` in its folder."""
    figures = report.figures
    if figures is None:
        figures = draw(report)
    path.write_text(_make_page(report, figures), encoding="utf-8")
    save_figures(figures, path)


def draw(report: PlanReport) -> dict[str, Picture]:
    """Draw every figure of the page, by name."""
    from benchmarks.reports import window_figures  # which takes matplotlib along

    plan = report.plan
    figures: dict[str, Picture] = {}
    if report.overview is not None and report.activity is not None:
        assert isinstance(plan, PlanStanding)
        figures |= window_figures.draw(plan, report.overview, report.activity)
    elif isinstance(plan, Plan):
        figures |= draw_axes(plan) | draw_path(plan) | draw_baseline(plan, report.classical)
    figures |= draw_realised(report.realised) | draw_tracking(report.metrics)
    return figures | draw_worth(report.worth) | draw_stops(report.stops)


def _make_page(report: PlanReport, figures: Mapping[str, Picture]) -> str:
    plan = report.plan
    results = {each.name: getattr(report, each.name) for each in fields(report)}
    del results["figures"]
    if isinstance(plan, Plan):
        values = _describe_whole(report, plan)
        values["band"] = make_band(plan) if figures else {}
    else:
        values = _describe_parts(report, plan)
    return render(
        "report.html.j2",
        figures,
        **{**results, **values},
        shaped=report.shaped,
        headline=[*list_headline(report)],
        summary=summarise(report),
        active_share=ACTIVE_SHARE,
        pulses=_tabulate_pulses(report),
        policy=PLAYER_POLICY if report.scene else POLICY,
        top_worth=[*_list_top_worth(report.worth)],
    )


def _describe_whole(report: PlanReport, plan: Plan) -> dict[str, object]:
    """Return what the page shows of a plan that was made as a whole."""
    baseline = report.classical
    allowed = {limit.name: _format_bounds(limit, plan) for limit in plan.limits} | CLAIMS
    segments = tabulate_segments(plan)
    activity = Activity(plan.program)
    activity.add(plan.trajectory, 0.0, plan.limits)
    together = ", all its repetitions together" if plan.program.repeat > 1 else ""
    triggers = report.triggers
    if triggers is None:
        triggers = trigger_tables(plan.triggers, plan.path.names)
    return {
        "duration": plan.trajectory.duration,
        "axis_bounds": plan.axis_bounds,
        "exceeded": plan.exceeded,
        "mover": "platform’s origin" if plan.path.tool is None else "tool",
        "missing": missing_limits(plan, baseline) if baseline else (),
        "differences": {one.kind: describe_differences(plan, one) for one in report.others},
        "active": activity.tabulate_limits(),
        "segment_tables": {f"Each segment of the program{together}: {SEGMENT_FACTS}": segments},
        "folded": len(segments) if len(segments) > MAX_SHOWN_ROWS else 0,
        "certificate": _tabulate_certificate(plan.certificate, allowed),
        "segments": list_segments(plan),
        "rate_window": plan.pulses.duration / RATE_WINDOWS,
        "triggers": triggers,
    }


SEGMENT_FACTS = "its time, and the limit that is active longest in it."


def _describe_parts(report: PlanReport, plan: PlanStanding) -> dict[str, object]:
    """Return what the page shows of a plan that was made in parts."""
    overview = report.overview
    activity = report.activity
    assert overview is not None
    assert activity is not None
    longest = activity.tabulate_longest()
    if activity.complete:
        apart = ", its repetitions one by one" if plan.program.repeat > 1 else ""
        tables = {f"Each segment of the program{apart}: {SEGMENT_FACTS}": longest}
    else:
        first = f"The {MOST_SEGMENTS} segments that take longest, and the limit that is active longest in each."
        tables = {
            first: longest,
            "The segments of the least mean speed.": activity.tabulate_slowest(),
        }
    return {
        "duration": plan.duration,
        "axis_bounds": None,
        "exceeded": "",
        "mover": "platform’s origin",
        "active": activity.tabulate_limits(),
        "segment_tables": tables,
        "folded": 0,
        "certificate": _tabulate_certificate(plan.certificate, {}),
        "band": make_window_band(activity),
        "segments": list_window_segments(overview, activity),
        "triggers": report.triggers or (),
    }


def _tabulate_certificate(certificate: Certificate, allowed: Mapping[str, str]) -> Table:
    """Tabulate the proved and the attained use of each limit. allowed: bounds by limit, or
    empty.
    """
    (table,) = certificate.tables()
    names, proved, *where = table.columns
    # A lower bound is rounded down, so that the text is one too.
    attained = [floor(1e7 * certificate.attained[name].max()) / 1e7 for name in names.values]
    columns = [replace(proved, name="proven ≤"), Column("attained ≥", attained, form=".7f")]
    if allowed:
        columns.insert(0, Column("allowed", [allowed[name] for name in names.values], right=True))
    return Table("proved and attained use of each limit", (names, *columns, *where))


def _tabulate_pulses(report: PlanReport) -> Table:
    """Tabulate the pulses of each axis, and their check."""
    plan = report.plan
    axes = plan.pulses.axes
    counted = list_counts(plan)
    finals = [axis.start + net for axis, (_, net) in zip(axes, counted, strict=True)]
    driven = zip(axes, plan.machine.axes, strict=True)
    columns = [
        Column("axis", [axis.name for axis in axes]),
        Column("pulses", [group_digits(number) for number, _ in counted], right=True),
        Column(
            "one pulse",
            [f"{1e6 * axis.pulse:.6g} µ{each.unit}" for axis, each in driven],
            right=True,
        ),
        Column("first count", [group_digits(axis.start) for axis in axes], right=True),
        Column("last count", [group_digits(final) for final in finals], right=True),
    ]
    checked = () if report.verdict is None else report.verdict.axes
    if checked:
        rates = [f"{1 / each.smallest_interval:.0f}" for each in checked]
        columns.append(Column("highest rate (1/s)", [*map(group_digits, rates)], right=True))
    bounds = [axis.bound for axis in axes]
    columns.append(Column("stated error (pulses)", bounds, form=".3f", up=True))
    if checked:
        errors = [each.time_error for each in checked]
        none = {"None": "–"}
        columns.append(Column("largest time error (ticks)", errors, form=".4f", words=none))
    clock = f"clock {group_digits(plan.pulses.clock_hz)} Hz. Firing rule: {plan.pulses.rule}"
    notes = [
        "the stated error bounds the difference between counts and motion, in addition to one tick’s travel"
    ]
    if checked:
        notes.append("the time error is given if every pulse marks a crossing")
    return Table(clock, tuple(columns), tuple(notes))


def _format_bounds(limit: Limit, plan: Plan) -> str:
    """Format the bounds of a limit at the place of its largest use.

    A place has two ends (lo … hi). A rate that differs by direction has both values, first the one
    towards smaller positions.
    """
    worst = plan.certificate.where[limit.name]
    piece = next(k for k in range(len(plan.path.pieces)) if plan.path.segment(k) == worst.segment)
    bounds: dict[str, list[float]] = {}
    for channel, (unit, scale) in enumerate(limit.units):
        if limit.channels[channel] != worst.axis:  # several channels of a curve can be of one axis
            continue
        for side in (-1.0, 1.0):
            bound = limit.report_value(side, channel, piece)[1]
            if isfinite(bound):
                bounds.setdefault(unit, []).append(bound * scale)
    directed = isinstance(limit, AxisLimit) and not limit.geometric
    return ", ".join(f"{_join_bounds(values, directed)} {unit}" for unit, values in bounds.items())


def _join_bounds(bounds: Sequence[float], directed: bool) -> str:
    """Join the bounds of two directions, or the ends of a range; equal ones are shown once."""
    if directed:
        return " / ".join(f"{bound:.6g}" for bound in dict.fromkeys(bounds))
    return " … ".join(f"{bound:.6g}" for bound in sorted({min(bounds), max(bounds)}))


def _list_top_worth(worth: Worth | None) -> Iterator[tuple[str, float, float]]:
    """Yield the limits that are worth most, the ms that 1 % more of each saves, and its share of
    the most.
    """
    from planner.bounds.limit_worth import call

    if worth is None:
        return
    rows = worth.rank()[:MOST_WORTH]
    if not rows or worth.saved[rows[0]] <= 0:
        return
    most = float(worth.saved[rows[0]])
    for k in rows:
        saved = float(worth.saved[k])
        yield call(worth.limits[k], worth.axes[k]), 1e3 * saved, max(saved, 0.0) / most
