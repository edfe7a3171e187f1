"""Figures of tracking errors: each function draws on `ax`, or on a figure of its own, and returns
the axes.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from controllers.metrics import ErrorSeries, Metrics
from controllers.metrics.circular_test import CircularTest
from controllers.metrics.iso_style import PathAccuracy, PoseAccuracy
from controllers.tracking import Tracking
from kinematics.foundation.arrays import Array
from kinematics.foundation.figure import draw_bars, literal_label, new_axes
from kinematics.foundation.line_styles import PALETTE, line_style
from kinematics.foundation.result import draws

_UNIT = {"m": ("µm", 1e6), "rad": ("mrad", 1e3)}


def contour_error(metrics: Metrics, ax: Axes | None = None, **style: Any) -> Axes:
    """How far the motion runs beside the path, over time; `style` goes to the line, so that laws
    can share the axes.
    """
    return _draw_over_time(metrics, metrics.contour, ax, **{"label": metrics.law, **style})


def tracking_error(metrics: Metrics, ax: Axes | None = None, **style: Any) -> Axes:
    """How far the motion is from where the plan has it at that time; `style` as in
    `contour_error`.
    """
    return _draw_over_time(metrics, metrics.tracking, ax, **{"label": metrics.law, **style})


def following_error(metrics: Metrics, ax: Axes | None = None) -> Axes:
    """Actual − planned over time, of every axis that shares the first one's unit."""
    ax = new_axes(ax)
    same = [series for series in metrics.following if series.unit == metrics.following[0].unit]
    for n, series in enumerate(same):
        _draw_over_time(
            metrics, series, ax, label=literal_label(series.name), color=PALETTE[n % len(PALETTE)]
        )
    ax.set_ylabel(f"following error ({_UNIT[same[0].unit][0]})")
    return ax


@draws(Tracking)
def draw_tracking(tracking: Tracking, ax: Axes | None = None) -> Axes:
    """Actual − planned over time, of every axis that shares the first one's unit."""
    ax = new_axes(ax)
    own = tracking.axes[0][1]
    unit, scale = _UNIT[own]
    for k, (name, other) in enumerate(tracking.axes):
        if other == own:
            error = tracking.actual[:, k] - tracking.reference[:, k]
            ax.plot(tracking.t, scale * error, label=literal_label(name), **line_style(k))
    ax.set(
        xlabel="time (s)", ylabel=f"following error ({unit})", xlim=(tracking.t[0], tracking.t[-1])
    )
    ax.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    return ax


@draws(PathAccuracy)
def path_accuracy(accuracy: PathAccuracy, ax: Axes | None = None) -> Axes:
    """Offset of the mean path, and repeatability, at every station."""
    ax = new_axes(ax)
    station = np.arange(1, len(accuracy.offset) + 1)
    for values, label in ((accuracy.offset, "accuracy"), (accuracy.band, "repeatability")):
        ax.plot(station, 1e6 * values, marker=".", linewidth=1.2, label=label)
    ax.set(xlabel="station", ylabel="ISO-style path accuracy (µm)", ylim=(0, None))
    ax.legend(frameon=False)
    return ax


@draws(PoseAccuracy)
def pose_accuracy(accuracy: PoseAccuracy, ax: Axes | None = None) -> Axes:
    """Accuracy and repeatability."""
    figures = [1e6 * accuracy.accuracy, 1e6 * accuracy.repeatability]
    return draw_bars(["accuracy", "repeatability"], figures, "ISO-style pose accuracy (µm)", ax)


@draws(CircularTest)
def circular_test(test: CircularTest, ax: Axes | None = None) -> Axes:
    """Both turns about the programmed circle; their deviations are magnified by what the title
    says.
    """
    ax = new_axes(ax)
    turns = {"counter-clockwise": test.ccw, "clockwise": test.cw}
    largest = max(float(np.abs(turn.deviation).max()) for turn in turns.values())
    # a quarter of the radius, in steps of 1, 2, 5
    wanted = test.circle.radius / 4 / largest if largest > 0 else 1.0
    tens = 10.0 ** np.floor(np.log10(wanted))
    magnified = tens * max(step for step in (1.0, 2.0, 5.0) if step * tens <= wanted)
    round_ = np.linspace(0, 2 * np.pi, 721)
    ax.plot(
        *1e3 * _polar(round_, test.circle.radius),
        color="black",
        linewidth=0.8,
        linestyle=":",
        label="programmed",
    )
    for colour, (label, turn) in zip(PALETTE, turns.items(), strict=False):
        radius = test.circle.radius + magnified * turn.deviation
        ax.plot(*1e3 * _polar(turn.angle, radius), color=colour, linewidth=1.2, label=label)
    ax.set(xlabel="mm", ylabel="mm", title=f"ISO-style circular test, deviations × {magnified:.0f}")
    ax.set_aspect("equal")
    ax.legend(frameon=False, loc="center")
    return ax


@draws(Metrics)
def draw_metrics(metrics: Metrics, ax: Axes | None = None) -> Axes:
    """The contour error over time, with the name of its law."""
    ax = contour_error(metrics, ax)
    ax.legend(frameon=False)
    return ax


def _polar(angle: Array, radius: Array | float) -> Array:
    return np.asarray(radius * np.array([np.cos(angle), np.sin(angle)]))


def _draw_over_time(metrics: Metrics, series: ErrorSeries, ax: Axes | None, **style: Any) -> Axes:
    ax = new_axes(ax)
    unit, scale = _UNIT[series.unit]
    ax.plot(metrics.t, scale * series.value, **{"linewidth": 1.2, **style})
    ax.set(
        xlabel="time (s)",
        ylabel=f"{series.name} error ({unit})",
        xlim=(metrics.t[0], metrics.t[-1]),
    )
    return ax
