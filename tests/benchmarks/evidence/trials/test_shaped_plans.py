"""Plans behind input shapers against samples: a small version of the evidence."""

import pytest

from benchmarks.evidence.trials import shaped_plans


def test_limits_deviation_and_vibration_of_some_plans(monkeypatch, capsys):
    monkeypatch.setattr(shaped_plans, "SAMPLES", 4000)
    monkeypatch.setattr(shaped_plans, "PROGRAMS", ("bare-circle", "linkage-line"))
    monkeypatch.setattr("sys.argv", ["shaped_plans", "--plans", "4"])
    shaped_plans.main()
    out = capsys.readouterr().out
    assert "4 plans: limits kept by 4, deviations within their bound 4, at most 5 % left of 4" in out
    assert out.count("zv 30 Hz") == 2
    assert out.count("zvd 30 Hz") == 2


def test_a_wrong_bound_is_found(monkeypatch):
    """What it holds against samples can fail: the deviation of a plan is more than a hundredth of what is proved."""
    monkeypatch.setattr(shaped_plans, "SAMPLES", 4000)
    plan = next(shaped_plans.make_plans(1))
    seen, away = shaped_plans.measure(plan)
    assert seen == pytest.approx(1, abs=1e-3)
    assert away > 0.5 * plan.proof.deviation
    assert shaped_plans.measure_vibration(plan, 2 * plan.shaper.frequency) > 0.05
