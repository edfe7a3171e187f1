"""The ISO-style figures of a report, from saved runs: the rigs and seeds of the sweep are the cycles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from benchmarks.reports.gain.comparison import Comparison, SettingEntry
from benchmarks.reports.gain.courses import collect_series, fit_circle
from benchmarks.sweep import RunSeries
from benchmarks.sweep.cell import NOMINAL
from controllers.metrics import Circle, CircularTest, circular_test
from controllers.metrics.pose_and_path_accuracy import Stations, path_accuracy, pose_accuracy
from kinematics.foundation.errors import MotionError

STATIONS = 50
"""Evenly along the path, the first and the last half a distance from its ends."""


ISO = ("path accuracy AT", "path repeatability RT", "pose accuracy AP", "pose repeatability RP")


@dataclass(frozen=True, slots=True)
class IsoRow:
    """The figures of `ISO` of a setting on a path, m; note: of how many cycles, or why there are none."""

    entry: SettingEntry
    path: str
    values: Mapping[str, float]
    note: str


@dataclass(frozen=True, slots=True)
class CirclePair:
    """A setting on a circle and its reverse, named by their paths; test: None where there is none, note: why."""

    entry: SettingEntry
    paths: str
    circle: Circle
    test: CircularTest | None
    note: str = ""


@dataclass(frozen=True, slots=True)
class IsoBlock:
    """Lines of the paths in space, and the circular tests by setting."""

    lines: tuple[IsoRow, ...]
    circles: tuple[CirclePair, ...]


def iso_block(comparison: Comparison, entries: Sequence[SettingEntry]) -> IsoBlock:
    """Path and pose accuracy and repeatability of each setting, and circular tests where a circle is run both ways."""
    all_runs = {entry: collect_series(comparison, entry) for entry in entries}
    lines = [
        _iso_row(entry, task, [series for (of, _, _), series in runs.items() if of == task])
        for task in comparison.tasks
        if comparison.about(task)["space"]
        for entry, runs in all_runs.items()
    ]
    nominal: dict[tuple[SettingEntry, str], RunSeries] = {}
    for entry, runs in all_runs.items():
        for (task, rig, _), series in runs.items():
            if rig == NOMINAL.name and comparison.about(task)["space"]:
                nominal.setdefault((entry, task), series)
    return IsoBlock(tuple(lines), tuple(_find_circle_pairs(entries, nominal)))


def _iso_row(entry: SettingEntry, task: str, runs: Sequence[RunSeries]) -> IsoRow:
    if not runs or len(np.unique(runs[0].s)) < 3:
        return IsoRow(entry, task, {}, "no run that held")
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
        return IsoRow(entry, task, {}, str(error))
    values = (path.at_p, path.rt_p, pose.accuracy, pose.repeatability)
    return IsoRow(entry, task, dict(zip(ISO, values, strict=True)), f"{len(runs)} cycles")


def _find_circle_pairs(
    entries: Sequence[SettingEntry], nominal: Mapping[tuple[SettingEntry, str], RunSeries]
) -> Iterator[CirclePair]:
    """Of each setting all pairs of circles that are one another's reverse."""
    planned = {task: series for (_, task), series in nominal.items()}
    round_ = {task: circle for task, series in planned.items() if (circle := fit_circle(series)) is not None}
    for (task, circle), (other, back) in combinations(round_.items(), 2):
        near = np.linalg.norm(circle.centre - back.centre) < 1e-3 * circle.radius
        if near and abs(circle.radius / back.radius - 1) < 1e-3 and circle.normal @ back.normal < -0.999:
            for entry in entries:
                yield _test_circle_pair(entry, (task, other), circle, nominal)


def _test_circle_pair(
    entry: SettingEntry, tasks: tuple[str, str], circle: Circle, nominal: Mapping[tuple[SettingEntry, str], RunSeries]
) -> CirclePair:
    paths = ", ".join(tasks)
    try:
        there, back = (nominal[entry, task].actual for task in tasks)
        return CirclePair(entry, paths, circle, circular_test(there, back, circle))
    except KeyError as missing:
        return CirclePair(entry, paths, circle, None, f"no run of {missing.args[0][1]} that held")
    except MotionError as error:
        return CirclePair(entry, paths, circle, None, f"does not complete the turn: {error}")
