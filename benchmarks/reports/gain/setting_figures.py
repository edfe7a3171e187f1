"""Figures of settings rather than of runs: error against gain, and against time; and what all of a
report's figures share.

That is lines, marks, panels, and one legend for all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.reports.gain.comparison import RANK, Comparison, ComparisonRow, SettingEntry
from benchmarks.reports.gain.criteria import HUMAN
from kinematics.foundation.figure import choose_ticks, scale_error_axis
from kinematics.foundation.line_styles import PALETTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (2, 1.2)), (0, (7, 2, 1.5, 2)), (0, (1, 1)))
MARKS = "osD^vPX*<>hp"
COLOURS = (*PALETTE, "#5D3A9B", "#8A5A00", "#882255", "#004D40", "#4D4D4D")
"""As many as there are marks: more settings than the palette has colours share none."""
EFFORT = "torque_rms"
"""The figure of a run."""
EFFORT_LABEL, ERROR_LABEL = (
    "RMS torque over the baseline's",
    "RMS contour error over the baseline's",
)
STRUCK = "unstable, or off its goal more often than the baseline"
MIN_SPAN = 1.01
"""Ratio to the baseline that an axis shows at least."""
NUMBER_ROOM = 0.055
"""Of the height of the figure, between two numbers."""
WIDTH = 11.0
"""Inches: as wide as a page of A4 on its side, so that text stays as large as it was drawn."""


def line_style(n: int) -> dict[str, Any]:
    return {
        "color": line_colour(n),
        "linestyle": DASHES[n % len(DASHES)],
        "linewidth": 1.7 if n < 2 else 1.2,
    }


def line_colour(n: int) -> str:
    return COLOURS[n % len(COLOURS)]


def marker_style(n: int) -> dict[str, Any]:
    """Hollow beyond the palette."""
    return {
        "marker": MARKS[n % len(MARKS)],
        "markerfacecolor": line_colour(n) if n < len(PALETTE) else "white",
    }


def make_panels(count: int, columns: int, height: float) -> list[Axes]:
    """So many panels of a height in inches, in up to so many columns."""
    from matplotlib.figure import Figure

    columns = min(columns, count)
    rows = -(-count // columns)
    figure = Figure(figsize=(WIDTH, rows * height + 0.9), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for ax in axes[count:]:
        ax.remove()
    return axes[:count]


def add_shared_legend(axes: Sequence[Axes], columns: int = 3) -> list[Axes]:
    """One legend above all axes, of every line that any has."""
    known: dict[str, Any] = {}
    for ax in axes:
        known.update(dict(zip(*ax.get_legend_handles_labels()[::-1], strict=True)))
    figure = axes[0].get_figure(root=True)
    if figure is not None and known:
        figure.legend(
            known.values(), known.keys(), loc="outside upper center", ncols=columns, frameon=False
        )
    return list(axes)


@dataclass(frozen=True, slots=True)
class SettingPlace:
    """Where a setting stands: its effort and its error over the baseline's.

    number  among the best, from 1; 0 of others
    fault   why it is struck out (`Comparison.fault`); empty where it holds
    """

    entry: SettingEntry
    effort: float
    error: float
    number: int
    fault: str


def find_places(comparison: Comparison, best: Sequence[SettingEntry]) -> list[SettingPlace]:
    """Of every setting but the baseline; what failed on every path has none. best: those numbered,
    the first first.
    """
    return [
        SettingPlace(
            entry, *pair, best.index(entry) + 1 if entry in best else 0, comparison.fault(entry)
        )
        for entry in comparison.entries
        if entry != comparison.baseline
        and (pair := _effort_and_error(comparison, entry)) is not None
    ]


@dataclass(frozen=True, slots=True)
class PlacesView:
    """What a figure of places shows: the ends of both axes and their ticks; beyond: how many places
    lie outside.
    """

    efforts: tuple[float, float]
    errors: tuple[float, float]
    effort_ticks: tuple[float, ...]
    error_ticks: tuple[float, ...]
    beyond: int


def choose_view(places: Sequence[SettingPlace], whole: bool = False) -> PlacesView:
    """About the baseline and the settings that hold; whole: about those struck out too."""
    held = [place for place in places if whole or not place.fault] or list(places)
    efforts, errors = (
        _choose_ends([1.0, *(getattr(place, name) for place in held)])
        for name in ("effort", "error")
    )
    beyond = sum(
        not (efforts[0] <= place.effort <= efforts[1] and errors[0] <= place.error <= errors[1])
        for place in places
    )
    return PlacesView(efforts, errors, choose_ticks(*efforts), choose_ticks(*errors), beyond)


def _choose_ends(values: Sequence[float]) -> tuple[float, float]:
    """Around positive values on a logarithmic axis, and never so near that noise would fill it."""
    low, high = min(*values, 1 / MIN_SPAN), max(*values, MIN_SPAN)
    room = (high / low) ** 0.06
    return low / room, high * room


def error_over_effort(comparison: Comparison, best: Sequence[SettingEntry]) -> list[Axes]:
    """Error against effort of every setting, over the baseline's; those that do not hold are struck
    out.

    best: those that are numbered, the first first. What lies beyond the view is drawn at its edge.
    """
    places = find_places(comparison, best)
    if not places:
        return []
    (ax,) = make_panels(1, 1, 4.4)
    view = choose_view(places)
    struck = [_clip(place, view) for place in places if place.fault]
    for n, law in enumerate(laws_of(comparison)):
        held = [
            _clip(place, view)
            for place in places
            if place.entry.setting.law == law and not place.fault
        ]
        if held:
            ax.plot(
                *np.transpose(held),
                linestyle="none",
                label=law,
                color=line_colour(n),
                **marker_style(n),
            )
    if struck:
        beyond = f"; {view.beyond} beyond the edge" if view.beyond else ""
        ax.plot(
            *np.transpose(struck),
            "x",
            color="#9A9A9A",
            markersize=7,
            label=f"{STRUCK}{beyond}",
            clip_on=False,
        )
    ax.plot(1, 1, marker="*", markersize=15, color="black", linestyle="none", label="baseline")
    for line in (ax.axhline, ax.axvline):
        line(1, color="#808080", linewidth=0.9, linestyle=(0, (6, 3)), zorder=0)
    for name, ends, ticks in (
        ("x", view.efforts, view.effort_ticks),
        ("y", view.errors, view.error_ticks),
    ):
        ax.set(**{f"{name}scale": "log", f"{name}lim": ends})
        axis = ax.xaxis if name == "x" else ax.yaxis
        axis.set_ticks([], minor=True)
        axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.set(xlabel=EFFORT_LABEL, ylabel=ERROR_LABEL)
    _number_places(
        ax, sorted((place for place in places if place.number), key=lambda place: place.error), view
    )
    return add_shared_legend([ax], 3)


def pack_places(comparison: Comparison, best: Sequence[SettingEntry]) -> dict[str, Any]:
    """The same for a page's script: laws, places, and two views, of those that hold and of all."""
    places, laws = find_places(comparison, best), laws_of(comparison)
    score = {place.entry: comparison.score(place.entry) for place in places}
    views = {
        name: {
            "x": [*view.efforts],
            "y": [*view.errors],
            "ticks": [[*view.effort_ticks], [*view.error_ticks]],
        }
        for name, view in (("held", choose_view(places)), ("all", choose_view(places, whole=True)))
    }
    return {
        "labels": [EFFORT_LABEL, ERROR_LABEL],
        "laws": [
            [law, line_colour(n), MARKS[n % len(MARKS)], n < len(PALETTE)]
            for n, law in enumerate(laws)
        ],
        "views": views,
        "baseline": comparison.label(comparison.baseline),
        "places": [
            {
                "name": comparison.label(place.entry),
                "law": laws.index(place.entry.setting.law),
                "at": [place.effort, place.error],
                "number": place.number,
                "fault": place.fault,
                "weighed": score[place.entry] if isfinite(score[place.entry]) else None,
            }
            for place in places
        ],
    }


