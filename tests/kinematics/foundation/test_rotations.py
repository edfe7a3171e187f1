"""Rotation matrices without SciPy: against SciPy, also next to no turn, to half a turn and to the
gimbal lock.
"""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from kinematics.foundation.rotations import (
    find_angles,
    find_vectors,
    make_matrices,
    turn_axes,
    turn_vector,
)

# Entries of products of a few rotations: some units in the last place.
ROUNDING = 1e-14

directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)
EDGES = [0.0, 1e-300, 1e-12, 1e-6, np.pi / 2, np.pi - 1e-12, np.pi - 1e-6, np.pi]
turns = st.one_of(st.sampled_from(EDGES), st.floats(0, np.pi))
angle = st.one_of(
    st.sampled_from([sign * edge for edge in EDGES for sign in (1, -1)]), st.floats(-3.1, 3.1)
)
angles = st.tuples(angle, angle, angle)


def vector(direction, turn):
    return turn * np.array(direction) / np.linalg.norm(direction)


@given(directions, turns)
def test_matrices_are_those_of_scipy(direction, turn):
    (found,) = make_matrices(vector(direction, turn)[None])
    assert found == pytest.approx(
        Rotation.from_rotvec(vector(direction, turn)).as_matrix(), rel=0, abs=ROUNDING
    )


@given(directions, turns)
def test_vectors_lead_back_to_the_matrix(direction, turn):
    """At half a turn, both signs of the axis do."""
    matrix = Rotation.from_rotvec(vector(direction, turn)).as_matrix()
    (found,) = find_vectors(matrix[None])
    assert np.linalg.norm(found) == pytest.approx(turn, rel=1e-12, abs=1e-15)
    assert Rotation.from_rotvec(found).as_matrix() == pytest.approx(matrix, rel=0, abs=ROUNDING)


@given(angles)
@example((0.3, np.pi / 2, 0.4))
@example((0.3, -np.pi / 2, 0.4))
def test_angles_are_about_the_moving_axes_in_turn(given_angles):
    (matrix,) = turn_axes(np.array([given_angles]))
    assert matrix == pytest.approx(
        Rotation.from_euler("XYZ", given_angles).as_matrix(), rel=0, abs=ROUNDING
    )
    (found,) = find_angles(matrix[None])
    # within the gimbal lock the other two angles are known to its width
    width = 1e-6 if abs(np.cos(given_angles[1])) < 1e-6 else ROUNDING
    assert turn_axes(found[None])[0] == pytest.approx(matrix, rel=0, abs=width)
    assert abs(found[1]) <= np.pi / 2


@given(directions, turns, directions)
@example((0.0, 0.0, 1.0), 9e-4, (1.0, 2.0, 3.0))
def test_a_point_turns_as_scipy_turns_it(direction, turn, point):
    """To the last bit: a path that is drawn without SciPy is the same path."""
    rotation = vector(direction, turn)
    point = np.asarray(point, float)
    assert np.array_equal(turn_vector(point, rotation), Rotation.from_rotvec(rotation).apply(point))


def test_no_rotations_have_no_vectors():
    assert make_matrices(np.zeros((0, 3))).shape == (0, 3, 3)
    assert find_vectors(np.zeros((0, 3, 3))).shape == (0, 3)
