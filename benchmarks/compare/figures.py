"""Figures of a gain report. Lines differ by dash and marks by shape, so that grey paper tells them apart too."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import floor, log10
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.compare.axis_figures import axes_over_time
from benchmarks.compare.courses import Courses, beside
from benchmarks.compare.gain_figures import gains, pareto
from benchmarks.compare.iso_block import IsoBlock
from benchmarks.compare.panels import grid, legend, line
from benchmarks.compare.shown import HUMAN
from benchmarks.compare.table import RANK, Comparison
from benchmarks.page import png, style
from benchmarks.sweep import Series
from kinematics.array import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS = 1500
"""Instants that a line is drawn with: more than a page's pixels show nothing more."""


def draw(comparison: Comparison, shown: Courses, iso: IsoBlock) -> dict[str, bytes]:
    """Every figure of the page as a PNG, by name; those that have nothing to show are missing."""
    with style():
        made: dict[str, list[Axes]] = {
            "time": _per_path(comparison, shown, 2.1, _over_time),
            "along": _per_path(comparison, shown, 2.1, _along_path),
            "path": _magnified(comparison, shown),
            "circle": _circles(comparison, iso),
            "gain": gains(comparison),
            "spectrum": _per_path(comparison, shown, 2.3, _spectrum),
            "effort": _per_path(comparison, shown, 2.1, _effort),
            "pareto": pareto(comparison),
        }
        made |= {f"axes-{n}": axes_over_time(comparison, shown, task) for n, task in enumerate(comparison.tasks)}
        return {name: png(*axes, colours=64) for name, axes in made.items() if axes}


def _per_path(
    comparison: Comparison,
    shown: Courses,
    height: float,
    panel: Callable[[Axes, Comparison, Courses, str], None],
) -> list[Axes]:
    """A panel for each path."""
    tasks = [task for task in comparison.tasks if shown.on(task)]
    if not tasks:
        return []
    axes = grid(len(tasks), 1 if len(tasks) <= 2 else 2, height)
    for ax, task in zip(axes, tasks, strict=True):
        panel(ax, comparison, shown, task)
        ax.set_title(task, loc="left", fontsize="medium", fontweight="bold")
    return legend(axes, 2)


def _corners(comparison: Comparison, task: str) -> list[dict[str, float]]:
    return list(comparison.about(task)["corners"])


def _mark_corners(ax: Axes, places: Sequence[float]) -> None:
    for n, place in enumerate(places):
        ax.axvline(place, color="#808080", linewidth=0.9, linestyle=(0, (4, 3)), zorder=0)
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


