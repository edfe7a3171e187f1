"""Every setting on every path against a baseline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, inf, isfinite, log, sqrt
from statistics import fmean, stdev

from benchmarks.sweep import Result, Runs, Setting, read_setting
from benchmarks.sweep.cell import NOMINAL
from kinematics.errors import MotionError

RANK = "contour_rms"
"""The figure by which settings are compared."""
USUAL = "closed-position:gain=0.7"
"""The baseline where none is given: the law and the gain that [Sahbaz 2007, chapter 7] recommends."""
LEVEL = 0.95
"""Of the interval of a ratio."""
UNSTABLE = 10.0
"""A run that never comes to rest and errs by more than so many times the baseline on the same rig is unstable."""
LEAST = 0.01
"""A difference of less is not worth a mark, however sure it is."""
Pairing = tuple[str, int]


@dataclass(frozen=True, slots=True)
class Entry:
    """A setting, and which saved runs it is of: their number among several, from 0."""

    source: int
    setting: Setting


@dataclass(frozen=True, slots=True)
class Against:
    """An error over the baseline's: geometric mean over rigs and seeds, each paired with its own, and its interval.

    mark  "better" or "worse" where the whole interval and at least 1 % of difference lie on that side; else
          "insignificant". One pair tells nothing of the spread: its interval is infinite.
    """

    ratio: float
    low: float
    high: float

    @property
    def mark(self) -> str:
        if self.high < 1 and self.ratio <= 1 - LEAST:
            return "better"
        return "worse" if self.low > 1 and self.ratio >= 1 + LEAST else "insignificant"


@dataclass(frozen=True, slots=True)
class Row:
    """A setting on a path.

    figures   mean over the seeds on the rig as stated; none where a run of those failed
    spread    least and largest RMS contour error of all rigs and seeds that did not fail
    failures  (rig, reason) of every run that failed
    restless  how many runs never came to rest
    unstable  how many failed, or never came to rest and err by more than `UNSTABLE` times the baseline
    against   the baseline on the same path; None where either failed on a rig, and of the baseline itself
    """

    entry: Entry
    task: str
    runs: int
    figures: Mapping[str, float]
    spread: tuple[float, float] | None
    failures: tuple[tuple[str, str], ...]
    restless: int
    unstable: int
    against: Against | None

    @property
    def stable(self) -> bool:
        """On every rig and seed."""
        return not self.unstable


@dataclass(frozen=True, slots=True)
class Comparison:
    """All rows, setting by setting, and what they were made of."""

    sources: tuple[Runs, ...]
    baseline: Entry
    rows: tuple[Row, ...]
    tasks: tuple[str, ...]

    @property
    def entries(self) -> tuple[Entry, ...]:
        return tuple(dict.fromkeys(row.entry for row in self.rows))

    def row(self, entry: Entry, task: str) -> Row | None:
        """None where a setting was not run on a path."""
        return next((row for row in self.rows if row.entry == entry and row.task == task), None)

    def of(self, entry: Entry) -> list[Row]:
        return [row for row in self.rows if row.entry == entry]

    def label(self, entry: Entry) -> str:
        """Of a setting; with the name of its runs, where there are several."""
        several = len(self.sources) > 1
        return f"{self.sources[entry.source].name}: {entry.setting.label}" if several else entry.setting.label

    def unit(self, figure: str, task: str) -> str:
        """SI unit of a figure on a path; empty for shares, and where axes of two kinds have it."""
        from controllers.metrics import FIGURES

        record = next(source.record for source in self.sources if task in source.record["tasks"])
        name, _, axis = figure.partition(".")
        unit = next((one.unit for one in FIGURES if one.name == name), "")
        kinds = {record["axes"].get(axis)} if axis else set(record["axes"].values())
        own = kinds.pop() if len(kinds) == 1 else ""
        return unit.replace("path", record["tasks"][task]["unit"]).replace("axis", own or "").removeprefix("1")


def compare(sources: Sequence[Runs], baseline: str | None = None) -> Comparison:
    """Every setting of the saved runs on every path.

    baseline: as `read_setting` reads it, of the first runs that have it. Without one it is `USUAL` where that was run,
    else the first setting. Raises MotionError where there are no runs, or not those of the baseline.
    """
    groups: dict[tuple[Entry, str], dict[Pairing, Result]] = {}
    for n, source in enumerate(sources):
        for result in source.results.values():
            cell = result.cell
            group = groups.setdefault((Entry(n, cell.setting), cell.task), {})
            group[cell.variation.name, cell.seed] = result
    if not groups:
        raise MotionError("compare: there are no runs")
    entries = list(dict.fromkeys(entry for entry, _ in groups))
    against = _baseline(entries, baseline)
    rows = tuple(_row(entry, task, groups, against) for entry, task in groups)
    return Comparison(tuple(sources), against, rows, tuple(dict.fromkeys(task for _, task in groups)))


def _baseline(entries: Sequence[Entry], text: str | None) -> Entry:
    wanted = read_setting(text or USUAL)
    found = next((entry for entry in entries if entry.setting == wanted), None)
    if found is None and text is not None:
        known = ", ".join(dict.fromkeys(entry.setting.text for entry in entries))
        raise MotionError(f"compare: the baseline {wanted.text} is not among the runs: {known}")
    return found or entries[0]


def _row(entry: Entry, task: str, groups: Mapping[tuple[Entry, str], dict[Pairing, Result]], baseline: Entry) -> Row:
    runs = groups[entry, task]
    nominal = [result.figures for (rig, _), result in runs.items() if rig == NOMINAL.name]
    errors = [result.figures[RANK] for result in runs.values() if not result.failure]
    others = groups.get((baseline, task), {})
    return Row(
        entry,
        task,
        len(runs),
        _mean(nominal) if nominal and all(nominal) else {},
        (min(errors), max(errors)) if errors else None,
        tuple((rig, result.failure) for (rig, _), result in runs.items() if result.failure),
        sum(map(_restless, runs.values())),
        sum(_unstable(result, others.get(pair)) for pair, result in runs.items()),
        None if entry == baseline else _against(runs, others),
    )


def _restless(result: Result) -> bool:
    return result.figures.get("end_time") == inf


def _unstable(result: Result, baseline: Result | None) -> bool:
    base = inf if baseline is None else baseline.figures.get(RANK, inf)
    return bool(result.failure) or (_restless(result) and result.figures[RANK] > UNSTABLE * base)


def _mean(figures: Sequence[Mapping[str, float]]) -> dict[str, float]:
    return {name: fmean(one[name] for one in figures) for name in figures[0] if all(name in one for one in figures)}


def _against(runs: Mapping[Pairing, Result], baseline: Mapping[Pairing, Result]) -> Against | None:
    """t-interval of the mean logarithm of the paired ratios."""
    pairs = [(runs[pair], baseline[pair]) for pair in runs if pair in baseline]
    if not pairs or len(pairs) < len(runs) or any(one.failure for pair in pairs for one in pair):
        return None
    errors = [(own.figures[RANK], other.figures[RANK]) for own, other in pairs]
    if any(other == 0 or own == 0 for own, other in errors):
        return None
    logs = [log(own / other) for own, other in errors]
    mean = fmean(logs)
    if len(logs) == 1:
        return Against(exp(mean), 0.0, inf)
    from scipy.special import stdtrit

    half = float(stdtrit(len(logs) - 1, (1 + LEVEL) / 2)) * stdev(logs) / sqrt(len(logs))
    return Against(exp(mean), exp(mean - half), exp(min(mean + half, 700.0)))


def mean_ratio(rows: Sequence[Row]) -> float:
    """Geometric mean of the ratios to the baseline over paths; infinite where any is missing or a run failed."""
    ratios = [inf if row.against is None or not row.stable else row.against.ratio for row in rows]
    return exp(fmean(map(log, ratios))) if ratios and all(map(isfinite, ratios)) else inf
