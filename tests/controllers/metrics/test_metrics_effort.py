"""Torque over its limit."""

import numpy as np
import pytest

from controllers import load_rig
from controllers.metrics.metrics import efforts, torque_limits


def test_effort_of_a_square_wave_and_of_a_sine():
    """A square wave at the limit is saturated throughout, RMS 1; a sine of half the limit never,
    RMS 1/(2√2).
    """
    t = np.arange(2000) / 2000
    limit = np.array([[0.9, 4.0]])
    torque = np.stack(
        [0.9 * np.sign(np.sin(2 * np.pi * 5 * (t + 1e-4))), 2.0 * np.sin(2 * np.pi * 3 * t)], 1
    )[:, None]
    found = efforts(torque, limit)[0]
    np.testing.assert_allclose(found.torque_rms, [1, 1 / np.sqrt(8)], rtol=1e-12)
    np.testing.assert_allclose(found.torque_peak, [1, 0.5], rtol=1e-6)
    np.testing.assert_array_equal(found.saturation, [1, 0])


def test_saturation_is_a_share_of_the_time():
    torque = np.concatenate([np.full(300, -2.0), np.full(900, 1.9)])[:, None, None]
    found = efforts(torque, np.array([[2.0]]))[0]
    assert found.saturation[0] == 0.25
    assert found.torque_rms[0] == pytest.approx(
        np.sqrt((300 * 4 + 900 * 1.9**2) / 1200) / 2, rel=1e-12
    )


def test_limits_are_those_of_each_rigs_drives():
    servos, steppers = load_rig("servo-rig"), load_rig("hexapod-steppers")
    np.testing.assert_array_equal(
        torque_limits([servos]), [[drive.torque_limit for drive in servos.drives]]
    )
    assert (
        torque_limits([steppers, steppers]).tolist()
        == [[drive.torque_speed[0][1] for drive in steppers.drives]] * 2
    )
