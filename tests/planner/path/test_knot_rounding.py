"""Knots of smooth splines are no corners: rounding of a derivative is judged by what it is computed
from.
"""

import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicSpline, PPoly, make_interp_spline

import pulsepath as pp

LIMITS = {"max_speed": 1.0, "max_acceleration": 5.0, "max_jerk": 100.0}
# From rest over 1 at v = 1, a = 5, j = 100: 1/v + v/a + a/j. The second axis never binds.
FASTEST = 1 + 1 / 5 + 5 / 100


def knots(name, count=40):
    rng = np.random.default_rng(3)
    return {
        "even": np.linspace(0, 1, count),
        "random": np.concatenate([[0.0], np.sort(rng.random(count - 2)), [1.0]]),
        "graded": np.concatenate(
            [[0.0], (c := np.cumsum(10 ** rng.uniform(-3, 0, count))) / c[-1]]
        ),
    }[name]


SPLINES = {
    "cubic": CubicSpline,
    "degree 3": lambda u, q: make_interp_spline(u, q, k=3),
    "degree 5": lambda u, q: make_interp_spline(u, q, k=5),
    "bernstein": lambda u, q: BPoly.from_power_basis(CubicSpline(u, q)),
}


@pytest.mark.parametrize("spacing", ["even", "random", "graded"])
@pytest.mark.parametrize("make", SPLINES.values(), ids=SPLINES.keys())
def test_an_axis_linear_in_the_parameter_stops_nowhere(make, spacing):
    u = knots(spacing)
    made = pp.time_optimal(make(u, np.c_[u, 0.04 * u * (1 - u)]), **LIMITS)
    assert made.certificate.holds
    assert made.trajectory.path.stops(3).sum() == 2
    assert made.trajectory.duration == pytest.approx(FASTEST, rel=1e-4)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_whatever_the_units_and_the_origin(scale, offset):
    """Of the parameter, and of where the values count from."""
    u = knots("random")
    made = pp.time_optimal(
        CubicSpline(scale * u, np.c_[u + offset, 0.04 * np.sin(6 * u)]), **LIMITS
    )
    assert made.trajectory.duration == pytest.approx(FASTEST, rel=1e-4)


@pytest.mark.parametrize("speed", [0.0, 0.1])
@pytest.mark.parametrize("spacing", ["even", "random", "graded"])
def test_collinear_waypoints_are_one_straight_line(spacing, speed):
    """The axis that moves by 2 takes all the time; at end speeds ṡ = 0.1 its speeds 0.2 save what a
    ramp takes.
    """
    u = knots(spacing, 60)
    made = pp.time_optimal(
        CubicSpline(u, np.c_[u, 2 * u, 5 - 0.3 * u]), start_speed=speed, end_speed=speed, **LIMITS
    )
    one = pp.time_optimal(
        PPoly([[[1, 2, -0.3]], [[0, 0, 5]]], [0, 1]), start_speed=speed, end_speed=speed, **LIMITS
    )
    assert made.certificate.holds
    assert made.trajectory.duration == pytest.approx(one.trajectory.duration, rel=1e-4)


@pytest.mark.parametrize("jump", [1e-4, 1e-2, 1.0])
def test_a_jump_of_the_curvature_is_a_corner_still(jump):
    """q = (s, b s²/2) with b larger by a share from the middle on: both sides of the middle to the
    last digit.
    """
    before, after = [0.5, 0.0, 0.0], [0.5 * (1 + jump), 0.5, 0.125]
    path = PPoly(
        np.array(
            [
                [[0, before[0]], [0, after[0]]],
                [[1, before[1]], [1, after[1]]],
                [[0, before[2]], [0.5, after[2]]],
            ]
        ),
        [0, 0.5, 1],
    )
    made = pp.time_optimal(path, **LIMITS)
    assert made.trajectory.path.stops(3).tolist() == [True, True, True]
    assert made.certificate.holds


def test_a_short_piece_beside_a_corner_hides_nothing():
    """A piece of 1e-7 has a q″ of no digit by its values; the corner of the path beside it is one
    all the same.
    """
    h = 1e-7
    path = PPoly(
        np.array(
            [
                [[0, 0.5], [0, 0.5], [0, 0.6]],
                [[1, 0], [1, 0.5], [1, 0.5 + h]],
                [[0, 0], [0.5, 0.125], [0.5 + h, 0.125 + 0.5 * h + 0.5 * h * h]],
            ]
        ),
        [0, 0.5, 0.5 + h, 1],
    )
    assert pp.time_optimal(path, **LIMITS).trajectory.path.stops(3).sum() == 3
