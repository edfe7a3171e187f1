"""A verdict weighs what a user would: a little less error is not worth a shaking machine, and what is paid is said."""

from dataclasses import replace
from math import inf, prod

import numpy as np
import pytest

from benchmarks.reports.gain import SettingEntry, compare, verdict_of
from benchmarks.reports.gain.courses import select_series
from benchmarks.reports.gain.criteria import CRITERIA, QUANTIZED, compare_figures, mean_of, weigh
from benchmarks.reports.gain.gain_report import comparison_record, gain_report
from benchmarks.reports.gain.run_figures import axes_over_time
from tests.benchmarks.reports.gain.test_comparison import BASE, GOOD, SAME, saved

PULSE = 4e-5
QUIET = 1.0
"""Pulses RMS."""


def with_costs(folder, costs, errors):
    """Saved runs whose settings shake by so many pulses, and have other figures too."""
    runs = saved(folder, errors=errors)
    changed = {}
    for key, one in runs.results.items():
        pulses, others = costs[one.cell.setting]
        shaken = {"vibration_power.a": (pulses * PULSE) ** 2, "vibration_power.b": 0.0}
        changed[key] = replace(one, figures={**one.figures, **shaken, **others})
    return replace(runs, results=changed, record={**runs.record, "pulses": {"a": PULSE, "b": PULSE}})


def test_nine_per_cent_of_error_are_not_worth_2800_times_the_vibration(tmp_path):
    """In power, which is 53 times in amplitude."""
    costs = {BASE: (QUIET, {}), GOOD: (QUIET * 2800**0.5, {}), SAME: (QUIET, {})}
    found = compare([with_costs(tmp_path / "runs", costs, {BASE: 100e-6, GOOD: 91e-6 / 1.05**2, SAME: 98e-6})])
    verdict = verdict_of(found)
    assert found.mean_ratio(SettingEntry(0, GOOD)) == pytest.approx(0.91)
    assert found.score(SettingEntry(0, GOOD)) > 1
    assert (verdict.best, verdict.least) == (SettingEntry(0, SAME), SettingEntry(0, GOOD))
    assert (
        "A smaller RMS contour error has closed-position gain 0.3, 0.91 times the baseline's, but it costs"
        in verdict.text
    )
    assert "52.9 times the vibration (52.9 pulses RMS against 1 pulses RMS on " in verdict.text
    record = comparison_record(found, verdict)["verdict"]
    assert record["least_contour_error"]["gains"] == {"gain": 0.3}
    assert sum(record["weights"].values()) == pytest.approx(1)
    # and where it is all there is, the baseline stays
    alone = compare([with_costs(tmp_path / "alone", costs, {BASE: 100e-6, GOOD: 91e-6 / 1.05**2})])
    assert "comes closest to the baseline, which remains the best" in verdict_of(alone).text


def test_a_great_gain_is_worth_its_price_which_is_told(tmp_path):
    costs = {BASE: (QUIET, {"torque_rms": 0.1}), GOOD: (3 * QUIET, {"torque_rms": 0.2})}
    found = compare([with_costs(tmp_path / "runs", costs, {BASE: 450e-6, GOOD: 10e-6})])
    verdict = verdict_of(found)
    assert verdict.best == verdict.least == SettingEntry(0, GOOD)
    assert verdict.score < 0.2
    assert "It costs 3 times the vibration (3 pulses RMS against 1 pulses RMS on " in verdict.text
    assert "2 times the effort (20 % of the torque limit RMS against 10 % of the torque limit RMS on " in verdict.text
    assert "A smaller RMS contour error has" not in verdict.text


def test_a_best_that_never_comes_to_its_goal_says_so(tmp_path):
    """Where the baseline does not either, the weights see no difference: all of them end late by the same."""
    away = {"end_time": inf}
    costs = {BASE: (QUIET, away), GOOD: (QUIET, away), SAME: (QUIET, {})}
    found = compare([with_costs(tmp_path / "runs", costs, {BASE: 450e-6, GOOD: 10e-6, SAME: 450e-6})])
    verdict = verdict_of(found)
    assert verdict.best == SettingEntry(0, GOOD)
    assert "It ends off its goal in 10 of its 10 runs (baseline in 10 of 10)." in verdict.text
    arrived = compare([with_costs(tmp_path / "arrived", {**costs, GOOD: (QUIET, {})}, {BASE: 450e-6, GOOD: 10e-6})])
    assert "off its goal" not in verdict_of(arrived).text


def test_ratios_are_of_what_makes_a_difference():
    about = {"floor": 1e-8, "pulses": {"a": PULSE, "b": 2 * PULSE}}

    def figures(**values):
        usual = {"contour_rms": 1e-4, "tracking_rms": 2e-4, "torque_rms": 0.1, "late": 0.1}
        return {**usual, "vibration_power.a": PULSE**2, "vibration_power.b": 0.0, **values}

    ratios = compare_figures(figures(), figures(), about)
    assert ratios == dict.fromkeys([one.name for one in CRITERIA], 1.0)
    assert weigh(ratios) == 1.0
    tiny = {"vibration_power.a": (1e-3 * PULSE) ** 2, "contour_rms": 1e-12, "torque_rms": 1e-5, "late": -3.0}
    least = compare_figures(figures(**tiny), figures(), about)
    assert least["contour error"] == pytest.approx(1e-4)
    assert least["vibration"] == pytest.approx(QUANTIZED)
    assert least["effort"] == pytest.approx(0.1)
    assert least["end"] == pytest.approx(0.1)
    # the shaft that shakes most counts, in its own pulses; what is off its goal to the end is late by all of the record
    worst = compare_figures(figures(**{"vibration_power.b": (20 * PULSE) ** 2, "late": inf}), figures(), about)
    assert worst["vibration"] == pytest.approx(10)
    assert worst["end"] == pytest.approx(5)
    assert weigh(worst) == pytest.approx(10**0.2 * 5**0.1)
    assert weigh(mean_of([worst, ratios])) == pytest.approx(prod([10**0.1, 5**0.05]))
    # runs that were saved without their pulses have no vibration to weigh
    assert "vibration" not in compare_figures(figures(), figures(), {"floor": 1e-8, "pulses": {}})


def test_the_page_shows_what_is_weighed_and_every_axis(tmp_path):
    costs = {BASE: (QUIET, {}), GOOD: (2 * QUIET, {})}
    found = compare([with_costs(tmp_path / "runs", costs, {BASE: 100e-6, GOOD: 40e-6})])
    verdict, page = gain_report(found)
    table = page[page.index('id="weighed"') : page.index('id="provenance"')]
    assert all(f"{one.name}<br>({100 * one.weight:.0f} %)" in table for one in CRITERIA)
    assert f'<td class="n">{verdict.score:.3g}</td>' in table
    assert page.count("Reference and feedback of every axis over time on ") == 2
    panels = axes_over_time(found, select_series(found, verdict), "there")
    assert len(panels) == 4
    reference, baseline, best = panels[0].get_lines()
    series = select_series(found, verdict).select_task("there")
    assert reference.get_ydata().max() == pytest.approx(360, rel=1e-3)
    # the drawn axes err by the runs' offsets: 100 µrad and 40 µrad, kept in single precision
    for line, (_, one), offset in zip(panels[1].get_lines(), series, (100e-6, 40e-6), strict=True):
        np.testing.assert_allclose(line.get_ydata(), 1e3 * offset, rtol=2e-2)
        assert one.feedback.shape == (len(one.t), 2)
    assert len(baseline.get_xdata()) == len(best.get_xdata())
