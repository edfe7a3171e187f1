"""A small version of the trial of forward kinematics, and its referee put to the test."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.evidence.cases.forward import (
    MAX_SHIFT_XY,
    MAX_TURN,
    SAME_POSE_TOLERANCE,
    SHIFT_RANGE_Z,
    follow_lengths,
    interpolate_from_home,
    leg_jacobian,
    sample_anywhere,
    sample_within_limits,
    try_forward,
)
from kinematics import load_machine
from kinematics.machine.pose import to_numbers


@pytest.fixture(scope="module")
def machine():
    return load_machine("hexapod")


@pytest.fixture(scope="module")
def inside(machine):
    """500 poses within the limits, drawn once: fewer of them are the first of these."""
    return sample_within_limits(machine, 500)


def turned(machine, degrees):
    return machine.home * RigidTransform.from_rotation(
        Rotation.from_rotvec([[0, 0, np.deg2rad(degrees)]])
    )


def test_inside_the_limits_nearly_all_is_certified_and_nothing_in_another_mode(machine, inside):
    trial = try_forward(machine, inside[:100])
    assert trial["certified"] >= 0.95 * trial["poses"]
    assert trial["wrong"] == trial["elsewhere"] == 0


def test_anywhere_nothing_certified_is_wrong_and_every_other_pose_is_explained(machine):
    trial = try_forward(machine, sample_anywhere(machine, 100))
    assert trial["wrong"] == 0
    assert trial["elsewhere"] == trial["beyond"] + trial["free"]
    assert trial["beyond"] > 0  # a trial worth its name


def test_poses_inside_are_inside_and_not_cut_off_by_the_box(machine, inside):
    poses = inside
    low, high = np.array([axis.travel for axis in machine.axes]).T
    stroke = machine.inverse(poses) - machine.home_q
    assert (stroke >= low).all()
    assert (stroke <= high).all()
    assert (machine.tilt_map(to_numbers(poses)) >= np.cos(machine.max_tilt)).all()
    shift = poses.translation - machine.home.translation
    assert np.abs(shift[:, :2]).max() < 0.95 * MAX_SHIFT_XY
    assert SHIFT_RANGE_Z[0] < shift[:, 2].min()
    assert shift[:, 2].max() < 0.95 * SHIFT_RANGE_Z[1]
    assert (np.abs(poses.rotation.as_rotvec()).max(0) < 0.95 * MAX_TURN).all()


def test_the_referee_knows_lengths_and_jacobian(machine, inside):
    """Of its own formula; the machine's come from its expression."""
    poses = inside[:50]
    length, jacobian = leg_jacobian(machine, poses)
    assert length == pytest.approx(machine.inverse(poses), rel=1e-14)
    assert jacobian == pytest.approx(machine.jacobian(poses), rel=0, abs=1e-14)


@pytest.mark.parametrize(("degrees", "arrives"), [(80, True), (100, False)])
def test_a_machine_led_through_a_singularity_need_not_arrive(machine, degrees, arrives):
    """A quarter turn is singular [Fichter 1986]: beyond it, two poses of the same lengths have
    met.
    """
    end = turned(machine, degrees)
    signs = [
        np.linalg.slogdet(leg_jacobian(machine, interpolate_from_home(machine, end, share))[1])[0]
        for share in (0.0, 1.0)
    ]
    assert (signs[0] == signs[1]).all() == arrives
    apart = follow_lengths(machine, end).inv() * end
    assert (
        np.linalg.norm(apart.translation) + apart.rotation.magnitude() < SAME_POSE_TOLERANCE
    ).all() == arrives


def test_without_a_certificate_the_pose_is_the_same_and_nothing_is_certified(machine, inside):
    q = machine.inverse(inside[:20])
    plain, proved = machine.forward(q, certify=False), machine.forward(q)
    assert np.array_equal(plain.pose.as_matrix(), proved.pose.as_matrix())
    assert np.array_equal(plain.residual, proved.residual)
    assert proved.certified.all()
    assert not plain.certified.any()
