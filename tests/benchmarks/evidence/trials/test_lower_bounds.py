"""A small version of `benchmarks.evidence.trials.lower_bounds`."""

from benchmarks.evidence.trials.lower_bounds import describe, solve_straight


def test_straight_moves_take_no_less_than_is_proved():
    for exact, found in solve_straight(6, seed=4):
        assert exact * (1 - 2e-3) <= found.lower_bound <= exact
    assert "of solving" in describe("move", found, 1.0)
