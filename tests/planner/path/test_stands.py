"""Paths that stand (q′ = 0 of all axes): closed forms, never slower than a stop there, and the
given path as it was.
"""

import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicSpline, PchipInterpolator, PPoly

from planner import time_optimal

A, J = 10.0, 100.0


def powers(*columns, over=(-1.0, 1.0)):
    """Axes by their coefficients of 1, s, s², … on one piece."""
    made = np.zeros((max(map(len, columns)), 1, len(columns)))
    for k, column in enumerate(columns):
        moved = np.polynomial.Polynomial(column)(np.polynomial.Polynomial([over[0], 1.0])).coef
        made[len(made) - len(moved) :, 0, k] = moved[::-1]
    return PPoly(made, list(over))


def fastest(path, jerk=None, speed=1e3):
    """The solution, after what holds of each: limits, and the whole path once, forwards, by its own
    parameter.
    """
    found = time_optimal(path, max_speed=speed, max_acceleration=A, max_jerk=jerk)
    assert found.certificate.holds
    state = found.trajectory.at(np.linspace(0, found.trajectory.duration, 2001))
    assert np.abs(state.qdd).max() <= A * (1 + 1e-6)
    assert jerk is None or np.abs(state.qddd[1:-1]).max() <= jerk * (1 + 1e-6)
    assert state.s[[0, -1]].tolist() == pytest.approx(path.x[[0, -1]].tolist(), abs=1e-9)
    assert np.diff(state.s).min() >= -1e-12 * np.ptp(path.x)
    assert np.abs(path(state.s).reshape(state.q.shape) - state.q).max() < 1e-9 * np.ptp(state.q)
    return found


def rest_to_rest(length, jerk=None):
    """T of one line without a limit on speed: 2 √(L/A), or with jerk (A/J + √((A/J)² + 4 L/A))."""
    return (
        2 * np.sqrt(length / A)
        if jerk is None
        else A / jerk + np.sqrt((A / jerk) ** 2 + 4 * length / A)
    )


def turning(length, jerk):
    """T of a line there and back, passing the turn with q̈ = −A: each way q̈ rises by J, holds A,
    falls to −A, holds it.

    v is the speed after the first hold, and again after the fall; halving finds that of a way's
    length.
    """
    w = A / jerk
    low, high = 0.0, np.sqrt(A * length)
    for _ in range(100):
        v = (low + high) / 2
        held = (v - A * w / 2) / A
        way = (
            A * w**2 / 6
            + A * w / 2 * held
            + A * held**2 / 2
            + 2 * w * v
            + A * w**2 * (2 - 4 / 3)
            + v**2 / (2 * A)
        )
        low, high = (v, high) if way < length else (low, v)
    return 2 * (w + held + 2 * w + v / A)


@pytest.mark.parametrize("jerk", [None, J])
@pytest.mark.parametrize("other", [0.0, 0.5])
def test_two_points_of_a_clamped_cubic_are_a_line(jerk, other):
    path = CubicSpline([0.0, 3.0], [[0.0, 0.0], [1.0, other]], bc_type="clamped")
    assert fastest(path, jerk).trajectory.duration == pytest.approx(
        rest_to_rest(1.0, jerk), rel=1e-9
    )


@pytest.mark.parametrize("bc_type", ["not-a-knot", "natural", "clamped"])
def test_there_and_back(bc_type):
    """Without jerk a turn is a rest; with jerk the motion passes it with the acceleration −A."""
    path = CubicSpline([0.0, 1.0, 2.0], [[0.0, 0.0], [1.0, -0.25], [0.0, 0.0]], bc_type=bc_type)
    assert fastest(path).trajectory.duration == pytest.approx(2 * rest_to_rest(1.0), rel=1e-9)
    duration = fastest(path, J).trajectory.duration
    assert (
        turning(1.0, J) * (1 - 1e-6)
        <= duration
        <= min(2 * rest_to_rest(1.0, J), turning(1.0, J) * 1.008)
    )