def laws_of(comparison: Comparison) -> list[str]:
    return list(dict.fromkeys(entry.setting.law for entry in comparison.entries))


def _clip(place: SettingPlace, view: PlacesView) -> tuple[float, float]:
    (left, right), (low, high) = view.efforts, view.errors
    return min(max(place.effort, left), right), min(max(place.error, low), high)


def _number_places(ax: Axes, places: Sequence[SettingPlace], view: PlacesView) -> None:
    """Numbers right of the places, from the lowest up, each clear of the one before, with a line to
    its place.
    """
    low, high = np.log(view.errors)
    free = -1.0
    for place in places:
        height = (np.log(place.error) - low) / (high - low)
        free = max(height, free + NUMBER_ROOM)
        lift = (free - height) * ax.get_window_extent().height * 72 / ax.figure.dpi
        ax.annotate(
            str(place.number),
            (place.effort, place.error),
            xytext=(16, lift),
            textcoords="offset points",
            arrowprops={"arrowstyle": "-", "color": "#9A9A9A", "linewidth": 0.6, "shrinkB": 3},
            fontweight="bold",
            va="center",
        )


def _effort_and_error(comparison: Comparison, entry: SettingEntry) -> tuple[float, float] | None:
    """Geometric means over the ranked paths of what a setting takes and errs over the baseline;
    None: it has none.
    """
    pairs = [(row, comparison.row(comparison.baseline, row.task)) for row in comparison.of(entry)]
    efforts = [
        row.figures[EFFORT] / base.figures[EFFORT]
        for row, base in pairs
        if base is not None
        and row.task in comparison.ranked
        and min(_effort(row), _effort(base)) > 0
    ]
    error = comparison.ratios(entry).get("contour error")
    return (
        None if error is None or not efforts else (float(np.exp(np.mean(np.log(efforts)))), error)
    )


def _effort(row: ComparisonRow) -> float:
    return row.figures.get(EFFORT, 0.0)


