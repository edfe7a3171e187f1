"""The gain report: one HTML page that holds everything it shows, and the same as plain data:
compare.json, runs.csv.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from io import StringIO
from math import inf, nan
from typing import Any

from benchmarks.reports.gain.comparison import (
    MIN_DIFFERENCE_SHARE,
    RANK,
    UNSTABLE_SHARE,
    BaselineRatio,
    Comparison,
    ComparisonRow,
    SettingEntry,
)
from benchmarks.reports.gain.condition import Change, Judgement, describe_unjudged
from benchmarks.reports.gain.courses import ISO, IsoBlock, iso_block, select_series
from benchmarks.reports.gain.criteria import (
    CRITERIA,
    HUMAN,
    floors_text,
    format_unit,
    number,
    weigh,
)
from benchmarks.reports.gain.laws_outcome import LawOutcome, find_outcomes, outcome_record
from benchmarks.reports.gain.run_figures import MOST_BEST, draw, list_best
from benchmarks.reports.gain.setting_figures import pack_places
from benchmarks.reports.gain.verdict import Verdict, describe_unranked, verdict_of
from benchmarks.reports.page import render
from benchmarks.sweep.result import setting_columns
from controllers.metrics.metrics import END_BAND
from kinematics.files.plain_text import finite_or_none
from kinematics.foundation.names import count_noun

MARKS = {
    "better": ("▼ better", "good"),
    "worse": ("▲ worse", "bad"),
    "neither": ("≈ neither", ""),
    "baseline": ("● baseline", ""),
    "unstable": ("✕ unstable", "bad"),
    "failed": ("✕ failed", "bad"),
    "not comparable": ("– not comparable", ""),
    "not ranked": ("– not ranked", ""),
}
"""Sign and word, so that neither colour nor either alone has to tell; class of the style sheet."""
LARGEST = "contour_max"
"""The figure that users hold against what a part may be off by."""
COLUMNS = (
    ("contour_rms", "contour RMS"),
    ("contour_max", "contour max"),
    ("tracking_rms", "tracking RMS"),
    ("late", "late"),
    ("torque_rms", "torque RMS"),
    ("torque_peak", "torque peak"),
    ("vibration_power", "vibration"),
)


def gain_report(
    comparison: Comparison, changes: Sequence[Change] = (), judged: Sequence[Judgement] = ()
) -> tuple[Verdict, str]:
    """The verdict, and the page that begins with it.

    changes: of its settings against their saved runs, the worst first; judged: by conditions
    """
    verdict = verdict_of(comparison)
    shown_ones = select_series(comparison, verdict)
    iso = iso_block(comparison, shown_ones.entries[:2])
    figures = draw(comparison, shown_ones, iso)
    page = render(
        "gains.html.j2",
        figures,
        comparison=comparison,
        verdict=verdict,
        baseline=comparison.label(comparison.baseline),
        tasks=comparison.tasks,
        figure_names=COLUMNS,
        sections=[
            (task, list(_cells(comparison, task)), _units(comparison, task))
            for task in comparison.tasks
        ],
        marks=MARKS,
        provenance=list(_provenance(comparison)),
        iso=list(_iso_rows(comparison, iso)),
        iso_names=ISO,
        circles=list(_circle_rows(comparison, iso)),
        shown=[comparison.label(entry) for entry in shown_ones.entries],
        least=100 * MIN_DIFFERENCE_SHARE,
        unstable=100 * UNSTABLE_SHARE,
        band=END_BAND,
        rigs=max(len(source.record["variations"]) for source in comparison.sources),
        not_ranked=describe_unranked(comparison),
        criteria=CRITERIA,
        floors=floors_text(_list_floors(comparison)),
        weighed=list(_weigh_entries(comparison)),
        held=sum(not comparison.fault(entry) for entry in comparison.entries),
        laws=[_outcome_row(comparison, one) for one in find_outcomes(comparison)],
        places=pack_places(comparison, list_best(comparison)) if "tradeoff" in figures else None,
        most_best=MOST_BEST,
        changes=[_change_row(one) for one in changes],
        human={unit: name for unit, (name, _) in HUMAN.items()},
        error_units=_error_units(comparison),
        unjudged=describe_unjudged(judged, comparison),
        judged=[_judged_row(one) for one in judged],
        worst_change=str(changes[0]) if changes else "",
    )
    return verdict, page


def _judged_row(one: Judgement) -> tuple[str, ...]:
    """Condition, setting, path, its value, what that is compared with, of which runs, and what
    comes out.
    """
    value, limit = (format_unit(each, one.unit) for each in (one.value, one.limit))
    return (
        one.condition.text,
        one.setting,
        one.task,
        value,
        limit,
        one.about,
        "FAILS" if one.met else "passes",
    )


def _change_row(change: Change) -> tuple[str, ...]:
    values = (format_unit(value, change.unit) for value in (change.saved, change.value))
    ratio = _ratio(change.ratio) if change.stable else f"{_ratio(change.ratio)}, unstable now"
    return (change.setting.label, change.task, change.figure, *values, ratio)


def choose_mark(row: ComparisonRow, comparison: Comparison) -> str:
    """The key of a row's mark in `MARKS`."""
    if len(row.failures) == row.runs:
        return "failed"
    if row.unstable:
        return "unstable"
    if row.entry == comparison.baseline:
        return "baseline"
    if row.task not in comparison.ranked:
        return "not ranked"
    return row.against.mark if row.against is not None else "not comparable"


