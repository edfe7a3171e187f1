"""Steppers against the analytic answers of a rotor in a turning field, and against losing their
steps.
"""

from dataclasses import replace

import numpy as np
import pytest

from controllers import evaluate, find_law, load_rig, track
from controllers.drives.stepper import Stepper, peak_torque, stepper_axes
from kinematics import MotionError
from planner import Line, Program, plan

STEP = 2 * np.pi / 200
PLAIN = Stepper(((0.0, 0.4), (20.0, 0.4), (100.0, 0.1)), STEP, inertia=2e-5)
CYCLE = 4 * STEP


def run(stepper, command):
    """Position, speed, torque (N,) and full steps lost, of one stepper whose field is told to be at
    command (N,).
    """
    axes = stepper_axes([[stepper]], stepper.sample)
    told, state = axes.run(
        axes.standing(np.zeros((1, 1))), np.asarray(command)[:, None, None], np.arange(len(command))
    )
    return (
        told.position[:, 0, 0],
        told.speed[:, 0, 0],
        told.torque[:, 0, 0],
        int(axes.count_lost_steps(state)[0, 0]),
    )


def ramp(stepper, speed, seconds, up=0.1):
    """A field at a speed that it comes to within `up` seconds."""
    t = np.arange(round(seconds / stepper.sample)) * stepper.sample
    return speed * np.where(t < up, t**2 / 2 / up, t - up / 2)


def test_small_swings_have_the_frequency_of_the_linear_rotor():
    """ω² = π T/(2 · full step · J), longer by A²/16 of a pendulum's amplitude A."""
    kick = 0.02 * STEP
    x, *_ = run(PLAIN, np.full(4000, kick))
    crossings = np.flatnonzero(np.diff(np.sign(x - kick)))
    period = 2 * np.mean(np.diff(crossings)) * PLAIN.sample
    # held torque: 3e-4 at most; crossings counted to a sample in hundreds of them
    assert 2 * np.pi / period == pytest.approx(PLAIN.swing, rel=5e-4)
    # no friction: it swings as far at the end as at the beginning
    assert np.ptp(x[-1000:]) == pytest.approx(2 * kick, rel=1e-2)


@pytest.mark.parametrize("speed", [5.0, 40.0])
def test_the_rotor_lags_by_what_friction_needs_of_the_torque(speed):
    """sin(π/2 · lag/full step) = (b v + c)/T(v)."""
    stepper = replace(PLAIN, friction=1e-3, coulomb=0.02, damping=4e-3)
    command = ramp(stepper, speed, 0.8)
    x, v, _, lost = run(stepper, command)
    peak = np.interp(speed, [0, 20, 100], [0.4, 0.4, 0.1])
    lag = STEP * 2 / np.pi * np.arcsin((1e-3 * speed + 0.02) / peak)
    # at sample i the field is where it was told one sample ago
    assert command[-2] - x[-1] == pytest.approx(lag, rel=1e-4)
    assert v[-1] == pytest.approx(speed, rel=1e-6)
    assert lost == 0


def test_at_rest_it_stands_within_the_band_of_its_friction():
    stepper = replace(PLAIN, coulomb=0.02, damping=4e-3)
    command = np.concatenate([ramp(stepper, 5.0, 0.5), np.full(1500, 2.25)])
    x, v, _, lost = run(stepper, command)
    assert v[-1] == 0
    assert abs(x[-1] - 2.25) <= STEP * 2 / np.pi * np.arcsin(0.02 / 0.4)
    assert lost == 0


def brake(load):
    """A field that comes to 30 rad/s slowly against a friction, holds it, and comes to rest."""
    stepper = replace(PLAIN, coulomb=load, damping=4e-3)
    up = ramp(stepper, 30.0, 0.4, up=0.25)
    down = up[-1] + (30.0 * (t := np.arange(1000) * stepper.sample) - 60.0 * t**2)
    return stepper, np.concatenate([up, down, np.full(1000, down[-1])])


