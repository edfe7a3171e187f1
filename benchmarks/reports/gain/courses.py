"""How the runs that a report shows went over time, what their paths are, and their ISO-style
figures.

The runs are saved ones. The cycles are those of the rig as stated, one for each seed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from benchmarks.reports.gain.comparison import Comparison, SettingEntry
from benchmarks.reports.gain.verdict import Verdict
from benchmarks.sweep import RunSeries
from benchmarks.sweep.result import NOMINAL
from controllers.metrics import Circle, CircularTest, circular_test
from controllers.metrics.iso_style import Stations, path_accuracy, pose_accuracy
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun

MAX_SETTINGS_DRAWN = 5
"""Settings that share the axes of a figure: more lines are not told apart."""
CIRCLE_TOLERANCE_SHARE = 1e-6
"""Of the radius, by which a circle's points may be off it: they are kept in single precision."""


@dataclass(frozen=True, slots=True)
class SettingSeries:
    """The series of some settings on the rig as stated, with the first seed; those that failed
    there are missing.
    """

    entries: tuple[SettingEntry, ...]
    series: Mapping[tuple[SettingEntry, str], RunSeries]

    def select_task(self, task: str) -> list[tuple[SettingEntry, RunSeries]]:
        return [
            (entry, self.series[entry, task])
            for entry in self.entries
            if (entry, task) in self.series
        ]


def select_series(comparison: Comparison, verdict: Verdict) -> SettingSeries:
    """Of the baseline, the best, that of the least error, and the best setting of each of the next
    best laws.
    """
    named = (comparison.baseline, verdict.best, verdict.least)
    chosen = list(dict.fromkeys(entry for entry in named if entry is not None))
    laws = {entry.setting.law for entry in chosen}
    for entry in comparison.rank():
        if len(chosen) < MAX_SETTINGS_DRAWN and entry.setting.law not in laws:
            chosen.append(entry)
            laws.add(entry.setting.law)
    found: dict[tuple[SettingEntry, str], RunSeries] = {}
    for entry in chosen:
        for (task, rig, _), series in collect_series(comparison, entry).items():
            if rig == NOMINAL.name:
                found.setdefault((entry, task), series)
    return SettingSeries(tuple(chosen), found)


def collect_series(
    comparison: Comparison, entry: SettingEntry
) -> dict[tuple[str, str, int], RunSeries]:
    """The series of all runs of a setting that did not fail, by path, rig and seed."""
    source, found = comparison.sources[entry.source], {}
    for key, result in source.results.items():
        cell = result.cell
        if cell.setting == entry.setting and not result.failure:
            series = source.series(key)
            if series is not None:
                found[cell.task, cell.variation.name, cell.seed] = series
    return found


def path_offsets(series: RunSeries) -> Array:
    """(N, d) from the nearest point of the path, among those planned within half a second, to the
    actual one.
    """
    planned, actual = series.planned, series.actual
    step = max(float(series.t[1] - series.t[0]), 1e-9)
    reach = int(0.5 / step)
    side = np.diff(planned, axis=0)
    length2 = np.maximum((side**2).sum(1), 1e-30)
    out = np.empty_like(actual)
    for k, point in enumerate(actual):
        window = slice(max(k - reach, 0), min(k + reach, len(side)))
        offset = point - planned[window]
        share = np.clip((offset * side[window]).sum(1) / length2[window], 0.0, 1.0)
        offset = offset - share[:, None] * side[window]
        out[k] = offset[int(np.argmin((offset**2).sum(1)))]
    return out


