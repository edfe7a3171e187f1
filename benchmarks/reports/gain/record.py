"""A comparison as plain data: for compare.json, and its runs for runs.csv. SI units throughout."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from io import StringIO
from math import isfinite
from typing import Any

from benchmarks.reports.gain.comparison import BaselineRatio, Comparison, SettingEntry
from benchmarks.reports.gain.criteria import CRITERIA, weigh
from benchmarks.reports.gain.gain_report import choose_mark
from benchmarks.reports.gain.verdict import Verdict


def comparison_record(comparison: Comparison, verdict: Verdict) -> dict[str, Any]:
    """The verdict, every row of the table, and how the runs were made; null for what is infinite or not known."""
    return {
        "baseline": _entry(comparison, comparison.baseline),
        "verdict": {
            "best": None if verdict.best is None else _entry(comparison, verdict.best),
            "score": _finite_or_none(verdict.score),
            "weights": {one.name: one.weight for one in CRITERIA},
            "ratios": dict(verdict.ratios),
            "ratio": _finite_or_none(verdict.ratio),
            "least_contour_error": None if verdict.least is None else _entry(comparison, verdict.least),
            "margins": [
                {"gain": one.gain, "value": one.value, "unstable_from": one.edge, "tried_up_to": one.up_to}
                for one in verdict.margins
            ],
            "ranked_paths": list(comparison.ranked),
            "text": verdict.text,
            "gains": verdict.gains,
        },
        "rows": [
            {
                **_entry(comparison, row.entry),
                "path": row.task,
                "mark": choose_mark(row, comparison),
                "runs": row.runs,
                "figures": {name: _finite_or_none(value) for name, value in row.figures.items()},
                "contour_rms_over_rigs": row.spread,
                "against_baseline": _ratio_record(row.against),
                "failures": [{"rig": rig, "reason": reason} for rig, reason in row.failures],
                "not_at_goal": row.away,
                "unstable": row.unstable,
            }
            for row in comparison.rows
        ],
        "sources": [{"name": source.name, **source.record} for source in comparison.sources],
    }


def runs_csv(comparison: Comparison) -> str:
    """A line for each run: what it was, its figures by `controllers.metrics.FIGURES`, and why there are none."""
    every = [(source, result) for source in comparison.sources for result in source.results.values()]
    names = list(dict.fromkeys(name for _, result in every for name in result.figures))
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["runs", "law", "gains", "path", "rig", "seed", "failure", *names])
    for source, result in every:
        cell = result.cell
        gains = " ".join(f"{name}={value!r}" for name, value in cell.setting.gains)
        what: Iterable[object] = (source.name, cell.setting.law, gains, cell.task, cell.variation.name, cell.seed)
        table.writerow([*what, result.failure, *(_cell(result.figures.get(name)) for name in names)])
    return text.getvalue()


def _entry(comparison: Comparison, entry: SettingEntry) -> dict[str, Any]:
    setting = entry.setting
    return {"runs_of": comparison.sources[entry.source].name, "law": setting.law, "gains": dict(setting.gains)}


def _ratio_record(against: BaselineRatio | None) -> dict[str, Any] | None:
    if against is None:
        return None
    ratios = {"ratio": against.ratio, "least": against.least, "largest": against.largest, "mark": against.mark}
    return {**ratios, "weighed": weigh(against.ratios), "by_criterion": dict(against.ratios)}


def _finite_or_none(value: float) -> float | None:
    return value if isfinite(value) else None


def _cell(value: float | None) -> str:
    return "" if value is None else repr(value)
