"""What comes out of a comparison, in sentences; and conditions on it: "contour_rms > 1.1x" fails if so"""

from __future__ import annotations

import operator
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite
from statistics import fmean, geometric_mean
from typing import TYPE_CHECKING, Any

from benchmarks.reports.gain.comparison import RANK, Comparison, ComparisonRow, SettingEntry
from benchmarks.reports.gain.criteria import CRITERIA, TRADE_RATIO, format_unit, weights_text
from benchmarks.sweep import Setting
from benchmarks.sweep.result import figure_unit
from controllers.metrics import FIGURES
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun, nearest
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.foundation.units import quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class Margin:
    """How far one gain may rise until the law is unstable on some path or rig of the sweep.

    edge  the lowest value above the setting's own that is unstable; None where none was tried that is
    up_to the highest value tried
    """

    gain: str
    value: float
    edge: float | None
    up_to: float

    def __str__(self) -> str:
        name = self.gain.replace("_", " ")
        if self.edge is not None:
            return f"{name} may rise ×{self.edge / self.value:.3g} until {self.edge:g}, the lowest value found unstable"
        if self.up_to > self.value:
            return f"{name} stays stable up to {self.up_to:g} (×{self.up_to / self.value:.3g}), the highest value tried"
        return f"{name} {self.value:g} is the highest value tried, so its margin is not known"


@dataclass(frozen=True, slots=True)
class Verdict(Result):
    """The best setting other than the baseline, by all criteria weighed; None where none holds (`Comparison.fault`).

    ratio   of its RMS contour error to the baseline's: geometric mean over paths, rigs and seeds
    score   its weighed ratio to the baseline
    ratios  of it to the baseline, by criterion
    least   the setting of the least RMS contour error, whatever that costs; the best one, or another
    told    sentences: which is the best, then what it gains and costs, what was left out, and how sure that is
    """

    best: SettingEntry | None
    ratio: float
    margins: tuple[Margin, ...]
    told: tuple[str, ...]
    score: float = inf
    ratios: Mapping[str, float] = field(default_factory=dict)
    least: SettingEntry | None = None

    @property
    def text(self) -> str:
        """All sentences."""
        return " ".join(self.told)

    def tables(self) -> tuple[Table, ...]:
        """The best setting and, below, what it gains and costs; how far each of its gains may rise."""
        best = (
            Column("best setting", [None if self.best is None else self.best.setting.text], words={"None": "none"}),
            Column("weighed ratio to the baseline", [self.score], form=".3f"),
            Column("RMS contour error over the baseline's", [self.ratio], form=".3f"),
        )
        margins = (
            Column("gain", [margin.gain for margin in self.margins]),
            Column("value", [margin.value for margin in self.margins]),
            Column("unstable from", [margin.edge for margin in self.margins], words={"None": "none tried"}),
            Column("tried up to", [margin.up_to for margin in self.margins]),
        )
        first = Table("verdict", best, self.told)
        return (first, Table("margins", margins)) if self.margins else (first,)

    def plot(self, ax: Axes | None = None) -> Axes:
        """How many times its value each gain may have: to where it is unstable, or to the highest that was tried."""
        from kinematics.foundation.figure import draw_bars

        ends = [margin.up_to if margin.edge is None else margin.edge for margin in self.margins]
        named = [f"{one.gain}{', tried' if one.edge is None else ', unstable'}" for one in self.margins]
        shares = [end / margin.value for end, margin in zip(ends, self.margins, strict=True)]
        return draw_bars(named, shares, "times the gain", ax, 1.0)

    @property
    def gains(self) -> str:
        """What to paste: the setting on the command line and in Python."""
        return "" if self.best is None else gain_block(self.best.setting)


def gain_block(setting: Setting) -> str:
    """The setting as an option of the commands, and as a call."""
    gains = "".join(f", {name}={value!r}" for name, value in setting.gains)
    return f'--law {setting.text}\nfind_law("{setting.law}"{gains})'