def _cells(comparison: Comparison, task: str) -> Iterator[Mapping[str, Any]]:
    """What the table shows of each setting on a path, the least error first, what failed last."""
    rows = [row for row in comparison.rows if row.task == task]
    for row in sorted(rows, key=lambda row: (bool(row.unstable), row.figures.get(RANK, 1e300))):
        unit, floor = comparison.unit(RANK, task), comparison.floor(task)
        yield {
            "label": comparison.label(row.entry),
            "mark": choose_mark(row, comparison),
            "ratio": "" if row.against is None else _ratio(row.against.ratio),
            "range": ""
            if row.against is None or row.runs < 2
            else f"{_ratio(row.against.least)}…{_ratio(row.against.largest)}",
            "spread": "–"
            if row.spread is None
            else "…".join(_format_above_floor(value, floor, unit) for value in row.spread),
            "figures": [
                _format_above_floor(
                    row.figures[name],
                    floor if name.startswith("contour") else -inf,
                    comparison.unit(name, task),
                )
                if name in row.figures
                else "–"
                for name, _ in COLUMNS
            ],
            "notes": list(_notes(row)),
        }


def _error_units(comparison: Comparison) -> list[str]:
    """SI units of the errors on ranked paths, each once."""
    return list(dict.fromkeys(comparison.unit(RANK, task) for task in comparison.ranked))


def _list_errors(comparison: Comparison, entry: SettingEntry) -> list[str]:
    """For each unit of `_error_units` the RMS contour errors from the least path to the largest,
    and the largest error.

    The RMS is that on the rig as stated, the largest that of all runs on ranked paths.
    """
    cells = []
    for unit in _error_units(comparison):
        rows = [row for row in comparison.of(entry) if row.task in comparison.ranked]
        rows = [row for row in rows if comparison.unit(RANK, row.task) == unit]
        floor = max((comparison.floor(row.task) for row in rows), default=0.0)
        errors = [row.figures[RANK] for row in rows if RANK in row.figures]
        runs = [run.figures for row in rows for run in comparison.runs(entry, row.task)]
        largest = max((figures.get(LARGEST, inf) for figures in runs), default=nan)
        ends = (
            [_format_above_floor(each, floor, unit) for each in sorted({min(errors), max(errors)})]
            if errors
            else []
        )
        cells += ["…".join(dict.fromkeys(ends)) or "–", _format_above_floor(largest, floor, unit)]
    return cells


def _weigh_entries(comparison: Comparison) -> Iterator[tuple[int, str, str, list[str], list[str]]]:
    """Rank, setting, its weighed ratio to the baseline, its errors (`_list_errors`) and its ratio
    by each criterion.

    Of those that hold, the best first.

    Settings of a law that come out alike share a row. The baseline stands where its ratio of 1 puts
    it, with rank 0.
    """
    ranked = comparison.rank_alike()
    better = sum(comparison.score(entry) < 1 for entry, *_ in ranked)
    for n, (entry, *others) in enumerate(ranked, 1):
        if n == better + 1:
            yield _weigh_baseline(comparison)
        alike = f", {len(others) + 1} settings alike" if others else ""
        each = [_show_criterion(comparison, entry, one.name) for one in CRITERIA]
        errors = _list_errors(comparison, entry)
        yield n, f"{comparison.label(entry)}{alike}", _ratio(comparison.score(entry)), errors, each
    if better == len(ranked) > 0:
        yield _weigh_baseline(comparison)


