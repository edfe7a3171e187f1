"""What every machine does, whatever its kind."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import (
    Load,
    MotionError,
    OutOfReach,
    forces,
    load_machine,
    machine_names,
    motion_of_poses,
)
from kinematics.machine.kind import columns
from kinematics.machine.pose import COMPONENTS
from tests.kinematics.kinds.test_equations import OF_FORMULAS


@pytest.mark.parametrize("name", machine_names())
def test_every_preset_is_in_the_zoo(name, zoo_names):
    assert name in {*zoo_names, *OF_FORMULAS}


def test_home_is_where_it_says(machine):
    assert machine.inverse(machine.home) == pytest.approx(machine.home_q, abs=1e-12)
    assert machine.forward(machine.home_q).pose.as_matrix() == pytest.approx(
        machine.home.as_matrix(), abs=1e-12
    )
    assert machine.check(machine.home).ok.all()


def test_jacobian_is_the_derivative_of_the_inverse(machine, poses_about, room):
    """Central differences for a twist about the platform's origin, in the base frame, of what the
    machine controls.
    """
    poses = poses_about(machine.home, machine, 20, 0.4)
    step = 1e-5
    size = room(machine)
    jacobian = machine.jacobian(poses)
    assert jacobian.shape == (20, len(machine.axes), 6)
    for k in columns(machine):
        shift, turn = np.zeros(3), np.zeros(3)
        (shift if k < 3 else turn)[k % 3] = step
        ahead, behind = (
            machine.inverse(
                RigidTransform.from_components(
                    poses.translation + sign * size * shift,
                    Rotation.from_rotvec(sign * turn) * poses.rotation,
                )
            )
            for sign in (1, -1)
        )
        difference = (ahead - behind) / (2 * step) / (size if k < 3 else 1)
        # step² of the third derivative and 1e-16/step of rounding: some 1e-10 of the machine's size
        # each
        scale = max(1.0, np.abs(machine.home_q).max() / size) * (1 if k < 3 else size)
        assert jacobian[:, :, k] == pytest.approx(difference, rel=0, abs=2e-9 * scale)


def test_one_pose_is_a_batch_of_one(machine, poses_about):
    poses = poses_about(machine.home, machine, 5, 0.3)
    count = len(machine.axes)
    q, jacobian = machine.inverse(poses), machine.jacobian(poses)
    assert q.shape == (5, count)
    for k in range(5):
        assert machine.inverse(poses[k]).shape == (count,)
        assert np.array_equal(machine.inverse(poses[k]), q[k])
        assert np.array_equal(machine.jacobian(poses[k]), jacobian[k])
        assert np.array_equal(machine.check(poses[k]).tilt[0], machine.check(poses).tilt[k])
    assert np.array_equal(machine.home_q, machine.inverse(machine.home))


def test_what_is_held_is_refused_and_what_follows_is_ignored(machine):
    pose = machine.home
    for k, name in enumerate(COMPONENTS):
        twist = np.zeros(6)
        twist[k] = 1e-3
        moved = RigidTransform.from_components(
            pose.translation + twist[:3], Rotation.from_rotvec(twist[3:]) * pose.rotation
        )
        if name in machine.freedom:
            assert np.abs(machine.inverse(moved) - machine.home_q).max() > 1e-5
        elif name in machine.follows:
            assert machine.inverse(moved) == pytest.approx(machine.home_q, abs=1e-14)
        else:
            with pytest.raises(OutOfReach, match=f"holds {name}: pose 0 has {name}"):
                machine.inverse(moved)


def test_other_actuators_on_the_same_machine():
    """Home, tilts and room stay, so every pose has the same coordinates; a rotor is felt by the new
    machine alone.
    """
    machine = load_machine("hexapod").carrying(Load())
    pose = machine.home * RigidTransform.from_translation([0.005, 0.0, 0.02])
    before = machine.loaded
    axes = [
        replace(axis, max_speed=0.04, reflected=0.2, travel=(0.0, 0.06)) for axis in machine.axes
    ]
    other = machine.driven_by(axes)
    assert other.axes == tuple(axes)
    assert machine.axes[0].max_speed == 0.02
    np.testing.assert_array_equal(other.inverse(pose), machine.inverse(pose))
    assert other.check(pose).tilt == pytest.approx(machine.check(pose).tilt)
    assert not before
    assert not machine.loaded
    assert other.loaded
    accelerated = motion_of_poses(other, pose, np.zeros((1, 6)), np.array([[0, 0, 1.0, 0, 0, 0]]))
    qdd = machine.jacobian(pose) @ [0, 0, 1, 0, 0, 0]  # at rest, q̈ = J ν̇
    assert forces(other, accelerated).force[0] == pytest.approx(0.2 * qdd)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda axes: axes[:5], "5 axes; a hexapod has 6"),
        (lambda axes: axes[::-1], "its axes are called leg1, .*, not leg6, .*; keep their names"),
        (
            lambda axes: [replace(axis, kind="rotary") for axis in axes],
            "leg1 is rotary; a hexapod has a linear one",
        ),
    ],
)
def test_actuators_that_are_not_the_machines(change, told):
    machine = load_machine("hexapod")
    with pytest.raises(MotionError, match=told):
        machine.driven_by(change(machine.axes))
