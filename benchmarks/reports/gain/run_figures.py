"""Figures of runs in a gain report, such as reference and feedback of each axis over time.

Those are as [Sahbaz 2007, Figures 7.10 to 7.18] show them. Lines differ by dash and marks by shape,
so that grey paper tells them apart too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import floor, inf, log10
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.reports.gain.comparison import RANK, Comparison, SettingEntry
from benchmarks.reports.gain.courses import IsoBlock, SettingSeries, path_offsets
from benchmarks.reports.gain.criteria import HUMAN
from benchmarks.reports.gain.setting_figures import (
    WIDTH,
    add_shared_legend,
    error_over_effort,
    gains,
    line_style,
    make_panels,
    pareto,
)
from benchmarks.reports.page import Picture, draw_figure, style
from benchmarks.sweep import RunSeries
from kinematics.foundation.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AXIS_POINTS = 1500
"""Instants that a line is drawn with."""
UNITS = {"m": ("mm", 1e3, "µm", 1e6), "rad": ("°", 180 / np.pi, "mrad", 1e3)}
"""SI unit of an axis -> what positions are shown in, and errors."""


def axes_over_time(comparison: Comparison, shown: SettingSeries, task: str) -> list[Axes]:
    """A row for each axis: where it should be and what its encoder reads, of the baseline and the
    best; the difference.

    Empty where the runs were saved without them.
    """
    from matplotlib.figure import Figure

    runs = [
        (entry, series) for entry, series in shown.select_task(task)[:2] if series.reference.size
    ]
    if not runs:
        return []
    record = next(of.record for of in comparison.sources if task in of.record["tasks"])
    names = [*record["axes"].items()]
    figure = Figure(figsize=(WIDTH, 1.9 * len(names) + 0.9), layout="constrained")
    panels = figure.subplots(len(names), 2, squeeze=False, sharex="col")
    series = runs[0][1]
    every = slice(None, None, max(1, len(series.t) // AXIS_POINTS))
    for k, (name, unit) in enumerate(names):
        place, off = panels[k]
        position, scale, error, fine = UNITS[unit]
        place.plot(
            series.t[every],
            scale * series.reference[every, k],
            color="black",
            linewidth=2.2,
            label="reference",
        )
        for entry, one in runs:
            drawn = {**line_style(shown.entries.index(entry)), "linewidth": 1.2}
            label = comparison.label(entry)
            place.plot(
                one.t[every], scale * one.feedback[every, k], label=f"feedback, {label}", **drawn
            )
            off.plot(one.t[every], fine * (one.feedback - one.reference)[every, k], **drawn)
        place.set_ylabel(f"{name} ({position})")
        off.set_ylabel(f"{name} ({error})")
    for ax in panels[-1]:
        ax.set(xlabel="time (s)", xlim=(0, series.t[-1]))
    titled = {"loc": "left", "fontsize": "medium", "fontweight": "bold"}
    panels[0, 0].set_title(f"{task}: reference and feedback", **titled)
    panels[0, 1].set_title("feedback − reference", **titled)
    return add_shared_legend([*panels.ravel()], 2)


MOST_BEST = 5
"""Settings that the page begins with."""
MAX_POINTS = 1500
"""Instants that a line is drawn with: more than a page's pixels show nothing more."""


def list_best(comparison: Comparison) -> list[SettingEntry]:
    """The settings that the page begins with, of those that come out alike one."""
    return [alike[0] for alike in comparison.rank_alike()[:MOST_BEST]]


def draw(comparison: Comparison, shown: SettingSeries, iso: IsoBlock) -> dict[str, Picture]:
    """Every figure of the page as a PNG, by name; those that have nothing to show are missing."""
    with style():
        made: dict[str, list[Axes]] = {
            "tradeoff": error_over_effort(comparison, list_best(comparison)),
            "time": _draw_panels(comparison, shown, 2.1, _draw_over_time),
            "along": _draw_panels(comparison, shown, 2.1, _draw_along_path),
            "path": _draw_magnified(comparison, shown),
            "circle": _draw_circles(comparison, iso),
            "gain": gains(comparison),
            "spectrum": _draw_panels(comparison, shown, 2.3, _draw_spectrum),
            "effort": _draw_panels(comparison, shown, 2.1, _draw_effort),
            "pareto": pareto(comparison),
        }
        made |= {
            f"axes-{n}": axes_over_time(comparison, shown, task)
            for n, task in enumerate(comparison.tasks)
        }
        return {name: draw_figure(*axes, small=True) for name, axes in made.items() if axes}


def _draw_panels(
    comparison: Comparison,
    shown: SettingSeries,
    height: float,
    panel: Callable[[Axes, Comparison, SettingSeries, str], None],
) -> list[Axes]:
    """A panel for each path."""
    tasks = [task for task in comparison.tasks if shown.select_task(task)]
    if not tasks:
        return []
    axes = make_panels(len(tasks), 1 if len(tasks) <= 2 else 2, height)
    for ax, task in zip(axes, tasks, strict=True):
        panel(ax, comparison, shown, task)
        ax.set_title(task, loc="left", fontsize="medium", fontweight="bold")
    return add_shared_legend(axes, 2)


