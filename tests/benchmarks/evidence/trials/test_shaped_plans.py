"""Plans behind input shapers against samples: a small version of the evidence."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.evidence.flexible_load import FlexibleLoad
from benchmarks.evidence.trials import shaped_plans
from kinematics.machine.shaper import IMPULSES, Shaper
from planner import load_program, plan


def test_limits_deviation_and_vibration_of_some_plans(monkeypatch, capsys):
    monkeypatch.setattr(shaped_plans, "SAMPLES", 4000)
    monkeypatch.setattr(shaped_plans, "PROGRAMS", ("bare-circle", "linkage-line"))
    monkeypatch.setattr(shaped_plans, "MODES_OF", ())
    monkeypatch.setattr("sys.argv", ["shaped_plans", "--plans", "4"])
    shaped_plans.main()
    out = capsys.readouterr().out
    assert "4 plans: limits kept by 4, deviations within their bound 4, at most 5 % left of 4" in out
    for kind, count in (("zv", 1), ("zvd", 2), ("mzv", 1)):  # the programs in turn, each with another one every time
        assert out.count(f"| {kind} 30 Hz") == count


def test_each_program_is_planned_under_all_four_shapers():
    chosen = [(name, machine.axes[0].shaper.kind) for name, machine, _ in shaped_plans.choose_plans(100)]
    assert len(set(chosen)) == len(chosen) == 4 * len(shaped_plans.PROGRAMS)
    assert {kind for _, kind in chosen[:4]} == set(IMPULSES)


def test_stops_of_plans_under_all_four_shapers(monkeypatch, capsys):
    monkeypatch.setattr(shaped_plans, "SAMPLES", 4000)
    monkeypatch.setattr(shaped_plans, "PROGRAMS", ("linkage-line",))
    monkeypatch.setattr(shaped_plans, "HOLDS", 1)
    monkeypatch.setattr("sys.argv", ["shaped_plans", "--plans", "4", "--holds"])
    shaped_plans.main()
    out = capsys.readouterr().out
    assert all(f"| {kind} 30 Hz" in out for kind in IMPULSES)
    assert "4 stops, 4 proved: limits kept by 4, pulses within their bound 4" in out


def test_a_stop_that_is_too_hard_and_pulses_beside_their_axes_are_found(monkeypatch):
    monkeypatch.setattr(shaped_plans, "SAMPLES", 4000)
    monkeypatch.setattr(shaped_plans, "PROGRAMS", ("linkage-line",))
    name, machine, order = next(shaped_plans.choose_plans(1))
    made = plan(load_program(name), machine, order=order)
    held = made.hold(0.4)
    seen, off = shaped_plans.measure_stop(made, held)
    assert seen == pytest.approx(1, abs=1e-4)
    assert off == pytest.approx(1, abs=0.1)
    # limits are seen on both sides
    still, most = np.zeros((2, len(machine.axes))), np.array([axis.max_acceleration for axis in machine.axes])
    for side in (-1.2, 1.2):
        push = np.array([side * most, 0 * most])
        assert shaped_plans.measure_axes(machine, 2, machine.home_q + still, [still, push]) == pytest.approx(1.2)
    shifted = [replace(axis, ticks=axis.ticks + 500) for axis in held.pulses.axes]
    late = replace(held, pulses=replace(held.pulses, axes=tuple(shifted)))
    assert shaped_plans.measure_stop(made, late)[1] > 1


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
