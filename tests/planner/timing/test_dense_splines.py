"""Splines of very many knots: timed in one run, with fewer intervals for each piece."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import pulsepath as pp

LIMITS = {"max_speed": 1.0, "max_acceleration": 5.0, "max_jerk": 100.0}


def circle(knots):
    t = np.linspace(0, 2 * np.pi, knots)
    return CubicSpline(t, np.c_[np.cos(t), np.sin(t)])


def test_a_circle_of_2600_knots_takes_as_long_as_one_of_100():
    """It was refused: 20 intervals for each piece are more than a run may have."""
    dense, usual = (pp.time_optimal(circle(knots), **LIMITS) for knots in (2600, 100))
    assert dense.certificate.holds
    assert dense.trajectory.duration == pytest.approx(usual.trajectory.duration, rel=1e-5)
    assert dense.trajectory.duration == pytest.approx(5.907, abs=1e-3)


def test_too_many_are_refused_with_a_remedy_that_there_is(monkeypatch):
    """At the real limit, 100 000, the spline alone takes 5 s."""
    monkeypatch.setattr("planner.timing.grid.MAX_DENSE_PIECES", 100)
    with pytest.raises(
        pp.MotionError, match=r"119 pieces without a stop, at most 100 .* start_speed"
    ):
        pp.time_optimal(circle(120), **LIMITS)
