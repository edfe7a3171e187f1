"""Contour error on curves whose answer is known."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from controllers.metrics.contour import MotionCurve, PathCurve, contour_error

RADIUS = 15e-3
ROUNDING = 1e-15
"""m: a few units in the last place of centimetres."""


@dataclass(frozen=True)
class Circle:
    """One turn and a half of a circle, by arc length."""

    radius: float = RADIUS

    @property
    def breaks(self):
        return np.array([0.0, 3 * np.pi * self.radius])

    def at(self, s, piece):
        a = s / self.radius
        c, d, o = np.cos(a), np.sin(a), np.zeros_like(a)
        return self.radius * np.stack([c, d, o], 1), np.stack([-d, c, o], 1)


@dataclass(frozen=True)
class Polygon:
    """Straight lines through points, by arc length."""

    points: np.ndarray

    @property
    def breaks(self):
        return np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))]
        )

    def at(self, s, piece):
        side = np.diff(self.points, axis=0)
        unit = (side / np.linalg.norm(side, axis=1)[:, None])[piece]
        return self.points[piece] + (s - self.breaks[piece])[:, None] * unit, unit


LINE = Polygon(np.array([[0, 0, 0], [0.06, 0.08, 0]]))
CORNER = Polygon(np.array([[0, 0, 0], [0.04, 0, 0], [0.04, 0.03, 0]]))
RETRACE = Polygon(np.array([[0, 0, 0], [0.04, 0, 0], [0, 0, 0]]))


def along(curve, s):
    piece = np.clip(np.searchsorted(curve.breaks, s, side="right") - 1, 0, len(curve.breaks) - 2)
    return curve.at(s, piece)


@pytest.mark.parametrize("offset", [-0.9, -0.3, -1e-3, 1e-9, 1e-3, 0.5, 3.0])
def test_radial_offset_of_a_circle_is_the_contour_error(offset):
    """From almost at the centre to far outside the centre of curvature's reach."""
    s = np.linspace(0, Circle().breaks[-1] - 1e-3, 400)
    # planned a millimetre further on, or the tracking error would be the answer already
    result = contour_error(along(Circle(), s)[0] * (1 + offset), s + 1e-3, Circle())
    np.testing.assert_allclose(result.error, abs(offset) * RADIUS, rtol=1e-11, atol=ROUNDING)
    # the distance is flat about s*: its rounding of 1e-18 leaves the root of that, more towards the
    # centre of curvature
    np.testing.assert_allclose(result.s, s, atol=1e-7)


def test_pure_lag_along_a_line_is_no_contour_error():
    t = np.linspace(0, 1, 500)
    s, lagging = 0.1 * t, 0.1 * np.maximum(t - 0.03, 0)
    y = along(LINE, lagging)[0]
    result = contour_error(y, s, LINE)
    assert result.error.max() < ROUNDING
    np.testing.assert_allclose(
        np.linalg.norm(y - along(LINE, s)[0], axis=1), s - lagging, atol=ROUNDING
    )
    np.testing.assert_allclose(result.s, lagging, atol=ROUNDING)


def test_lag_along_a_circle_is_no_contour_error():
    s = np.linspace(0, Circle().breaks[-1], 500)
    lagging = np.maximum(s - 2e-3, 0)
    assert contour_error(along(Circle(), lagging)[0], s, Circle()).error.max() < ROUNDING


def test_equal_lags_on_a_circle_change_its_radius():
    """x and y behind first-order lags T at rate ω, in steady state: D = R (1/√(1 + (ωT)²) − 1),
    everywhere alike.
    """
    omega, lag = 8.0, 1 / 30
    t = np.linspace(2 * np.pi / omega, 3 * np.pi / omega, 300)
    # the exact response to R e^{jωt} is R e^{jωt}/(1 + jωT)
    z = RADIUS * np.exp(1j * omega * t) / (1 + 1j * omega * lag)
    y = np.stack([z.real, z.imag, np.zeros_like(t)], 1)
    result = contour_error(y, RADIUS * omega * t, Circle())
    change = RADIUS * (1 / np.sqrt(1 + (omega * lag) ** 2) - 1)
    np.testing.assert_allclose(result.error, -change, rtol=1e-11)
    assert np.ptp(result.error) < 1e-14, "circular: G = 0"


def test_cut_corner():
    """A point that cuts the corner at 45°: its distance to the nearer leg, which changes at the
    bisector.
    """
    cut = np.linspace(0, 1, 301)
    y = np.array([0.03, 0, 0]) + np.outer(cut, [0.01, 0.01, 0])
    s = 0.03 + 0.02 * cut
    np.testing.assert_allclose(
        contour_error(y, s, CORNER).error, 0.01 * np.minimum(cut, 1 - cut), atol=ROUNDING
    )


def test_round_the_outside_of_a_corner_the_corner_is_nearest():
    angle = np.linspace(-np.pi / 2, 0, 101)
    y = np.array([0.04, 0, 0]) + 1e-3 * np.stack([np.cos(angle), np.sin(angle), np.zeros(101)], 1)
    result = contour_error(y, np.linspace(0.039, 0.041, 101), CORNER)
    np.testing.assert_allclose(result.error, 1e-3, rtol=1e-9)
    np.testing.assert_allclose(result.s, 0.04, atol=1e-12)


