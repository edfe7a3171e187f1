"""A flexible load against its equation, and the vibration that input shapers leave of it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.evidence.flexible_load import FlexibleLoad
from kinematics.machine.shaper import IMPULSES, Shaper
from planner.shaping.shaped_motion import shape_motion

STEP = 1e-4


def test_a_base_that_starts_at_full_speed_swings_the_load_by_the_formula():
    """q = v t: z = −v/ω_d e^(−ζωt) sin ω_d t, from ż(0) = −v."""
    load, t = FlexibleLoad(20.0, 0.1), np.arange(4000) * STEP
    omega = 2 * np.pi * 20.0
    damped = omega * np.sqrt(1 - 0.01)
    z, envelope = load.swing(0.3 * t, STEP)
    exact = -0.3 / damped * np.exp(-0.1 * omega * t) * np.sin(damped * t)
    assert np.allclose(z[:-1], exact[:-1], rtol=0, atol=1e-12)
    assert np.allclose(envelope[:-1], 0.3 / damped * np.exp(-0.1 * omega * t[:-1]), rtol=1e-9)


@pytest.fixture(scope="module")
def bare(plan_bundled):
    return plan_bundled("bare-circle", "hexapod", 2)


def residuals(trajectory, machine, shaper, load):
    """Return the residual vibration (n,) of a load on each leg, with the shaper and without it."""
    shaped = shape_motion(trajectory, [replace(axis, shaper=shaper) for axis in machine.axes])
    left = []
    for motion in (shaped, trajectory):
        t = np.arange(0.0, motion.duration + 0.2, STEP)
        q = motion.at(t).q
        left.append([load.residual(q[:, k], STEP, motion.duration) for k in range(q.shape[1])])
    return np.array(left)


@pytest.mark.parametrize("kind", sorted(IMPULSES))
def test_the_residual_vibration_is_that_of_the_formula(bare, kind):
    """Without damping the amplitude after the end is the spectrum at f: the shaper multiplies it by
    V(f).
    """
    shaper = Shaper(kind, 23.0)
    for frequency in (20.7, 23.0, 25.3):
        shaped, unshaped = residuals(bare.trajectory, bare.machine, shaper, FlexibleLoad(frequency))
        assert unshaped.min() > 1e-8
        assert np.allclose(
            shaped, shaper.vibration(frequency, 0.0) * unshaped, rtol=0, atol=2e-3 * unshaped.max()
        )


@pytest.mark.parametrize("kind", sorted(IMPULSES))
def test_a_damped_vibration_is_below_five_per_cent_at_its_frequency(bare, kind):
    shaped, unshaped = residuals(
        bare.trajectory, bare.machine, Shaper(kind, 23.0, 0.05), FlexibleLoad(23.0, 0.05)
    )
    assert (shaped <= 0.05 * unshaped).all()
