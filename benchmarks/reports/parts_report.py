"""The report of a plan that was made in parts: one HTML page, whose figures show the extremes over windows of time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.reports.page import NARROW, Picture, draw_figure, group_digits, render, save_figures, style
from benchmarks.reports.time_series import TIME, Panel, TimeSeries
from kinematics.foundation.arrays import Array
from kinematics.foundation.figure import DASHES, PALETTE, line_style, literal_label
from kinematics.foundation.table import Table
from planner.active_limits import ACTIVE_SHARE, name_segment
from planner.activity import MOST_SEGMENTS, Activity
from planner.overview import TOOL_SPEED, Overview
from planner.plan_parts import PlanStanding
from planner.pulses import PulseCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from planner.figures import Quantity

SHARES = {"linear": ("mm", 1e3), "rotary": ("°", 180 / np.pi)}


@dataclass(frozen=True, slots=True)
class PartsReport:
    """The content of the report of a plan in parts.

    standing  the plan at its end
    overview  extremes of the motion over windows of time
    activity  active limits over windows of time
    verdict   on the pulses; None: no file of pulses was requested
    note      reason why the motion ends before the program
    drives    tables of the times on STEP and DIR
    triggers  tables of the first triggers
    """

    standing: PlanStanding
    overview: Overview
    activity: Activity
    verdict: PulseCheck | None = None
    note: str = ""
    drives: Sequence[Table] = ()
    triggers: Sequence[Table] = ()


def write_report(report: PartsReport, path: Path, *, figures: bool) -> None:
    """Write the page and, with figures, `figures/*.png` in its folder."""
    standing, overview, activity = report.standing, report.overview, report.activity
    drawn = draw(standing, overview, activity) if figures else {}
    pulses = standing.pulses.axes
    page = render(
        "parts.html.j2",
        drawn,
        standing=standing,
        seen=overview,
        verdict=report.verdict,
        note=report.note,
        drives=report.drives,
        triggers=report.triggers,
        summary=summary(standing),
        held=activity,
        band=make_parts_band(activity),
        segments=list_segments(overview, activity),
        active_share=ACTIVE_SHARE,
        most_segments=MOST_SEGMENTS,
        axes=list(zip(pulses, standing.counted, standing.machine.axes, strict=True)),
    )
    path.write_text(page, encoding="utf-8")
    save_figures(drawn, path)


def summary(standing: PlanStanding) -> dict[str, str]:
    """The table that the page begins with."""
    kept = "speed and acceleration" if standing.order == 2 else "speed, acceleration and jerk"
    found, windows = standing.fit, "window" if standing.windows == 1 else "windows"
    told = {
        "Duration": f"{standing.duration:.6f} s",
        "Segments": group_digits(standing.segment),
        "Length of the path": f"{1e3 * standing.start.length:.3f} mm",
        "Order": f"{standing.order} ({kept})",
        "Planned in": f"{group_digits(standing.windows)} {windows}; certified in round {standing.rounds} at most",
    }
    if standing.avoidable is not None and standing.avoidable.count:
        told["Stops"] = standing.avoidable.describe()
    if found is not None:
        told["Fit"] = found.describe()
    pulses = sum(number for number, _ in standing.counted)
    told["Pulses"] = f"{group_digits(pulses)} on a clock of {group_digits(standing.pulses.clock_hz)} Hz"
    return told


def draw(standing: PlanStanding, seen: Overview, held: Activity) -> dict[str, Picture]:
    """Every figure of the page as a PNG, by name; of one window alone the certificate says it all."""
    from kinematics.foundation.figure import new_axes
    from planner.figures import window_uses

    with style():
        drawn = {"path": draw_figure(_draw_path(seen)), "axes": _draw_axes(standing, seen, held)}
        if standing.windows == 1:
            return drawn
        return drawn | {"limits": draw_figure(window_uses(standing, new_axes(None, (NARROW, 3.6))))}


def _draw_path(seen: Overview) -> "Axes":
    from kinematics.foundation.figure import new_axes_3d
    from planner.figures import draw_way

    speed = seen.column(TOOL_SPEED)[0]
    points = np.stack([seen.column(name)[0] for name in "xyz"], 1)
    drawn: Axes = draw_way(new_axes_3d(None, (1.15 * NARROW, 0.75 * NARROW)), 1e3 * points, 1e3 * speed)
    return drawn


QUANTITIES: "tuple[tuple[str, Quantity, str], ...]" = (
    ("q", "position", ""),
    ("qd", "speed", "/s"),
    ("qdd", "acceleration", "/s²"),
    ("qddd", "jerk", "/s³"),
)
"""Quantities of an axis: name in the columns of an overview, label, and unit of time."""


def _draw_axes(standing: PlanStanding, seen: Overview, held: Activity) -> Picture:
    """Draw the range of each axis, the largest speed of the tool and the shares of the limits in every window."""
    from matplotlib.figure import Figure

    panels = [*_axis_panels(standing, seen), _make_speed_panel(standing, seen), _make_use_panel(held)]
    figure = Figure(figsize=(9, 2.3 * len(panels) + 0.4), layout="constrained")
    drawn = list(figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0])
    for ax, panel in zip(drawn, panels, strict=True):
        for one in panel.series:
            label = literal_label(one.name)
            if one.thinned:
                low, high = np.sort(np.reshape(one.values[1:-1], (-1, 2)), axis=1).T
                ax.fill_between(one.t[1:-1:2], low, high, color=one.color, alpha=0.5, label=label)
            else:
                ax.step(one.t, one.values, where="post", color=one.color, linewidth=1, label=label)
        for level, color in panel.levels:
            ax.axhline(level, color=color, linestyle=(0, (6, 3)), linewidth=1)
        ax.set(xlabel=TIME, ylabel=panel.label, xlim=(0, standing.duration))
    for ax in (drawn[0], drawn[-1]):
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=6, frameon=False)
    return replace(draw_figure(*drawn), panels=tuple(panels))


def _axis_panels(standing: PlanStanding, seen: Overview) -> Iterator[Panel]:
    from planner.figures import list_levels

    axes = standing.machine.axes
    for short, name, per in QUANTITIES[: standing.order + 1]:
        for kind in sorted({axis.kind for axis in axes}):
            unit, scale = SHARES[kind]
            own = [(n, axis) for n, axis in enumerate(axes) if axis.kind == kind]
            series = []
            for n, axis in own:
                home = standing.machine.home_q[n] if short == "q" else 0.0
                first, low, high = (scale * (each - home) for each in seen.column(f"{axis.name} {short}"))
                t, values = _lay_extremes(seen.t, first, low, high, standing.duration)
                drawn = line_style(n)
                dash = DASHES.index(drawn["linestyle"])
                series.append(TimeSeries(axis.name, t, values, drawn["color"], dash, thinned=True))
            held = tuple((scale * level, color) for level, color in list_levels(axes, name, kind))
            yield Panel(f"{name} ({unit}{per})", tuple(series), held)


def _lay_extremes(t: Array, first: Array, low: Array, high: Array, end: float) -> tuple[Array, Array]:
    """Windows that begin at t (N,) as `keep_extremes` gives its own: (2 N + 2,) each; the nearer to the first first."""
    both = np.stack([low, high], 1)
    falls = np.abs(high - first) < np.abs(first - low)
    both[falls] = both[falls, ::-1]
    middle = (t + np.append(t[1:], end)) / 2
    values = both.ravel()
    return (
        np.concatenate([t[:1], np.stack([t, middle], 1).ravel(), [end]]),
        np.concatenate([values[:1], values, values[-1:]]),
    )


def _make_speed_panel(standing: PlanStanding, seen: Overview) -> Panel:
    """Make the panel of the largest speed of the tool in each window."""
    edges = np.append(seen.t, standing.duration)
    largest = 1e3 * seen.column(TOOL_SPEED)[2]
    return Panel("speed of the tool (mm/s)", (_hold("largest speed of the tool", edges, largest, PALETTE[0]),), ())


def _make_use_panel(held: Activity) -> Panel:
    from planner.figures import style_limits

    edges, styles = np.append(held.t, held.end), style_limits(held.use)
    series = (_hold(name, edges, use, str(styles[name]["color"])) for name, use in held.use.items())
    return Panel("largest share of the limit", tuple(series), ((1.0, "#000000"),))


def _hold(name: str, edges: Array, values: Array, color: str) -> TimeSeries:
    return TimeSeries(name, edges, np.append(values, values[-1:]), color, step=True)


def list_segments(seen: Overview, held: Activity) -> list[tuple[float, str]]:
    """When each segment of the program begins, to a window, and its name; those within one window are passed over."""
    begins = np.flatnonzero(np.diff(seen.segments, prepend=0))
    numbers = [int(seen.segments[k]) for k in begins]
    known = held.find_segments(number - 1 for number in numbers)
    return [(float(seen.t[k]), name_segment(n, known[n - 1])) for k, n in zip(begins, numbers, strict=True)]


def make_parts_band(held: Activity) -> dict[str, Any]:
    """Which limit is active, as `timeline.make_band` tells it of a plan, in each of the windows of time."""
    from planner.figures import style_limits

    active, names, styles = held.active, [*held.names], style_limits(held.names)
    owners = sorted({int(owner) for owner in active if owner >= 0})
    begins = np.flatnonzero(np.diff(active, prepend=-2))
    return {
        "limits": [{"name": names[n], "color": styles[names[n]]["color"]} for n in owners],
        "runs": [(float(held.t[k]), owners.index(int(active[k])) if active[k] >= 0 else -1) for k in begins],
    }
