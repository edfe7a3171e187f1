"""The report of a plan: one self-contained HTML page, and its figures as PNG files."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import cycle
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.animation.animate import POLICY as PLAYER_POLICY
from benchmarks.reports.page import NARROW, Picture, draw_figure, render, save_figures, style
from benchmarks.reports.plan_summary import summary
from benchmarks.reports.timeline import list_segments, make_band
from controllers.metrics import Metrics
from controllers.rig import Rig
from kinematics.foundation.table import MAX_SHOWN_ROWS, Table
from planner.active_limits import ACTIVE_SHARE, active_limits, tabulate_segments
from planner.baselines import Classical, describe_differences, missing_limits
from planner.certificate.certify import CROSSING
from planner.certificate.constant_speed import CONSTANT_SPEED, SPEED_TOLERANCE
from planner.cross_check import CrossCheck
from planner.interruption.hold import Stops
from planner.limits import Limit
from planner.limits.limit import AxisLimit
from planner.plan import Plan
from planner.pulses import PulseCheck, RealisedPath
from planner.pulses.schedule import RATE_WINDOWS
from planner.tradeoffs.limit_worth import LimitChange, Worth

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""Content policy of the page: a browser loads only the content of the page itself."""
MOST_WORTH = 5
"""Limits on the first screen."""

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from planner.figures import Quantity


@dataclass(frozen=True, slots=True)
class PlanReport:
    """The content of a plan's report. A part of the page without its result is left out.

    plan       plan of the report
    verdict    of the independent check of its pulses
    classical  baseline of the saving
    others     further baseline timings, for the table
    metrics    errors of each tracking law; without them the page says how to get them
    rig        rig that the laws were run on
    untracked  reason why there are no errors, or the rig to choose for them
    realised   path that the pulses make
    crossed    comparison with toppra's motion
    worth      worth of the limits
    change     motion with more of one limit
    unbounded  reason why there is no worth
    stops      soonest stops
    figures    figures as `draw` gives them, all or some; None: `write_report` draws them
    scene      page of the machine in motion, from `benchmarks.animation`
    drives     tables of the times on STEP and DIR against the needs of the drives
    left_out   results that were left out to save time, each with the option that asks for it
    """

    plan: Plan
    verdict: PulseCheck
    classical: Classical | None = None
    others: Sequence[Classical] = ()
    metrics: Sequence[Metrics] = ()
    rig: Rig | None = None
    untracked: str = ""
    realised: RealisedPath | None = None
    crossed: CrossCheck | None = None
    worth: Worth | None = None
    change: LimitChange | None = None
    unbounded: str = ""
    stops: Stops | None = None
    figures: Mapping[str, Picture] | None = None
    scene: str = ""
    drives: Sequence[Table] = ()
    left_out: Sequence[str] = ()


def write_report(report: PlanReport, path: Path) -> None:
    """Write the page of a plan, and its figures as `figures/*.png` in its folder."""
    figures = report.figures
    if figures is None:
        figures = draw(report)
    path.write_text(_page(report, figures), encoding="utf-8")
    save_figures(figures, path)


def draw(report: PlanReport) -> dict[str, Picture]:
    """Draw every figure of the page, by name."""
    plan = report.plan
    return (
        draw_axes(plan)
        | draw_path(plan)
        | draw_comparisons(plan, report.classical, report.realised)
        | draw_tracking(report.metrics)
        | draw_worth(report.worth, report.stops)
    )


def draw_axes(plan: Plan) -> dict[str, Picture]:
    """Draw the motion of the axes, and the pulse rates."""
    from planner.figures import pulse_rate

    with style():
        return {
            "axes": draw_figure(*_draw_axis_motion(plan)),
            "pulses": draw_figure(_add_legend(pulse_rate(plan))),
        }


def draw_path(plan: Plan) -> dict[str, Picture]:
    """The figures of the path, and of the limits along it."""
    from kinematics.foundation.figure import new_axes_3d
    from planner.figures import path_in_space

    with style():
        space = path_in_space(plan, new_axes_3d(None, (1.15 * NARROW, 0.75 * NARROW)))
        return {"path": draw_figure(space), "limits": draw_figure(*_draw_limit_use(plan))}


