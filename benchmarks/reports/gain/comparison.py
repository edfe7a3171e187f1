"""Every setting on every path against a baseline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import exp, inf, isfinite, log
from statistics import fmean
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.reports.gain.criteria import (
    About,
    compare_figures,
    mean_of,
    measure_ratios,
    weigh,
)
from benchmarks.sweep import RunResult, SavedRuns, Setting, read_setting
from benchmarks.sweep.result import NOMINAL, figure_unit, setting_columns
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RANK = "contour_rms"
"""The figure by which settings are compared."""
DEFAULT_BASELINE = "closed-position:gain=0.7"
"""The baseline where none is given: the law and the gain that [Sahbaz 2007, chapter 7]
recommends.
"""
UNSTABLE_SHARE = 0.1
"""A run that is not at its goal at the end of the record, and whose RMS tracking error is more than
this share of the path's extent, is unstable.
"""
MIN_DIFFERENCE_SHARE = 0.01
"""A difference of less is not worth a mark."""
ERROR_FLOOR_PULSES = 0.01
"""Of the rig's smallest pulse, as a distance on the path: an error of less is rounding, which no
rig could show.
"""
DEFAULT_RESOLUTION = 1e-7
"""m or rad: the pulse of runs that were saved without one; coarse for a drive, and far above
rounding.
"""
SAME_RATIO = 1e-9
"""Relative difference of errors below which a gain changed nothing."""
Pairing = tuple[str, int]


@dataclass(frozen=True, slots=True)
class RunGroup:
    """The runs of a setting on a path, by rig and seed.

    equal_rigs  variations that were not run, because they equal an earlier one: name -> earlier
                name
    random      whether the seed changes the run; if not, one run represents all seeds
    """

    equal_rigs: Mapping[str, str] = field(default_factory=dict)
    random: bool = True
    runs: dict[Pairing, RunResult] = field(default_factory=dict)

    def find(self, pairing: Pairing) -> RunResult | None:
        """Return the run with this rig and seed, or the equal run that represents it; None if
        neither exists.
        """
        rig, seed = pairing
        rig = self.equal_rigs.get(rig, rig)
        if (rig, seed) in self.runs or self.random:
            return self.runs.get((rig, seed))
        return next((run for (other, _), run in self.runs.items() if other == rig), None)


def make_group(record: Mapping[str, Any], law: str) -> RunGroup:
    """Return an empty group for the runs of a law; older records do not say which runs are
    equal.
    """
    random = law in record.get("random_laws", [law])
    return RunGroup(record.get("equal_rigs", {}), random)


@dataclass(frozen=True, slots=True)
class SettingEntry:
    """A setting, and which saved runs it is of: their number among several, from 0."""

    source: int
    setting: Setting


@dataclass(frozen=True, slots=True)
class BaselineRatio:
    """An error over the baseline's on the same rig with the same seed: geometric mean, least and
    largest.

    ratios    by the criteria of a verdict, as they count, the geometric mean of each
    measured  the same as measured, also below what counts

    mark  "better" or "worse" where it is so, by more than 1 %, on every rig and seed that was
          tried; else "neither". The rigs are chosen, no sample of a population, so nothing is said
          of others.
    """

    ratio: float
    least: float
    largest: float
    ratios: Mapping[str, float] = field(default_factory=dict)
    measured: Mapping[str, float] = field(default_factory=dict)

    @property
    def mark(self) -> str:
        if self.largest < 1 - MIN_DIFFERENCE_SHARE:
            return "better"
        return "worse" if self.least > 1 + MIN_DIFFERENCE_SHARE else "neither"


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """A setting on a path.

    figures   mean over the seeds on the rig as stated; none where a run of those failed
    spread    least and largest RMS contour error of all rigs and seeds that did not fail
    failures  (rig, reason) of every run that failed
    away      how many runs are not within `END_BAND` pulses of their goal at the end of the record
    unstable  how many failed, or are away and err by more than `UNSTABLE_SHARE` of the path's
              extent
    against   the baseline on the same path; None where either failed on a rig, of the baseline
              itself, and where the path is not ranked
    """

    entry: SettingEntry
    task: str
    runs: int
    figures: Mapping[str, float]
    spread: tuple[float, float] | None
    failures: tuple[tuple[str, str], ...]
    away: int
    unstable: int
    against: BaselineRatio | None

    @property
    def worst(self) -> float:
        """The largest RMS contour error of all rigs and seeds, m or rad; infinite where it is
        unstable on any.
        """
        return inf if self.unstable or self.spread is None else self.spread[1]

    @property
    def stable(self) -> bool:
        """On every rig and seed."""
        return not self.unstable


@dataclass(frozen=True, slots=True)
class Comparison(Result):
    """All rows of a comparison, setting by setting, and the runs behind them.

    ranked  the tasks by which settings are ranked: those that no stable run stays on to less than
            the floor. On the others, as where two like axes go straight, an error to the path tells
            nothing of how it was tracked.
    """

    sources: tuple[SavedRuns, ...]
    baseline: SettingEntry
    rows: tuple[ComparisonRow, ...]
    tasks: tuple[str, ...]
    ranked: tuple[str, ...]

    def tables(self) -> tuple[Table, ...]:
        """Every row: the error to the path on all rigs, over the baseline's, and the runs that did
        not hold.

        The worst rig's is infinite where a run is unstable.
        """
        rows, against = self.rows, [row.against for row in self.rows]
        units = (
            [self.unit(RANK, row.task) for row in rows]
            if self.sources
            else ["m or rad"] * len(rows)
        )
        errors: dict[str, list[float | None]] = {
            "contour RMS": [row.figures.get(RANK) for row in rows],
            "best rig": [row.spread and row.spread[0] for row in rows],
            "worst rig": [row.worst for row in rows],
        }
        ratios = (
            Column(
                name, [None if one is None else getattr(one, field) for one in against], form=".3f"
            )
            for name, field in (
                ("ratio", "ratio"),
                ("least", "least"),
                ("most", "largest"),
                ("mark", "mark"),
            )
        )
        columns = (
            *setting_columns([row.entry.setting for row in rows]),
            Column("path", [row.task for row in rows]),
            *(Column(name, values, units, "micro", ".4g") for name, values in errors.items()),
            *ratios,
            Column("peak torque", [row.figures.get("torque_peak") for row in rows], form=".3f"),
            Column("runs", [row.runs for row in rows]),
            Column("unstable", [row.unstable for row in rows]),
            Column("off its goal", [row.away for row in rows]),
            Column("failed", [len(row.failures) for row in rows]),
        )
        return (
            Table(
                f"settings, and their errors over those of {self.baseline.setting.text}", columns
            ),
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the mean ratio to the baseline of each setting that holds on every ranked path."""
        from kinematics.foundation.figure import draw_bars

        ratios = {entry.setting.text: self.mean_ratio(entry) for entry in self.entries}
        held = {name: ratio for name, ratio in ratios.items() if isfinite(ratio)}
        return draw_bars(
            [*held],
            [*held.values()],
            "RMS contour error over the baseline's, mean over paths",
            ax,
            1.0,
        )

    @property
    def entries(self) -> tuple[SettingEntry, ...]:
        return tuple(dict.fromkeys(row.entry for row in self.rows))

    def row(self, entry: SettingEntry, task: str) -> ComparisonRow | None:
        """None where a setting was not run on a path."""
        return next((row for row in self.rows if row.entry == entry and row.task == task), None)

    def of(self, entry: SettingEntry) -> list[ComparisonRow]:
        return [row for row in self.rows if row.entry == entry]

    def runs(self, entry: SettingEntry, task: str) -> list[RunResult]:
        """Of a setting on a path, with every rig and seed."""
        every = self.sources[entry.source].results.values()
        return [one for one in every if one.cell.setting == entry.setting and one.cell.task == task]

    def fault(self, entry: SettingEntry) -> str:
        """Return why a setting is struck out; empty where it holds.

        It holds where it was run on every ranked path, is stable there on every rig and seed, and
        on none of them ends off its goal in a larger share of its runs than the baseline. A path
        that is not ranked strikes out nothing; where no path is ranked, all of them count. The
        verdict, the ranking and the figure all ask here.
        """
        tasks = self.ranked or self.tasks
        rows = {row.task: row for row in self.of(entry) if row.task in tasks}
        own = {task: row.away / row.runs for task, row in rows.items()}
        base = {row.task: row.away / row.runs for row in self.of(self.baseline)}
        for why, faulty in (
            ("not run on", [task for task in tasks if task not in rows]),
            ("failed or unstable on", [task for task, row in rows.items() if row.unstable]),
            (
                "off its goal more often than the baseline on",
                [task for task in own if own[task] > base.get(task, 1.0)],
            ),
        ):
            if faulty:
                return f"{why} {', '.join(faulty)}"
        return ""

    def mean_ratio(self, entry: SettingEntry) -> float:
        """Geometric mean of the ratios to the baseline over ranked paths; infinite where `fault`
        names one.
        """
        rows = [row for row in self.of(entry) if row.task in self.ranked]
        ratios = [inf if row.against is None else row.against.ratio for row in rows]
        held = all(map(isfinite, ratios)) and not self.fault(entry)
        return exp(fmean(map(log, ratios))) if ratios and held else inf

    def ratios(self, entry: SettingEntry) -> dict[str, float]:
        """By the criteria of a verdict, over the baseline: geometric means over ranked paths, those
        that all have.
        """
        rows = [row for row in self.of(entry) if row.task in self.ranked]
        return mean_of([row.against.ratios for row in rows if row.against is not None])

    def measured(self, entry: SettingEntry) -> dict[str, float]:
        """Return the same as measured, also where a difference is too small to count."""
        rows = [row for row in self.of(entry) if row.task in self.ranked]
        return mean_of([row.against.measured for row in rows if row.against is not None])

    def score(self, entry: SettingEntry) -> float:
        """What a verdict ranks by: all criteria weighed, below 1 where it beats the baseline; inf
        as `mean_ratio`.
        """
        return weigh(self.ratios(entry)) if isfinite(self.mean_ratio(entry)) else inf

    def rank(self) -> list[SettingEntry]:
        """The settings other than the baseline that hold, the best by all criteria weighed
        first.
        """
        return [entry for alike in self.rank_alike() for entry in alike]

    def rank_alike(self) -> list[tuple[SettingEntry, ...]]:
        """The same in groups: settings of one law that come out alike by all criteria, the nearest
        to its usual gains first.
        """
        groups: list[list[SettingEntry]] = []
        scores = {entry: self.score(entry) for entry in self.entries}
        ratios = {
            entry: [one, self.mean_ratio(entry), *self.ratios(entry).values()]
            for entry, one in scores.items()
        }
        for entry in sorted(
            (one for one in scores if isfinite(scores[one])), key=scores.__getitem__
        ):
            same = (
                group
                for group in groups
                if (group[0].source, group[0].setting.law) == (entry.source, entry.setting.law)
                and np.allclose(ratios[group[0]], ratios[entry], rtol=SAME_RATIO, atol=0.0)
            )
            alike = next(same, None)
            if alike is None:
                groups.append([entry])
            else:
                alike.append(entry)
        return [
            tuple(sorted(group, key=lambda one: _find_distance(one.setting))) for group in groups
        ]

    def about(self, task: str) -> Mapping[str, Any]:
        """What the record of the runs says of a task."""
        return _task_record(self.sources, task)

    def criteria_of(self, task: str) -> About:
        """What the criteria of a verdict need to know of a path."""
        return _criteria_of(self.sources, task)

    def floor(self, task: str) -> float:
        """m or rad: errors of less are not told apart on this path."""
        return _floor(self.sources, task)

    def label(self, entry: SettingEntry) -> str:
        """Of a setting; with the name of its runs, where there are several."""
        several = len(self.sources) > 1
        return (
            f"{self.sources[entry.source].name}: {entry.setting.label}"
            if several
            else entry.setting.label
        )

    def unit(self, figure: str, task: str) -> str:
        """SI unit of a figure on a path; empty for shares, and where axes of two kinds have it."""
        return figure_unit(
            figure, task, next(of.record for of in self.sources if task in of.record["tasks"])
        )


