"""Figures of a gain report. Lines differ by dash and marks by shape, so that grey paper tells them apart too."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import floor, inf, isfinite, log10
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.compare.courses import Courses, beside
from benchmarks.compare.iso_block import IsoBlock
from benchmarks.compare.shown import HUMAN
from benchmarks.compare.table import RANK, Comparison, Entry, Row
from benchmarks.page import png, style
from benchmarks.sweep import Series
from kinematics.array import Array
from planner.plots import PALETTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (2, 1.2)), (0, (7, 2, 1.5, 2)), (0, (1, 1)))
MARKS = "osD^vPX*<>hp"
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
            "gain": _gains(comparison),
            "spectrum": _per_path(comparison, shown, 2.3, _spectrum),
            "effort": _per_path(comparison, shown, 2.1, _effort),
            "pareto": _pareto(comparison),
        }
        return {name: png(*axes, colours=64) for name, axes in made.items() if axes}


def _line(n: int) -> dict[str, Any]:
    return {
        "color": PALETTE[n % len(PALETTE)],
        "linestyle": DASHES[n % len(DASHES)],
        "linewidth": 1.7 if n < 2 else 1.2,
    }


def _grid(count: int, columns: int, width: float, height: float) -> list[Axes]:
    from matplotlib.figure import Figure

    rows = -(-count // columns)
    figure = Figure(figsize=(width, rows * height + 0.7), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for ax in axes[count:]:
        ax.remove()
    return axes[:count]


def _legend(axes: Sequence[Axes], columns: int = 3) -> list[Axes]:
    """One legend above all axes, of every line that any has."""
    known: dict[str, Any] = {}
    for ax in axes:
        known.update(dict(zip(*ax.get_legend_handles_labels()[::-1], strict=True)))
    figure = axes[0].get_figure(root=True)
    if figure is not None and known:
        figure.legend(known.values(), known.keys(), loc="outside upper center", ncols=columns, frameon=False)
    return list(axes)


def _per_path(
    comparison: Comparison,
    shown: Courses,
    height: float,
    panel: Callable[[Axes, Comparison, Courses, str], None],
) -> list[Axes]:
    """A panel for each path, one below the other."""
    tasks = [task for task in comparison.tasks if shown.on(task)]
    if not tasks:
        return []
    axes = _grid(len(tasks), 1, 9, height)
    for ax, task in zip(axes, tasks, strict=True):
        panel(ax, comparison, shown, task)
        ax.set_title(task, loc="left", fontsize="medium", fontweight="bold")
    return _legend(axes, 2)


def _corners(comparison: Comparison, task: str) -> list[dict[str, float]]:
    return list(_record(comparison, task)["corners"])


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
        ax.plot(series.t[every], scale * series.contour[every], label=comparison.label(entry), **_line(n))
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
        ax.plot(length * one.s[every], scale * one.contour[every], label=comparison.label(entry), **_line(n))
    _mark_corners(ax, [length * corner["s_m"] for corner in _corners(comparison, task)])
    name = "planned place along the path (mm)" if length == 1e3 else "planned place on the curve (s)"
    ax.set(xlabel=name, ylabel=f"contour error ({unit})", xlim=(length * series.s[0], length * series.s[-1]))
    ax.set_ylim(bottom=0)


def _record(comparison: Comparison, task: str) -> dict[str, Any]:
    return next(dict(of.record["tasks"][task]) for of in comparison.sources if task in of.record["tasks"])


def _in_space(comparison: Comparison, task: str) -> bool:
    return bool(_record(comparison, task)["space"])


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
    axes = _grid(len(tasks), min(len(tasks), 2), 9, 4.0)
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
                **_line(n),
            )
        ax.set(xlabel="mm", ylabel="mm")
        ax.set_title(f"{task}: deviations × {times:g}", loc="left", fontsize="medium", fontweight="bold")
        ax.set_aspect("equal")
    return _legend(axes, 2)


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
    tests = iso.circles[:4]
    if not tests:
        return []
    largest = max(float(np.abs(turn.deviation).max()) for _, _, test in tests for turn in (test.ccw, test.cw))
    axes = _grid(len(tests), min(len(tests), 2), 9, 4.2)
    for ax, (entry, paths, test) in zip(axes, tests, strict=True):
        radius = test.circle.radius
        times = magnification(largest, 2 * radius)
        angle = np.linspace(0, 2 * np.pi, 361)
        ax.plot(*_round(angle, radius), color="black", linewidth=0.9, label="programmed circle")
        for n, (name, turn) in enumerate((("counter-clockwise", test.ccw), ("clockwise", test.cw))):
            ax.plot(*_round(turn.angle, radius + times * turn.deviation), label=name, **_line(n))
        ax.set(xlabel="mm", ylabel="mm")
        ax.set_title(f"{comparison.label(entry)}\n{paths}: deviations × {times:g}", loc="left", fontsize="small")
        ax.set_aspect("equal")
    return _legend(axes, 3)


def _round(angle: Array, radius: Array | float) -> Array:
    return np.asarray(1e3 * radius * np.array([np.cos(angle), np.sin(angle)]))


def _gains(comparison: Comparison) -> list[Axes]:
    """Error over each law's first gain, with the spread over rigs, and where it is unstable."""
    tasks = list(comparison.tasks)
    axes = _grid(len(tasks), min(len(tasks), 2), 9, 3.2)
    lines = _gain_lines(comparison)
    if not lines:
        return []
    for ax, task in zip(axes, tasks, strict=True):
        unit, scale = HUMAN[comparison.unit(RANK, task)]
        for n, (name, entries) in enumerate(lines.items()):
            rows = [(_first(entry), row) for entry in entries if (row := comparison.row(entry, task)) is not None]
            rows.sort(key=lambda one: one[0])
            _gain_line(ax, rows, scale, name, n)
        baseline = comparison.row(comparison.baseline, task)
        if baseline is not None and baseline.figures:
            ax.axhline(
                scale * baseline.figures[RANK], color="black", linewidth=1, linestyle=(0, (6, 3)), label="baseline"
            )
        _log_error(ax)
        ax.set(xlabel="first gain of the law", ylabel=f"RMS contour error ({unit})")
        ax.set_title(task, loc="left", fontsize="medium", fontweight="bold")
    return _legend(axes, 2)


