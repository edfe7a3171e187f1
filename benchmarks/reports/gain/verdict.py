"""What comes out of a comparison, in sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import TYPE_CHECKING

from benchmarks.reports.gain.comparison import RANK, SAME_RATIO, Comparison, SettingEntry, is_away
from benchmarks.reports.gain.criteria import CRITERIA, TRADE_RATIO, format_unit, weights_text
from benchmarks.reports.gain.laws_outcome import (
    describe_feedback,
    describe_outcomes,
    describe_overload,
)
from benchmarks.sweep import Setting, settings_of
from controllers.metrics.metrics import END_BAND
from kinematics.foundation.names import count_noun, presets
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class Margin:
    """How far one gain may rise until the law is unstable on some path or rig of the sweep.

    edge  the lowest value above the setting's own that is unstable; None where none was tried that
          is
    up_to the highest value tried
    """

    gain: str
    value: float
    edge: float | None
    up_to: float

    def __str__(self) -> str:
        name = self.gain.replace("_", " ")
        if self.edge is not None:
            rise = f"from {self.value:g}"
            if self.value > 0:
                rise = f"×{self.edge / self.value:.3g}"
            return f"{name} may rise {rise} until {self.edge:g}, the lowest value found unstable"
        if self.up_to > self.value:
            rise = (
                f" (×{self.up_to / self.value:.3g})"
                if self.value > 0
                else f" (from {self.value:g})"
            )
            return f"{name} stays stable up to {self.up_to:g}{rise}, the highest value tried"
        return f"{name} {self.value:g} is the highest value tried, so its margin is not known"


@dataclass(frozen=True, slots=True)
class Verdict(Result):
    """The best setting other than the baseline, by all criteria weighed; None where none holds
    (`Comparison.fault`).

    ratio   of its RMS contour error to the baseline's: geometric mean over paths, rigs and seeds
    score   its weighed ratio to the baseline
    ratios  of it to the baseline, by criterion
    least   the setting of the least RMS contour error, whatever that costs; the best one, or
            another
    told    sentences: which is the best, then what it gains and costs, what was left out, and how
            sure that is
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
        """The best setting and, below, what it gains and costs; how far each of its gains may
        rise.
        """
        best = (
            Column(
                "best setting",
                [None if self.best is None else self.best.setting.text],
                words={"None": "none"},
            ),
            Column("weighed ratio to the baseline", [self.score], form=".3f"),
            Column("RMS contour error over the baseline's", [self.ratio], form=".3f"),
        )
        margins = (
            Column("gain", [margin.gain for margin in self.margins]),
            Column("value", [margin.value for margin in self.margins]),
            Column(
                "unstable from",
                [margin.edge for margin in self.margins],
                words={"None": "none tried"},
            ),
            Column("tried up to", [margin.up_to for margin in self.margins]),
        )
        first = Table("verdict", best, self.told)
        return (first, Table("margins", margins)) if self.margins else (first,)

    def plot(self, ax: Axes | None = None) -> Axes:
        """How many times its value each gain may have: to where it is unstable, or to the highest
        that was tried.
        """
        from kinematics.foundation.figure import draw_bars

        ends = [margin.up_to if margin.edge is None else margin.edge for margin in self.margins]
        pairs = [
            (margin, end)
            for margin, end in zip(self.margins, ends, strict=True)
            if margin.value > 0
        ]
        named = [f"{one.gain}{', tried' if one.edge is None else ', unstable'}" for one, _ in pairs]
        shares = [end / margin.value for margin, end in pairs]
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
    """Find the best setting that holds (`Comparison.fault`), weighed by `criteria`, with its gains
    and costs.

    Where another setting has the least contour error it is named, with what it pays for that.

    Parameters
    ----------
    comparison
        Of settings on every path against a baseline.

    Returns
    -------
    Verdict
        The best setting, if any but the baseline holds, its margins, and why.
    """
    others = [entry for entry in comparison.entries if entry != comparison.baseline]
    ranked = comparison.rank()
    name = comparison.label(comparison.baseline)
    if not ranked:
        why = (
            "no other setting was run"
            if not others
            else "no other setting holds on every ranked path and rig"
        )
        why = why if comparison.ranked else "no path ranks settings"
        pieces = [
            f"The baseline {name} is not compared: {why}.",
            *_describe_faults(comparison, others),
        ]
        pieces += [*describe_feedback(comparison), *describe_outcomes(comparison)]
        pieces += [
            _describe_setting(comparison, entry) for entry in comparison.entries[:MAX_DESCRIBED]
        ]
        return Verdict(
            None, inf, (), (*pieces, *describe_unranked(comparison), *_describe_laws(comparison))
        )
    best, least = ranked[0], min(ranked, key=comparison.mean_ratio)
    if least in comparison.rank_alike()[0]:
        least = best
    margins = _margins(comparison, best)
    told = _describe_verdict(comparison, best, least, margins, others)
    ratio, score = comparison.mean_ratio(best), comparison.score(best)
    return Verdict(best, ratio, margins, told, score, comparison.ratios(best), least)