@check_arguments()
def verdict_of(comparison: Comparison) -> Verdict:
    """The best setting that holds (`Comparison.fault`), weighed by `criteria`, with its gains and costs.

    Where another setting has the least contour error it is named, with what it pays for that.
    """
    others = [entry for entry in comparison.entries if entry != comparison.baseline]
    ranked = comparison.rank()
    name = comparison.label(comparison.baseline)
    if not ranked:
        why = "no other setting was run" if not others else "no other setting holds on every path and rig"
        why = why if comparison.ranked else "no path ranks settings"
        pieces = [f"The baseline {name} is not compared: {why}.", *_describe_faults(comparison, others)]
        return Verdict(None, inf, (), (*pieces, *describe_unranked(comparison)))
    best, least = ranked[0], min(ranked, key=comparison.mean_ratio)
    margins = _margins(comparison, best)
    told = _describe_verdict(comparison, best, least, margins, others)
    ratio, score = comparison.mean_ratio(best), comparison.score(best)
    return Verdict(best, ratio, margins, told, score, comparison.ratios(best), least)


def _describe_faults(comparison: Comparison, others: Sequence[SettingEntry]) -> list[str]:
    """How many settings do not hold, in a sentence by what is wrong with them."""
    faults = Counter(comparison.fault(entry).partition(" on ")[0] for entry in others)
    told = ", ".join(f"{count} {why} on some path" for why, count in faults.items() if why)
    return [f"Left out: {told}."] if told else []


def _costs(comparison: Comparison, entry: SettingEntry) -> str:
    """By which criteria a setting is much worse than the baseline, by how much, and what it comes to where most."""
    told = []
    for one in CRITERIA:
        ratio = comparison.ratios(entry).get(one.name, 1.0)
        if ratio <= TRADE_RATIO:
            continue
        values = [
            (own / base, own, base, row.task)
            for row in comparison.of(entry)
            if row.task in comparison.ranked and (other := comparison.row(comparison.baseline, row.task))
            for about in [comparison.criteria_of(row.task)]
            for own, base in [(one.value(row.figures, about), one.value(other.figures, about))]
            if own is not None and base is not None
        ]
        where = ""
        if values:
            _, own, base, task = max(values)
            unit = comparison.unit(RANK, task)
            where = f" ({one.shown(own, unit)} against {one.shown(base, unit)} on {task})"
        told.append(f"{ratio:.3g} times the {one.name}{where}")
    return ", ".join(told)


def describe_unranked(comparison: Comparison) -> list[str]:
    """A sentence for each path that does not count, and why."""
    return [
        f"Not ranked: {task}, because some laws track it to less than a hundredth of a pulse at any setting."
        for task in comparison.tasks
        if task not in comparison.ranked
    ]


def _margins(comparison: Comparison, best: SettingEntry) -> tuple[Margin, ...]:
    found = []
    for gain, value in best.setting.gains:
        alike = {
            dict(entry.setting.gains)[gain]: all(row.stable for row in comparison.of(entry))
            for entry in comparison.entries
            if entry.source == best.source and _differ_in_one_gain(entry.setting, best.setting, gain)
        }
        if len(alike) > 1 and value > 0:
            edges = [other for other, stable in alike.items() if other > value and not stable]
            found.append(Margin(gain, value, min(edges, default=None), max(alike)))
    return tuple(found)


SAME_RATIO = 1e-9
"""Relative difference of errors below which a gain changed nothing."""


def _describe_edges(comparison: Comparison, best: SettingEntry) -> list[str]:
    """A sentence for each gain whose best value is the smallest tried, or that changes nothing."""
    told = []
    for gain, value in best.setting.gains:
        alike = {
            dict(entry.setting.gains)[gain]: ratio
            for entry in comparison.entries
            if entry.source == best.source
            and _differ_in_one_gain(entry.setting, best.setting, gain)
            and isfinite(ratio := comparison.mean_ratio(entry))
        }
        if len(alike) < 2:
            continue
        if max(alike.values()) - min(alike.values()) <= SAME_RATIO * max(alike.values()):
            told.append(f"Changing {gain} changes nothing on this rig, as where no encoder is read.")
        elif value == min(alike) and value > 0:
            told.append(f"{gain} {value:g} is the smallest tried: a smaller one may be better.")
    return told


def _differ_in_one_gain(one: Setting, other: Setting, gain: str) -> bool:
    """Of the same law, and of the same gains but for one."""
    same = [dict(setting.gains) | {gain: 0.0} for setting in (one, other)]
    return one.law == other.law and same[0] == same[1]


