"""Sampled ranges: parabolas through samples, and samples that are not numbers."""

import numpy as np
import pytest

from planner.timing.sampling import bound_parabolas


def test_the_peak_of_a_parabola_between_samples_is_exact():
    t = np.linspace(0.0, 1.0, 5)
    peak = 0.6
    values = 2.0 - (t - peak) ** 2
    low, high = bound_parabolas(values.reshape(1, 5, 1))
    assert high[0, 0] == pytest.approx(2.0, abs=1e-15)
    assert low[0, 0] == values.min()


def test_vertices_outside_the_samples_do_not_count():
    values = np.linspace(0.0, 1.0, 5) ** 2 + np.linspace(0.0, 3.0, 5)
    low, high = bound_parabolas(values.reshape(1, 5, 1))
    assert (low[0, 0], high[0, 0]) == (0.0, 4.0)


@pytest.mark.parametrize("place", range(5))
@pytest.mark.parametrize("unknown", [np.nan, np.inf, -np.inf])
def test_a_sample_that_is_no_number_leaves_the_range_open(place, unknown):
    values = np.zeros((2, 5, 2))
    values[1, place, 0] = unknown
    low, high = bound_parabolas(values)
    assert low.tolist() == [[0.0, 0.0], [-np.inf, 0.0]]
    assert high.tolist() == [[0.0, 0.0], [np.inf, 0.0]]
