"""The ISO-style figures of a report, from saved runs: the rigs and seeds of the sweep are the cycles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from benchmarks.compare.courses import circle_of, every_run
from benchmarks.compare.table import Comparison, Entry
from benchmarks.sweep import Series
from benchmarks.sweep.cell import NOMINAL
from controllers.metrics import Circle, CircularTest, circular_test
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
class Turns:
    """A setting on a circle and its reverse, named by their paths; test: None where there is none, note: why."""

    entry: Entry
    paths: str
    circle: Circle
    test: CircularTest | None
    note: str = ""


@dataclass(frozen=True, slots=True)
class IsoBlock:
    """Lines of the paths in space, and the circular tests by setting."""

    lines: tuple[Line, ...]
    circles: tuple[Turns, ...]


def iso_block(comparison: Comparison, entries: Sequence[Entry]) -> IsoBlock:
    """Path and pose accuracy and repeatability of each setting, and circular tests where a circle is run both ways."""
    all_runs = {entry: every_run(comparison, entry) for entry in entries}
    lines = [
        _of_path(entry, task, [series for (of, _, _), series in runs.items() if of == task])
        for task in comparison.tasks
        if comparison.about(task)["space"]
        for entry, runs in all_runs.items()
    ]
    nominal: dict[tuple[Entry, str], Series] = {}
    for entry, runs in all_runs.items():
        for (task, rig, _), series in runs.items():
            if rig == NOMINAL.name and comparison.about(task)["space"]:
                nominal.setdefault((entry, task), series)
    return IsoBlock(tuple(lines), tuple(_circles(entries, nominal)))


def _of_path(entry: Entry, task: str, runs: Sequence[Series]) -> Line:
    if not runs or len(np.unique(runs[0].s)) < 3:
        return Line(entry, task, {}, "no run that held")
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


def _circles(entries: Sequence[Entry], nominal: Mapping[tuple[Entry, str], Series]) -> Iterator[Turns]:
    """Of each setting all pairs of circles that are one another's reverse."""
    planned = {task: series for (_, task), series in nominal.items()}
    round_ = {task: circle for task, series in planned.items() if (circle := circle_of(series)) is not None}
    for (task, circle), (other, back) in combinations(round_.items(), 2):
        near = np.linalg.norm(circle.centre - back.centre) < 1e-3 * circle.radius
        if near and abs(circle.radius / back.radius - 1) < 1e-3 and circle.normal @ back.normal < -0.999:
            for entry in entries:
                yield _turns(entry, (task, other), circle, nominal)


def _turns(entry: Entry, tasks: tuple[str, str], circle: Circle, nominal: Mapping[tuple[Entry, str], Series]) -> Turns:
    paths = ", ".join(tasks)
    try:
        there, back = (nominal[entry, task].actual for task in tasks)
        return Turns(entry, paths, circle, circular_test(there, back, circle))
    except KeyError as missing:
        return Turns(entry, paths, circle, None, f"no run of {missing.args[0][1]} that held")
    except MotionError as error:
        return Turns(entry, paths, circle, None, f"does not complete the turn: {error}")