def draw_comparisons(plan: Plan, classical: Classical | None, realised: RealisedPath | None) -> dict[str, Picture]:
    """The figures of the baseline timing, and of the path of the pulses."""
    with style():
        figures = {"classical": draw_figure(_draw_classical(plan, classical))} if classical else {}
        return figures | ({"realised": draw_figure(*_draw_realised(realised))} if realised else {})


def draw_worth(worth: Worth | None, stops: Stops | None = None) -> dict[str, Picture]:
    """Draw the worth of the limits, if any limit saves time, and the stops."""
    with style():
        found = {"worth": draw_figure(*_draw_worth(worth))} if worth is not None and worth.rank() else {}
        return found | ({"stops": draw_figure(stops.plot())} if stops is not None else {})


def draw_tracking(metrics: Sequence[Metrics]) -> dict[str, Picture]:
    """The figure of the laws' errors, if there are any."""
    with style():
        return {"tracking": draw_figure(*_draw_law_errors(metrics))} if metrics else {}


def _draw_axis_motion(plan: Plan) -> "list[Axes]":
    from planner.figures import axis_motion

    every: tuple[Quantity, ...] = ("position", "speed", "acceleration", "jerk")
    kinds = sorted({axis.kind for axis in plan.machine.axes})
    # order 2 leaves the jerk without bound
    panels = [(quantity, kind) for quantity in every[: plan.order + 1] for kind in kinds]
    axes = _stack_axes(len(panels), 2.3)
    for ax, (quantity, kind) in zip(axes, panels, strict=True):
        axis_motion(plan, quantity, ax, kind)
    _add_legend(axes[0])
    return axes


def _draw_limit_use(plan: Plan) -> "list[Axes]":
    from planner.figures import limit_use

    axes = _stack_axes(2, 3.2, share=False)
    limit_use(plan, axes[0], "path")
    limit_use(plan, axes[1], "time")
    _add_legend(axes[0])
    return axes


def _draw_worth(worth: Worth) -> "list[Axes]":
    from planner.tradeoffs.figures import worth_along

    axes = _stack_axes(2, 3.2, share=False, width=NARROW)
    worth.plot(axes[0])
    worth_along(worth, axes[1])
    _add_legend(axes[1], 3)
    return axes


def _draw_realised(realised: RealisedPath) -> "list[Axes]":
    from planner.figures import realised_error

    names = [error.name for error in realised.errors if error.name in ("position", "orientation")]
    axes = [realised_error(realised, name, ax) for name, ax in zip(names, _stack_axes(len(names), 2.6), strict=True)]
    _add_legend(axes[0])
    return axes


def _draw_law_errors(metrics: Sequence[Metrics]) -> "list[Axes]":
    from controllers.figures import contour_error, tracking_error
    from kinematics.foundation.figure import PALETTE

    axes = _stack_axes(2, 2.6)
    for law, color in zip(metrics, cycle(PALETTE)):
        contour_error(law, axes[0], color=color)
        tracking_error(law, axes[1], color=color)
    _add_legend(axes[0])
    return axes


def _draw_classical(plan: Plan, classical: Classical) -> "Axes":
    from kinematics.foundation.figure import PALETTE
    from planner.figures import path_speed

    (ax,) = _stack_axes(1, 3.0)
    path_speed(plan.trajectory, ax, label=f"this plan, {plan.trajectory.duration:.4f} s", color=PALETTE[0])
    named = f"{classical.kind}, {classical.duration:.4f} s"
    path_speed(classical.trajectory, ax, label=named, color=PALETTE[3], linewidth=1)
    ax.set(xlim=(0, max(plan.trajectory.duration, classical.duration)), ylim=(0, None))
    return _add_legend(ax)