def gains(comparison: Comparison) -> list[Axes]:
    """Error over each law's first gain, with the spread over rigs, and where it is unstable."""
    tasks = list(comparison.ranked)
    if not tasks:
        return []
    axes = make_panels(len(tasks), 2 if len(tasks) in (2, 4) else 3, 2.9)
    lines = _gain_lines(comparison)
    if not lines:
        return []
    for ax, task in zip(axes, tasks, strict=True):
        unit, scale = HUMAN[comparison.unit(RANK, task)]
        for n, (name, entries) in enumerate(lines.items()):
            rows = [
                (_first_gain(entry), row)
                for entry in entries
                if (row := comparison.row(entry, task)) is not None
            ]
            rows.sort(key=lambda one: one[0])
            _gain_line(ax, rows, scale, name, n)
        baseline = comparison.row(comparison.baseline, task)
        if baseline is not None and baseline.figures:
            ax.axhline(
                scale * baseline.figures[RANK],
                color="black",
                linewidth=1,
                linestyle=(0, (6, 3)),
                label="baseline",
            )
        scale_error_axis(ax)
        ax.set(xlabel="first gain of the law", ylabel=f"RMS contour error ({unit})")
        ax.set_title(task, loc="left", fontsize="medium", fontweight="bold")
    return add_shared_legend(axes, 2)


def _gain_line(
    ax: Axes, rows: Sequence[tuple[float, ComparisonRow]], scale: float, name: str, n: int
) -> None:
    good = [(x, row) for x, row in rows if row.figures and row.spread]
    if good:
        gains = [x for x, _ in good]
        error = np.array([row.figures[RANK] for _, row in good])
        spread = np.array([row.spread for _, row in good if row.spread]).T
        drawn = {**line_style(n), "linewidth": 1.2}
        ax.plot(gains, scale * error, markersize=4.5, label=name, **marker_style(n), **drawn)
        ax.vlines(
            gains,
            scale * spread[0],
            scale * spread[1],
            color=line_colour(n),
            linewidth=2.5,
            alpha=0.45,
        )
    unstable = [x for x, row in rows if not row.stable]
    height = 0.98 - 0.045 * n
    for k, x in enumerate(unstable):
        ax.plot(
            x,
            height,
            marker="x",
            color=line_colour(n),
            markersize=6,
            transform=ax.get_xaxis_transform(),
            linestyle="none",
            label="unstable on some rig" if k == 0 and n == 0 else None,
        )
    if unstable and any(row.stable for x, row in rows):
        ax.axvline(
            min(unstable),
            color=line_colour(n),
            linestyle=DASHES[n % len(DASHES)],
            linewidth=0.9,
            zorder=0,
        )


def _gain_lines(comparison: Comparison) -> dict[str, list[SettingEntry]]:
    """Settings of one law that differ in their first gain alone, by the law and what they have in
    common.
    """
    found: dict[str, list[SettingEntry]] = {}
    for entry in comparison.entries:
        if entry.setting.gains:
            rest = [
                f"{name.replace('_', ' ')} {value:g}" for name, value in entry.setting.gains[1:]
            ]
            several = (
                f"{comparison.sources[entry.source].name}: " if len(comparison.sources) > 1 else ""
            )
            found.setdefault(" ".join([several + entry.setting.law, *rest]), []).append(entry)
    return found


def _first_gain(entry: SettingEntry) -> float:
    return entry.setting.gains[0][1]


def pareto(comparison: Comparison) -> list[Axes]:
    """Every stable setting: how late it is at its goal, against its error; the front of those that
    no other beats.
    """
    laws = list(dict.fromkeys(entry.setting.law for entry in comparison.entries))
    of_task = {task: _lateness_points(comparison, task) for task in comparison.ranked}
    of_task = {task: points for task, points in of_task.items() if points}
    if not of_task:
        return []
    axes = make_panels(len(of_task), 2 if len(of_task) in (2, 4) else 3, 2.9)
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
                    color=line_colour(n),
                    label=law,
                    alpha=0.85,
                    **marker_style(n),
                )
        best = np.array(pareto_front([point for _, point in points]))
        ax.step(
            best[:, 0],
            scale * best[:, 1],
            where="post",
            color="black",
            linewidth=0.9,
            zorder=0,
            label="front",
        )
        scale_error_axis(ax)
        ax.set(xlabel="at its goal after the planned end (s)", ylabel=f"RMS contour error ({unit})")
        ax.set_title(task, loc="left", fontsize="medium", fontweight="bold")
    return add_shared_legend(axes, 3)


def _lateness_points(comparison: Comparison, task: str) -> list[tuple[str, tuple[float, float]]]:
    """Law, lateness and error of every stable setting that is at its goal in the end."""
    return [
        (row.entry.setting.law, (row.figures["late"], row.figures[RANK]))
        for row in comparison.rows
        if row.task == task and row.stable and isfinite(row.figures.get("late", inf))
    ]


def pareto_front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Those that no other is at least as good as in both, by the first."""
    found: list[tuple[float, float]] = []
    for point in sorted(points):
        if not found or point[1] < found[-1][1]:
            found.append(point)
    return found
