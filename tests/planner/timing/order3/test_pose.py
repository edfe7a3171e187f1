"""Coefficients of rows in the middle of an interval, from those at its ends."""

import numpy as np
import pytest

from planner.path.polynomial import PolynomialPath
from planner.timing.order3.pose import interpolate_middles
from planner.timing.problem import Problem

CUBIC = PolynomialPath(
    [0.0, 0.5, 1.0],
    np.array([[[3.0], [2.0]], [[-1.0], [0.5]], [[0.5], [-2.0]], [[0.0], [1.0]]]),
    ["x"],
)
"""q of degree 3 on two pieces, between which q′ steps."""


def make_problem(s):
    s = np.asarray(s)
    return Problem(s, (s[:-1] >= 0.5).astype(int), ())


@pytest.mark.parametrize("intervals", [16, 64])
def test_coefficients_in_the_middle_are_those_of_the_path(intervals):
    """q′ is a parabola on each piece: exact in all intervals, also next to its step at the
    break.
    """
    problem = make_problem(np.linspace(0.0, 1.0, intervals + 1))
    middle = (problem.s[1:] + problem.s[:-1]) / 2
    places = (problem.s[:-1], problem.s[1:], middle)
    start, end, exact = (CUBIC.derivatives(s, problem.piece, 1)[1] for s in places)
    assert interpolate_middles(problem, start, end) == pytest.approx(exact, rel=1e-12)
    # the mean of both ends is off by Δs² q‴/8
    third = CUBIC.derivatives(middle, problem.piece, 3)[3]
    assert (start + end) / 2 - exact == pytest.approx(third / intervals**2 / 8, rel=1e-9)


def test_the_error_of_an_uneven_grid_falls_with_its_cube():
    """Differences of slopes are first-order estimates of c″ where adjacent intervals differ."""

    def find_error(intervals):
        s = np.linspace(0.0, 0.5, intervals + 1) ** 2
        problem = make_problem(s)
        middle = (s[1:] + s[:-1]) / 2
        between = interpolate_middles(problem, np.sin(9 * s[:-1, None]), np.sin(9 * s[1:, None]))
        return np.abs(between[:, 0] - np.sin(9 * middle)).max()

    assert find_error(64) < find_error(32) / 7


def test_a_step_of_a_coefficient_stays_in_its_interval():
    """Next to a step, as of bounds that are lowered along the path, nothing overshoots."""
    problem = make_problem(np.linspace(0.0, 0.4, 17))
    values = np.where(np.arange(17) > 4, 2.0, 1.0)[:, None]
    between = interpolate_middles(problem, values[:-1], values[1:])[:, 0]
    assert between.tolist() == [1.0] * 4 + [1.5] + [2.0] * 11


def test_a_piece_of_one_interval_is_interpolated_linearly():
    problem = make_problem([0.0, 0.5, 1.0])
    between = interpolate_middles(problem, np.array([[1.0], [5.0]]), np.array([[3.0], [4.0]]))
    assert between.tolist() == [[2.0], [4.5]]


def test_an_interval_of_no_length_gives_finite_rows():
    """Rounding may leave one. The solver refuses it; a warning here would fail this test."""
    problem = make_problem([0.0, 0.25, 0.25, 0.75, 1.0])
    values = np.array([[1.0], [2.0], [3.0], [4.0], [5.0]])
    with np.errstate(all="raise"):
        between = interpolate_middles(problem, values[:-1], values[1:])
    assert np.isfinite(between).all()
