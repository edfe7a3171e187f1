"""Settling, overshoot and timing of steps whose answer is known."""

import numpy as np
import pytest

from controllers.metrics.metrics import endings

STEP = 1000.0
SAMPLE = 0.25e-3
T = np.arange(0, 4, SAMPLE)
PULSE = np.array([2e-6])


def ending(actual, planned=None, duration=0.0, band=10.0):
    planned = np.full((len(T), 1), STEP) if planned is None else planned
    return endings(T, actual.reshape(len(T), 1, 1), planned, duration, PULSE, band)[0]


def test_a_first_order_step_settles_logarithmically():
    """1 − e^(−t/T) is within the band from T ln(step/band) on, to a sample; it never goes
    beyond.
    """
    found = ending(STEP * (1 - np.exp(-T / 0.05)))
    assert found.end_time == pytest.approx(0.05 * np.log(STEP / 10), abs=SAMPLE)
    assert found.late == found.settling[0] == found.end_time
    assert found.overshoot[0] == 0


@pytest.mark.parametrize("zeta", [0.2, 0.5, 0.8])
def test_a_second_order_step_overshoots_by_its_damping(zeta):
    """e^(−πζ/√(1 − ζ²)) of the step; the samples miss the peak by ω²(h/2)²/2 of it at most.

    The last crossing of the band is looked for in a thousand times finer samples.
    """
    omega = 30.0
    damped = omega * np.sqrt(1 - zeta**2)

    def step(t):
        swing = np.cos(damped * t) + zeta / np.sqrt(1 - zeta**2) * np.sin(damped * t)
        return STEP * (1 - np.exp(-zeta * omega * t) * swing)

    found = ending(step(T))
    peak = STEP * np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2))
    missed = STEP * omega**2 * SAMPLE**2 / 8
    assert peak - missed <= found.overshoot[0] / PULSE[0] <= peak
    near = np.linspace(found.end_time - 2 * SAMPLE, found.end_time + 1, 400_000)
    out = np.abs(step(near) - STEP) > 10.0
    assert out[near < found.end_time].any()
    assert not out[near >= found.end_time].any()


def test_a_step_downwards_is_the_same():
    up = STEP * (1 - np.exp(-T / 0.05) * np.cos(60 * T))
    down = ending(STEP - up, np.zeros((len(T), 1)))
    assert down.overshoot[0] == pytest.approx(ending(up).overshoot[0], rel=1e-12)
    assert down.end_time == ending(up).end_time


def test_what_is_not_within_the_band_never_ends():
    found = ending(np.full(len(T), STEP - 10.5))
    assert found.end_time == found.late == found.settling[0] == np.inf
    assert ending(np.full(len(T), STEP - 9.5)).end_time == 0


def test_a_motion_may_be_there_before_its_planned_end():
    """A ramp of 1 s at 1000 pulses/s is 10 pulses from its end 10 ms before."""
    ramp = STEP * np.minimum(T, 1.0)
    found = ending(ramp, ramp[:, None], duration=1.0)
    assert found.late == pytest.approx(-0.01, abs=SAMPLE)
    assert found.settling[0] == 0


def test_going_there_and_back_is_no_overshoot():
    """Planned out to 1000 and back to 0 within 2 s, followed 50 ms late, and 7 pulses too far in
    the end.
    """
    planned = STEP * np.maximum(1 - np.abs(np.minimum(T, 2.0) - 1), 0)
    late = np.interp(T - 0.05, T, planned)
    beyond = np.where(T > 2.05, -7.0 * np.sin(np.pi * np.minimum((T - 2.05) / 0.1, 1.0)), 0.0)
    found = ending(late + beyond, planned[:, None], duration=2.0)
    assert found.overshoot[0] / PULSE[0] == pytest.approx(7.0, rel=1e-4)
    assert found.late == pytest.approx(0.04, abs=SAMPLE)


def test_the_slowest_axis_tells_the_end():
    slow, fast = (STEP * (1 - np.exp(-T / of)) for of in (0.1, 0.02))
    actual = np.stack([fast, slow], 1)[:, None]
    found = endings(T, actual, np.full((len(T), 2), STEP), 0.0, np.ones(2))[0]
    np.testing.assert_allclose(
        found.settling, np.array([0.02, 0.1]) * np.log(STEP / 10), atol=SAMPLE
    )
    assert found.end_time == found.settling[1]
