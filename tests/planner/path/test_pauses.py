"""Recorded samples with a pause, and paths that all but stand still inside: no slower than a rest
there, and soon.
"""

from time import process_time

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import pulsepath as pp

LIMITS = {"max_speed": 1.0, "max_acceleration": 5.0, "max_jerk": 100.0}


@pytest.mark.parametrize(("count", "power"), [(101, 3), (100, 5), (1001, 5)])
def test_at_order_2_passing_a_place_of_no_motion_is_no_slower_than_a_rest_there(count, power):
    """Half a turn whose angle goes as (s − ½)ᵐ: on a knot, and between two.

    Its halves by themselves, with a rest.
    """
    limits = {"max_speed": 1.0, "max_acceleration": 5.0}
    s = np.linspace(0, 1, count)

    def path(s):
        angle = np.pi * (2 ** (power - 1) * (s - 0.5) ** power + 0.5)
        return CubicSpline(s, np.c_[np.cos(angle), np.sin(angle)])

    whole = pp.time_optimal(path(s), **limits)
    halves = [
        pp.time_optimal(path(part), **limits)
        for part in (np.linspace(0, 0.5, 101), np.linspace(0.5, 1, 101))
    ]
    assert whole.certificate.holds
    assert whole.trajectory.duration <= sum(half.trajectory.duration for half in halves) * (
        1 + 1e-3
    )


def record(shape, count, pause):
    """Samples every 10 ms of a move that slows down to a rest in its middle and begins again."""
    way = (1 - np.cos(np.pi * np.linspace(0, 1, count))) / 4
    s = np.concatenate([way, np.full(pause, 0.5), 0.5 + way])
    return CubicSpline(0.01 * np.arange(len(s)), shape(s))


def line(s):
    return np.c_[s, 0.5 * s]


@pytest.mark.parametrize(("count", "pause"), [(20, 11), (500, 51)])
def test_a_pause_costs_little_more_than_a_rest(count, pause):
    """Two lines of ½ take 2 (½ + v/a + a/j) = 1.5 s; the spline swings about the pause, by less
    with more samples.
    """
    begin = process_time()
    made = pp.time_optimal(record(line, count, pause), **LIMITS)
    assert made.certificate.holds
    assert 1.25 < made.trajectory.duration < {20: 1.64, 500: 1.53}[count]
    assert process_time() - begin < 60  # it took minutes


def test_samples_that_do_not_move_are_left_out():
    """Swings of rounding about a pause are no motion: as many rests as with a pause of few
    samples.
    """
    short, long = (
        pp.time_optimal(record(line, 100, pause), max_speed=1.0, max_acceleration=5.0)
        for pause in (40, 400)
    )
    assert long.trajectory.duration == pytest.approx(short.trajectory.duration, rel=1e-6)
    assert len(long.trajectory.path.breaks) == len(short.trajectory.path.breaks)


def test_an_arc_with_a_pause_is_as_fast_as_its_halves():
    arc = pp.time_optimal(record(lambda s: np.c_[np.cos(2 * s), np.sin(2 * s)], 100, 11), **LIMITS)
    assert arc.certificate.holds
    assert arc.trajectory.duration < 2 * (1 + 1 / 5 + 5 / 100)
