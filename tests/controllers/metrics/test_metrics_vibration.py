"""Jerk and spectrum of pure tones."""

import numpy as np
import pytest

from controllers.metrics.metrics import vibrations

SAMPLE, HOST = 0.25e-3, 5e-3
T = np.arange(8000) * SAMPLE
PULSE = np.array([1e-6])


def tone(frequency, amplitude=30.0, phase=0.3, t=T):
    return amplitude * np.sin(2 * np.pi * frequency * t + phase)


def vibration(error, planned=None, t=T):
    planned = np.zeros((len(t), 1)) if planned is None else planned
    return vibrations(t, (error + planned[:, 0]).reshape(-1, 1, 1), planned, PULSE, HOST)[0]


@pytest.mark.parametrize("frequency", [200.0, 230.3, 611.17, 1500.0])
def test_a_tone_above_the_sample_rate_has_half_its_square(frequency):
    """A²/2; the window's lobe about zero adds what its side lobes reach at twice the frequency:
    below 1e-9.
    """
    found = vibration(tone(frequency))
    assert found.above == 200.0
    assert found.power[0] == pytest.approx((30e-6) ** 2 / 2, rel=1e-8)


@pytest.mark.parametrize("frequency", [3.0, 50.5, 150.0])
def test_a_tone_below_has_none(frequency):
    """50 Hz away are 100 bins: Hann's side lobes are below 1e-11 of the power there."""
    assert vibration(tone(frequency)).power[0] < 1e-9 * (30e-6) ** 2 / 2


def test_of_two_tones_the_upper_one_counts():
    found = vibration(tone(40.0, 500.0) + tone(700.0, 2.0))
    assert found.power[0] == pytest.approx((2e-6) ** 2 / 2, rel=1e-4)


def test_neither_an_offset_nor_the_plan_is_vibration():
    planned = 1e4 * np.sin(2 * np.pi * 400.0 * T)[:, None]
    assert vibration(np.full(len(T), 77.0), planned).power[0] < 1e-20


@pytest.mark.parametrize("frequency", [5.0, 60.0, 400.0])
def test_jerk_of_a_tone(frequency):
    """A ω³/√2, seen through third differences by (sin(x)/x)³, x = π f h; whole periods, but for 3
    samples.
    """
    omega, x = 2 * np.pi * frequency, np.pi * frequency * SAMPLE
    expected = 30e-6 * omega**3 / np.sqrt(2) * (np.sin(x) / x) ** 3
    assert vibration(tone(frequency)).jerk_rms[0] == pytest.approx(expected, rel=2 * 3 / len(T))


def test_jerk_of_a_cubic_is_its_third_derivative():
    """To the rounding of third differences: 8 · 1e-16 · 1e4 pulses over h³."""
    position = 1e4 * (T / 2) ** 3
    jerk = vibration(np.zeros(len(T)), position[:, None]).jerk_rms[0]
    assert jerk == pytest.approx(1e4 * 6 / 8 * 1e-6, rel=1e-5)


def test_samples_as_far_apart_as_the_host_see_nothing():
    t = np.arange(400) * HOST
    assert np.isnan(vibration(tone(20.0, t=t), t=t).power[0])


def test_many_runs_are_as_each_alone():
    random = np.random.default_rng(1)
    actual = random.normal(size=(3001, 200, 3))
    planned, pulse = random.normal(size=(3001, 3)), np.array([1e-6, 2e-6, 3e-6])
    t = np.arange(3001) * SAMPLE
    together = vibrations(t, actual, planned, pulse, HOST)
    for b in (0, 57, 199):
        alone = vibrations(t, actual[:, b : b + 1], planned, pulse, HOST)[0]
        np.testing.assert_allclose(together[b].power, alone.power, rtol=1e-12)
        np.testing.assert_allclose(together[b].jerk_rms, alone.jerk_rms, rtol=1e-12)
