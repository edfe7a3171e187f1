"""The gain report: one HTML page that holds everything it shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf, isfinite, nan
from typing import Any

from benchmarks.reports.gain.comparison import MIN_DIFFERENCE_SHARE, RANK, UNSTABLE_SHARE, Comparison, ComparisonRow
from benchmarks.reports.gain.courses import select_series
from benchmarks.reports.gain.criteria import CRITERIA, HUMAN, number, shown
from benchmarks.reports.gain.iso_block import ISO, IsoBlock, iso_block
from benchmarks.reports.gain.run_figures import draw
from benchmarks.reports.gain.verdict import Verdict, describe_unranked, verdict_of
from benchmarks.reports.page import render
from controllers.metrics.ending import BAND

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
COLUMNS = (
    ("contour_rms", "contour RMS"),
    ("contour_max", "contour max"),
    ("tracking_rms", "tracking RMS"),
    ("late", "late"),
    ("torque_rms", "torque RMS"),
    ("torque_peak", "torque peak"),
    ("vibration_power", "vibration"),
)


def gain_report(comparison: Comparison) -> tuple[Verdict, str]:
    """The verdict, and the page that begins with it."""
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
        sections=[(task, list(_cells(comparison, task)), _units(comparison, task)) for task in comparison.tasks],
        marks=MARKS,
        provenance=list(_provenance(comparison)),
        iso=list(_iso_rows(comparison, iso)),
        iso_names=ISO,
        circles=list(_circle_rows(comparison, iso)),
        shown=[comparison.label(entry) for entry in shown_ones.entries],
        least=100 * MIN_DIFFERENCE_SHARE,
        unstable=100 * UNSTABLE_SHARE,
        band=BAND,
        rigs=max(len(source.record["variations"]) for source in comparison.sources),
        not_ranked=describe_unranked(comparison),
        criteria=CRITERIA,
        weighed=list(_weighed(comparison)),
    )
    return verdict, page


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
                    row.figures[name], floor if name.startswith("contour") else -inf, comparison.unit(name, task)
                )
                if name in row.figures
                else "–"
                for name, _ in COLUMNS
            ],
            "notes": list(_notes(row)),
        }


def _weighed(comparison: Comparison) -> Iterator[tuple[str, str, list[str]]]:
    """Setting, its weighed ratio to the baseline, and its ratio by each criterion; the best first, none unstable."""
    scores = {entry: comparison.score(entry) for entry in comparison.entries}
    for entry in sorted((entry for entry in scores if isfinite(scores[entry])), key=scores.__getitem__):
        ratios = comparison.ratios(entry)
        yield (
            comparison.label(entry),
            _ratio(scores[entry]),
            [_ratio(ratios[one.name]) if one.name in ratios else "–" for one in CRITERIA],
        )


def _format_above_floor(value: float, floor: float, unit: str) -> str:
    """A value without its unit; one below the floor is not told apart from it."""
    return number(value, unit) if value >= floor else f"<{floor * HUMAN.get(unit, (unit, 1.0))[1]:.2g}"


def _ratio(value: float) -> str:
    return f"{value:#.3g}".rstrip(".")


def _notes(row: ComparisonRow) -> Iterator[str]:
    reasons: dict[str, list[str]] = {}
    for rig, reason in row.failures:
        reasons.setdefault(reason, []).append(rig)
    for reason, rigs in reasons.items():
        yield f"failed with {', '.join(dict.fromkeys(rigs))}: {reason}"
    if row.away:
        yield f"off its goal in {row.away} of {row.runs} runs"


def _units(comparison: Comparison, task: str) -> list[str]:
    return [shown(0.0, comparison.unit(name, task)).partition(" ")[2] for name, _ in COLUMNS]


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
        yield [about, comparison.label(turns.entry), *(number(value, "m") for value in named), turns.note]