def test_path_that_runs_back_over_itself_is_followed_in_order():
    """Out and back on one line with a lag: s* never jumps to the other way's coinciding point."""
    t = np.linspace(0, 1, 801)
    s = 0.08 * t
    lagging = np.maximum(s - 3e-3, 0)
    result = contour_error(along(RETRACE, lagging)[0], s, RETRACE)
    assert result.error.max() < ROUNDING
    np.testing.assert_allclose(result.s, lagging, atol=ROUNDING)


def test_path_parameter_only_grows():
    """A motion that shakes along the path: where it comes back, s* waits, and the error is that to
    r(t) at most.
    """
    t = np.linspace(0, 1, 1000)
    s = 0.1 * t
    y = along(LINE, np.clip(s + 2e-3 * np.sin(60 * t), 0, 0.1))[0]
    result = contour_error(y, s, LINE)
    assert np.all(np.diff(result.s) >= 0)
    assert result.error.max() > 1e-4, "the shaking must be seen"


errors = arrays(np.float64, (40, 3), elements=st.floats(-5e-3, 5e-3))


@given(errors, st.sampled_from([Circle(), LINE, CORNER, RETRACE]), st.floats(0.05, 1.0))
def test_contour_error_never_exceeds_tracking_error(error, curve, share):
    s = np.linspace(0, share * curve.breaks[-1], len(error))
    r = along(curve, s)[0]
    result = contour_error(r + error, s, curve)
    # one rounding of r and one of the norm
    assert np.all(result.error <= np.linalg.norm(error, axis=1) + 1e-16)
    assert np.all(np.diff(result.s) >= 0)


@given(
    arrays(np.float64, (1, 3), elements=st.floats(-5e-3, 5e-3)),
    st.floats(0.2, 0.8),
    st.sampled_from([Circle(), LINE, CORNER]),
)
def test_one_point_against_an_exhaustive_search(error, share, curve):
    """No point of a fine grid over the window is nearer."""
    s = np.array([share * curve.breaks[-1]])
    y = along(curve, s)[0] + error
    reach = np.linalg.norm(error)
    grid = np.clip(np.linspace(s[0] - reach, s[0] + reach, 4001), 0, curve.breaks[-1])
    best = np.linalg.norm(y - along(curve, grid)[0], axis=1).min()
    assert contour_error(y, s, curve).error[0] <= best + ROUNDING


def test_path_curve_is_the_planned_path_and_its_slope(circle_trip):
    """r as the path has it; r′ by central differences (step h = 1 µm: truncation h²/6R² = 1e-9,
    rounding 1e-16/h).
    """
    path, h = circle_trip.path, 1e-6
    curve = PathCurve(path)
    ends = zip(path.breaks[:-1], path.breaks[1:], strict=True)
    inside = np.concatenate([np.linspace(low + 2 * h, high - 2 * h, 90) for low, high in ends])
    piece = np.repeat(np.arange(len(path.breaks) - 1), 90)
    r, slope = curve.at(inside, piece)
    before, after = curve.at(inside - h, piece)[0], curve.at(inside + h, piece)[0]
    np.testing.assert_array_equal(r, path.pose_numbers(inside, piece)[:, :3])
    np.testing.assert_allclose(slope, (after - before) / (2 * h), atol=5e-9)


@dataclass(frozen=True)
class Swing:
    """Two axes along a line, or round a part of a circle, and back within 3 s: a motion without a
    path.
    """

    bend: float
    knots = np.array([0.0, 3.0])
    duration = 3.0

    def at(self, t):
        a, rate = 2 * np.sin(np.pi * t / 3), 2 / 3 * np.pi * np.cos(np.pi * t / 3)
        if not self.bend:
            return SimpleNamespace(q=np.stack([a, a], 1), qd=np.stack([rate, rate], 1))
        c, d = np.cos(self.bend * a), np.sin(self.bend * a)
        return SimpleNamespace(
            q=np.stack([d, 1 - c], 1) / self.bend, qd=rate[:, None] * np.stack([c, d], 1)
        )


@pytest.mark.parametrize("bend", [0.0, 0.7])
def test_axes_are_followed_there_and_back(bend):
    """A lag of 60 ms behind axes that turn back in the middle of a smooth piece.

    On the bent way the polyline tells there from back when they are twice its sagitta of 1e-5 of
    the extent apart: until then s* may wait at the turn, at a point nearer than that.
    """
    curve, t = MotionCurve(Swing(bend)), np.linspace(0, 3, 700)
    np.testing.assert_allclose(curve.breaks, [0, 1.5, 3], rtol=1e-15)
    lagging = np.maximum(t - 0.06, 0)
    result = contour_error(along(curve, lagging)[0], t, curve)
    assert result.error.max() < (3 * 2e-5 if bend else 1e-14)
    # at rest the distance is flat in the time
    inner = (np.abs(lagging - 1.5) > 0.05) & (lagging > 0.03)
    np.testing.assert_allclose(result.s[inner], lagging[inner], atol=1e-9)


@settings(max_examples=25)
@given(
    arrays(np.float64, (12, 7, 3), elements=st.floats(-5e-3, 5e-3)),
    st.sampled_from([Circle(), LINE, CORNER, RETRACE]),
)
def test_runs_of_a_batch_do_not_know_of_each_other(error, curve):
    s = np.linspace(0, 0.8 * curve.breaks[-1], len(error))
    y = along(curve, s)[0][:, None] + error
    together = contour_error(y, s, curve)
    for b in range(error.shape[1]):
        one = contour_error(y[:, b], s, curve)
        np.testing.assert_array_equal(together.error[:, b], one.error)
        np.testing.assert_array_equal(together.s[:, b], one.s)