@check_arguments()
def compare(sources: Sequence[SavedRuns], baseline: str | None = None) -> Comparison:
    """Compare every setting of saved runs on every path.

    Parameters
    ----------
    sources
        Runs of one sweep or several.
    baseline
        As `read_setting` reads it, of the first runs that have it. None: `DEFAULT_BASELINE` where
        that was run, else
        the first setting.

    Returns
    -------
    Comparison
        The settings, ranked.

    Raises
    ------
    MotionError
        There are no runs, or not those of the baseline.
    """
    groups: dict[tuple[SettingEntry, str], RunGroup] = {}
    for n, source in enumerate(sources):
        for result in source.results.values():
            cell = result.cell
            key = SettingEntry(n, cell.setting), cell.task
            if key not in groups:
                groups[key] = make_group(source.record, cell.setting.law)
            groups[key].runs[cell.variation.name, cell.seed] = result
    if not groups:
        raise MotionError("compare: there are no runs")
    entries = list(dict.fromkeys(entry for entry, _ in groups))
    against = _baseline(entries, baseline)
    tasks = tuple(dict.fromkeys(task for _, task in groups))
    largest = {task: UNSTABLE_SHARE * _extent(sources, task) for task in tasks}
    ranked = tuple(
        task
        for task in tasks
        if not any(
            result.figures[RANK] < _floor(sources, task)
            for (_, of), group in groups.items()
            if of == task
            for result in group.runs.values()
            if not _is_unstable(result, largest[task])
        )
    )
    rows = tuple(
        _row(
            entry,
            task,
            groups,
            against,
            largest[task],
            _criteria_of(sources, task) if task in ranked else None,
        )
        for entry, task in groups
    )
    return Comparison(tuple(sources), against, rows, tasks, ranked)


