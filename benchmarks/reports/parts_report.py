"""The report of a plan that was made in parts: one HTML page, whose figures show the extremes over windows of time."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.reports.page import Drawing, draw_figure, group_digits, render, save_figures, style
from planner.overview import Overview
from planner.plan_parts import PlanStanding
from planner.pulses import PulseCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHARES = {"linear": ("mm", 1e3), "rotary": ("°", 180 / np.pi)}
RATES = {"": "position", " qd": "speed"}


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
            axes=list(zip(standing.pulses.axes, standing.counted, standing.machine.axes, strict=True)),
        ),
        encoding="utf-8",
    )
    save_figures(drawn, path)


def summary(standing: PlanStanding) -> dict[str, str]:
    """The table that the page begins with."""
    kept = "speed and acceleration" if standing.order == 2 else "speed, acceleration and jerk"
    found = standing.fit
    told = {
        "Duration": f"{standing.duration:.6f} s",
        "Segments": group_digits(standing.segment),
        "Length of the path": f"{1e3 * standing.start.length:.3f} mm",
        "Order": f"{standing.order} ({kept})",
        "Planned in": f"{group_digits(standing.windows)} windows; certified in round {standing.rounds} at most",
    }
    if found is not None:
        near = (
            f"within {1e6 * found.deviation:.4g} um of the program (proved; tolerance {1e6 * found.tolerance:.4g} um)"
        )
        corners = f"{found.rounded} corners rounded, {found.stopped} with a stop"
        told["Fit"] = f"{found.before} pieces became {found.after} in {found.curves} curves, {near}; {corners}"
    pulses = sum(number for number, _ in standing.counted)
    told["Pulses"] = f"{group_digits(pulses)} on a clock of {group_digits(standing.pulses.clock_hz)} Hz"
    return told


def draw(standing: PlanStanding, seen: Overview) -> dict[str, Drawing]:
    """Every figure of the page as a PNG, by name."""
    from planner.figures import window_uses

    with style():
        return {
            "path": draw_figure(_draw_path(seen)),
            "axes": draw_figure(*_draw_axes(standing, seen)),
            "limits": draw_figure(window_uses(standing)),
        }


def _draw_path(seen: Overview) -> "Axes":
    from kinematics.foundation.figure import new_axes_3d
    from planner.figures import draw_way

    way, t = seen.column("s")[0], seen.t
    speed = np.gradient(way, t) if len(t) > 1 else np.zeros(len(t))
    points = np.stack([seen.column(name)[0] for name in "xyz"], 1)
    drawn: Axes = draw_way(new_axes_3d(None), 1e3 * points, 1e3 * speed)
    return drawn


def _draw_axes(standing: PlanStanding, seen: Overview) -> "list[Axes]":
    """Each axis between its least and its largest in every window of time."""
    from matplotlib.figure import Figure

    from kinematics.foundation.figure import PALETTE, literal_label

    axes = standing.machine.axes
    quantities = (("q", "position", ""), ("qd", "speed", "/s"), ("qdd", "acceleration", "/s²"), ("qddd", "jerk", "/s³"))
    kinds = sorted({axis.kind for axis in axes})
    panels = [(kind, *each) for each in quantities[: standing.order + 1] for kind in kinds]
    figure = Figure(figsize=(9, 2.3 * len(panels) + 0.4), layout="constrained")
    drawn = list(figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0])
    for ax, (kind, short, name, per) in zip(drawn, panels, strict=True):
        unit, scale = SHARES[kind]
        own = [(n, axis) for n, axis in enumerate(axes) if axis.kind == kind]
        for place, (n, axis) in enumerate(own):
            _, low, high = seen.column(f"{axis.name} {short}")
            home = standing.machine.home_q[n] if short == "q" else 0.0
            color = PALETTE[place % len(PALETTE)]
            label = literal_label(axis.name)
            ax.fill_between(seen.t, scale * (low - home), scale * (high - home), color=color, alpha=0.5, label=label)
        for most in {float(most) for _, axis in own if (most := getattr(axis, f"max_{name}", None)) is not None}:
            for bound in (-most, most):
                ax.axhline(scale * bound, color="black", linestyle=(0, (6, 3)), linewidth=1)
        ax.set(xlabel="time (s)", ylabel=f"{name} ({unit}{per})", xlim=(0, standing.duration))
    drawn[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=6, frameon=False)
    return drawn
