"""ISO-style accuracy and repeatability of cycles whose scatter is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from controllers.metrics.iso_style import Stations, path_accuracy, pose_accuracy
from kinematics import MotionError

X = np.array([1.0, 0, 0])


def cycles(offsets, samples=60):
    """Straight cycles along x, each beside it by its own offset, at its own pace."""
    paths = []
    for j, offset in enumerate(offsets):
        u = np.linspace(0, 1, samples) ** (1 + 0.1 * j)
        paths.append(np.outer(u, X) + offset)
    return np.stack(paths, 1)


def along_x(m=9):
    s = (np.arange(m) + 0.5) / m
    return Stations(np.outer(s, X), np.tile(X, (m, 1)), np.tile(np.eye(3), (m, 1, 1)))


SHIFTS = np.array([[0, 3e-6, 1e-6], [0, 1e-6, 1e-6], [0, 2e-6, 4e-6], [0, 2e-6, -2e-6]])


def test_parallel_cycles():
    """All stations alike: AT = ‖mean shift‖ = √(2² + 1²) µm; RT of the four distances 1, 1, 3, 3
    µm: 2 + 3 · 2/√3.
    """
    found = path_accuracy(cycles(SHIFTS), along_x())
    np.testing.assert_allclose(found.offset, np.sqrt(5) * 1e-6, rtol=1e-9)
    np.testing.assert_allclose(found.band, (2 + 6 / np.sqrt(3)) * 1e-6, rtol=1e-9)
    assert (found.at_p, found.rt_p) == (found.offset.max(), found.band.max())


def test_lag_is_no_path_error():
    """A shift along the path does not count: the plane is met later, at the same place."""
    along = np.outer([5e-3, 2e-3, 0, -4e-3], X)
    found = path_accuracy(cycles(SHIFTS + along), along_x())
    assert found.at_p == pytest.approx(np.sqrt(5) * 1e-6, rel=1e-9)


def test_a_way_back_is_not_taken_for_the_way_there():
    out = cycles(SHIFTS)
    back = out[::-1] + np.array([0, 50e-6, 0])
    found = path_accuracy(np.concatenate([out, back]), along_x())
    assert found.at_p == pytest.approx(np.sqrt(5) * 1e-6, rel=1e-9)
    there = Stations(along_x().points, -along_x().tangents)
    assert path_accuracy(np.concatenate([out, back]), there).at_p == pytest.approx(
        np.hypot(52e-6, 1e-6), rel=1e-9
    )


def test_angles_are_about_the_commanded_axes():
    """Turned by ±4 and ±2 mrad about z, 1 mrad about x on average: AT 1, 0, 0; RT 3 S, S² = (2·16 +
    2·4)/3.
    """
    turns = np.array([[1, 0, 4], [1, 0, -4], [1, 0, 2], [1, 0, -2]]) * 1e-3
    rotations = np.tile(Rotation.from_rotvec(turns).as_matrix(), (60, 1, 1, 1))
    figures = path_accuracy(cycles(SHIFTS), along_x(), rotations).figures()
    assert figures["path_accuracy_rx"] == pytest.approx(1e-3, rel=1e-9)
    assert figures["path_accuracy_rz"] == pytest.approx(0, abs=1e-12)
    assert figures["path_repeatability_rx"] == pytest.approx(0, abs=1e-12)
    assert figures["path_repeatability_rz"] == pytest.approx(3e-3 * np.sqrt(40 / 3), rel=1e-9)


def test_a_plane_that_is_not_met_is_named():
    short = cycles(SHIFTS)
    short[:, 2] = np.minimum(short[:, 2], [0.6, 1, 1])
    with pytest.raises(MotionError, match="cycle 3 does not pass station 6"):
        path_accuracy(short, along_x())


@given(arrays(np.float64, (5, 3), elements=st.floats(-1e-4, 1e-4)))
def test_a_common_shift_changes_accuracy_alone(points):
    commanded, shift = np.array([0.1, 0.2, 0.3]), np.array([3e-5, -1e-5, 2e-5])
    before, after = (pose_accuracy(commanded + points + by, commanded) for by in (0 * shift, shift))
    # coordinates of 0.3 m are rounded to 6e-17 m
    assert before.repeatability == pytest.approx(after.repeatability, abs=1e-15)
    assert after.accuracy == pytest.approx(float(np.linalg.norm(points.mean(0) + shift)), abs=1e-15)


def test_pose_figures():
    """Four arrivals, 1, 1, 3, 3 µm from their mean, as the stations above."""
    found = pose_accuracy(SHIFTS, np.zeros(3), SHIFTS * 100)
    assert found.accuracy == pytest.approx(np.sqrt(5) * 1e-6)
    assert found.repeatability == pytest.approx((2 + 6 / np.sqrt(3)) * 1e-6)
    assert found.figures()["pose_accuracy_ry"] == pytest.approx(2e-4)
    assert found.figures()["pose_repeatability_ry"] == pytest.approx(3e-4 * np.sqrt(2 / 3))


def test_one_cycle_has_no_scatter():
    with pytest.raises(MotionError, match="at least 2"):
        path_accuracy(cycles(SHIFTS[:1]), along_x())
    with pytest.raises(MotionError, match="at least 2"):
        pose_accuracy(SHIFTS[:1], np.zeros(3))