def _find_distance(setting: Setting) -> tuple[int, float]:
    """How far a setting is from the law's usual gains: how many differ, and by how much."""
    usual = dict(read_setting(setting.law).gains)
    off = [abs(value - usual[gain]) for gain, value in setting.gains]
    return sum(each > 0 for each in off), sum(off)


def _task_record(sources: Sequence[SavedRuns], task: str) -> Mapping[str, Any]:
    return next(dict(of.record["tasks"][task]) for of in sources if task in of.record["tasks"])


def _floor(sources: Sequence[SavedRuns], task: str) -> float:
    return ERROR_FLOOR_PULSES * float(
        _task_record(sources, task).get("resolution", DEFAULT_RESOLUTION)
    )


def _criteria_of(sources: Sequence[SavedRuns], task: str) -> dict[str, Any]:
    """What the criteria need to know of a path; runs that were saved without pulses have none, and
    no vibration.
    """
    records = [of.record for of in sources if task in of.record["tasks"]]
    return {"floor": _floor(sources, task), "pulses": records[0].get("pulses", {})}


def _extent(sources: Sequence[SavedRuns], task: str) -> float:
    """Diagonal of the box about the planned path, m or rad; infinite where no run held."""
    for source in sources:
        for key, result in source.results.items():
            series = None if result.failure or result.cell.task != task else source.series(key)
            if series is not None:
                return float(np.linalg.norm(np.ptp(series.planned, axis=0)))
    return inf


