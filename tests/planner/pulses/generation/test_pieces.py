"""Pulses of long motions: what is trusted grows with the way, as rounding does."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator, PPoly

from kinematics import Axis
from planner import time_optimal
from planner.pulses import check, generate
from planner.pulses.generation.pieces import FIT_TOLERANCE, fit


@pytest.fixture(scope="module")
def motion():
    """An hour: 10 km of path over which q hardly moves, a metre over which it moves one, and 10 km
    back to hardly.
    """
    far = 1e4
    s = np.array([0, 0.999 * far, far, far + 1, 1.001 * far + 1, 2 * far])
    slope = PchipInterpolator(
        s, np.array([1 / far, 1 / far, 1.0, 1.0, 1 / far, 1 / far])
    ).antiderivative()
    return time_optimal(
        PPoly(slope.c[:, :, None], slope.x), max_speed=4e-3, max_acceleration=8e-4
    ).trajectory


def test_rounding_of_a_long_way_is_no_roughness(motion):
    """It was refused: "strays 1.78e-12 from any polynomial, more than 3.6e-13", by rounding of s at
    10 km alone.
    """
    assert motion.duration > 3000
    pieces = fit(motion, np.array([FIT_TOLERANCE * 3.6e-7]))
    assert pieces.error[0] < 4 * np.finfo(float).eps * 1e4  # of s, where dq/ds is 1
    assert pieces.noise[0] >= min(pieces.error[0], FIT_TOLERANCE * 3.6e-7)


def test_pulses_of_a_long_way_are_proved(motion):
    """The check took rounding of s for pulses 0.5017 ticks off their crossing."""
    axis, home = Axis("x", pulse=1e-5), motion.at(np.zeros(1)).q[0]
    schedule = generate(motion, [axis], home)
    found = check(schedule, motion, [axis], home)
    assert found.holds, found.faults
    assert (
        abs(
            schedule.axes[0].final
            - (motion.at(np.array([motion.duration])).q[0, 0] - home[0]) / 1e-5
        )
        <= 0.5
    )
