"""Plans behind input shapers against samples: a small version of the evidence."""

import pytest

from benchmarks.evidence.trials import shaped_plans
from controllers.drives.flexible_load import FlexibleLoad
from kinematics.machine.shaper import Shaper


def test_limits_deviation_and_vibration_of_some_plans(monkeypatch, capsys):
    monkeypatch.setattr(shaped_plans, "SAMPLES", 4000)
    monkeypatch.setattr(shaped_plans, "PROGRAMS", ("bare-circle", "linkage-line"))
    monkeypatch.setattr(shaped_plans, "MODES_OF", ())
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


@pytest.mark.parametrize("program", ["tripod-circle", "linkage-line"])
def test_two_directions_are_still_behind_shapers_of_axes_that_lie_along_neither(program, monkeypatch):
    assert max(shaped_plans.measure_directions(program)) < 0.002
    # the vibration that a shaper is not for is left
    one, _ = shaped_plans.MODES
    monkeypatch.setattr(
        shaped_plans, "FlexibleLoad", lambda frequency, damping: FlexibleLoad(1.5 * one.frequency, damping)
    )
    assert max(shaped_plans.measure_directions(program)) > 0.02


@pytest.fixture(scope="module")
def circle():
    return shaped_plans.solve_circle()


@pytest.mark.parametrize("frequency", [6.0, 12.0])
@pytest.mark.parametrize("rig", ["servos", "hexapod-steppers"])
def test_the_rig_swings_less_behind_a_shaper(circle, rig, frequency):
    """Drives, a card and pulses between the plan and the axis: a load behind a leg, before and after, without play."""
    before, after = shaped_plans.swing_on_rig(circle[1], circle[0], Shaper("zvd", frequency, 0.01), rig, play=0.0)
    assert before.min() > 5e-6
    assert (after <= 0.015 * before).all(), after / before


def test_what_play_adds_is_not_shaped(circle):
    """The nut's 5 um are let go all at once where a leg turns back: a step, which swings the load as it would alone."""
    shaper, play = Shaper("zvd", 12.0, 0.01), 5e-6
    _, without = shaped_plans.swing_on_rig(circle[1], circle[0], shaper, "hexapod-steppers", play=0.0)
    _, after = shaped_plans.swing_on_rig(circle[1], circle[0], shaper, "hexapod-steppers", play=play)
    assert (after > 4 * without).all()
    assert (after < 1.5 * play).all()