def _baseline(entries: Sequence[SettingEntry], text: str | None) -> SettingEntry:
    wanted = read_setting(text or DEFAULT_BASELINE)
    found = next((entry for entry in entries if entry.setting == wanted), None)
    if found is None and text is not None:
        known = ", ".join(dict.fromkeys(entry.setting.text for entry in entries))
        raise MotionError(f"compare: the baseline {wanted.text} is not among the runs: {known}")
    return found or entries[0]


def _row(
    entry: SettingEntry,
    task: str,
    groups: Mapping[tuple[SettingEntry, str], RunGroup],
    baseline: SettingEntry,
    largest: float,
    about: About | None,
) -> ComparisonRow:
    group = groups[entry, task]
    runs = group.runs
    nominal = [result.figures for (rig, _), result in runs.items() if rig == NOMINAL.name]
    errors = [result.figures[RANK] for result in runs.values() if not result.failure]
    others = groups.get((baseline, task), RunGroup())
    return ComparisonRow(
        entry,
        task,
        len(runs),
        _mean(nominal) if nominal and all(nominal) else {},
        (min(errors), max(errors)) if errors else None,
        tuple((rig, result.failure) for (rig, _), result in runs.items() if result.failure),
        sum(map(is_away, runs.values())),
        sum(_is_unstable(result, largest) for result in runs.values()),
        None if about is None or entry == baseline else _compare_errors(group, others, about),
    )


def is_away(result: RunResult) -> bool:
    """Whether a run is not within `END_BAND` pulses of its goal at the end of the record."""
    return result.figures.get("end_time") == inf


def _is_unstable(result: RunResult, largest: float) -> bool:
    """The tracking error counts: a run that stays where it starts is on the path all the time."""
    return bool(result.failure) or (is_away(result) and result.figures["tracking_rms"] > largest)


def _mean(figures: Sequence[Mapping[str, float]]) -> dict[str, float]:
    return {
        name: fmean(one[name] for one in figures)
        for name in figures[0]
        if all(name in one for one in figures)
    }


def _compare_errors(own: RunGroup, base: RunGroup, about: About) -> BaselineRatio | None:
    pairs = []
    for pairing in dict.fromkeys([*own.runs, *base.runs]):
        run, other = own.find(pairing), base.find(pairing)
        if run is None:  # of the baseline alone
            continue
        if other is None or run.failure or other.failure:
            return None
        pairs.append((run, other))
    if not pairs:
        return None
    each = [compare_figures(run.figures, other.figures, about) for run, other in pairs]
    errors = [one["contour error"] for one in each]
    mean = exp(fmean(map(log, errors)))
    measured = [measure_ratios(run.figures, other.figures, about) for run, other in pairs]
    return BaselineRatio(mean, min(errors), max(errors), mean_of(each), mean_of(measured))
