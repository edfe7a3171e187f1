"""Poses as twelve numbers, and straight motions between them: against SciPy, also next to no turn
and to half a one.
"""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.machine.pose import (
    STRAIGHT_SIZE,
    axis_angle,
    column,
    from_numbers,
    split_pose_symbols,
    straight_parameters,
    straight_pose,
    to_numbers,
)

directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)
angles = st.one_of(
    st.sampled_from([0.0, 1e-300, 1e-12, 1e-6, np.pi - 1e-12, np.pi - 1e-6, np.pi]),
    st.floats(1e-9, np.pi),
)
points = st.tuples(*[st.floats(-2, 2)] * 3)


def pose(point, direction, angle):
    return RigidTransform.from_components(
        point, Rotation.from_rotvec(angle * np.array(direction) / np.linalg.norm(direction))
    )


poses = st.builds(pose, points, directions, angles)


def rows(found):
    """(12,) position, then the rotation's rows: the definition."""
    return np.concatenate([found.translation, found.rotation.as_matrix().ravel()])


@given(poses)
def test_numbers_are_position_and_rows_of_the_rotation(given_pose):
    assert to_numbers(given_pose) == pytest.approx(rows(given_pose)[None], rel=0, abs=1e-15)
    assert rows(from_numbers(rows(given_pose))) == pytest.approx(rows(given_pose), rel=0, abs=1e-15)
    batch = RigidTransform.concatenate([given_pose, RigidTransform.identity()])
    assert from_numbers(to_numbers(batch)).as_matrix() == pytest.approx(
        batch.as_matrix(), rel=0, abs=1e-15
    )


def test_symbols_are_the_numbers():
    x = ca.SX.sym("x", 12)
    position, rotation = split_pose_symbols(x)
    both = ca.Function("both", [x], [position, rotation, column(position, rotation)])
    where, matrix, again = (np.array(out) for out in both(np.arange(12.0)))
    assert where.ravel().tolist() == [0, 1, 2]
    assert matrix.tolist() == [[3, 4, 5], [6, 7, 8], [9, 10, 11]]
    assert again.ravel().tolist() == list(range(12))


@given(poses, directions, angles)
def test_axis_and_angle_of_the_shortest_turn(start, direction, angle):
    """Seen from the start; half a turn has two axes, so what counts is where it leads."""
    end = start * pose([0, 0, 0], direction, angle)
    (axis,), (found,) = axis_angle(start.rotation, end.rotation)
    assert np.linalg.norm(axis) == pytest.approx(1, rel=1e-14)
    assert 0 <= found <= np.pi * (1 + 1e-15)
    assert found == pytest.approx(angle, rel=0, abs=2e-14)
    led = start.rotation * Rotation.from_rotvec(found * axis)
    assert (led.inv() * end.rotation).magnitude() < 1e-14


ARC, PARAMETERS = ca.SX.sym("s"), ca.SX.sym("parameters", STRAIGHT_SIZE)
MOTION = ca.Function("straight", [ARC, PARAMETERS], [column(*straight_pose(ARC, PARAMETERS))])


def at(s, parameters):
    return np.array(MOTION(s, parameters)).ravel()


@given(poses, poses, st.floats(0.01, 10), st.floats(0, 1))
def test_straight_motions_turn_steadily_from_start_to_end(start, end, length, share):
    (parameters,) = straight_parameters(start, end, length)
    # a dozen operations on numbers below 10
    assert at(0, parameters) == pytest.approx(rows(start), rel=0, abs=1e-14)
    assert at(length, parameters) == pytest.approx(rows(end), rel=0, abs=1e-14)
    turn = (start.rotation.inv() * end.rotation).as_rotvec()
    between = RigidTransform.from_components(
        (1 - share) * start.translation + share * end.translation,
        start.rotation * Rotation.from_rotvec(share * turn),
    )
    assert at(share * length, parameters) == pytest.approx(rows(between), rel=0, abs=1e-14)
