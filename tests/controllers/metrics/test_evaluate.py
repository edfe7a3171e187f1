"""Errors in space through the hexapod's forward kinematics."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from controllers import Tracking, evaluate
from controllers.drives.servo import leg_servo
from controllers.laws.open_loop import OpenPosition
from controllers.metrics import ErrorSeries
from kinematics import MotionError, load_machine
from planner import Place, Trajectory
from planner.path.polynomial import PolynomialPath
from tests.controllers.servos import track


@pytest.fixture(scope="module")
def tracked(circle_trip, hexapod):
    return track(circle_trip, hexapod, OpenPosition())


def as_if(trajectory, machine, moved):
    """A tracking in which the platform is at moved(planned pose) instead of the planned pose,
    exactly.
    """
    t = np.linspace(0, trajectory.duration, 400)
    state = trajectory.at(t)
    actual = machine.inverse(moved(state.pose))
    axes = tuple((axis.name, axis.unit) for axis in machine.axes)
    return Tracking(
        "as if",
        5e-3,
        t,
        state.q,
        state.q,
        actual,
        np.zeros(6, int),
        axes,
        "as if",
        np.zeros(6, int),
    )


def test_no_error_where_there_is_none(circle_trip, hexapod):
    metrics = evaluate(as_if(circle_trip, hexapod, lambda pose: pose), circle_trip, hexapod)
    # Newton of the forward kinematics leaves 1e-14 of metres
    assert max(series.max for series in metrics.series) < 1e-12


def test_a_shifted_platform_is_off_by_the_shift(circle_trip, hexapod):
    """30 µm up: tracking and contour error on the horizontal pieces; no contour error along the
    first, vertical one.
    """
    shift = RigidTransform.from_translation([0, 0, 30e-6])
    metrics = evaluate(as_if(circle_trip, hexapod, lambda pose: shift * pose), circle_trip, hexapod)
    np.testing.assert_allclose(metrics.tracking.value, 30e-6, rtol=1e-8)
    assert metrics.orientation.max < 1e-11
    vertical = circle_trip.at(metrics.t).piece == 0
    np.testing.assert_allclose(metrics.contour.value[~vertical], 30e-6, rtol=1e-8)
    assert np.median(metrics.contour.value[vertical]) < 1e-11


def test_a_turned_platform_is_off_by_the_angle(circle_trip, hexapod):
    turn = RigidTransform.from_components(
        [0, 0, 0], RigidTransform.from_exp_coords([2e-4, -1e-4, 2e-4, 0, 0, 0]).rotation
    )
    metrics = evaluate(as_if(circle_trip, hexapod, lambda pose: pose * turn), circle_trip, hexapod)
    np.testing.assert_allclose(metrics.orientation.value, 3e-4, rtol=1e-8)
    assert metrics.tracking.max < 1e-12
    assert metrics.contour.max < 1e-12


def test_the_circle_shrinks_by_the_gain_of_the_loops(circle_trip, hexapod, tracked):
    """In the steady part of the arc the legs follow with the loop's gain |G(jω)| at ω = v/R, and
    the radius with them.

    Small strokes are near linear in the legs, so the figure holds to a tenth of the change; the
    table of the loop is G = K ωs (s + 1/T) / (s³ + ωs s² + (ωs/T) s + K ωs (s + 1/T)) for small
    friction.
    """
    servo = leg_servo(hexapod.axes[0])
    omega, radius = 20e-3 / 15e-3, 15e-3
    s, ws, integral = 1j * omega, 2 * np.pi * servo.speed_loop, 1 / servo.integral_time
    loop = servo.position_gain * ws * (s + integral)
    gain = abs(loop / (s**3 + ws * s**2 + ws * integral * s + loop))
    metrics = evaluate(tracked, circle_trip, hexapod)
    state = circle_trip.at(metrics.t)
    steady = (
        (state.piece == 1)
        & (state.s > circle_trip.path.breaks[1] + 0.04)
        & (state.s < circle_trip.path.breaks[2] - 0.01)
    )
    assert np.mean(metrics.contour.value[steady]) == pytest.approx(radius * abs(gain - 1), rel=0.1)


def test_contour_error_is_the_smaller(circle_trip, hexapod, tracked):
    metrics = evaluate(tracked, circle_trip, hexapod)
    assert np.all(metrics.contour.value <= metrics.tracking.value)
    # a lag of 0.67 mm along the way shows in the one and not in the other
    assert metrics.contour.p95 < 0.1 * metrics.tracking.p95


def test_following_error_is_per_axis_and_says_where(circle_trip, hexapod, tracked):
    metrics = evaluate(tracked, circle_trip, hexapod)
    assert [series.name for series in metrics.following] == [axis.name for axis in hexapod.axes]
    for i, series in enumerate(metrics.following):
        error = (tracked.actual - tracked.reference)[::4, i]
        worst = int(np.abs(error).argmax())
        assert series.max == abs(error[worst])
        assert series.where.t == tracked.t[4 * worst]
        piece = circle_trip.at(np.minimum(series.where.t, circle_trip.duration)).piece[0]
        assert series.where.segment == piece + 1


def test_figures_of_a_known_series():
    """e = −1 … 0 in 1001 steps, √(mean e²) → 1/√3."""
    series = ErrorSeries("x", "m", -np.linspace(0, 1, 1001), Place(0.0))
    assert series.max == 1
    assert series.p95 == pytest.approx(0.95)
    assert series.rms == pytest.approx(
        np.sqrt(np.sum(np.arange(1001.0) ** 2) / 1001) / 1000, rel=1e-12
    )


def test_table_shows_every_error(circle_trip, hexapod, tracked):
    text = str(evaluate(tracked, circle_trip, hexapod))
    for name in (
        *(axis.name for axis in hexapod.axes),
        "tracking",
        "orientation",
        "contour",
        "open-position",
        "segment",
    ):
        assert name in text
    assert max(map(len, text.splitlines())) <= 120


def test_without_a_path_in_space_errors_are_those_of_the_axes(hexapod, tracked):
    """All six legs planned at 1 m throughout: their distance is the norm of their errors."""
    path = PolynomialPath(
        np.array([0.0, 1.0]), np.ones((1, 1, 6)), [axis.name for axis in hexapod.axes]
    )
    none = np.zeros(1)
    bare = Trajectory(path, np.array([0.0, 1.0]), none, none, none, none, np.zeros(1, int))
    metrics = evaluate(tracked, bare, hexapod)
    error = np.linalg.norm(tracked.actual[::4] - 1, axis=1)
    np.testing.assert_allclose(metrics.tracking.value, error, rtol=1e-12)
    np.testing.assert_allclose(metrics.contour.value, error, rtol=1e-12)
    assert metrics.orientation is None
    assert not metrics.lag.value.any()


def test_axes_of_two_kinds_have_no_distance(axis_motion, tracked):
    mixed = load_machine("traverser")
    flat = replace(tracked, actual=tracked.actual[:, :4], reference=tracked.reference[:, :4])
    motion = replace(axis_motion("smooth"), home=np.zeros(4), stroke=np.ones(4))
    with pytest.raises(MotionError, match="no common distance"):
        evaluate(flat, motion, mixed)


def test_positions_that_no_pose_has_are_refused(circle_trip, hexapod, tracked):
    torn = np.array(tracked.actual)
    torn[2000:, 0] += 0.5
    with pytest.raises(MotionError, match="not a certain pose"):
        evaluate(replace(tracked, actual=torn), circle_trip, hexapod)