def _list_floors(comparison: Comparison) -> str:
    """Return the floors of errors, for each unit of ranked paths the largest."""
    largest: dict[str, float] = {}
    for task in comparison.ranked:
        unit = comparison.unit(RANK, task)
        largest[unit] = max(largest.get(unit, 0.0), comparison.floor(task))
    return " or ".join(format_unit(floor, unit) for unit, floor in largest.items())


def _show_criterion(comparison: Comparison, entry: SettingEntry, name: str) -> str:
    """Return the measured ratio by a criterion, and in parentheses what counts of it, where that
    differs.
    """
    counted = comparison.ratios(entry).get(name)
    if counted is None:
        return "–"
    text = _ratio(counted)
    measured = _ratio(comparison.measured(entry).get(name, counted))
    return text if measured == text else f"{measured} ({text})"


def _weigh_baseline(comparison: Comparison) -> tuple[int, str, str, list[str], list[str]]:
    base = comparison.baseline
    return (
        0,
        comparison.label(base),
        _ratio(1.0),
        _list_errors(comparison, base),
        [_ratio(1.0)] * len(CRITERIA),
    )


def _outcome_row(
    comparison: Comparison, one: LawOutcome
) -> tuple[str, str, str, str, list[str], str]:
    """Law, how many of its settings hold, the best of them, its weighed ratio and its errors, why
    others are out.
    """
    best = "none" if one.best is None else comparison.label(one.best)
    baseline = " (baseline)" if one.best == comparison.baseline else ""
    left = ", ".join(f"{count} {why}" for why, count in one.faults.items())
    return (
        one.law,
        f"{one.held} of {one.settings}",
        f"{best}{baseline}",
        "–" if one.best is None else _ratio(one.score),
        [] if one.best is None else _list_errors(comparison, one.best),
        left,
    )


def _format_above_floor(value: float, floor: float, unit: str) -> str:
    """A value without its unit; one below the floor is not told apart from it."""
    return (
        number(value, unit) if value >= floor else f"<{floor * HUMAN.get(unit, (unit, 1.0))[1]:.2g}"
    )


def _ratio(value: float) -> str:
    return f"{value:#.3g}".rstrip(".")


def _notes(row: ComparisonRow) -> Iterator[str]:
    reasons: dict[str, list[str]] = {}
    for rig, reason in row.failures:
        reasons.setdefault(reason, []).append(rig)
    for reason, rigs in reasons.items():
        yield f"failed with {', '.join(dict.fromkeys(rigs))}: {reason}"
    if row.away:
        yield f"off its goal in {row.away} of {count_noun(row.runs, 'run')}"


def _units(comparison: Comparison, task: str) -> list[str]:
    return [format_unit(0.0, comparison.unit(name, task)).partition(" ")[2] for name, _ in COLUMNS]


def _provenance(comparison: Comparison) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """Of each of the saved runs: where from, of what, how many, by which versions."""
    for source in comparison.sources:
        record = source.record
        hashes = record["sha256"]
        versions = ", ".join(f"{name} {version}" for name, version in record["versions"].items())
        yield (
            source.name,
            [
                ("rig", record["rig"]),
                ("runs", f"{len(source.results)}"),
                ("rig variations", ", ".join(record["variations"])),
                ("seeds", ", ".join(map(str, record["seeds"]))),
                ("versions", versions),
                ("SHA-256 of the rig", hashes["rig"]),
                *(
                    (f"SHA-256 of path {name}", value)
                    for name, value in hashes["tasks"].items()
                    if name in record["tasks"]
                ),
                ("SHA-256 of the code", hashes["code"]),
            ],
        )


