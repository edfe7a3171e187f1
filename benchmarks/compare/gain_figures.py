"""Figures of settings rather than of runs: error against gain, and against time."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.compare.panels import DASHES, color, grid, legend, line, mark
from benchmarks.compare.shown import HUMAN
from benchmarks.compare.table import RANK, Comparison, Entry, Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def gains(comparison: Comparison) -> list[Axes]:
    """Error over each law's first gain, with the spread over rigs, and where it is unstable."""
    tasks = list(comparison.ranked)
    if not tasks:
        return []
    axes = grid(len(tasks), 2 if len(tasks) in (2, 4) else 3, 2.9)
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
    return legend(axes, 2)


def _gain_line(ax: Axes, rows: Sequence[tuple[float, Row]], scale: float, name: str, n: int) -> None:
    good = [(x, row) for x, row in rows if row.figures and row.spread]
    if good:
        gains = [x for x, _ in good]
        error = np.array([row.figures[RANK] for _, row in good])
        spread = np.array([row.spread for _, row in good if row.spread]).T
        drawn = {**line(n), "linewidth": 1.2}
        ax.plot(gains, scale * error, markersize=4.5, label=name, **mark(n), **drawn)
        ax.vlines(gains, scale * spread[0], scale * spread[1], color=color(n), linewidth=2.5, alpha=0.45)
    unstable = [x for x, row in rows if not row.stable]
    height = 0.98 - 0.045 * n
    for k, x in enumerate(unstable):
        ax.plot(
            x,
            height,
            marker="x",
            color=color(n),
            markersize=6,
            transform=ax.get_xaxis_transform(),
            linestyle="none",
            label="unstable on some rig" if k == 0 and n == 0 else None,
        )
    if unstable and any(row.stable for x, row in rows):
        ax.axvline(min(unstable), color=color(n), linestyle=DASHES[n % len(DASHES)], linewidth=0.9, zorder=0)


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


def pareto(comparison: Comparison) -> list[Axes]:
    """Every stable setting: how late it is at its goal, against its error; the front of those that no other beats."""
    laws = list(dict.fromkeys(entry.setting.law for entry in comparison.entries))
    of_task = {task: _late(comparison, task) for task in comparison.ranked}
    of_task = {task: points for task, points in of_task.items() if points}
    if not of_task:
        return []
    axes = grid(len(of_task), 2 if len(of_task) in (2, 4) else 3, 2.9)
    for ax, (task, points) in zip(axes, of_task.items(), strict=True):
        unit, scale = HUMAN[comparison.unit(RANK, task)]
        for n, law in enumerate(laws):
            here = np.array([point for of, point in points if of == law])
            if len(here):
                ax.plot(
                    here[:, 0],
                    scale * here[:, 1],
                    linestyle="none",
                    markersize=5.5,
                    color=color(n),
                    label=law,
                    alpha=0.85,
                    **mark(n),
                )
        best = np.array(front([point for _, point in points]))
        ax.step(best[:, 0], scale * best[:, 1], where="post", color="black", linewidth=0.9, zorder=0, label="front")
        _log_error(ax)
        ax.set(xlabel="at its goal after the planned end (s)", ylabel=f"RMS contour error ({unit})")
        ax.set_title(task, loc="left", fontsize="medium", fontweight="bold")
    return legend(axes, 3)


def _late(comparison: Comparison, task: str) -> list[tuple[str, tuple[float, float]]]:
    """Law, lateness and error of every stable setting that is at its goal in the end."""
    return [
        (row.entry.setting.law, (row.figures["late"], row.figures[RANK]))
        for row in comparison.rows
        if row.task == task and row.stable and isfinite(row.figures.get("late", inf))
    ]


def front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Those that no other is at least as good as in both, by the first."""
    found: list[tuple[float, float]] = []
    for point in sorted(points):
        if not found or point[1] < found[-1][1]:
            found.append(point)
    return found


def _log_error(ax: Axes) -> None:
    """A logarithmic axis of errors that says 200 and 500, not powers, also where it spans less than a decade."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5, 7)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
