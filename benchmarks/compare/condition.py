"""Conditions on a comparison, for checks: "contour_rms > 1.1x" fails when that holds."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf

from benchmarks.compare.shown import shown
from benchmarks.compare.table import Comparison, Entry
from kinematics.errors import MotionError
from kinematics.registry import nearest
from kinematics.units import quantity

COMPARED: dict[str, Callable[[float, float], bool]] = {
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

    def met(self, comparison: Comparison, entry: Entry | None) -> list[str]:
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
                limit = self.value * (inf if base is None else self._value(base.figures))
            else:
                limit = self.value if not self.unit else quantity(f"{self.value!r} {self.unit}", unit or "1")
            if COMPARED[self.compared](own, limit):
                times = f" ({self.value:g} × the baseline)" if self.unit == "x" else ""
                found.append(
                    f"{self.text}: {comparison.label(entry)} on {row.task}: {shown(own, unit)} {self.compared} "
                    f"{shown(limit, unit)}{times}"
                )
        return found

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