def _describe_faults(comparison: Comparison, others: Sequence[SettingEntry]) -> list[str]:
    """How many settings do not hold, in a sentence by what is wrong with them."""
    faults = Counter(comparison.fault(entry).partition(" on ")[0] for entry in others)
    told = ", ".join(f"{count} {why} on some path" for why, count in faults.items() if why)
    many = len(comparison.entries)
    held = sum(not comparison.fault(entry) for entry in comparison.entries)
    base = "" if comparison.fault(comparison.baseline) else ", the baseline among them"
    return [f"Of the {many} settings {held} hold{base}; left out: {told}."] if told else []


def _costs(comparison: Comparison, entry: SettingEntry) -> str:
    """By which criteria a setting is much worse than the baseline, by how much, and what it comes
    to where most.
    """
    told = []
    for one in CRITERIA:
        ratio = comparison.ratios(entry).get(one.name, 1.0)
        if ratio <= TRADE_RATIO:
            continue
        values = [
            (own / base, own, base, row.task)
            for row in comparison.of(entry)
            if row.task in comparison.ranked
            and (other := comparison.row(comparison.baseline, row.task))
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
    """Say of each path that does not count why, and how many settings failed or were unstable
    there.
    """
    sentences = []
    for task in comparison.tasks:
        if task in comparison.ranked:
            continue
        unstable = [row.entry for row in comparison.rows if row.task == task and row.unstable]
        many = count_noun(len(unstable), "setting")
        faults = f" {many} failed or unstable there: that strikes out none." if unstable else ""
        why = "some laws track it to less than a hundredth of a pulse at any setting"
        sentences.append(f"Not ranked: {task}, because {why}.{faults}")
    return sentences


def _margins(comparison: Comparison, best: SettingEntry) -> tuple[Margin, ...]:
    found = []
    for gain, value in best.setting.gains:
        alike = {
            dict(entry.setting.gains)[gain]: all(row.stable for row in comparison.of(entry))
            for entry in comparison.entries
            if entry.source == best.source
            and _differ_in_one_gain(entry.setting, best.setting, gain)
        }
        if len(alike) > 1:
            edges = [other for other, stable in alike.items() if other > value and not stable]
            found.append(Margin(gain, value, min(edges, default=None), max(alike)))
    return tuple(found)


MODEL_LAWS = {"ff": "feedforward", "mpc": "predictive"}
"""Laws that know a model of the drives, by number: `compare` runs their gains where it is asked
to.
"""
OFF_GOAL = f"more than {END_BAND:g} pulses of an axis away"
MAX_DESCRIBED = 5
"""Settings whose figures are told where none is best."""


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
            told.append(f"Changing {gain} changes nothing on this rig.")
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
        of = f"of {len(comparison.entries)} settings"
        verb = (
            f"is the best {of}"
            if score < 1
            else f"comes closest {of} to the baseline, which remains the best"
        )
    counts = ", ".join(
        f"{mark} on {marks.count(mark)}" for mark in ("better", "neither", "worse") if mark in marks
    )
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
    if away := _describe_ending(comparison, best):
        theirs = _describe_ending(comparison, comparison.baseline) or "in none of its runs"
        pieces.append(
            f"It ends off its goal, more than {END_BAND:g} pulses of an axis away, {away} (baseline {theirs})."
        )
    alike = comparison.rank_alike()[0]
    if len(alike) > 1:
        pieces.append(
            f"{len(alike)} settings of it come out alike; this is the nearest to the law's usual gains."
        )
    pieces += describe_feedback(comparison)
    pieces += describe_outcomes(comparison)
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
    pieces += describe_overload(comparison, best)
    pieces += _describe_edges(comparison, best)
    pieces.append(_describe_margins(comparison, best, margins))
    return (*pieces, *describe_unranked(comparison), *_describe_laws(comparison))


def _describe_margins(
    comparison: Comparison, best: SettingEntry, margins: tuple[Margin, ...]
) -> str:
    if margins:
        return f"Margin: {'; '.join(map(str, margins))}."
    if not best.setting.gains:
        return "Margin: the law has no gains."
    law = best.setting.law
    run = {entry.setting for entry in comparison.entries if entry.source == best.source}
    if run.issuperset(settings_of(law)):
        return f"Margin: not known, since {law} has no other gains in its grid that differ in one alone."
    alone = (
        "no other gains"
        if len([one for one in run if one.law == law]) == 1
        else "no gains that differ in one alone"
    )
    return f"Margin: not known, since {alone} of {law} were run; --law {law} without gains runs them all."


def _describe_setting(comparison: Comparison, entry: SettingEntry) -> str:
    """Whether a setting is stable, and its figures path by path."""
    rows = comparison.of(entry)
    many, bad = sum(row.runs for row in rows), sum(row.unstable for row in rows)
    where = ", ".join(row.task for row in rows if row.unstable)
    held = (
        f"failed or is unstable in {bad} of {many} runs, on {where}"
        if bad
        else f"is stable in all of {many} runs"
    )
    figures = []
    for row in rows:
        unit = comparison.unit(RANK, row.task)
        if row.figures and row.spread:
            low, high = (format_unit(value, unit) for value in row.spread)
            rigs = f" ({low} to {high} over {row.runs} runs)" if row.runs > 1 else ""
            torque = row.figures.get("torque_peak")
            peak = "" if torque is None else f", peak torque {format_unit(torque, '')} of the limit"
            figures.append(f"{format_unit(row.figures[RANK], unit)}{rigs}{peak} on {row.task}")
    pieces = [f"{comparison.label(entry)} {held}."]
    if figures:
        pieces.append(f"RMS contour error on the rig as stated: {'; '.join(figures)}.")
    if away := _describe_ending(comparison, entry):
        pieces.append(f"It ends off its goal, {OFF_GOAL}, {away}.")
    return " ".join(pieces)


def _describe_ending(comparison: Comparison, entry: SettingEntry) -> str:
    """In how many runs a setting ends off its goal, and the largest distance from it; empty: in
    none.
    """
    rows, source = comparison.of(entry), comparison.sources[entry.source]
    many = sum(row.away for row in rows)
    ends = [
        (float(series.tracking[-1]), result.cell.task)
        for key, result in source.results.items()
        if result.cell.setting == entry.setting
        and is_away(result)
        and (series := source.series(key)) is not None
    ]
    told = f"in {many} of its {count_noun(sum(row.runs for row in rows), 'run')}"
    if ends:
        distance, task = max(ends)
        told += f", by up to {format_unit(distance, comparison.unit(RANK, task))} on {task}"
    return told if many else ""


def _describe_laws(comparison: Comparison) -> list[str]:
    """Which laws by model were not run, and what runs them: their errors are often far smaller."""
    run = {entry.setting.law for entry in comparison.entries}
    left = {number: name for number, name in MODEL_LAWS.items() if name not in run}
    if not left:
        return []
    options = " ".join(f"--law {each}" for each in (comparison.baseline.setting.text, *left))
    rig = comparison.sources[comparison.baseline.source].record["rig"]
    rig = rig if rig in presets("controllers") else f"{rig}.toml"  # a rig is called as its file is
    return [
        f"Not run: {', '.join(left.values())}. Laws that know a model of the drives often err far less: "
        f'"pulsepath compare {rig} {options} --out DIR" runs them.'
    ]
