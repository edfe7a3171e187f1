"""The ISO-style figures of a report, from saved runs: the rigs and seeds of the sweep are the cycles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.compare.courses import circle_of, every_run
from benchmarks.compare.table import Comparison, Entry
from benchmarks.sweep import Series
from benchmarks.sweep.cell import NOMINAL
from controllers.metrics import CircularTest, circular_test
from controllers.metrics.path_accuracy import Stations, path_accuracy
from controllers.metrics.pose_accuracy import pose_accuracy
from kinematics.errors import MotionError

STATIONS = 50
"""Evenly along the path, the first and the last half a distance from its ends."""


ISO = ("path accuracy AT", "path repeatability RT", "pose accuracy AP", "pose repeatability RP")


@dataclass(frozen=True, slots=True)
class Line:
    """The figures of `ISO` of a setting on a path, m; note: of how many cycles, or why there are none."""

    entry: Entry
    path: str
    values: Mapping[str, float]
    note: str


@dataclass(frozen=True, slots=True)
class IsoBlock:
    """Lines, and the circular tests by setting."""

    lines: tuple[Line, ...]
    circles: tuple[tuple[Entry, str, CircularTest], ...]


def iso_block(comparison: Comparison, entries: Sequence[Entry]) -> IsoBlock:
    """Path and pose accuracy and repeatability of each setting, and circular tests where a circle is run both ways."""
    lines: list[Line] = []
    circles: list[tuple[Entry, str, CircularTest]] = []
    all_runs = {entry: every_run(comparison, entry) for entry in entries}
    for task in comparison.tasks:
        for entry, runs in all_runs.items():
            lines.append(_of_path(entry, task, [series for (of, _, _), series in runs.items() if of == task]))
    for entry, runs in all_runs.items():
        nominal: dict[str, Series] = {}
        for (task, rig, _), series in runs.items():
            if rig == NOMINAL.name:
                nominal.setdefault(task, series)
        circles += _circles(entry, nominal)
    return IsoBlock(tuple(lines), tuple(circles))


def _of_path(entry: Entry, task: str, runs: Sequence[Series]) -> Line:
    if not runs or runs[0].planned.shape[1] != 3 or len(np.unique(runs[0].s)) < 3:
        return Line(entry, task, {}, "no path in space, or no run that held")
    shortest = min(len(series.t) for series in runs)
    first = runs[0]
    paths = np.stack([series.actual[:shortest] for series in runs], axis=1)
    s, keep = np.unique(first.s, return_index=True)
    points = first.planned[keep]
    at = s[0] + (s[-1] - s[0]) * (np.arange(STATIONS) + 0.5) / STATIONS
    after = np.clip(np.searchsorted(s, at), 1, len(s) - 1)
    side = points[after] - points[after - 1]
    share = (at - s[after - 1]) / (s[after] - s[after - 1])
    stations = Stations(points[after - 1] + share[:, None] * side, side / np.linalg.norm(side, axis=1)[:, None])
    try:
        path, pose = path_accuracy(paths, stations), pose_accuracy(paths[-1], first.planned[-1])
    except MotionError as error:
        return Line(entry, task, {}, str(error))
    values = (path.at_p, path.rt_p, pose.accuracy, pose.repeatability)
    return Line(entry, task, dict(zip(ISO, values, strict=True)), f"{len(runs)} cycles")


def _circles(entry: Entry, nominal: dict[str, Series]) -> list[tuple[Entry, str, CircularTest]]:
    """Tests of all pairs of circles that are one another's reverse."""
    round_ = {task: circle for task, series in nominal.items() if (circle := circle_of(series)) is not None}
    found = []
    for n, (task, circle) in enumerate(round_.items()):
        for other, back in list(round_.items())[n + 1 :]:
            near = np.linalg.norm(circle.centre - back.centre) < 1e-3 * circle.radius
            if near and abs(circle.radius / back.radius - 1) < 1e-3 and circle.normal @ back.normal < -0.999:
                try:
                    test = circular_test(nominal[task].actual, nominal[other].actual, circle)
                except MotionError:
                    continue  # it did not get all the way round, which the table of errors tells
                found.append((entry, f"{task}, {other}", test))
    return found
