"""Conditions on a comparison: "contour_rms > 1.1x" fails if so, against the baseline or against
saved runs.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from math import inf, isfinite
from statistics import fmean, geometric_mean
from typing import Any

from benchmarks.reports.gain.comparison import RANK, Comparison, ComparisonRow, SettingEntry
from benchmarks.reports.gain.criteria import CRITERIA, HUMAN, About, format_unit
from benchmarks.sweep import RunResult, Setting
from benchmarks.sweep.result import figure_unit
from controllers.metrics import FIGURES
from kinematics.files.plain_text import finite_or_none
from kinematics.foundation.errors import MotionError
from kinematics.foundation.units import everyday_unit, quantity

COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    ">": operator.gt,
    ">=": operator.ge,
    "<": operator.lt,
    "<=": operator.le,
}
GRAMMAR = re.compile(
    r"\s*([a-z_]+(?:\.[\w-]+)?)\s*(>=|<=|>|<)\s*(\d+(?:\.\d*)?(?:e[+-]?\d+)?)\s*(\S.*?)?\s*"
)
HELP = 'write FIGURE > VALUE, as "contour_rms > 1.1x" (times the baseline), "contour_max > 250 um", "torque_peak > 0.9"'


MOST_NAMED, MIN_LIKENESS = 4, 0.5
"""Names of figures that an unknown one is answered with, and how like it they are at least."""
NONE_JUDGED = "no setting holds on every ranked path and rig"
"""Said where there is nothing to judge."""
COUNTS = ("", "full steps")
"""Units of figures that a plain number is compared with."""
EXAMPLES = {
    "m": "um",
    "rad": "mrad",
    "s": "ms",
    "m²": "um^2",
    "rad²": "mrad^2",
    "m/s³": "m/s^3",
    "rad/s³": "rad/s^3",
}
"""SI unit -> how one that people use is written in a condition."""


@dataclass(frozen=True, slots=True)
class Change:
    """A figure of a setting on a path, SI, and of the same setting's saved runs: means over `runs`
    pairs.

    stable  whether the new runs are; the saved ones were
    met     whether the condition holds of it, as it does where the setting is unstable now
    """

    setting: Setting
    task: str
    figure: str
    unit: str
    saved: float
    value: float
    runs: int
    stable: bool
    met: bool

    @property
    def ratio(self) -> float:
        """Of the new runs to the saved ones; 1 where both are 0."""
        if self.value == self.saved:
            return 1.0
        return self.value / self.saved if self.saved else inf

    def __str__(self) -> str:
        now, before = format_unit(self.value, self.unit), format_unit(self.saved, self.unit)
        many = f"mean of {self.runs} runs" if self.runs > 1 else "1 run"
        end = "" if self.stable else ", and unstable now"
        ratio = (
            f"{self.figure} {self.ratio:.3g} times the saved ({now}, saved {before}; {many}){end}"
        )
        return f"{self.setting.label} on {self.task}: {ratio}"

    def as_record(self) -> dict[str, Any]:
        """As plain data, SI; null for what is infinite."""
        numbers = {"saved": self.saved, "value": self.value, "ratio": self.ratio}
        return {
            "law": self.setting.law,
            "gains": dict(self.setting.gains),
            "path": self.task,
            "figure": self.figure,
            **{name: finite_or_none(number) for name, number in numbers.items()},
            "runs": self.runs,
            "stable": self.stable,
            "failed": self.met,
        }


@dataclass(frozen=True, slots=True)
class Judgement:
    """A setting on a path by a condition: its value and what that is compared with, SI; `about`
    says of which runs.

    met  whether the condition holds of it
    """

    condition: Condition
    setting: str
    task: str
    value: float
    limit: float
    unit: str
    about: str
    met: bool

    def __str__(self) -> str:
        value, limit = (format_unit(each, self.unit) for each in (self.value, self.limit))
        return f"on {self.task}: {value} {self.condition.compared} {limit} ({self.about})"

    def as_record(self) -> dict[str, Any]:
        """As plain data, SI; null for what is infinite."""
        return {
            "condition": self.condition.text,
            "setting": self.setting,
            "path": self.task,
            "value": finite_or_none(self.value),
            "limit": finite_or_none(self.limit),
            "of": self.about,
            "failed": self.met,
        }


@dataclass(frozen=True, slots=True)
class Condition:
    """unit: "x" for times the baseline, else the unit of a quantity, "" of a plain number."""

    text: str
    figure: str
    compared: str
    value: float
    unit: str

    def check_alone(self) -> None:
        """Raise MotionError where no runs at all have such a figure, or one of such a unit."""
        stem = self.figure.partition(".")[0]
        of = next((figure for figure in FIGURES if figure.name == stem), None)
        if of is None:
            self._refuse_figure(figure.name for figure in FIGURES)
            return
        no: MotionError | None = None
        for own in (
            ("m", "rad", "") if of.unit == "axis" else ("m", "rad")
        ):  # "": of axes of both kinds
            try:
                self._limit(of.unit.replace("path", own).replace("axis", own).replace("1", ""))
            except MotionError as error:
                no = no or error
            else:
                return
        if no is not None:
            raise no

    def check(self, record: Mapping[str, Any]) -> None:
        """Raise MotionError where runs with this record will have no such figure, or on no task one
        of such a unit.
        """
        known = {figure.name for figure in FIGURES} | {
            f"{figure.name}.{axis}"
            for figure in FIGURES
            if figure.per_axis
            for axis in record["axes"]
        }
        if self.figure not in known:
            self._refuse_figure(known)
        refusals = [
            self._refuse_unit(figure_unit(self.figure, task, record), task)
            for task in record["tasks"]
        ]
        if refusals and all(refusals):
            raise next(filter(None, refusals))

    def _refuse_figure(self, known: Iterable[str]) -> None:
        """Raise MotionError with the names that are nearest: there are too many to list all."""
        near = get_close_matches(self.figure, list(known), MOST_NAMED, MIN_LIKENESS)
        nearest = f"; the nearest are {', '.join(near)}" if near else ""
        told = f'condition "{self.text}": there is no figure {self.figure}'
        raise MotionError(f'{told}{nearest}; "pulsepath figures" lists all')

    def list_reasons(self, comparison: Comparison, entry: SettingEntry | None) -> list[str]:
        """Why it holds of a setting, path by path (`judge`); empty where it does not.

        Without a setting that holds everywhere the condition holds, since what is checked is not
        there.
        """
        judged = find_judged(comparison, entry)
        if judged is None:
            return [f"{self.text}: {NONE_JUDGED}"]
        return [
            f"{self.text}: {one.setting} {one}" for one in self.judge(comparison, judged) if one.met
        ]

    def judge(self, comparison: Comparison, entry: SettingEntry) -> list[Judgement]:
        """A setting by this condition, path by path.

        A ratio is what the verdict is made of: the mean over all rigs and seeds, over the
        baseline's, on paths that are ranked. A quantity is compared with every run, on every path
        on which the figure is one of its kind.
        """
        rows = comparison.of(entry)
        if self.unit == "x":
            return [
                self._judge_ratio(comparison, entry, row)
                for row in rows
                if row.task in comparison.ranked
            ]
        fitting = [
            row
            for row in rows
            if not self._refuse_unit(comparison.unit(self.figure, row.task), row.task)
        ]
        return [self._judge_runs(comparison, entry, row) for row in fitting]

    def _judge_ratio(
        self, comparison: Comparison, entry: SettingEntry, row: ComparisonRow
    ) -> Judgement:
        own, base = (comparison.runs(of, row.task) for of in (entry, comparison.baseline))
        value, mean = self._means(own, base, comparison.criteria_of(row.task))
        times = f"{self.value:g} × the baseline"
        about = f"{times}; mean of {row.runs} runs" if row.runs > 1 else times
        return self._judgement(comparison, entry, row, (value, self.value * mean), about)

    def _judge_runs(
        self, comparison: Comparison, entry: SettingEntry, row: ComparisonRow
    ) -> Judgement:
        limit = self._limit(comparison.unit(self.figure, row.task), row.task)
        runs = [(self._value(run.figures), run.cell) for run in comparison.runs(entry, row.task)]
        worst = max if self.compared.startswith(">") else min
        value, cell = worst(runs, key=lambda run: run[0])
        about = f"rig {cell.variation.name}, seed {cell.seed}"
        return self._judgement(comparison, entry, row, (value, limit), about)

    def _judgement(
        self,
        comparison: Comparison,
        entry: SettingEntry,
        row: ComparisonRow,
        both: tuple[float, float],
        about: str,
    ) -> Judgement:
        unit = comparison.unit(self.figure, row.task)
        met = COMPARISONS[self.compared](*both)
        return Judgement(self, comparison.label(entry), row.task, *both, unit, about, met)

    def list_changes(self, comparison: Comparison, saved: Comparison) -> list[Change]:
        """The figure of every setting over that of its saved runs, the worst first; saved runs are
        compared alone.

        Runs are paired by rig and seed. A path on which the saved runs of a setting are unstable is
        left out, and so is a pair whose saved run has no such figure: there is nothing to guard.
        """
        changes = [
            change
            for row in comparison.rows
            for old in saved.rows
            if old.stable and (old.entry.setting, old.task) == (row.entry.setting, row.task)
            for change in self._change(comparison, row, saved.runs(old.entry, old.task))
        ]
        return sorted(changes, key=lambda one: one.ratio, reverse=self.compared.startswith(">"))

    def _change(
        self, comparison: Comparison, row: ComparisonRow, saved: Sequence[RunResult]
    ) -> Iterator[Change]:
        new = {
            (run.cell.variation.name, run.cell.seed): run
            for run in comparison.runs(row.entry, row.task)
        }
        pairs = [
            (new[key], old)
            for old in saved
            if (key := (old.cell.variation.name, old.cell.seed)) in new
            and isfinite(self._value(old.figures))
        ]
        if pairs:
            own, base = zip(*pairs, strict=True)
            value, mean = self._means(own, base, comparison.criteria_of(row.task))
            met = not row.stable or COMPARISONS[self.compared](value, self.value * mean)
            unit = comparison.unit(self.figure, row.task)
            yield Change(
                row.entry.setting,
                row.task,
                self.figure,
                unit,
                mean,
                value,
                len(pairs),
                row.stable,
                met,
            )

    def _means(
        self, own: Sequence[RunResult], base: Sequence[RunResult], about: About
    ) -> tuple[float, float]:
        """Of runs and of those they are compared with; geometric where all are above 0.

        What makes no difference to the verdict makes none here: a criterion's figure counts as the
        verdict counts it, another error in space is not told apart below the floor.
        """
        weighed = next((one.value for one in CRITERIA if one.figure == self.figure), None)
        in_space = any(figure.unit == "path" for figure in FIGURES if figure.name == self.figure)

        def read(run: RunResult) -> float:
            value = self._value(run.figures)
            if weighed is not None and run.figures:
                counted = weighed(run.figures, about)
                return value if counted is None else counted
            return max(value, about["floor"]) if in_space else value

        values = [[*map(read, runs)] for runs in (own, base)]
        mean = geometric_mean if min(values[0] + values[1]) > 0 else fmean
        return mean(values[0]), mean(values[1])

    def _refuse_unit(self, unit: str, task: str) -> MotionError | None:
        """What is wrong with the condition's unit for a figure of this one; None: nothing."""
        try:
            self._limit(unit, task)
        except MotionError as error:
            return error
        return None

    def _limit(self, unit: str, task: str = "") -> float:
        """The value in SI.

        Raises MotionError unless it has a unit where the figure, of a task, has one.
        """
        if self.unit == "x" or (self.unit == "" and unit in COUNTS):
            return self.value
        try:
            if not self.unit:
                raise MotionError(
                    f"{self.figure} needs a unit, as {self._unit_example(unit)}, or x for times the baseline"
                )
            return quantity(f"{self.value!r} {self.unit}", unit or "1")
        except MotionError as error:
            told = f"; {self.figure} of task {task} is in {everyday_unit(unit)}"
            raise MotionError(f'condition "{self.text}": {error}{told if task else ""}') from None

    def _unit_example(self, unit: str) -> str:
        return f'"{self.value:g} {EXAMPLES.get(unit, unit)}"'

    def _value(self, figures: Mapping[str, float]) -> float:
        if not figures:
            return inf
        if self.figure not in figures:
            self._refuse_figure(figures)
        return figures[self.figure]


