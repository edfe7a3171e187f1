"""Learning over trials: the closed-form update, errors that fall, and what can be taken along."""

from dataclasses import replace

import numpy as np
import pytest

from controllers import Rig, track
from controllers.drives.servo import leg_servo
from controllers.laws.nominal import nominal_axes
from controllers.laws.open_loop import Feedforward
from controllers.laws.predictive import Horizon
from controllers.learning import TAIL_STEPS, fit_feedforward, learn
from controllers.rig import Task
from controllers.simulate import sample
from kinematics import MotionError

PULSE = 0.75e-6
DT = 0.125


@pytest.fixture(scope="module")
def bench(rig, axis_motion):
    return Rig(rig, (leg_servo(rig.axes[0]),) * 3), Task(
        "way", axis_motion("quarter-sine", (30_000, -9_000, 15_000), 2.0), DT
    )


@pytest.fixture(scope="module")
def learning(bench):
    return learn(*bench, 3)


def test_errors_fall_from_trial_to_trial(learning):
    """To what quantization and straight lines of speed leave; where that is reached, by half a pulse up or down."""
    assert np.all(learning.error[1:] <= learning.error[:-1] + 0.5)
    assert np.all(learning.error[0] > 50 * learning.error[-1])
    assert any(learning.best is law for law in learning.laws)


def test_the_update_without_limits_is_norm_optimal_in_closed_form(bench):
    """u⁺ = u + (PᵀP + s I)⁻¹ Pᵀ e, by numpy, for errors of some motion; the program's own tolerance is 1e-4 pulses."""
    rig, _ = bench
    s, steps = 0.1, 8
    program = Horizon(nominal_axes(rig), DT, steps, s)
    rng = np.random.default_rng(0)
    u, e = np.full((3, 2 * steps), 800.0), rng.normal(size=(3, len(program.instants)))
    P = program.driven
    got = program.best(np.zeros((3, 4)), e + (P @ u[..., None])[..., 0], u)
    for i in range(3):
        want = u[i] + np.linalg.solve(P[i].T @ P[i] + s * np.eye(2 * steps), P[i].T @ e[i])
        np.testing.assert_allclose(got[i], want, atol=1e-4)


def test_learned_commands_keep_the_limits_of_the_machine(bench, axis_motion):
    rig, task = bench
    top = 0.9 * np.abs(sample(task.motion, rig.machine, DT).speed).max(0) * PULSE
    slow = Rig(_limited(rig.machine, top), rig.drives)
    law = learn(slow, task, 1).laws[-1]
    mean = np.diff(law.position, axis=0) / DT
    fastest = np.maximum(np.abs(mean + law.turn / 2), np.abs(mean - law.turn / 2)).max(0)
    assert np.all(fastest <= top / PULSE + 1e-2)
    assert np.all(fastest >= 0.99 * top / PULSE)


def test_the_table_ends_where_the_motion_does(learning, bench):
    rig, task = bench
    reference = sample(task.motion, rig.machine, DT)
    for law in learning.laws[1:]:
        assert len(law.turn) == reference.steps + TAIL_STEPS
        np.testing.assert_allclose(law.position[-1], reference.position[-1], atol=1.0)


def test_a_gain_that_the_data_sheet_has_wrong_is_learned_and_taken_along(bench, axis_motion):
    """Plant of 24 1/s, data sheet 30: the model that trials tell has 24, and with it another motion lags no more."""
    rig, task = bench
    plant = replace(rig, drives=tuple(replace(drive, position_gain=24.0) for drive in rig.drives))
    learning = learn(rig, task, 3, plant=plant)
    told = fit_feedforward(sample(task.motion, rig.machine, DT), learning.best, nominal_axes(rig))
    np.testing.assert_allclose(told.position_gain, 24.0, rtol=0.01)
    other = axis_motion("smooth", (9_000, 20_000, -14_000), 2.0)
    rms = [
        np.sqrt(np.mean((run.actual - run.reference) ** 2, 0))
        for run in (
            track(other, rig.machine, Feedforward(axes=of), dt=DT, rig=plant) for of in (nominal_axes(rig), told)
        )
    ]
    assert np.all(rms[1] < rms[0] / 5)


@pytest.mark.parametrize(
    ("wrong", "reason"), [({"trials": 0}, "at least one"), ({"trials": 1, "change": 0.0}, "positive")]
)
def test_learning_refuses_what_has_no_meaning(bench, wrong, reason):
    with pytest.raises(MotionError, match=reason):
        learn(*bench, **wrong)


def _limited(machine, top):
    from types import SimpleNamespace

    axes = tuple(replace(axis, max_speed=float(speed)) for axis, speed in zip(machine.axes, top, strict=True))
    return SimpleNamespace(name=machine.name, axes=axes, home_q=machine.home_q)