def test_several_turns_between_the_knots():
    """Where it turns is found: lengths of the ways are those between the extremes of the spline."""
    path = CubicSpline([0.0, 1, 2, 3], [0.0, 1, 0, 1])
    ways = np.abs(np.diff([0.0, *path(np.sort(path.derivative().roots(extrapolate=False))), 1.0]))
    assert len(ways) == 3
    assert fastest(path).trajectory.duration == pytest.approx(
        sum(map(rest_to_rest, ways)), rel=1e-9
    )
    assert fastest(path, J).trajectory.duration < sum(rest_to_rest(way, J) for way in ways)


def test_what_stands_on_a_line_without_turning_is_passed():
    """s³, s⁵, a monotone interpolant that is flat at knots, quintics that rest at each of their
    points on one line.
    """
    for path, length in (
        (powers([0.0, 0, 0, 1]), 2.0),
        (powers([0.0] * 5 + [1.0], over=(-0.3, 1.0)), 1 + 0.3**5),
        (PchipInterpolator([0.0, 1, 2, 3], [0.0, 0.5, 0.6, 2]), 2.0),
        (
            BPoly.from_derivatives(
                [0.0, 1, 2], [[[v, 2 * v], [0, 0], [0, 0]] for v in (0.0, 0.3, 1.0)]
            ),
            2.0,
        ),
    ):
        for jerk in (None, J):
            assert fastest(path, jerk).trajectory.duration == pytest.approx(
                rest_to_rest(length, jerk), rel=1e-8
            )


def test_quintics_that_rest_at_their_points_are_a_polyline():
    points = np.array([[0.0, 0], [1, 0], [1, 1], [2, 2]])
    path = BPoly.from_derivatives(np.arange(4.0), [[p, 0 * p, 0 * p] for p in points])
    assert fastest(path).trajectory.duration == pytest.approx(3 * rest_to_rest(1.0), rel=1e-9)


@pytest.mark.parametrize("jerk", [None, J])
def test_a_cusp_is_no_slower_than_a_stop_at_it(jerk):
    """(s², s³): each half by itself begins or ends there, and the whole is as long as both, or
    passes it.
    """
    whole = fastest(powers([0.0, 0, 1], [0.0, 0, 0, 1]), jerk)
    half = fastest(powers([0.0, 0, 1], [0.0, 0, 0, 1], over=(0.0, 1.0)), jerk)
    if jerk is None:
        assert whole.trajectory.duration == pytest.approx(2 * half.trajectory.duration, rel=1e-5)
        assert whole.gap >= 0
        assert whole.trajectory.duration == pytest.approx(whole.lower_estimate, rel=1e-3)
    else:
        assert whole.trajectory.duration < 2 * half.trajectory.duration * (1 - 1e-2)


@pytest.mark.parametrize("width", [1e-2, 1e-6, 1e-10, 1e-12, 1e-14])
def test_near_a_turn_is_near_its_duration(width):
    """A hairpin (s², ε s) takes what the turn takes, however narrow."""
    assert fastest(powers([0.0, 0, 1], [0.0, width])).trajectory.duration == pytest.approx(
        2 * rest_to_rest(1.0), rel=2e-3
    )


def test_lengths_and_times_do_not_matter():
    for size, pace in ((1e-7, 1e3), (1e3, 1e-6)):
        path = CubicSpline(np.array([0.0, 1, 2]) * pace, np.array([0.0, 1, 0]) * size)
        assert fastest(path).trajectory.duration == pytest.approx(2 * rest_to_rest(size), rel=1e-9)


def test_a_speed_at_an_end_is_one_of_the_parameter_given():
    """q = s² to s = 1, where q̇ = 2 ṡ, though the line could be drawn by its way."""
    path = powers([0.0, 0, 1], over=(0.5, 1.0))
    found = time_optimal(path, max_speed=100.0, max_acceleration=A, end_speed=1.0)
    assert found.trajectory.at(found.trajectory.duration).qd[0, 0] == pytest.approx(2.0, rel=1e-9)