def read_condition(text: str) -> Condition:
    """The condition of "contour_rms > 1.1x" or "contour_max > 250 um".

    Raises MotionError for what no runs can meet.
    """
    match = GRAMMAR.fullmatch(text)
    if match is None:
        raise MotionError(f'condition "{text}" is not understood: {HELP}')
    figure, compared, value, unit = match.groups()
    condition = Condition(text.strip(), figure, compared, float(value), unit or "")
    condition.check_alone()
    return condition


def find_judged(comparison: Comparison, best: SettingEntry | None) -> SettingEntry | None:
    """The setting that conditions judge: the verdict's best; where the baseline alone was run it is
    the best there is.

    None where no setting holds on every ranked path and rig.
    """
    if (
        best is None
        and comparison.entries == (comparison.baseline,)
        and not comparison.fault(comparison.baseline)
    ):
        return comparison.baseline
    return best


def judge(
    conditions: Sequence[Condition],
    comparison: Comparison,
    best: SettingEntry | None,
    changes: Mapping[Condition, Sequence[Change]],
) -> list[Judgement]:
    """What a page tells of conditions: the verdict's best setting path by path, and the worst
    change of saved runs.
    """
    entry, found = find_judged(comparison, best), []
    for one in conditions:
        if one in changes:
            found += [_judge_change(one, changes[one])]
        elif entry is not None:
            found += one.judge(comparison, entry)
    return found