def _corners(comparison: Comparison, task: str) -> list[dict[str, float]]:
    return list(comparison.about(task)["corners"])


CORNER_ROOM, LINE_ROOM = 0.07, 0.004
"""Shares of the width between two labels of corners, and between two lines: nearer ones would
overprint.
"""


def _mark_corners(ax: Axes, places: Sequence[float], end: float) -> None:
    """Mark corners at places along an axis that ends at `end`; those with room carry their
    number.
    """
    free = free_line = -inf
    for n, place in enumerate(places):
        if place < free_line:
            continue
        free_line = place + LINE_ROOM * end
        ax.axvline(place, color="#808080", linewidth=0.9, linestyle=(0, (4, 3)), zorder=0)
        if place < free:
            continue
        free = place + CORNER_ROOM * end
        ax.annotate(
            f"corner {n + 1}",
            (place, 1),
            xycoords=("data", "axes fraction"),
            xytext=(3, -2),
            textcoords="offset points",
            va="top",
            fontsize="small",
            color="#505050",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.5},
        )


def _draw_over_time(ax: Axes, comparison: Comparison, shown: SettingSeries, task: str) -> None:
    unit, scale = HUMAN[comparison.unit(RANK, task)]
    for entry, series in shown.select_task(task):
        every = slice(None, None, max(1, len(series.t) // MAX_POINTS))
        n = shown.entries.index(entry)
        ax.plot(
            series.t[every],
            scale * series.contour[every],
            label=comparison.label(entry),
            **line_style(n),
        )
    end = float(shown.select_task(task)[0][1].t[-1])
    _mark_corners(ax, [corner["t_s"] for corner in _corners(comparison, task)], end)
    ax.set(xlabel="time (s)", ylabel=f"contour error ({unit})", xlim=(0, end))
    ax.set_ylim(bottom=0)


def _draw_along_path(ax: Axes, comparison: Comparison, shown: SettingSeries, task: str) -> None:
    unit, scale = HUMAN[comparison.unit(RANK, task)]
    series = shown.select_task(task)[0][1]
    length = 1e3 if _is_in_space(comparison, task) else 1.0
    for entry, one in shown.select_task(task):
        every = slice(None, None, max(1, len(one.t) // MAX_POINTS))
        n = shown.entries.index(entry)
        ax.plot(
            length * one.s[every],
            scale * one.contour[every],
            label=comparison.label(entry),
            **line_style(n),
        )
    places = [length * corner["s_m"] for corner in _corners(comparison, task)]
    _mark_corners(ax, places, length * float(series.s[-1]))
    name = (
        "planned place along the path (mm)" if length == 1e3 else "planned place on the curve (s)"
    )
    ax.set(
        xlabel=name,
        ylabel=f"contour error ({unit})",
        xlim=(length * series.s[0], length * series.s[-1]),
    )
    ax.set_ylim(bottom=0)


def _is_in_space(comparison: Comparison, task: str) -> bool:
    return bool(comparison.about(task)["space"])


def magnification(deviation: float, extent: float) -> float:
    """1, 2 or 5 times a power of ten, by which a deviation becomes an eighth of the extent or a
    little less.
    """
    if not deviation > 0 or not extent > 0:
        return 1.0
    wanted = extent / 8 / deviation
    tens = 10.0 ** floor(log10(wanted))
    return tens * max(step for step in (1.0, 2.0, 5.0) if step * tens <= wanted * (1 + 1e-9))


def _draw_magnified(comparison: Comparison, shown: SettingSeries) -> list[Axes]:
    """The path seen along the direction in which it is thinnest, the deviation from it
    magnified.
    """
    tasks = [
        task
        for task in comparison.tasks
        if shown.select_task(task) and _is_in_space(comparison, task)
    ]
    if not tasks:
        return []
    axes = make_panels(len(tasks), 3, 3.9)
    for ax, task in zip(axes, tasks, strict=True):
        on = shown.select_task(task)
        planned = on[0][1].planned
        plane = _plane(planned)
        off = {entry: path_offsets(series) for entry, series in on}
        # the baseline and the best decide: a third that errs more may leave the picture
        largest = max(
            float(np.linalg.norm(off[entry] @ plane.T, axis=1).max()) for entry, _ in on[:2]
        )
        times = magnification(largest, float(np.ptp(planned, axis=0).max()))
        middle = (planned.min(0) + planned.max(0)) / 2
        ax.plot(
            *_project_points(planned - middle, plane),
            color="black",
            linewidth=0.9,
            label="planned path",
        )
        for entry, series in on:
            n = shown.entries.index(entry)
            ax.plot(
                *_project_points(series.actual - middle + (times - 1) * off[entry], plane),
                label=comparison.label(entry),
                **line_style(n),
            )
        ax.set(xlabel="mm", ylabel="mm")
        ax.set_title(
            f"{task}: deviations × {times:g}", loc="left", fontsize="medium", fontweight="bold"
        )
        ax.set_aspect("equal")
    return add_shared_legend(axes, 2)


def _plane(points: Array) -> Array:
    """Two unit vectors (2, 3) along which the points spread most; across a straight line, one that
    is level.
    """
    _, size, axes = np.linalg.svd(points - points.mean(0), full_matrices=False)
    if size[1] > 1e-4 * size[0]:
        return np.asarray(axes[:2])
    across = np.cross([0.0, 0.0, 1.0], axes[0])
    across = across if np.linalg.norm(across) > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.array([axes[0], across / np.linalg.norm(across)])


def _project_points(points: Array, plane: Array) -> Array:
    return np.asarray(1e3 * (points @ plane.T).T)


def _draw_circles(comparison: Comparison, iso: IsoBlock) -> list[Axes]:
    """Each setting's circular test: both directions about the programmed circle, on one
    magnification.
    """
    tests = [(turns, turns.test) for turns in iso.circles if turns.test is not None][:4]
    if not tests:
        return []
    largest = max(
        float(np.abs(turn.deviation).max()) for _, test in tests for turn in (test.ccw, test.cw)
    )
    axes = make_panels(len(tests), 2, 4.6)
    for ax, (turns, test) in zip(axes, tests, strict=True):
        radius = test.circle.radius
        times = magnification(largest, 2 * radius)
        angle = np.linspace(0, 2 * np.pi, 361)
        ax.plot(
            *_polar_points(angle, radius), color="black", linewidth=0.9, label="programmed circle"
        )
        for n, (name, turn) in enumerate((("counter-clockwise", test.ccw), ("clockwise", test.cw))):
            ax.plot(
                *_polar_points(turn.angle, radius + times * turn.deviation),
                label=name,
                **line_style(n),
            )
        ax.set(xlabel="mm", ylabel="mm")
        ax.set_title(
            f"{comparison.label(turns.entry)}\n{turns.paths}: deviations × {times:g}",
            loc="left",
            fontsize="small",
        )
        ax.set_aspect("equal")
    return add_shared_legend(axes, 3)


def _polar_points(angle: Array, radius: Array | float) -> Array:
    return np.asarray(1e3 * radius * np.array([np.cos(angle), np.sin(angle)]))


def _draw_spectrum(ax: Axes, comparison: Comparison, shown: SettingSeries, task: str) -> None:
    unit, scale = HUMAN[comparison.unit(RANK, task)]
    for entry, series in shown.select_task(task):
        frequency, amplitude = spectrum(series)
        ax.plot(
            frequency,
            scale * amplitude,
            label=comparison.label(entry),
            **line_style(shown.entries.index(entry)),
        )
    rate = 1 / comparison.about(task)["dt_s"]
    ax.axvline(rate, color="#808080", linewidth=0.9, linestyle=(0, (4, 3)), zorder=0)
    ax.annotate(
        f"sample rate {rate:.3g} Hz",
        (rate, 0),
        xycoords=("data", "axes fraction"),
        xytext=(3, 3),
        textcoords="offset points",
        fontsize="small",
        color="#505050",
    )
    ax.set(xscale="log", yscale="log", xlabel="frequency (Hz)", ylabel=f"amplitude ({unit})")


def spectrum(series: RunSeries) -> tuple[Array, Array]:
    """Frequencies (F,), Hz, and amplitudes √Σ|X|² of the components of the tracking error, under a
    Hann window.

    |X| is divided by half the sum of the window, so that a sine of amplitude a shows as a.
    """
    error = series.actual - series.planned
    window = np.hanning(len(error))
    amplitude: Array = (
        np.linalg.norm(np.fft.rfft(error * window[:, None], axis=0), axis=1) * 2 / window.sum()
    )
    return np.asarray(np.fft.rfftfreq(len(error), float(series.t[1] - series.t[0])))[1:], amplitude[
        1:
    ]


def _draw_effort(ax: Axes, comparison: Comparison, shown: SettingSeries, task: str) -> None:
    for entry, series in shown.select_task(task):
        every = max(1, len(series.t) // MAX_POINTS)
        share = np.abs(series.torque).max(1)
        first = np.arange(0, len(share), every)
        n = shown.entries.index(entry)
        ax.plot(
            series.t[first],
            100 * np.maximum.reduceat(share, first),
            label=comparison.label(entry),
            **line_style(n),
        )
    ax.axhline(100, color="black", linewidth=1.2, linestyle=(0, (6, 3)), label="limit")
    ax.set(
        xlabel="time (s)",
        ylabel="torque (% of limit)",
        xlim=(0, shown.select_task(task)[0][1].t[-1]),
    )
    ax.set_ylim(0, None)