def _log_error(ax: Axes) -> None:
    """A logarithmic axis of errors that says 200 and 500, not powers, also where it spans less than a decade."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5, 7)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())


def _gain_line(ax: Axes, rows: Sequence[tuple[float, Row]], scale: float, name: str, n: int) -> None:
    good = [(x, row) for x, row in rows if row.figures and row.spread]
    color, mark = PALETTE[n % len(PALETTE)], MARKS[n % len(MARKS)]
    if good:
        gains = [x for x, _ in good]
        error = np.array([row.figures[RANK] for _, row in good])
        spread = np.array([row.spread for _, row in good if row.spread]).T
        line = {**_line(n), "linewidth": 1.2}
        ax.plot(gains, scale * error, marker=mark, markersize=4.5, label=name, **line)
        ax.vlines(gains, scale * spread[0], scale * spread[1], color=color, linewidth=2.5, alpha=0.45)
    unstable = [x for x, row in rows if not row.stable]
    height = 0.98 - 0.045 * n
    for k, x in enumerate(unstable):
        ax.plot(
            x,
            height,
            marker="x",
            color=color,
            markersize=6,
            transform=ax.get_xaxis_transform(),
            linestyle="none",
            label="unstable on some rig" if k == 0 and n == 0 else None,
        )
    if unstable and any(row.stable for x, row in rows):
        ax.axvline(min(unstable), color=color, linestyle=DASHES[n % len(DASHES)], linewidth=0.9, zorder=0)


def _gain_lines(comparison: Comparison) -> dict[str, list[Entry]]:
    """Settings of one law that differ in their first gain alone, by the law and what they have in common."""
    found: dict[str, list[Entry]] = {}
    for entry in comparison.entries:
        if entry.setting.gains:
            rest = [f"{name.replace('_', ' ')} {value:g}" for name, value in entry.setting.gains[1:]]
            several = f"{comparison.sources[entry.source].name}: " if len(comparison.sources) > 1 else ""
            found.setdefault(" ".join([several + entry.setting.law, *rest]), []).append(entry)
    return found


def _first(entry: Entry) -> float:
    return entry.setting.gains[0][1]


def _spectrum(ax: Axes, comparison: Comparison, shown: Courses, task: str) -> None:
    unit, scale = HUMAN[comparison.unit(RANK, task)]
    for entry, series in shown.on(task):
        frequency, amplitude = spectrum(series)
        ax.plot(frequency, scale * amplitude, label=comparison.label(entry), **_line(shown.entries.index(entry)))
    rate = 1 / _record(comparison, task)["dt_s"]
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
        ax.plot(series.t[first], 100 * np.maximum.reduceat(share, first), label=comparison.label(entry), **_line(n))
    ax.axhline(100, color="black", linewidth=1.2, linestyle=(0, (6, 3)), label="limit")
    ax.set(xlabel="time (s)", ylabel="torque (% of limit)", xlim=(0, shown.on(task)[0][1].t[-1]))
    ax.set_ylim(0, None)


def _pareto(comparison: Comparison) -> list[Axes]:
    """Every setting that holds: how late it is at rest, against its error; the front of those that no other beats."""
    tasks = list(comparison.tasks)
    axes = _grid(len(tasks), min(len(tasks), 2), 9, 3.2)
    laws = list(dict.fromkeys(entry.setting.law for entry in comparison.entries))
    drawn = False
    for ax, task in zip(axes, tasks, strict=True):
        unit, scale = HUMAN[comparison.unit(RANK, task)]
        points = []
        for n, law in enumerate(laws):
            rows = [row for row in comparison.rows if row.task == task and row.entry.setting.law == law and row.stable]
            here = [(row.figures["late"], row.figures[RANK]) for row in rows if isfinite(row.figures.get("late", inf))]
            if here:
                points += here
                of_law = np.array(here)
                ax.plot(
                    of_law[:, 0],
                    scale * of_law[:, 1],
                    linestyle="none",
                    marker=MARKS[n % len(MARKS)],
                    markersize=5.5,
                    color=PALETTE[n % len(PALETTE)],
                    label=law,
                    alpha=0.85,
                )
        if points:
            drawn = True
            best = np.array(front(points))
            ax.step(best[:, 0], scale * best[:, 1], where="post", color="black", linewidth=0.9, zorder=0, label="front")
            _log_error(ax)
        ax.set(xlabel="at rest after the planned end (s)", ylabel=f"RMS contour error ({unit})")
        ax.set_title(task, loc="left", fontsize="medium", fontweight="bold")
    return _legend(axes, 3) if drawn else []


def front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Those that no other is at least as good as in both, by the first."""
    found: list[tuple[float, float]] = []
    for point in sorted(points):
        if not found or point[1] < found[-1][1]:
            found.append(point)
    return found
