"""Motions of days to decades: an instant is known to a share of itself only, and what is proved
takes that in.
"""

import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicSpline, PPoly

from benchmarks.evidence.random_problems import random_spline
from planner import time_optimal
from planner.timing import Profile
from planner.timing.initial_guess import average


def polyline(points):
    points = np.array(points, float)[:, None]
    return PPoly(np.stack([np.diff(points, axis=0), points[:-1]]), np.arange(float(len(points))))


@pytest.mark.parametrize("jerk", [None, 1e6])
def test_a_short_move_behind_a_long_one(jerk):
    """The last ramps take 1e-4 s after 3e6 s, where instants are 5e-10 s apart."""
    found = time_optimal(
        polyline([0.0, 3e6, 3e6 - 1e-3]), max_speed=1.0, max_acceleration=1e3, max_jerk=jerk
    )
    assert found.certificate.holds
    assert found.trajectory.duration == pytest.approx(3e6, rel=1e-6)


def test_a_ramp_far_shorter_than_its_motion():
    """1e8 s at 1e-9 of a unit per second, reached in 1e-7 s."""
    found = time_optimal(polyline([0.0, 0.1]), max_speed=1e-9, max_acceleration=1e-2)
    assert found.certificate.holds
    assert found.trajectory.duration == pytest.approx(1e8, rel=1e-8)


def test_the_average_over_a_window_far_shorter_than_its_motion():
    """A jerk-limited start: 10⁴ s at 10⁻⁷ m/s behind a ramp, averaged over 1.5 · 10⁻⁴ s; s̃ = s − v
    w/2, ṡ̃ = v.

    As a difference of ∫ s from the start on, it used to jump by 10⁻¹¹ m from instant to instant.
    """
    v, w, zero = 1e-7, 1.5e-4, np.zeros(2)
    motion = Profile(
        np.array([0.0, 5e-9]),
        np.array([0.0, v]),
        np.array([1e-6, 0.0]),
        zero,
        np.array([0.1, 1e4]),
        zero,
    )
    t = np.linspace(1.0, 1e4, 500)
    averaged = average(motion, w, (0.0, v))
    knots = np.cumsum(averaged.h)

    def at(t):
        k = np.searchsorted(knots, t).clip(max=len(knots) - 1)
        return averaged.at(k, t - np.append(0.0, knots)[k])

    s, speed, slope, _ = at(t)
    np.testing.assert_allclose(s, 5e-9 + v * (t - 0.1 - w / 2), rtol=0, atol=1e-17)
    np.testing.assert_allclose(speed, v, rtol=1e-12)
    assert not slope.any()
    ramp = np.linspace(0.01, 0.09, 50)
    s, speed, slope, _ = at(ramp)
    np.testing.assert_allclose(speed, 1e-6 * (ramp - w / 2), rtol=1e-12)
    np.testing.assert_allclose(s, 1e-6 * (ramp**2 / 2 - ramp * w / 2 + w**2 / 6), rtol=1e-12)
    np.testing.assert_allclose(slope, 1e-6, rtol=1e-12)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 104])
def test_random_splines_of_every_scale(seed):
    """A small part of the case `robustness` of the evidence."""
    certificate = random_spline(seed).solve().certificate
    assert certificate.holds
    assert max(certificate.worst.values()) <= 1


def test_a_curve_beside_which_its_ramps_are_nothing():
    """At every place one axis is at 1e-9: the first over the first 0.7, then the other.

    No solver sees such ramps.
    """
    path = CubicSpline([0.0, 1.0, 2.0], [[0.0, 0.0], [0.7, 0.3], [1.0, 1.0]])
    found = time_optimal(path, max_speed=1e-9, max_acceleration=1e-3, max_jerk=1e2)
    assert found.certificate.holds
    assert found.trajectory.duration == pytest.approx(1.4e9, rel=2e-5)


def test_what_rounding_leaves_of_a_slope_is_no_jump():
    """q′ = q″ = 0 at both ends, where s̈ passes 1e8: the rounding of q′ there, 1e-15, is 1e-7 of
    q̈.
    """
    rng = np.random.default_rng(3)
    rng.normal(size=(5, 2))
    y = rng.normal(size=(3, 2))
    stands = [
        [y[0], 0 * y[0], 0 * y[0]],
        [y[1], (y[2] - y[0]) / 2, 0 * y[1]],
        [y[2], 0 * y[0], 0 * y[0]],
    ]
    found = time_optimal(
        BPoly.from_derivatives([0, 1, 2], stands), max_speed=10, max_acceleration=10, max_jerk=1e4
    )
    assert found.certificate.holds
    assert found.trajectory.duration < 1.0513  # as it was found when jumps were held against less