def _iso_rows(comparison: Comparison, iso: IsoBlock) -> Iterator[list[str]]:
    """Path, setting, its figures in the order of `ISO`, and a note."""
    for line in iso.lines:
        values = [number(line.values[name], "m") if name in line.values else "–" for name in ISO]
        yield [line.path, comparison.label(line.entry), *values, line.note]


def _circle_rows(comparison: Comparison, iso: IsoBlock) -> Iterator[list[str]]:
    for turns in iso.circles:
        circle, test = turns.circle, turns.test
        about = f"{turns.paths}: ⌀ {2e3 * circle.radius:.4g} mm, {1e3 * circle.feed:.3g} mm/s"
        named: tuple[float, ...] = (nan,) * 6
        if test is not None:
            named = (
                test.ccw.circular,
                test.cw.circular,
                test.both,
                max(test.ccw.radial_max, test.cw.radial_max),
                min(test.ccw.radial_min, test.cw.radial_min),
                test.mean_radial,
            )
        yield [
            about,
            comparison.label(turns.entry),
            *(number(value, "m") for value in named),
            turns.note,
        ]


def comparison_record(
    comparison: Comparison,
    verdict: Verdict,
    changes: Sequence[Change] = (),
    judged: Sequence[Judgement] = (),
) -> dict[str, Any]:
    """The verdict, every row of the table, and how the runs were made; null for what is infinite or
    not known.
    """
    return {
        "baseline": _entry(comparison, comparison.baseline),
        "verdict": {
            "best": None if verdict.best is None else _entry(comparison, verdict.best),
            "score": finite_or_none(verdict.score),
            "weights": {one.name: one.weight for one in CRITERIA},
            "ratios": dict(verdict.ratios),
            "measured_ratios": {} if verdict.best is None else comparison.measured(verdict.best),
            "ratio": finite_or_none(verdict.ratio),
            "least_contour_error": None
            if verdict.least is None
            else _entry(comparison, verdict.least),
            "margins": [
                {
                    "gain": one.gain,
                    "value": one.value,
                    "unstable_from": one.edge,
                    "tried_up_to": one.up_to,
                }
                for one in verdict.margins
            ],
            "laws": [outcome_record(one) for one in find_outcomes(comparison)],
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
                "figures": {name: finite_or_none(value) for name, value in row.figures.items()},
                "contour_rms_over_rigs": row.spread,
                "against_baseline": _ratio_record(row.against),
                "failures": [{"rig": rig, "reason": reason} for rig, reason in row.failures],
                "not_at_goal": row.away,
                "unstable": row.unstable,
            }
            for row in comparison.rows
        ],
        **({"against_saved": [one.as_record() for one in changes]} if changes else {}),
        **({"conditions": [one.as_record() for one in judged]} if judged else {}),
        "sources": [{"name": source.name, **source.record} for source in comparison.sources],
    }


def runs_csv(comparison: Comparison) -> str:
    """A line for each run: its law, a column for each gain, figures
    (`controllers.metrics.FIGURES`), its failure.
    """
    every = [
        (source, result) for source in comparison.sources for result in source.results.values()
    ]
    names = list(dict.fromkeys(name for _, result in every for name in result.figures))
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    settings = setting_columns([result.cell.setting for _, result in every])
    table.writerow(
        ["runs", *(column.name for column in settings), "path", "rig", "seed", "failure", *names]
    )
    for n, (source, result) in enumerate(every):
        cell = result.cell
        what: Iterable[object] = (source.name, *(column.values[n] for column in settings))
        of = (cell.task, cell.variation.name, cell.seed, result.failure)
        table.writerow([*what, *of, *(_cell(result.figures.get(name)) for name in names)])
    return text.getvalue()


def _entry(comparison: Comparison, entry: SettingEntry) -> dict[str, Any]:
    setting = entry.setting
    return {
        "runs_of": comparison.sources[entry.source].name,
        "law": setting.law,
        "gains": dict(setting.gains),
    }


def _ratio_record(against: BaselineRatio | None) -> dict[str, Any] | None:
    if against is None:
        return None
    ratios = {
        "ratio": against.ratio,
        "least": against.least,
        "largest": against.largest,
        "mark": against.mark,
    }
    return {**ratios, "weighed": weigh(against.ratios), "by_criterion": dict(against.ratios)}


def _cell(value: float | None) -> str:
    return "" if value is None else repr(value)
