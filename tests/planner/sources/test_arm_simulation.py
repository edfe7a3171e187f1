"""The plate turned on three arms, on the screen alone."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from kinematics import MotionError, load_machine
from planner import PositionList, simulate_arms
from planner.sources.positions import step_through

DEGREE = np.pi / 180
LISTED = PositionList(
    [
        [0, 0, 0.01, 0, 0, 0],
        [0.005, 0, 0.012, 0, 0, 0],
        [0.005, 0, 0.012, 3 * DEGREE, -2 * DEGREE, 0],
    ],
    "yzx",
)


def test_held_poses_are_the_machine_s_own_and_turned_ones_are_marked():
    machine = load_machine("tripod")
    found = simulate_arms(LISTED, machine)
    np.testing.assert_array_equal(found.turned, [False, False, True])
    held = machine.home * RigidTransform.from_translation(LISTED.poses[:2, :3])
    np.testing.assert_allclose(found.lengths[:2], machine.inverse(held), rtol=1e-14)
    np.testing.assert_array_equal(found.off[:2], 0.0)
    told = str(found)
    assert "rotated, and only simulated: 1 of 3 poses" in told


def test_how_far_off_the_held_plate_would_be_is_where_these_arms_meet():
    """The place that is `off` from the wanted one has the turned pose's arm lengths, its plate not
    turned.
    """
    machine = load_machine("tripod")
    found = simulate_arms(LISTED, machine)
    wanted = machine.home.translation + LISTED.poses[2, :3]
    place = machine.forward(found.lengths[2]).pose
    np.testing.assert_allclose(machine.inverse(place), found.lengths[2], atol=1e-12)
    assert found.off[2] == pytest.approx(np.linalg.norm(place.translation - wanted), rel=1e-6)
    assert found.off[2] > 1e-4


def test_lengths_that_no_held_plate_has_have_no_place():
    far = PositionList([[0, 0, 0.01, 0, 170 * DEGREE, 0]])
    found = simulate_arms(far, load_machine("tripod"))
    assert found.turned[0]
    assert np.isnan(found.off[0]) or found.off[0] > 1e-3


def test_every_step_of_the_source_s_rule():
    """1 mm steps, and 1° ones where only angles change: the poses that a run of the list rests
    at.
    """
    machine = load_machine("tripod")
    found = simulate_arms(LISTED, machine, unit=1e-3)
    assert len(found.listed) == 1 + 5 + 3
    segments, _ = step_through(LISTED, RigidTransform.identity(), 1e-3)
    assert len(segments) == 1 + 5 + 3
    np.testing.assert_allclose(np.diff(found.listed.poses[5:, 3]), [DEGREE] * 3, atol=1e-12)
    dropped = PositionList([[0, 0, 0.01, 0, 0, 0], [0.002, 0, 0.01, 0.1, 0, 0]])
    both = simulate_arms(dropped, machine, unit=1e-3)
    assert not both.turned.any()
    assert "1 rotations combined with a translation were dropped" in str(both)


def test_arms_beyond_their_travel_are_named():
    found = simulate_arms(
        PositionList([[0, 0, 0.01, 0, 0, 0], [0, 0, 0.2, 0, 0, 0]]), load_machine("tripod")
    )
    np.testing.assert_array_equal(found.within, [[True] * 3, [False] * 3])
    assert "outside their travel" in str(found)


def test_what_cannot_be_simulated(hexapod):
    with pytest.raises(MotionError, match="hexapod is not a tripod"):
        simulate_arms(LISTED, hexapod)
    with pytest.raises(MotionError, match="no pose; record one"):
        simulate_arms(PositionList(np.zeros((0, 6))), load_machine("tripod"))


def test_a_list_from_the_base_frame_and_one_from_home_agree():
    machine = load_machine("tripod")
    base = PositionList(
        LISTED.poses + np.append(machine.home.translation, [0, 0, 0]), "yzx", "base"
    )
    np.testing.assert_allclose(
        simulate_arms(base, machine).lengths, simulate_arms(LISTED, machine).lengths, rtol=1e-14
    )


def test_the_figure_marks_what_is_turned():
    drawn = simulate_arms(LISTED, load_machine("tripod")).plot()
    rings = [line for line in drawn.lines if line.get_marker() == "o" and len(line.get_xdata())]
    assert [line.get_xdata().tolist() for line in rings] == [[3], [3], [3]]