def _over_time(ax: Axes, comparison: Comparison, shown: Courses, task: str) -> None:
    unit, scale = HUMAN[comparison.unit(RANK, task)]
    for entry, series in shown.on(task):
        every = slice(None, None, max(1, len(series.t) // POINTS))
        n = shown.entries.index(entry)
        ax.plot(series.t[every], scale * series.contour[every], label=comparison.label(entry), **line(n))
    _mark_corners(ax, [corner["t_s"] for corner in _corners(comparison, task)])
    ax.set(xlabel="time (s)", ylabel=f"contour error ({unit})", xlim=(0, shown.on(task)[0][1].t[-1]))
    ax.set_ylim(bottom=0)


def _along_path(ax: Axes, comparison: Comparison, shown: Courses, task: str) -> None:
    unit, scale = HUMAN[comparison.unit(RANK, task)]
    series = shown.on(task)[0][1]
    length = 1e3 if _in_space(comparison, task) else 1.0
    for entry, one in shown.on(task):
        every = slice(None, None, max(1, len(one.t) // POINTS))
        n = shown.entries.index(entry)
        ax.plot(length * one.s[every], scale * one.contour[every], label=comparison.label(entry), **line(n))
    _mark_corners(ax, [length * corner["s_m"] for corner in _corners(comparison, task)])
    name = "planned place along the path (mm)" if length == 1e3 else "planned place on the curve (s)"
    ax.set(xlabel=name, ylabel=f"contour error ({unit})", xlim=(length * series.s[0], length * series.s[-1]))
    ax.set_ylim(bottom=0)


def _in_space(comparison: Comparison, task: str) -> bool:
    return bool(comparison.about(task)["space"])


def magnification(deviation: float, extent: float) -> float:
    """1, 2 or 5 times a power of ten, by which a deviation becomes an eighth of the extent or a little less."""
    if not deviation > 0 or not extent > 0:
        return 1.0
    wanted = extent / 8 / deviation
    tens = 10.0 ** floor(log10(wanted))
    return tens * max(step for step in (1.0, 2.0, 5.0) if step * tens <= wanted * (1 + 1e-9))


def _magnified(comparison: Comparison, shown: Courses) -> list[Axes]:
    """The path seen along the direction in which it is thinnest, the deviation from it magnified."""
    tasks = [task for task in comparison.tasks if shown.on(task) and _in_space(comparison, task)]
    if not tasks:
        return []
    axes = grid(len(tasks), 3, 3.9)
    for ax, task in zip(axes, tasks, strict=True):
        on = shown.on(task)
        planned = on[0][1].planned
        plane = _plane(planned)
        off = {entry: beside(series) for entry, series in on}
        # the baseline and the best decide: a third that errs more may leave the picture
        largest = max(float(np.linalg.norm(off[entry] @ plane.T, axis=1).max()) for entry, _ in on[:2])
        times = magnification(largest, float(np.ptp(planned, axis=0).max()))
        middle = (planned.min(0) + planned.max(0)) / 2
        ax.plot(*_drawn(planned - middle, plane), color="black", linewidth=0.9, label="planned path")
        for entry, series in on:
            n = shown.entries.index(entry)
            ax.plot(
                *_drawn(series.actual - middle + (times - 1) * off[entry], plane),
                label=comparison.label(entry),
                **line(n),
            )
        ax.set(xlabel="mm", ylabel="mm")
        ax.set_title(f"{task}: deviations × {times:g}", loc="left", fontsize="medium", fontweight="bold")
        ax.set_aspect("equal")
    return legend(axes, 2)


def _plane(points: Array) -> Array:
    """Two unit vectors (2, 3) along which the points spread most; across a straight line, one that is level."""
    _, size, axes = np.linalg.svd(points - points.mean(0), full_matrices=False)
    if size[1] > 1e-4 * size[0]:
        return np.asarray(axes[:2])
    across = np.cross([0.0, 0.0, 1.0], axes[0])
    across = across if np.linalg.norm(across) > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.array([axes[0], across / np.linalg.norm(across)])


def _drawn(points: Array, plane: Array) -> Array:
    return np.asarray(1e3 * (points @ plane.T).T)


def _circles(comparison: Comparison, iso: IsoBlock) -> list[Axes]:
    """Each setting's circular test: both directions about the programmed circle, on one magnification."""
    tests = [(turns, turns.test) for turns in iso.circles if turns.test is not None][:4]
    if not tests:
        return []
    largest = max(float(np.abs(turn.deviation).max()) for _, test in tests for turn in (test.ccw, test.cw))
    axes = grid(len(tests), 2, 4.6)
    for ax, (turns, test) in zip(axes, tests, strict=True):
        radius = test.circle.radius
        times = magnification(largest, 2 * radius)
        angle = np.linspace(0, 2 * np.pi, 361)
        ax.plot(*_round(angle, radius), color="black", linewidth=0.9, label="programmed circle")
        for n, (name, turn) in enumerate((("counter-clockwise", test.ccw), ("clockwise", test.cw))):
            ax.plot(*_round(turn.angle, radius + times * turn.deviation), label=name, **line(n))
        ax.set(xlabel="mm", ylabel="mm")
        ax.set_title(
            f"{comparison.label(turns.entry)}\n{turns.paths}: deviations × {times:g}", loc="left", fontsize="small"
        )
        ax.set_aspect("equal")
    return legend(axes, 3)


def _round(angle: Array, radius: Array | float) -> Array:
    return np.asarray(1e3 * radius * np.array([np.cos(angle), np.sin(angle)]))


def _spectrum(ax: Axes, comparison: Comparison, shown: Courses, task: str) -> None:
    unit, scale = HUMAN[comparison.unit(RANK, task)]
    for entry, series in shown.on(task):
        frequency, amplitude = spectrum(series)
        ax.plot(frequency, scale * amplitude, label=comparison.label(entry), **line(shown.entries.index(entry)))
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


def spectrum(series: Series) -> tuple[Array, Array]:
    """Frequencies (F,), Hz, and amplitudes √Σ|X|² of the components of the tracking error, under a Hann window.

    |X| is divided by half the sum of the window, so that a sine of amplitude a shows as a.
    """
    error = series.actual - series.planned
    window = np.hanning(len(error))
    amplitude: Array = np.linalg.norm(np.fft.rfft(error * window[:, None], axis=0), axis=1) * 2 / window.sum()
    return np.asarray(np.fft.rfftfreq(len(error), float(series.t[1] - series.t[0])))[1:], amplitude[1:]


def _effort(ax: Axes, comparison: Comparison, shown: Courses, task: str) -> None:
    for entry, series in shown.on(task):
        every = max(1, len(series.t) // POINTS)
        share = np.abs(series.torque).max(1)
        first = np.arange(0, len(share), every)
        n = shown.entries.index(entry)
        ax.plot(series.t[first], 100 * np.maximum.reduceat(share, first), label=comparison.label(entry), **line(n))
    ax.axhline(100, color="black", linewidth=1.2, linestyle=(0, (6, 3)), label="limit")
    ax.set(xlabel="time (s)", ylabel="torque (% of limit)", xlim=(0, shown.on(task)[0][1].t[-1]))
    ax.set_ylim(0, None)
