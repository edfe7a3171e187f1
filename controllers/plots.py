"""Figures of tracking errors: each function draws on `ax`, or on a figure of its own, and returns the axes."""

from typing import Any

from matplotlib.axes import Axes

from controllers.metrics import ErrorSeries, Metrics
from planner.plots import PALETTE, new_axes

_UNIT = {"m": ("µm", 1e6), "rad": ("mrad", 1e3)}


def contour_error(metrics: Metrics, ax: Axes | None = None, **style: Any) -> Axes:
    """How far the motion runs beside the path, over time; `style` goes to the line, so that laws can share the axes."""
    return _over_time(metrics, metrics.contour, ax, **{"label": metrics.law, **style})


def tracking_error(metrics: Metrics, ax: Axes | None = None, **style: Any) -> Axes:
    """How far the motion is from where the plan has it at that time; `style` as in `contour_error`."""
    return _over_time(metrics, metrics.tracking, ax, **{"label": metrics.law, **style})


def following_error(metrics: Metrics, ax: Axes | None = None) -> Axes:
    """Actual − planned over time, of every axis that shares the first one's unit."""
    ax = new_axes(ax)
    same = [series for series in metrics.following if series.unit == metrics.following[0].unit]
    for n, series in enumerate(same):
        _over_time(metrics, series, ax, label=series.name, color=PALETTE[n % len(PALETTE)])
    ax.set_ylabel(f"following error ({_UNIT[same[0].unit][0]})")
    return ax


def _over_time(metrics: Metrics, series: ErrorSeries, ax: Axes | None, **style: Any) -> Axes:
    ax = new_axes(ax)
    unit, scale = _UNIT[series.unit]
    ax.plot(metrics.t, scale * series.value, **{"linewidth": 1.2, **style})
    ax.set(xlabel="time (s)", ylabel=f"{series.name} error ({unit})", xlim=(metrics.t[0], metrics.t[-1]))
    return ax