def _stack_axes(count: int, height: float, share: bool = True, width: float = 9.0) -> "list[Axes]":
    """Axes of one figure, one below the other; with `share`, on one time axis."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, count * height + 0.4), layout="constrained")
    return list(figure.subplots(count, 1, sharex=share, squeeze=False)[:, 0])


def _add_legend(ax: "Axes", columns: int = 6) -> "Axes":
    """Put the legend above the axes, in the middle of the figure and no wider than it."""
    from matplotlib.transforms import blended_transform_factory

    figure = ax.get_figure(root=True)
    assert figure is not None
    middle = blended_transform_factory(figure.transFigure, ax.transAxes)
    for count in range(columns, 0, -1):
        legend = ax.legend(
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            bbox_transform=middle,
            ncols=count,
            frameon=False,
        )
        if legend.get_window_extent().width <= figure.bbox.width:
            break
    return ax


def _page(report: PlanReport, figures: Mapping[str, Picture]) -> str:
    plan, baseline = report.plan, report.classical
    results = {each.name: getattr(report, each.name) for each in fields(report)}
    del results["figures"]
    return render(
        "report.html.j2",
        figures,
        **results,
        triggers=plan.triggers,
        summary=summary(plan, baseline, report.verdict, report.left_out),
        saved=baseline.duration - plan.trajectory.duration if baseline else 0.0,
        missing=missing_limits(plan, baseline) if baseline else (),
        differences={one.kind: describe_differences(plan, one) for one in report.others},
        allowed={limit.name: _format_bounds(limit, plan) for limit in plan.limits} | CLAIMS,
        active=dict(_active_time(plan)),
        active_share=ACTIVE_SHARE,
        each=tabulate_segments(plan),
        most_rows=MAX_SHOWN_ROWS,
        window=plan.pulses.duration / RATE_WINDOWS,
        policy=PLAYER_POLICY if report.scene else POLICY,
        top_worth=_list_top_worth(report.worth),
        band=make_band(plan) if figures else {},  # which takes matplotlib along
        segments=list_segments(plan),
        axes=list(zip(plan.pulses.axes, report.verdict.axes, plan.machine.axes, strict=True)),
    )


# Proved claims besides the limits, and the bound of each.
CLAIMS = {CROSSING: "the time of its axis", CONSTANT_SPEED: f"{SPEED_TOLERANCE:g} off the speed"}


def _format_bounds(limit: Limit, plan: Plan) -> str:
    """Format the bounds of a limit at the place of its largest use.

    A place has two ends (lo … hi). A rate that differs by direction has both values, first the one
    towards smaller positions.
    """
    worst = plan.certificate.where[limit.name]
    piece = next(k for k in range(len(plan.path.pieces)) if plan.path.segment(k) == worst.segment)
    shown: dict[str, list[float]] = {}
    for channel, (unit, scale) in enumerate(limit.units):
        if limit.channels[channel] == worst.axis:  # of a curve several lines are of one axis
            both = (limit.report_value(side, channel, piece)[1] for side in (-1.0, 1.0))
            shown.setdefault(unit, []).extend(bound * scale for bound in both if isfinite(bound))
    told = [
        (_join_bounds(bounds, isinstance(limit, AxisLimit) and not limit.geometric), unit)
        for unit, bounds in shown.items()
    ]
    return ", ".join(f"{bounds} {unit}" for bounds, unit in told if bounds)


def _join_bounds(bounds: Sequence[float], directed: bool) -> str:
    """Bounds that are one, those of two directions, or the ends of a range."""
    ends = list(dict.fromkeys(bounds)) if directed else sorted({min(bounds), max(bounds)}) if bounds else []
    return (" / " if directed else " … ").join(f"{bound:.6g}" for bound in ends)


def _active_time(plan: Plan) -> Iterator[tuple[str, float]]:
    """For how many seconds each limit that depends on timing is active, and for how many none is."""
    active, lengths = active_limits(plan), np.diff(plan.trajectory.knots)
    for n, limit in enumerate(plan.limits):
        if not limit.geometric:
            yield limit.name, float(lengths[active == n].sum())
    yield "none of them", float(lengths[active < 0].sum())


def _list_top_worth(worth: Worth | None) -> list[tuple[str, float, float]]:
    """The limits that are worth most, with the ms that one per cent more of each saves, and its share of the most."""
    from planner.tradeoffs.limit_worth import call

    rows = [] if worth is None else worth.rank()[:MOST_WORTH]
    if worth is None or not rows or worth.saved[rows[0]] <= 0:
        return []
    most = float(worth.saved[rows[0]])
    return [
        (
            call(worth.limits[k], worth.axes[k]),
            1e3 * float(worth.saved[k]),
            max(float(worth.saved[k]), 0.0) / most,
        )
        for k in rows
    ]