def _describe_verdict(
    comparison: Comparison,
    best: SettingEntry,
    least: SettingEntry,
    margins: tuple[Margin, ...],
    others: Sequence[SettingEntry],
) -> tuple[str, ...]:
    ratio, score = comparison.mean_ratio(best), comparison.score(best)
    name, baseline = comparison.label(best), comparison.label(comparison.baseline)
    rows = comparison.of(best)
    marks = [row.against.mark for row in rows if row.against]
    if len(others) == 1:
        verb = "is better than the baseline" if score < 1 else "is no better than the baseline"
    else:
        of = f"of {len(others)} settings"
        verb = f"is the best {of}" if score < 1 else f"comes closest {of} to the baseline, which remains the best"
    counts = ", ".join(f"{mark} on {marks.count(mark)}" for mark in ("better", "neither", "worse") if mark in marks)
    many = count_noun(len(comparison.ranked), "path")
    pieces = [
        f"{name} {verb}, weighed ({weights_text()}): {score:.3g} times the baseline, {baseline}.",
        f"Its RMS contour error is {ratio:.3g} times that of the baseline "
        f"(geometric mean over {many} and {count_noun(rows[0].runs, 'run')} of each; {counts}).",
    ]
    both = [(row, comparison.row(comparison.baseline, row.task)) for row in rows]
    errors = [
        f"{format_unit(other.figures[RANK], unit)} to {format_unit(row.figures[RANK], unit)} on {row.task}"
        for row, other in both
        if row.task in comparison.ranked and other is not None and other.figures and row.figures
        for unit in [comparison.unit(RANK, row.task)]
    ]
    pieces.append(f"On the rig as stated, this is from {', '.join(errors)}.")
    costs = _costs(comparison, best)
    if costs:
        pieces.append(f"It costs {costs}.")
    if away := sum(row.away for row in rows):
        theirs = comparison.of(comparison.baseline)
        pieces.append(
            f"It ends off its goal in {away} of its {count_noun(sum(row.runs for row in rows), 'run')} "
            f"(baseline in {sum(row.away for row in theirs)} of {sum(row.runs for row in theirs)})."
        )
    pieces += _describe_faults(comparison, others)
    if least != best:
        dearer = _costs(comparison, least)
        why = f"but it costs {dearer}" if dearer else "but its weighed total is worse"
        error = comparison.mean_ratio(least)
        pieces.append(
            f"{comparison.label(least)} has a smaller RMS contour error, {error:.3g} times the baseline's, {why}."
        )
    for figure, what in (("torque_rms", "RMS torque"), ("torque_peak", "peak torque")):
        pair = [
            (row.figures[figure], other.figures[figure])
            for row, other in both
            if other is not None and figure in row.figures and figure in other.figures
        ]
        if pair:
            own, base = max(pair)[0], max(other for _, other in pair)
            pieces.append(
                f"Its {what} is at most {format_unit(own, '')} of the limit (baseline {format_unit(base, '')})."
            )
    pieces += _describe_edges(comparison, best)
    pieces += (
        [f"Margin: {'; '.join(map(str, margins))}."] if margins else ["Margin: the law has no gain that was varied."]
    )
    return (*pieces, *describe_unranked(comparison))


COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    ">": operator.gt,
    ">=": operator.ge,
    "<": operator.lt,
    "<=": operator.le,
}
GRAMMAR = re.compile(r"\s*([a-z_]+(?:\.[\w-]+)?)\s*(>=|<=|>|<)\s*(\d+(?:\.\d*)?(?:e[+-]?\d+)?)\s*(\S.*?)?\s*")
HELP = 'write FIGURE > VALUE, as "contour_rms > 1.1x" (times the baseline), "contour_max > 250 um", "torque_peak > 0.9"'


COUNTS = ("", "full steps")
"""Units of figures that a plain number is compared with."""
EXAMPLES = {"m": "um", "rad": "mrad", "s": "ms", "m²": "um^2", "rad²": "mrad^2", "m/s³": "m/s^3", "rad/s³": "rad/s^3"}
"""SI unit -> how one that people use is written in a condition."""


