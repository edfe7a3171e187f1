"""Forward kinematics: the way back from the actuators."""

import tracemalloc

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError, OutOfReach, load_machine
from kinematics.analysis.forward import BLOCK_ROWS, iterate_newton
from kinematics.machine.pose import to_numbers
from tests.pace import cpu_limit

EXACT = 1e-12
"""m and rad: what forward∘inverse may be off by."""


# the way back


def test_forward_undoes_inverse_on_the_machine(machine, poses_about, distance, scaled_jacobian):
    """Hundreds of poses about home, in one batch."""
    poses = poses_about(machine.home, machine, 500, 0.15)
    found = machine.forward(machine.inverse(poses))
    # ten units in the last place of a length, through the least singular value
    least = np.linalg.svd(scaled_jacobian(machine, poses), compute_uv=False)[:, -1].min()
    tolerance = max(EXACT, 1e-15 * np.abs(machine.home_q).max() / least * 10)
    assert distance(found.pose, poses) < tolerance
    assert found.certified.all()
    assert found.residual.shape == (500,)


def test_forward_undoes_inverse_everywhere_in_the_travel(preset, distance):
    random = np.random.default_rng(5)
    count = 5_000
    poses = RigidTransform.from_components(
        random.uniform(-1, 1, (count, 3)) * [0.05, 0.05, 0.03]
        + preset.home.translation
        + [0, 0, 0.025],
        Rotation.from_rotvec(random.uniform(-0.2, 0.2, (count, 3))),
    )
    poses = poses[preset.check(poses).ok]
    assert len(poses) > 750
    found = preset.forward(preset.inverse(poses))
    assert distance(found.pose, poses) < EXACT
    assert found.certified.all()
    assert (
        found.residual.max() < 3e-14
    )  # Newton stops at 1e-14; rounding of decimetres makes some more


def test_a_batch_equals_its_members(machine, poses_about, distance):
    """From a start for each, and from home."""
    poses, near = (
        poses_about(machine.home, machine, 6, 0.2),
        poses_about(machine.home, machine, 6, 0.1, seed=1),
    )
    q = machine.inverse(poses)
    for starts in (near, None):
        batch = machine.forward(q, starts)
        for k in range(6):
            single = machine.forward(q[k], starts and starts[k])
            assert distance(single.pose, batch.pose[k]) < EXACT
            assert single.certified == batch.certified[k]
            assert single.pose.single
            assert np.ndim(single.residual) == np.ndim(single.certified) == 0
    assert machine.forward(q[:1]).residual.shape == (1,)


def test_home_is_where_the_machine_is_at_home(machine, distance):
    found = machine.forward(machine.home_q)
    assert distance(found.pose, machine.home) < EXACT
    assert found.certified


def test_residual_is_what_inverse_says(parallel, poses_about, room):
    """Reached or not: the largest difference of a coordinate, at the very pose returned."""
    machine = parallel
    q = machine.inverse(poses_about(machine.home, machine, 20, 0.2))
    q[10:] = np.abs(
        q[10:] + np.random.default_rng(2).uniform(-2, 2, (10, len(machine.axes))) * room(machine)
    )
    found = machine.forward(q)
    assert found.residual == pytest.approx(
        np.abs(machine.inverse(found.pose) - q).max(1), rel=0, abs=1e-15
    )
    assert found.certified[:10].all()
    assert found.residual[10:].max() > 1e-3  # some of them are unreachable indeed
    assert not found.certified[found.residual > 1e-9].any()


def test_a_long_way_is_gone_in_steps(preset, distance):
    """Continued from the last pose, each step certified, round a circle and through turns."""
    angle = np.linspace(0, 2 * np.pi, 60)
    way = RigidTransform.from_components(
        preset.home.translation
        + np.stack([0.04 * np.sin(angle), 0.04 * (1 - np.cos(angle)), 0 * angle + 0.02], 1),
        Rotation.from_rotvec(
            np.stack([0.3 * np.sin(2 * angle), 0 * angle, 0.5 * np.sin(angle)], 1)
        ),
    )
    near = preset.home
    for pose in way:
        found = preset.forward(preset.inverse(pose), near)
        assert found.certified
        near = found.pose
        assert distance(near, pose) < EXACT


def test_more_than_a_block_at_once(preset, poses_about):
    """Rows are solved in blocks; each is where it belongs, with its own start."""
    count = 2 * BLOCK_ROWS + 5
    poses, near = (
        poses_about(preset.home, preset, count, 0.1),
        poses_about(preset.home, preset, count, 0.05, seed=1),
    )
    q = preset.inverse(poses)
    for starts in (None, near):
        found = preset.forward(q, starts, certify=False)
        assert len(found.pose) == len(found.residual) == len(found.certified) == count
        assert found.residual.max() < 1e-12
        assert np.abs(found.pose.as_matrix() - poses.as_matrix()).max() < 1e-10
        last = preset.forward(q[-1], starts and starts[-1], certify=False)
        assert np.abs(last.pose.as_matrix() - found.pose[-1].as_matrix()).max() < EXACT


