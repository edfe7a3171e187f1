"""A small part of the case `lower_bounds` of the evidence."""

import pytest

from benchmarks.evidence.cases.lower_bounds import find_shortest, solve_straight


def test_straight_moves_take_no_less_than_is_proved():
    for _, bound, shortest in solve_straight(3, seed=4):
        assert shortest * (1 - 2e-3) <= bound <= shortest


def test_the_shortest_move_has_the_ramps_that_its_limits_ask_for():
    # two ramps of 1/2 + 2/4 s take 1 m together, the other 2 m are at 1 m/s
    assert find_shortest(3.0, 1.0, 2.0, 4.0) == pytest.approx(1.0 + 1.0 + 2.0)
    # jerk alone: four ramps of (L/2J)^(1/3)
    assert find_shortest(2.0, 1e3, 1e3, 1.0) == pytest.approx(4.0)
    # without a cruise: 2 m/s² between ramps of 1 s, up to 4 m/s in 3 s
    assert find_shortest(12.0, 1e3, 2.0, 2.0) == pytest.approx(6.0)
