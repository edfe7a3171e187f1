"""Reference and feedback of each axis over time, as [Sahbaz 2007, Figures 7.10 to 7.18] show them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.compare.courses import Courses
from benchmarks.compare.panels import WIDTH, legend, line
from benchmarks.compare.table import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS = 1500
"""Instants that a line is drawn with."""
UNITS = {"m": ("mm", 1e3, "µm", 1e6), "rad": ("°", 180 / np.pi, "mrad", 1e3)}
"""SI unit of an axis -> what positions are shown in, and errors."""


def axes_over_time(comparison: Comparison, shown: Courses, task: str) -> list[Axes]:
    """A row for each axis: where it should be and what its encoder reads, of the baseline and the best; the difference.

    Empty where the runs were saved without them.
    """
    from matplotlib.figure import Figure

    runs = [(entry, series) for entry, series in shown.on(task)[:2] if series.reference.size]
    if not runs:
        return []
    record = next(of.record for of in comparison.sources if task in of.record["tasks"])
    names = [*record["axes"].items()]
    figure = Figure(figsize=(WIDTH, 1.9 * len(names) + 0.9), layout="constrained")
    panels = figure.subplots(len(names), 2, squeeze=False, sharex="col")
    series = runs[0][1]
    every = slice(None, None, max(1, len(series.t) // POINTS))
    for k, (name, unit) in enumerate(names):
        place, off = panels[k]
        position, scale, error, fine = UNITS[unit]
        place.plot(series.t[every], scale * series.reference[every, k], color="black", linewidth=2.2, label="reference")
        for entry, one in runs:
            drawn = {**line(shown.entries.index(entry)), "linewidth": 1.2}
            label = comparison.label(entry)
            place.plot(one.t[every], scale * one.feedback[every, k], label=f"feedback, {label}", **drawn)
            off.plot(one.t[every], fine * (one.feedback - one.reference)[every, k], **drawn)
        place.set_ylabel(f"{name} ({position})")
        off.set_ylabel(f"{name} ({error})")
    for ax in panels[-1]:
        ax.set(xlabel="time (s)", xlim=(0, series.t[-1]))
    titled = {"loc": "left", "fontsize": "medium", "fontweight": "bold"}
    panels[0, 0].set_title(f"{task}: reference and feedback", **titled)
    panels[0, 1].set_title("feedback − reference", **titled)
    return legend([*panels.ravel()], 2)
