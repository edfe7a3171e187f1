"""The figures of a long plan's report: extremes over windows of time."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.reports.page import NARROW, Picture, draw_figure, style
from benchmarks.reports.time_series import TIME, Panel, TimeSeries
from kinematics.foundation.arrays import Array
from kinematics.foundation.figure import literal_label
from kinematics.foundation.line_styles import DASHES, PALETTE, line_style
from planner.activity import Activity
from planner.overview import TOOL_SPEED, Overview
from planner.plan_parts import PlanStanding

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from planner.figures import Quantity

# Shown unit of an axis, and how many of it make one SI unit.
UNITS = {"linear": ("mm", 1e3), "rotary": ("°", 180 / np.pi)}

# Quantities of an axis: name in the columns of an overview, label, and unit of time.
QUANTITIES: "tuple[tuple[str, Quantity, str], ...]" = (
    ("q", "position", ""),
    ("qd", "speed", "/s"),
    ("qdd", "acceleration", "/s²"),
    ("qddd", "jerk", "/s³"),
)


def draw(plan: PlanStanding, overview: Overview, activity: Activity) -> dict[str, Picture]:
    """Draw the path, the axes and the limits over windows of time.

    The limits of an only window are in the certificate alone.
    """
    from kinematics.foundation.figure import new_axes
    from planner.figures import window_uses

    with style():
        pictures = {
            "path": draw_figure(_draw_path(overview)),
            "axes": _draw_axes(plan, overview, activity),
        }
        if plan.windows > 1:
            ax = window_uses(plan, new_axes(None, (NARROW, 3.6)))
            pictures["limits"] = draw_figure(ax)
        return pictures


def _draw_path(overview: Overview) -> "Axes":
    from kinematics.foundation.figure import new_axes_3d
    from planner.figures import draw_way

    speed = overview.column(TOOL_SPEED)[0]
    points = np.stack([overview.column(name)[0] for name in "xyz"], 1)
    axes = new_axes_3d(None, (1.15 * NARROW, 0.75 * NARROW))
    ax: Axes = draw_way(axes, 1e3 * points, 1e3 * speed)
    return ax


def _draw_axes(plan: PlanStanding, overview: Overview, activity: Activity) -> Picture:
    """Draw the range of each axis, the largest tool speed and the limits' shares in every
    window.
    """
    from matplotlib.figure import Figure

    panels = [
        *_make_axis_panels(plan, overview),
        _make_speed_panel(plan, overview),
        _make_use_panel(activity),
    ]
    figure = Figure(figsize=(9, 2.3 * len(panels) + 0.4), layout="constrained")
    axes = list(figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0])
    for ax, panel in zip(axes, panels, strict=True):
        for one in panel.series:
            _draw_series(ax, one)
        for level, color in panel.levels:
            ax.axhline(level, color=color, linestyle=(0, (6, 3)), linewidth=1)
        ax.set(xlabel=TIME, ylabel=panel.label, xlim=(0, plan.duration))
    for ax in (axes[0], axes[-1]):
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=6, frameon=False)
    return replace(draw_figure(*axes), panels=tuple(panels))


def _draw_series(ax: "Axes", series: TimeSeries) -> None:
    """Draw a band between the extremes of each window, or one value of each window as a step."""
    label = literal_label(series.name)
    if not series.thinned:
        ax.step(series.t, series.values, where="post", color=series.color, linewidth=1, label=label)
        return
    low, high = np.sort(np.reshape(series.values[1:-1], (-1, 2)), axis=1).T
    ax.fill_between(series.t[1:-1:2], low, high, color=series.color, alpha=0.5, label=label)


def _make_axis_panels(plan: PlanStanding, overview: Overview) -> Iterator[Panel]:
    from planner.figures import list_levels

    axes = plan.machine.axes
    for short, name, per in QUANTITIES[: plan.order + 1]:
        for kind in sorted({axis.kind for axis in axes}):
            unit, scale = UNITS[kind]
            series = []
            for n, axis in enumerate(axes):
                if axis.kind != kind:
                    continue
                home = plan.machine.home_q[n] if short == "q" else 0.0
                extremes = overview.column(f"{axis.name} {short}")
                first, low, high = (scale * (each - home) for each in extremes)
                t, values = _join_extremes(overview.t, first, low, high, plan.duration)
                line = line_style(n)
                dash = DASHES.index(line["linestyle"])
                series.append(TimeSeries(axis.name, t, values, line["color"], dash, thinned=True))
            levels = tuple((scale * level, color) for level, color in list_levels(axes, name, kind))
            yield Panel(f"{name} ({unit}{per})", tuple(series), levels)


def _join_extremes(
    t: Array, first: Array, low: Array, high: Array, end: float
) -> tuple[Array, Array]:
    """Return times and values (2 N + 2,) of windows that begin at t (N,), as `keep_extremes` does.

    Of the two extremes in a window, the one nearer to its first value comes first.
    """
    extremes = np.stack([low, high], 1)
    falling = np.abs(high - first) < np.abs(first - low)
    extremes[falling] = extremes[falling, ::-1]
    middle = (t + np.append(t[1:], end)) / 2
    times = np.stack([t, middle], 1).ravel()
    values = extremes.ravel()
    return (
        np.concatenate([t[:1], times, [end]]),
        np.concatenate([values[:1], values, values[-1:]]),
    )


def _make_speed_panel(plan: PlanStanding, overview: Overview) -> Panel:
    """Make the panel of the largest speed of the tool in each window."""
    edges = np.append(overview.t, plan.duration)
    largest = 1e3 * overview.column(TOOL_SPEED)[2]
    series = _make_steps("largest speed of the tool", edges, largest, PALETTE[0])
    return Panel("speed of the tool (mm/s)", (series,), ())


def _make_use_panel(activity: Activity) -> Panel:
    """Make the panel of the largest share of each limit in each window."""
    from planner.limits.styles import style_limits

    edges = np.append(activity.t, activity.end)
    styles = style_limits(activity.use)
    series = [
        _make_steps(name, edges, use, str(styles[name]["color"]))
        for name, use in activity.use.items()
    ]
    return Panel("largest share of the limit", tuple(series), ((1.0, "#000000"),))


def _make_steps(name: str, edges: Array, values: Array, color: str) -> TimeSeries:
    """Return a series that has one value from each edge to the next."""
    return TimeSeries(name, edges, np.append(values, values[-1:]), color, step=True)