def fit_circle(series: RunSeries) -> Circle | None:
    """The full circle that a planned path in space is, its normal by the right hand; None of any
    other path.
    """
    points = series.planned
    middle = points.mean(0)
    _, size, axes = np.linalg.svd(points - middle, full_matrices=False)
    if (
        size[1] <= CIRCLE_TOLERANCE_SHARE * size[0]
        or size[2] > 10 * CIRCLE_TOLERANCE_SHARE * size[0]
    ):
        return None
    flat = (points - middle) @ axes[:2].T
    solved = np.linalg.lstsq(
        np.column_stack([2 * flat, np.ones(len(flat))]), (flat**2).sum(1), rcond=None
    )[0]
    radius = float(np.sqrt(solved[2] + solved[:2] @ solved[:2]))
    arms = flat - solved[:2]
    off = np.abs(np.linalg.norm(arms, axis=1) - radius).max()
    turned = float(np.ptp(np.unwrap(np.arctan2(arms[:, 1], arms[:, 0]))))
    if off > 10 * CIRCLE_TOLERANCE_SHARE * radius or turned < 2 * np.pi * (1 - 1e-3):
        return None
    centre = middle + solved[:2] @ axes[:2]
    quarter = len(points) // 8
    normal = sum(
        np.cross(points[k] - centre, points[k + 1] - centre)
        for k in range(0, len(points) - 1, max(quarter // 8, 1))
    )
    speed = np.linalg.norm(np.diff(points, axis=0), axis=1).max() / (series.t[1] - series.t[0])
    return Circle(centre, np.asarray(normal), radius, float(speed))


STATIONS = 50
"""Evenly along the path, the first and the last half a distance from its ends."""


ISO = ("path accuracy AT", "path repeatability RT", "pose accuracy AP", "pose repeatability RP")


@dataclass(frozen=True, slots=True)
class IsoRow:
    """Figures of `ISO` of a setting on a path, m.

    note  of how many cycles they are, or why some are missing
    """

    entry: SettingEntry
    path: str
    values: Mapping[str, float]
    note: str


@dataclass(frozen=True, slots=True)
class CirclePair:
    """A setting on a circle and its reverse, named by their paths; test: None where there is none,
    note: why.
    """

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
    """Path and pose accuracy and repeatability of each setting, and circular tests where a circle
    is run both ways.
    """
    all_runs = {entry: collect_series(comparison, entry) for entry in entries}
    lines = [
        _iso_row(entry, task, select_cycles(runs, task))
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


def select_cycles(runs: Mapping[tuple[str, str, int], RunSeries], task: str) -> list[RunSeries]:
    """Return the runs of a path on the rig as stated that are repetitions of one another.

    Those with other inertia or friction are other rigs. Runs without anything random are all alike:
    one is returned.
    """
    cycles: list[RunSeries] = []
    for (of, rig, _), series in runs.items():
        if of == task and rig == NOMINAL.name:
            cycles.append(series)
    if all(np.array_equal(one.actual, cycles[0].actual) for one in cycles[1:]):
        return cycles[:1]
    return cycles


def _iso_row(entry: SettingEntry, task: str, runs: Sequence[RunSeries]) -> IsoRow:
    if not runs or len(np.unique(runs[0].s)) < 3:
        return IsoRow(entry, task, {}, "no run that held")
    shortest = min(len(series.t) for series in runs)
    first = runs[0]
    # a path is measured from two cycles on: a single one is measured against itself
    cycles = runs if len(runs) > 1 else [first, first]
    paths = np.stack([series.actual[:shortest] for series in cycles], axis=1)
    try:
        path = path_accuracy(paths, _choose_stations(first))
        pose = pose_accuracy(paths[-1], first.planned[-1])
    except MotionError as error:
        return IsoRow(entry, task, {}, str(error))
    values = dict(zip(ISO, (path.at_p, path.rt_p, pose.accuracy, pose.repeatability), strict=True))
    if len(runs) > 1:
        return IsoRow(entry, task, values, count_noun(len(runs), "cycle"))
    accuracies = {name: value for name, value in values.items() if "accuracy" in name}
    return IsoRow(
        entry, task, accuracies, "1 run: nothing in it is random, so that it repeats exactly"
    )


def _choose_stations(series: RunSeries) -> Stations:
    """Return `STATIONS` places along the planned path, with the directions there."""
    s, keep = np.unique(series.s, return_index=True)
    points = series.planned[keep]
    at = s[0] + (s[-1] - s[0]) * (np.arange(STATIONS) + 0.5) / STATIONS
    after = np.clip(np.searchsorted(s, at), 1, len(s) - 1)
    side = points[after] - points[after - 1]
    share = (at - s[after - 1]) / (s[after] - s[after - 1])
    normals = side / np.linalg.norm(side, axis=1)[:, None]
    return Stations(points[after - 1] + share[:, None] * side, normals)


def _find_circle_pairs(
    entries: Sequence[SettingEntry], nominal: Mapping[tuple[SettingEntry, str], RunSeries]
) -> Iterator[CirclePair]:
    """Of each setting all pairs of circles that are one another's reverse."""
    planned = {task: series for (_, task), series in nominal.items()}
    round_ = {
        task: circle
        for task, series in planned.items()
        if (circle := fit_circle(series)) is not None
    }
    for (task, circle), (other, back) in combinations(round_.items(), 2):
        near = np.linalg.norm(circle.centre - back.centre) < 1e-3 * circle.radius
        if (
            near
            and abs(circle.radius / back.radius - 1) < 1e-3
            and circle.normal @ back.normal < -0.999
        ):
            for entry in entries:
                yield _test_circle_pair(entry, (task, other), circle, nominal)


def _test_circle_pair(
    entry: SettingEntry,
    tasks: tuple[str, str],
    circle: Circle,
    nominal: Mapping[tuple[SettingEntry, str], RunSeries],
) -> CirclePair:
    paths = ", ".join(tasks)
    try:
        there, back = (nominal[entry, task].actual for task in tasks)
        return CirclePair(entry, paths, circle, circular_test(there, back, circle))
    except KeyError as missing:
        return CirclePair(entry, paths, circle, None, f"no run of {missing.args[0][1]} that held")
    except MotionError as error:
        return CirclePair(entry, paths, circle, None, f"does not complete the turn: {error}")