@dataclass(frozen=True, slots=True)
class Condition:
    """unit: "x" for times the baseline, else the unit of a quantity, "" of a plain number."""

    text: str
    figure: str
    compared: str
    value: float
    unit: str

    def check(self, record: Mapping[str, Any]) -> None:
        """Raise MotionError where runs with this record will have no such figure, or none of such a unit."""
        known = {figure.name for figure in FIGURES} | {
            f"{figure.name}.{axis}" for figure in FIGURES if figure.per_axis for axis in record["axes"]
        }
        if self.figure not in known:
            raise MotionError(
                f'condition "{self.text}": there is no figure {self.figure}{nearest(self.figure, known)}; '
                f"figures: {', '.join(sorted(known))}"
            )
        for task in record["tasks"]:
            self._limit(figure_unit(self.figure, task, record))

    def list_reasons(self, comparison: Comparison, entry: SettingEntry | None) -> list[str]:
        """Why it holds of a setting, path by path; empty where it does not.

        A ratio is judged on each ranked path: the mean over its rigs and seeds, over the baseline's on the same path.
        The verdict's ratio is the mean of these over the paths. A quantity is compared with every run. If no setting
        holds everywhere, the condition is met, since there is none to check.
        """
        if entry is None:
            return [f"{self.text}: no setting holds on every path and rig"]
        told = (
            self._check_ratio(comparison, entry, row) if self.unit == "x" else self._check_runs(comparison, entry, row)
            for row in comparison.of(entry)
            if self.unit != "x" or row.task in comparison.ranked
        )
        return [f"{self.text}: {comparison.label(entry)} {reason}" for reason in told if reason]

    def _check_ratio(self, comparison: Comparison, entry: SettingEntry, row: ComparisonRow) -> str:
        in_space = any(figure.unit == "path" for figure in FIGURES if figure.name == self.figure)
        least = comparison.floor(row.task) if in_space else -inf  # what no rig could show is no difference
        own, base = (
            [max(self._value(run.figures), least) for run in comparison.runs(of, row.task)]
            for of in (entry, comparison.baseline)
        )
        mean = geometric_mean if min(own + base) > 0 else fmean
        value, limit = mean(own), self.value * mean(base)
        unit = comparison.unit(self.figure, row.task)
        told = f"{format_unit(value, unit)} {self.compared} {format_unit(limit, unit)}"
        about = (
            f"{self.value:g} × the baseline; mean of {row.runs} runs"
            if row.runs > 1
            else f"{self.value:g} × the baseline"
        )
        return f"on {row.task}: {told} ({about})" if COMPARISONS[self.compared](value, limit) else ""

    def _check_runs(self, comparison: Comparison, entry: SettingEntry, row: ComparisonRow) -> str:
        unit = comparison.unit(self.figure, row.task)
        limit = self._limit(unit)
        runs = [(self._value(run.figures), run.cell) for run in comparison.runs(entry, row.task)]
        worst = max if self.compared.startswith(">") else min
        value, cell = worst(runs, key=lambda run: run[0])
        told = f"{format_unit(value, unit)} {self.compared} {format_unit(limit, unit)}"
        about = f"rig {cell.variation.name}, seed {cell.seed}"
        return f"on {row.task}: {told} ({about})" if COMPARISONS[self.compared](value, limit) else ""

    def _limit(self, unit: str) -> float:
        """The value in SI. Raises MotionError unless it has a unit where the figure has one."""
        if self.unit == "x" or (self.unit == "" and unit in COUNTS):
            return self.value
        try:
            if not self.unit:
                raise MotionError(
                    f"{self.figure} needs a unit, as {self._unit_example(unit)}, or x for times the baseline"
                )
            return quantity(f"{self.value!r} {self.unit}", unit or "1")
        except MotionError as error:
            raise MotionError(f'condition "{self.text}": {error}') from None

    def _unit_example(self, unit: str) -> str:
        return f'"{self.value:g} {EXAMPLES.get(unit, unit)}"'

    def _value(self, figures: Mapping[str, float]) -> float:
        if not figures:
            return inf
        if self.figure not in figures:
            raise MotionError(
                f'condition "{self.text}": the runs have no figure {self.figure}{nearest(self.figure, figures)}; '
                f"figures: {', '.join(sorted(figures))}"
            )
        return figures[self.figure]


def read_condition(text: str) -> Condition:
    """The condition of "contour_rms > 1.1x" or "contour_max > 250 um". Raises MotionError for what is no condition."""
    match = GRAMMAR.fullmatch(text)
    if match is None:
        raise MotionError(f'condition "{text}" is not understood: {HELP}')
    figure, compared, value, unit = match.groups()
    return Condition(text.strip(), figure, compared, float(value), unit or "")
