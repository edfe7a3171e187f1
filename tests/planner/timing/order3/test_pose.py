"""Rows in the middle of an interval: where the motion is half-way in time, not half-way in length."""

import numpy as np
import pytest

from planner.path.polynomial import PolynomialPath
from planner.timing.order3.pose import Middles
from planner.timing.problem import Problem
from planner.timing.profile import Profile

CUBIC = PolynomialPath(
    [0.0, 0.5, 1.0],
    np.array([[[3.0], [2.0]], [[-1.0], [0.5]], [[0.5], [-2.0]], [[0.0], [1.0]]]),
    ["x"],
)
"""q of degree 3 on two pieces, between which q′ steps."""


def accelerate(intervals):
    """Return a problem without limits over both pieces, and the motion s = t² on its grid."""
    s = np.linspace(0.0, 1.0, intervals + 1)
    piece = (s[:-1] >= 0.5).astype(int)
    problem = Problem(s, piece, ())
    one = np.ones(1)
    motion = Profile(0 * one, 0 * one, 2 * one, 0 * one, one, np.zeros(1, int))
    return problem, motion.on(s)


def derivative(s, piece):
    return CUBIC.derivatives(s, piece, 1)[1]


def test_the_middle_is_half_way_in_time():
    """From rest with constant acceleration, half of the time takes a quarter of the length."""
    problem, columns = accelerate(64)
    share = Middles.of(problem, columns).share
    assert share[0] == pytest.approx(0.25, rel=1e-12)
    t = np.sqrt(problem.s)
    middle = ((t[1:] + t[:-1]) / 2) ** 2
    expected = (middle - problem.s[:-1]) / np.diff(problem.s)
    # columns of a motion end with s̈ = 0, so that its last interval is another
    assert share[:-1] == pytest.approx(expected[:-1], rel=1e-12)


@pytest.mark.parametrize("intervals", [16, 64])
def test_coefficients_in_the_middle_are_those_of_the_path(intervals):
    """q′ is a parabola on each piece: exact in all intervals, also next to its step at the break."""
    problem, columns = accelerate(intervals)
    middles = Middles.of(problem, columns)
    start = derivative(problem.s[:-1], problem.piece)
    end = derivative(problem.s[1:], problem.piece)
    exact = derivative(problem.s[:-1] + middles.share / intervals, problem.piece)
    assert middles.interpolate(start, end) == pytest.approx(exact, rel=1e-12)
    # the mean of both ends would be off by far more
    assert np.abs((start + end) / 2 - exact).max() > 1e-3 * np.abs(exact).max()


def test_a_step_of_a_coefficient_stays_in_its_interval():
    """Next to a step, as of bounds that are lowered along the path, nothing overshoots."""
    problem, columns = accelerate(16)
    middles = Middles.of(problem, columns)
    place = np.arange(17)
    values = np.where(place > 4, 2.0, 1.0)[:, None]
    between = middles.interpolate(values[:-1], values[1:])[:, 0]
    assert (between >= 1.0).all()
    assert (between <= 2.0).all()
    assert np.flatnonzero((between != 1.0) & (between != 2.0)).tolist() == [4]


def test_a_piece_of_one_interval_is_interpolated_linearly():
    problem, columns = accelerate(2)
    middles = Middles.of(problem, columns)
    start, end = np.array([[1.0], [5.0]]), np.array([[3.0], [4.0]])
    expected = start + middles.share[:, None] * (end - start)
    assert middles.interpolate(start, end) == pytest.approx(expected, rel=1e-15)


def test_an_interval_of_no_length_gives_finite_rows():
    """Rounding may leave one. The solver refuses it; a warning here would fail this test."""
    problem, columns = accelerate(4)
    s = np.array([0.0, 0.25, 0.25, 0.75, 1.0])
    middles = Middles.of(Problem(s, problem.piece, ()), columns)
    values = np.array([[1.0], [2.0], [3.0], [4.0], [5.0]])
    with np.errstate(all="raise"):
        between = middles.interpolate(values[:-1], values[1:])
    assert np.isfinite(between).all()