def describe_unjudged(judged: Sequence[Judgement], comparison: Comparison) -> list[str]:
    """A sentence for each quantity on the paths where its figure is of another kind, as an
    angle.
    """
    told = []
    for condition in dict.fromkeys(one.condition for one in judged if one.condition.unit != "x"):
        seen = {one.task for one in judged if one.condition == condition}
        if left := [task for task in comparison.tasks if task not in seen]:
            units = {
                HUMAN.get(unit := comparison.unit(condition.figure, task), (unit,))[0]
                for task in left
            }
            kind = f"where {condition.figure} is in {', '.join(sorted(units))}"
            told.append(f"not judged on {', '.join(left)}, {kind}: {condition.text}")
    return told


def _judge_change(condition: Condition, changes: Sequence[Change]) -> Judgement:
    """The worst of all settings against their saved runs, the first that the condition holds of
    before others.
    """
    worst = next((each for each in changes if each.met), changes[0])
    met = sum(each.met for each in changes)
    about = (
        f"{condition.value:g} × its saved runs; the worst of {len(changes)}, of which {met} fail"
    )
    limit = condition.value * worst.saved
    return Judgement(
        condition,
        worst.setting.label,
        worst.task,
        worst.value,
        limit,
        worst.unit,
        about,
        met=worst.met,
    )


def guard(
    comparison: Comparison, saved: Comparison, conditions: Sequence[Condition]
) -> dict[Condition, list[Change]]:
    """Every setting against its own saved runs, by the conditions that are ratios; contour error
    where there is none.

    Raises MotionError where no setting was run on a path on which its saved runs are stable.
    """
    ratios = [one for one in conditions if one.unit == "x"] or [Condition("", RANK, ">", inf, "x")]
    changes = {one: one.list_changes(comparison, saved) for one in ratios}
    if not all(changes.values()):
        known = ", ".join(
            dict.fromkeys(
                f"{row.entry.setting.text} on {row.task}" for row in saved.rows if row.stable
            )
        )
        name = saved.sources[0].name
        raise MotionError(
            f"compare: nothing that was run has stable saved runs in {name}; they are of {known or 'none'}"
        )
    return changes


def list_regressions(condition: Condition, changes: Sequence[Change]) -> list[str]:
    """In which settings a condition holds: the worst named, the others counted."""
    met = [change for change in changes if change.met and condition.text]
    if not met:
        return []
    others = f", and {len(met) - 1} more of {len(changes)}" if met[1:] else ""
    return [f"{condition.text}: {met[0]}{others}"]
