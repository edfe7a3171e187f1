"""Conditions on a comparison, for checks: "contour_rms > 1.1x" fails when that holds."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any

from benchmarks.reports.gain.comparison import Comparison, SettingEntry
from benchmarks.reports.gain.criteria import shown
from benchmarks.sweep.result import figure_unit
from controllers.metrics import FIGURES
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import nearest
from kinematics.foundation.units import quantity

COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    ">": operator.gt,
    ">=": operator.ge,
    "<": operator.lt,
    "<=": operator.le,
}
GRAMMAR = re.compile(r"\s*([a-z_]+(?:\.[\w-]+)?)\s*(>=|<=|>|<)\s*(\d+(?:\.\d*)?(?:e[+-]?\d+)?)\s*(\S.*?)?\s*")
HELP = 'write FIGURE > VALUE, as "contour_rms > 1.1x" (times the baseline), "contour_max > 250 um", "torque_peak > 0.9"'


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

    def met(self, comparison: Comparison, entry: SettingEntry | None) -> list[str]:
        """Why it holds of a setting, path by path; empty where it does not.

        A setting that failed on the rig as stated has an infinite figure; and without a setting that holds everywhere
        the condition holds, since what is checked is not there.
        """
        if entry is None:
            return [f"{self.text}: no setting holds on every path and rig"]
        found = []
        for row in comparison.of(entry):
            unit = comparison.unit(self.figure, row.task)
            own = self._value(row.figures)
            base = comparison.row(comparison.baseline, row.task)
            if self.unit == "x":
                # what no rig could show is no difference
                least = (
                    comparison.floor(row.task)
                    if any(f.unit == "path" for f in FIGURES if f.name == self.figure)
                    else -inf
                )
                own = max(own, least)
                limit = self.value * (inf if base is None else max(self._value(base.figures), least))
            else:
                limit = self._limit(unit)
            if COMPARISONS[self.compared](own, limit):
                times = f" ({self.value:g} × the baseline)" if self.unit == "x" else ""
                found.append(
                    f"{self.text}: {comparison.label(entry)} on {row.task}: {shown(own, unit)} {self.compared} "
                    f"{shown(limit, unit)}{times}"
                )
        return found

    def _limit(self, unit: str) -> float:
        if self.unit in ("", "x"):
            return self.value
        try:
            return quantity(f"{self.value!r} {self.unit}", unit or "1")
        except MotionError as error:
            raise MotionError(f'condition "{self.text}": {error}') from None

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
