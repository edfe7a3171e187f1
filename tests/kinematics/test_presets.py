"""What every bundled machine must do, whatever its kind: one line of data each in the zoo."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import OutOfReach, load_machine, machine_names
from kinematics.freedom import COMPONENTS, columns

# How far (m, rad) poses are drawn from home in each component that a machine controls.
ZOO = {
    "arm": (0.1, 0.0),
    "hexapod": (0.01, 0.05),
    "hexapod-initial": (0.01, 0.05),
    "linkage": (0.03, 0.0),
    "traverser": (0.3, 3.0),
    "tripod": (0.03, 0.0),
}


@pytest.fixture(scope="module", params=ZOO)
def preset(request):
    if request.param == "arm":
        pytest.importorskip("pinocchio")
    return load_machine(request.param)


def drawn(machine, count=200, seed=0, share=1.0):
    """Poses about home in what the machine controls, and in nothing else."""
    shift, turn = ZOO[machine.name]
    off = np.zeros((count, 6))
    size = share * np.array([shift] * 3 + [turn] * 3)[columns(machine)]
    off[:, columns(machine)] = np.random.default_rng(seed).uniform(-1, 1, (count, len(machine.freedom))) * size
    return RigidTransform.from_components(
        machine.home.translation + off[:, :3], Rotation.from_rotvec(off[:, 3:]) * machine.home.rotation
    )


def test_every_preset_is_in_the_zoo():
    assert set(ZOO) == set(machine_names())


def test_home_is_where_it_says(preset):
    assert preset.inverse(preset.home) == pytest.approx(preset.home_q, abs=1e-12)
    assert preset.forward(preset.home_q).pose.as_matrix() == pytest.approx(preset.home.as_matrix(), abs=1e-12)
    assert preset.check(preset.home).ok.all()


def test_forward_undoes_inverse_certified(preset):
    """1e-12 m and rad, what follows included."""
    poses = drawn(preset)
    q = preset.inverse(poses)
    found = preset.forward(q)
    assert found.certified.all()
    assert np.abs(found.pose.translation - poses.translation).max() < 1e-12
    assert preset.inverse(found.pose) == pytest.approx(q, abs=1e-12)
    if not preset.follows:
        assert np.abs((found.pose.rotation.inv() * poses.rotation).magnitude()).max() < 1e-12


def test_the_jacobian_is_the_derivative_of_the_inverse(preset):
    """Central differences of 1e-6 in what is controlled: cut off at 1e-12, rounded at 1e-10."""
    poses = drawn(preset, count=20)
    jacobian, step = preset.jacobian(poses), 1e-6
    for k in columns(preset):
        twist = np.zeros(6)
        twist[k] = step
        ends = [
            RigidTransform.from_components(
                poses.translation + way * twist[:3], Rotation.from_rotvec(way * twist[3:]) * poses.rotation
            )
            for way in (1, -1)
        ]
        slope = (preset.inverse(ends[0]) - preset.inverse(ends[1])) / (2 * step)
        assert np.abs(jacobian[:, :, k] - slope).max() < 2e-8 * max(1.0, np.abs(jacobian).max())


def test_what_is_held_is_refused_and_what_follows_is_ignored(preset):
    pose = preset.home
    for k, name in enumerate(COMPONENTS):
        twist = np.zeros(6)
        twist[k] = 1e-3
        moved = RigidTransform.from_components(
            pose.translation + twist[:3], Rotation.from_rotvec(twist[3:]) * pose.rotation
        )
        if name in preset.freedom:
            assert np.abs(preset.inverse(moved) - preset.inverse(pose)).max() > 1e-5
        elif name in preset.follows:
            assert preset.inverse(moved) == pytest.approx(preset.inverse(pose), abs=1e-14)
        else:
            with pytest.raises(OutOfReach, match=f"holds {name}: pose 0 has {name}"):
                preset.inverse(moved)


def test_one_pose_is_a_batch_of_one(preset):
    poses = drawn(preset, count=3)
    many, one = preset.inverse(poses), [preset.inverse(poses[k]) for k in range(3)]
    assert (many == np.array(one)).all()
    assert (preset.jacobian(poses) == np.array([preset.jacobian(poses[k]) for k in range(3)])).all()


def test_the_tripod_hangs_and_holds_its_plate():
    """Arms by the theorem of Pythagoras; the tool is the point whose place a pose states."""
    tripod = load_machine("tripod")
    across, down = (300 - 60) / np.sqrt(3), 250.0
    assert tripod.home_q * 1e3 == pytest.approx([np.hypot(across, down)] * 3, abs=1e-6)
    assert np.rad2deg(np.arccos(tripod.tilt_map(np.concatenate([[0, 0, -0.3], np.eye(3).ravel()])[None]))) == (
        pytest.approx(np.rad2deg(np.arctan2(across, down)), abs=1e-6)
    )
    pulse = tripod.axes[0].pulse
    assert 1e-3 / pulse == pytest.approx(500 * 50, rel=1e-12)  # counts per mm, step pulses per count [KMITL 2005]
