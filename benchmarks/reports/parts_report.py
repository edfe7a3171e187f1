"""The report of a plan that was made in parts: one HTML page, whose figures show the extremes over windows of time."""

from collections.abc import Iterator
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.reports.page import NARROW, Drawing, draw_figure, group_digits, render, save_figures, style
from benchmarks.reports.time_series import TIME, Panel, Series
from kinematics.foundation.arrays import Array
from kinematics.foundation.figure import PALETTE, literal_label
from kinematics.machine.axis import directional_bounds
from planner.overview import Overview
from planner.plan_parts import PlanStanding
from planner.pulses import PulseCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHARES = {"linear": ("mm", 1e3), "rotary": ("°", 180 / np.pi)}


def write_report(
    standing: PlanStanding, seen: Overview, verdict: PulseCheck | None, path: Path, *, figures: bool, note: str = ""
) -> None:
    """Write the page and, with figures, `figures/*.png` beside it.

    verdict: of the check of its pulses; None: they were not asked for. note: why it ends where it does
    """
    drawn = draw(standing, seen) if figures else {}
    path.write_text(
        render(
            "parts.html.j2",
            drawn,
            standing=standing,
            seen=seen,
            verdict=verdict,
            note=note,
            summary=summary(standing),
            band=make_band(standing, seen),
            segments=list_segments(seen),
            used_share=USED_SHARE,
            axes=list(zip(standing.pulses.axes, standing.counted, standing.machine.axes, strict=True)),
        ),
        encoding="utf-8",
    )
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
    if found is not None:
        told["Fit"] = found.describe()
    pulses = sum(number for number, _ in standing.counted)
    told["Pulses"] = f"{group_digits(pulses)} on a clock of {group_digits(standing.pulses.clock_hz)} Hz"
    return told


def draw(standing: PlanStanding, seen: Overview) -> dict[str, Drawing]:
    """Every figure of the page as a PNG, by name."""
    from kinematics.foundation.figure import new_axes
    from planner.figures import window_uses

    with style():
        return {
            "path": draw_figure(_draw_path(seen)),
            "axes": _draw_axes(standing, seen),
            "limits": draw_figure(window_uses(standing, new_axes(None, (NARROW, 3.6)))),
        }


def _draw_path(seen: Overview) -> "Axes":
    from kinematics.foundation.figure import new_axes_3d
    from planner.figures import draw_way

    way, t = seen.column("s")[0], seen.t
    speed = np.gradient(way, t) if len(t) > 1 else np.zeros(len(t))
    points = np.stack([seen.column(name)[0] for name in "xyz"], 1)
    drawn: Axes = draw_way(new_axes_3d(None, (1.15 * NARROW, 0.75 * NARROW)), 1e3 * points, 1e3 * speed)
    return drawn


USED_SHARE = 0.95
"""Of a limit of an axis at the instants looked at, from which a window has its colour: between them it may be more."""
QUANTITIES = (("q", "position", ""), ("qd", "speed", "/s"), ("qdd", "acceleration", "/s²"), ("qddd", "jerk", "/s³"))
"""Of an axis: in the columns of an overview, in words, and by which time its unit is divided."""


def _draw_axes(standing: PlanStanding, seen: Overview) -> Drawing:
    """Each axis between its least and its largest in every window of time; path speed; the shares of axis limits."""
    from matplotlib.figure import Figure

    panels = [*_axis_panels(standing, seen), _make_speed_panel(standing, seen), _make_use_panel(standing, seen)]
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
    axes = standing.machine.axes
    for short, name, per in QUANTITIES[: standing.order + 1]:
        for kind in sorted({axis.kind for axis in axes}):
            unit, scale = SHARES[kind]
            own = [(n, axis) for n, axis in enumerate(axes) if axis.kind == kind]
            series = []
            for place, (n, axis) in enumerate(own):
                home = standing.machine.home_q[n] if short == "q" else 0.0
                first, low, high = (scale * (each - home) for each in seen.column(f"{axis.name} {short}"))
                t, values = _lay_extremes(seen.t, first, low, high, standing.duration)
                series.append(Series(axis.name, t, values, PALETTE[place % len(PALETTE)], thinned=True))
            both = [directional_bounds(getattr(axis, f"max_{name}", None)) for _, axis in own]
            levels = {scale * sign * side for pair in both for sign, side in zip((-1, 1), pair, strict=True)}
            held = tuple((level, "#000000") for level in sorted(levels) if isfinite(level))
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
    edges, way = np.append(seen.t, standing.duration), np.append(seen.column("s")[0], standing.start.length)
    speed = 1e3 * np.diff(way) / np.maximum(np.diff(edges), 1e-9)
    return Panel("path speed (mm/s)", (_hold("path speed", edges, speed, PALETTE[0]),), ())


def _make_use_panel(standing: PlanStanding, seen: Overview) -> Panel:
    edges = np.append(seen.t, standing.duration)
    uses = measure_uses(standing, seen).items()
    series = (_hold(name, edges, use, PALETTE[n % len(PALETTE)]) for n, (name, use) in enumerate(uses))
    return Panel("largest share of an axis limit", tuple(series), ((1.0, "#000000"),))


def _hold(name: str, edges: Array, values: Array, color: str) -> Series:
    return Series(name, edges, np.append(values, values[-1:]), color, step=True)


def measure_uses(standing: PlanStanding, seen: Overview) -> dict[str, Array]:
    """Of each limit of the axes: the largest share (windows,) that any axis uses at the instants looked at."""
    found = {}
    for short, name, _ in QUANTITIES[1 : standing.order + 1]:
        shares = []
        for axis in standing.machine.axes:
            below, above = directional_bounds(getattr(axis, f"max_{name}"))
            _, low, high = seen.column(f"{axis.name} {short}")
            shares.append(np.maximum(-low / below, high / above))
        found[name] = np.max(shares, axis=0)
    return found


def list_segments(seen: Overview) -> list[tuple[float, str]]:
    """When each segment of the program begins, to a window, and its number; those within one window are passed over."""
    begins = np.flatnonzero(np.diff(seen.segments, prepend=0))
    return [(float(seen.t[k]), f"segment {seen.segments[k]}") for k in begins]


def make_band(standing: PlanStanding, seen: Overview) -> dict[str, Any]:
    """Which limit of the axes is used most, as `timeline.make_band` tells which is active; and its words."""
    uses = measure_uses(standing, seen)
    share = np.array([*uses.values()])
    most = np.where(share.max(0) >= USED_SHARE, share.argmax(0), -1)
    begins = np.flatnonzero(np.diff(most, prepend=-2))
    return {
        "limits": [{"name": name, "color": PALETTE[n % len(PALETTE)]} for n, name in enumerate(uses)],
        "runs": [(float(seen.t[k]), int(most[k])) for k in begins],
        "words": ["most used limit of the axes: ", f"no axis at {100 * USED_SHARE:.0f} %: another limit, or none"],
    }
