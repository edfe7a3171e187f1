"""Learning over trials: errors that fall within the limits of the machine, and the gain that
carries over.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from benchmarks.evidence.learning import TAIL_STEPS, fit_feedforward, learn
from controllers import Rig, track
from controllers.drives.servo import leg_servo
from controllers.laws.nominal import nominal_axes
from controllers.laws.open_loop import Feedforward
from controllers.rig import Task
from controllers.simulate import sample
from kinematics import Axis
from tests.controllers.conftest import PULSE, SHAPES, AxisMotion

DT = 0.125


def make_rig(max_speeds=(None, None, None)):
    axes = tuple(
        Axis(name, pulse=PULSE, max_speed=top) for name, top in zip("xyz", max_speeds, strict=True)
    )
    machine = SimpleNamespace(name="rig", axes=axes, home_q=np.zeros(3))
    return Rig(machine, (leg_servo(axes[0]),) * 3)


def make_motion(shape, pulses):
    return AxisMotion(np.zeros(3), np.array(pulses) * PULSE, 2.0, SHAPES[shape])


TASK = Task("line", make_motion("quarter-sine", (30_000, -9_000, 15_000)), DT)


def test_errors_fall_from_trial_to_trial():
    """The last errors are those of quantization and of speeds in straight lines: they vary by half
    a pulse.
    """
    learning = learn(make_rig(), TASK, 3)
    assert np.all(learning.error[1:] <= learning.error[:-1] + 0.5)
    assert np.all(learning.error[0] > 50 * learning.error[-1])
    reference = sample(TASK.motion, make_rig().machine, DT)
    assert len(learning.best.turn) == reference.steps + TAIL_STEPS
    np.testing.assert_allclose(learning.best.position[-1], reference.position[-1], atol=1.0)


def test_learned_commands_keep_the_limits_of_the_machine():
    top = 0.9 * np.abs(sample(TASK.motion, make_rig().machine, DT).speed).max(0)
    law = learn(make_rig((top * PULSE).tolist()), TASK, 1).laws[-1]
    mean = np.diff(law.position, axis=0) / DT
    fastest = np.maximum(np.abs(mean + law.turn / 2), np.abs(mean - law.turn / 2)).max(0)
    assert np.all(fastest <= top + 1e-2)
    assert np.all(fastest >= 0.99 * top)


def test_a_gain_that_the_data_sheet_has_wrong_is_learned_and_carries_over():
    """The plant has 24 1/s, the data sheet 30: the fit to the learned table gives 24, for another
    motion as well.
    """
    rig = make_rig()
    plant = replace(rig, drives=tuple(replace(drive, position_gain=24.0) for drive in rig.drives))
    learning = learn(rig, TASK, 3, plant=plant)
    fitted = fit_feedforward(sample(TASK.motion, rig.machine, DT), learning.best, nominal_axes(rig))
    np.testing.assert_allclose(fitted.position_gain, 24.0, rtol=0.01)
    other = make_motion("smooth", (9_000, 20_000, -14_000))
    rms = []
    for axes in (nominal_axes(rig), fitted):
        run = track(other, rig.machine, Feedforward(axes=axes), dt=DT, rig=plant)
        rms.append(np.sqrt(np.mean((run.actual - run.reference) ** 2, 0)))
    assert np.all(rms[1] < rms[0] / 5)