def test_memory_does_not_grow_with_the_rows(preset, poses_about, monkeypatch):
    """The proof takes several kB a row; only the answers, some 200 bytes a row, may add up."""
    monkeypatch.setattr("kinematics.analysis.forward.BLOCK_ROWS", 100)
    q = preset.inverse(poses_about(preset.home, preset, 1000, 0.15))
    peaks = []
    for count in (100, 1000):
        preset.forward(q[:count])
        tracemalloc.start()
        assert preset.forward(q[:count]).certified.all()
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2 * peaks[0]


# what cannot be answered


@pytest.mark.parametrize(
    "q",
    [
        np.zeros(5),
        np.zeros((2, 5)),
        np.zeros((2, 3, 6)),
        0.2,
        [],
        [np.nan] * 6,
        [0.2] * 5 + [np.inf],
    ],
    ids=["five", "pairs of five", "three dimensions", "a number", "nothing", "nan", "infinite"],
)
def test_what_are_no_coordinates_is_refused(preset, q):
    with pytest.raises(
        MotionError, match=r"machine hexapod: forward takes finite coordinates \(N, 6\), not "
    ):
        preset.forward(q)


def test_the_coordinate_that_is_no_number_is_named(preset):
    q = np.tile(preset.home_q, (4, 1))
    q[2, 4] = np.nan
    with pytest.raises(MotionError, match="not nan m for leg5 in row 2"):
        preset.forward(q)


@pytest.mark.parametrize("count", [1, 3])
def test_as_many_starts_as_coordinates(preset, count):
    near = RigidTransform.from_translation(preset.home.translation + np.zeros((2, 3)))
    with pytest.raises(
        MotionError,
        match=f"machine hexapod: .*`near`, or one for each of {count} rows? of q, not 2",
    ):
        preset.forward(np.tile(preset.home_q, (count, 1)), near)


@pytest.mark.parametrize("position", [[0, 0, np.nan], [np.inf, 0, 0]])
def test_a_start_that_is_nowhere_is_refused(preset, position):
    with pytest.raises(MotionError, match="machine hexapod: near 0 must be finite"):
        preset.forward(preset.home_q, RigidTransform.from_translation(position))


def test_no_coordinates_have_no_poses(preset):
    found = preset.forward(np.zeros((0, 6)))
    assert len(found.pose) == len(found.residual) == len(found.certified) == 0


@pytest.mark.parametrize(
    "q",
    [
        np.zeros(6),
        np.full(6, 1e-9),
        np.full(6, 1e200),
        [0.1, 0.5, 0.1, 0.5, 0.1, 0.5],
        [0.22, 0.22, 0.22, 0.22, 0.22, 5.0],
    ],
    ids=["zero", "tiny", "beyond squares", "alternating", "one of another machine"],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_lengths_that_no_pose_has(preset, q):
    """Asked for alone they are refused; among others their residual tells, and they are not
    certified.
    """
    with cpu_limit(5.0):
        found = preset.forward([preset.home_q, q])
        with pytest.raises(
            OutOfReach,
            match=r"machine hexapod: no pose was found that has the lengths .* leaves .* mm",
        ):
            preset.forward(q)
    assert found.certified.tolist() == [True, False]
    assert found.residual[0] < 1e-12
    assert not found.residual[1] < 1e-4


def test_lengths_below_zero_are_refused(parallel):
    q = np.tile(parallel.home_q, (3, 1))
    q[2, 1] *= -1
    with pytest.raises(
        MotionError, match=f"m for {parallel.axes[1].name} in row 2; a length is not below 0"
    ):
        parallel.forward(q)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_start_out_of_reach_leads_nowhere():
    """No lengths of the linkage reach the pose it is asked from: it stays there, and says that it
    is no answer.
    """
    linkage = load_machine("linkage")
    nowhere = RigidTransform.from_translation([0.01, 0.01, 0])
    found = linkage.forward(linkage.home_q[None], nowhere)
    assert np.isinf(found.residual).all()
    assert not found.certified.any()
    assert np.isfinite(found.pose.as_matrix()).all()
    with pytest.raises(OutOfReach, match=r"no pose was found .* `near` is itself out of reach"):
        linkage.forward(linkage.home_q, nowhere)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_stretched_arm_is_where_its_joints_say_and_not_certified():
    """On the edge of its reach it is singular, and rounding may put the pose beyond it."""
    pytest.importorskip("pinocchio")
    arm = load_machine("arm")
    q = np.array([[0.0, 0.0, 0.0], [0.4, 0.3, 0.0], [-1.0, 0.7, 0.0]])
    found = arm.forward(q)
    assert np.abs(found.pose.translation - arm.pose_of(q).translation).max() < 1e-12
    assert not found.certified.any()


@pytest.mark.parametrize("name", ["hexapod", "tripod", "linkage", "traverser", "arm"])
def test_settling_alone_finds_the_poses_of_forward(name):
    """What batches use, without SciPy's transforms and without a proof: the same poses, to Newton's
    1e-14.
    """
    machine = load_machine(name)
    rng = np.random.default_rng(5)
    span = np.array([1e-3 if axis.kind == "linear" else 1e-2 for axis in machine.axes])
    q = machine.home_q + span * rng.uniform(-1, 1, (30, len(machine.axes)))
    x, residual = iterate_newton(machine, q, np.repeat(to_numbers(machine.home), 30, axis=0))
    assert residual.max() < 1e-12
    np.testing.assert_allclose(x, to_numbers(machine.forward(q).pose), atol=1e-12)