def test_steps_are_lost_just_when_the_load_exceeds_the_torque():
    """T(30 rad/s) = 0.3625 N m on the curve; the ramp needs J · 120 rad/s² = 0.0024 N m beside the
    load.
    """
    peak = np.interp(30.0, [0, 20, 100], [0.4, 0.4, 0.1])
    for load, loses in ((0.97 * peak, False), (1.01 * peak, True)):
        stepper, command = brake(load)
        x, _, _, lost = run(stepper, command)
        assert (lost > 0) == loses
        band = STEP * 2 / np.pi * np.arcsin(load / 0.4)
        assert abs(command[-1] - lost * STEP - x[-1]) <= band * (1 + 1e-9)
        assert lost % 4 == 0


def test_beyond_its_curve_it_stays_behind_for_good():
    """Thrown at once to a speed beyond its curve it does not even start: the damping drags less
    than friction holds.
    """
    t = np.arange(1200) * PLAIN.sample
    stepper = replace(PLAIN, damping=2e-4, coulomb=0.04)
    command = np.concatenate([150.0 * t, np.full(1200, 150.0 * t[-1])])
    x, _, _, lost = run(stepper, command)
    assert not x[: len(t)].any()
    assert abs(lost * STEP - command[-1]) <= CYCLE / 2 + STEP
    assert abs(command[-1] - lost * STEP - x[-1]) <= STEP * 2 / np.pi * np.arcsin(0.04 / 0.4) * (
        1 + 1e-9
    )


def test_a_quick_swing_beyond_the_unstable_place_is_no_loss():
    """Lag of more than two steps for a moment: the field comes back before the rotor has gone."""
    stepper = replace(PLAIN, damping=4e-3)
    command = np.concatenate([np.full(8, 2.4 * STEP), np.zeros(1500)])
    x, _, _, lost = run(stepper, command)
    assert lost == 0
    assert abs(x[-1]) < 1e-3 * STEP


def test_curves_of_different_lengths_share_a_batch():
    other = replace(PLAIN, torque_speed=((0.0, 0.3), (10.0, 0.25), (30.0, 0.2), (200.0, 0.0)))
    axes = stepper_axes([[PLAIN, other]], PLAIN.sample)
    for rate in (0.0, 5.0, 20.0, 25.0, 99.0, 101.0, 150.0, 250.0):
        wanted = [
            np.interp(rate, *np.transpose(s.torque_speed), right=0.0) for s in (PLAIN, other)
        ]  # fmt: skip
        found = [
            peak_torque(axes.peak[0, n], axes.bends[:, :, 0, n], axes.fastest[0, n], rate) for n in range(2)
        ]  # fmt: skip
        np.testing.assert_allclose(found, wanted, atol=1e-15)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"torque_speed": ((0.0, 0.0), (1.0, 0.0))}, "torque_speed"),
        ({"torque_speed": ((1.0, 0.2), (2.0, 0.1))}, "torque_speed"),
        ({"torque_speed": ((0.0, 0.2),)}, "torque_speed"),
        ({"full_step": 0.0}, "full_step"),
        ({"inertia": np.inf}, "inertia"),
        ({"play": -1e-6}, "play"),
        ({"sample": 5e-3}, "too long for a rotor that swings"),
    ],
)
def test_impossible_steppers_are_refused(change, words):
    with pytest.raises(MotionError, match=words):
        replace(PLAIN, **change)


def test_a_plan_that_is_tracked_tells_of_lost_steps():
    """A motor whose torque ends below the plan's speed falls behind, and the errors say why."""
    rig = load_rig("hexapod-steppers")
    weak = replace(
        rig,
        drives=(replace(rig.drives[0], torque_speed=((0.0, 3000.0), (5e-3, 0.0))), *rig.drives[1:]),
    )
    motion = plan(Program((Line(to=np.array([0, 0, 5e-3])),)), rig.machine).trajectory
    whole, fallen = (
        track(motion, rig.machine, find_law("3"), rig=on, period=1e-3) for on in (rig, weak)
    )
    assert not whole.lost.any()
    assert fallen.lost[0] > 0
    assert not fallen.lost[1:].any()
    told = evaluate(fallen, motion, rig.machine).figures()
    assert told["lost_steps"] == told["lost_steps.leg1"] == fallen.lost[0]
