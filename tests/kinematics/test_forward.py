"""Forward kinematics: the way back from the actuators, and what its certificate is worth."""

from contextlib import suppress
from time import perf_counter

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Hexapod, MotionError
from kinematics.forward import regular
from kinematics.hexapod import joint_circle

EXACT = 1e-12
"""m and rad: what forward∘inverse may be off by."""


def distance(found, expected):
    """Largest error of a position (m) and of a rotation (rad), over all poses."""
    apart = found.inv() * expected
    return np.linalg.norm(apart.translation, axis=-1).max(), np.max(apart.rotation.magnitude())


def scaled_jacobian(machine, poses):
    return machine.jacobian(poses) * np.array([1.0] * 3 + [1 / machine.characteristic_length] * 3)


def along(start, end, count):
    """(count, N) poses of the N straight motions, turning steadily about one axis: by SciPy alone."""
    turn = (start.rotation.inv() * end.rotation).as_rotvec()
    share = np.linspace(0, 1, count)[:, None, None]
    shift = start.translation + share * (end.translation - start.translation)
    rotations = [start.rotation * Rotation.from_rotvec(u * turn) for u in share[:, 0, 0]]
    return [RigidTransform.from_components(p, r) for p, r in zip(shift, rotations, strict=True)]


def sampled(machine, start, end, count=257):
    """Of N straight motions: whether the sign of det J changes (N,), and the least singular value of J met (N,)."""
    jacobians = np.stack([scaled_jacobian(machine, poses) for poses in along(start, end, count)])
    sign = np.sign(np.linalg.det(jacobians))
    return (sign != sign[0]).any(0), np.linalg.svd(jacobians, compute_uv=False)[..., -1].min(0)


def mirrored(pose, base=0.0115, platform=-0.011):
    """The image of the preset's platform below the plane of its base joints: the same leg lengths."""
    mirror = np.diag([1.0, 1.0, -1.0])
    rotation = pose.rotation.as_matrix()
    centre = pose.apply(np.array([0, 0, platform]))  # of the platform's joints
    turned = Rotation.from_matrix(mirror @ rotation @ mirror)
    image = centre * [1, 1, -1] + [0, 0, 2 * base]
    return RigidTransform.from_components(image - turned.apply([0, 0, platform]), turned)


# the way back


def test_forward_undoes_inverse_on_the_machine(machine, poses_about):
    """Thousands of poses about home, in one batch."""
    poses = poses_about(machine.home, machine, 2000, 0.15)
    found = machine.forward(machine.inverse(poses))
    # ten units in the last place of a length, through the least singular value
    least = np.linalg.svd(scaled_jacobian(machine, poses), compute_uv=False)[:, -1].min()
    tolerance = max(EXACT, 1e-15 * machine.home_q.max() / least * 10)
    assert max(distance(found.pose, poses)) < tolerance
    assert found.certified.all()
    assert found.residual.shape == (2000,)


def test_forward_undoes_inverse_everywhere_in_the_travel(preset):
    random = np.random.default_rng(5)
    count = 20_000
    poses = RigidTransform.from_components(
        random.uniform(-1, 1, (count, 3)) * [0.05, 0.05, 0.03] + preset.home.translation + [0, 0, 0.025],
        Rotation.from_rotvec(random.uniform(-0.2, 0.2, (count, 3))),
    )
    poses = poses[preset.check(poses).ok]
    assert len(poses) > 3000
    found = preset.forward(preset.inverse(poses))
    assert max(distance(found.pose, poses)) < EXACT
    assert found.certified.all()
    assert found.residual.max() < 3e-14  # Newton stops at 1e-14; rounding of decimetres makes some more


def test_a_batch_equals_its_members(machine, poses_about):
    """From a start for each, and from home."""
    poses, near = poses_about(machine.home, machine, 6, 0.2), poses_about(machine.home, machine, 6, 0.1, seed=1)
    q = machine.inverse(poses)
    for starts in (near, None):
        batch = machine.forward(q, starts)
        for k in range(6):
            single = machine.forward(q[k], starts and starts[k])
            assert max(distance(single.pose, batch.pose[k])) < EXACT
            assert single.certified == batch.certified[k]
            assert single.pose.single
            assert np.ndim(single.residual) == np.ndim(single.certified) == 0
    assert machine.forward(q[:1]).residual.shape == (1,)


def test_home_is_where_the_machine_is_at_home(machine):
    found = machine.forward(machine.home_q)
    assert max(distance(found.pose, machine.home)) < EXACT
    assert found.certified


def test_residual_is_what_inverse_says(machine, poses_about):
    """Reached or not: the largest difference of a coordinate, at the very pose returned."""
    q = machine.inverse(poses_about(machine.home, machine, 20, 0.2))
    q[10:] += np.random.default_rng(2).uniform(-2, 2, (10, len(machine.axes))) * machine.characteristic_length
    found = machine.forward(q)
    assert found.residual == pytest.approx(np.abs(machine.inverse(found.pose) - q).max(1), rel=0, abs=1e-15)
    assert found.certified[:10].all()
    assert found.residual[10:].max() > 1e-3  # some of them are unreachable indeed
    assert not found.certified[found.residual > 1e-9].any()


def test_a_long_way_is_gone_in_steps(preset):
    """Continued from the last pose, each step certified, round a circle and through turns."""
    angle = np.linspace(0, 2 * np.pi, 60)
    way = RigidTransform.from_components(
        preset.home.translation + np.stack([0.04 * np.sin(angle), 0.04 * (1 - np.cos(angle)), 0 * angle + 0.02], 1),
        Rotation.from_rotvec(np.stack([0.3 * np.sin(2 * angle), 0 * angle, 0.5 * np.sin(angle)], 1)),
    )
    near = preset.home
    for pose in way:
        found = preset.forward(preset.inverse(pose), near)
        assert found.certified
        near = found.pose
        assert max(distance(near, pose)) < EXACT


def test_near_chooses_the_assembly_mode(preset, poses_about):
    """The platform above its base and its image below share their leg lengths; each is found from its own side."""
    above = poses_about(preset.home, preset, 50, 0.2)
    below = RigidTransform.concatenate([mirrored(pose) for pose in above])
    q = preset.inverse(above)
    assert preset.inverse(below) == pytest.approx(q, rel=1e-14)
    from_below = preset.forward(q, mirrored(preset.home))
    assert max(distance(from_below.pose, below)) < EXACT
    assert from_below.certified.all()
    assert max(distance(preset.forward(q).pose, above)) < EXACT


# the certificate is a proof


def test_the_image_below_the_base_is_never_certified_from_above(preset, poses_about):
    """Reflection turns the sign of det J round, so every motion between the two crosses a singularity."""
    above, other = (poses_about(preset.home, preset, 100, 0.3, seed) for seed in (1, 2))
    below = RigidTransform.concatenate([mirrored(pose) for pose in other])
    assert not regular(preset, above, below).any()
    assert not regular(preset, below, above).any()
    assert regular(preset, above, other).all()
    assert regular(preset, below, RigidTransform.concatenate([mirrored(pose) for pose in above])).all()


@pytest.mark.parametrize(("shift", "turn"), [(0.7, 0.3), (2.0, 0.8), (3.0, 3.0)])
def test_motions_that_cross_a_singularity_are_never_certified(machine, shift, turn):
    """Against det J at 257 poses of each motion; those that keep well away from zero are all proved."""
    random = np.random.default_rng(11)

    def anywhere(count):
        return RigidTransform.from_components(
            machine.home.translation + shift * machine.characteristic_length * random.uniform(-1, 1, (count, 3)),
            machine.home.rotation * Rotation.from_rotvec(turn * random.uniform(-1, 1, (count, 3))),
        )

    start, end = anywhere(60), anywhere(60)
    crosses, least = sampled(machine, start, end)
    proved = regular(machine, start, end)
    assert crosses.any() or shift < 1
    assert not proved[crosses].any()
    # a cell of 2⁻¹² of such a motion changes J by some 1e-3: twenty times that is well away
    assert proved[~crosses & (least > 0.02)].all()


def test_motions_through_a_singular_pose_are_never_certified(machine):
    """In every direction, also where the motion only touches the singular surface and det J keeps its sign."""
    random = np.random.default_rng(12)

    def moved(pose, twist):
        """Along straight motions: scaled shift in the base frame, turn in the platform's."""
        shift, turn = np.split(np.atleast_2d(twist), 2, axis=1)
        return RigidTransform.from_components(
            pose.translation + machine.characteristic_length * shift, pose.rotation * Rotation.from_rotvec(turn)
        )

    def det(pose):
        return np.linalg.det(scaled_jacobian(machine, pose))

    # singular poses: bisection of det J on rays from home
    rays = random.uniform(-1.5, 1.5, (40, 6))
    home = det(machine.home)
    rays = rays[np.sign(det(moved(machine.home, rays))) != np.sign(home)]
    low, high = np.zeros(len(rays)), np.ones(len(rays))
    for _ in range(60):
        middle = (low + high) / 2
        same = np.sign(det(moved(machine.home, middle[:, None] * rays))) == np.sign(home)
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    singular = moved(machine.home, low[:, None] * rays)
    # the direction in which det J changes fastest, by differences: a tangent needs no more than three digits
    count, step = len(rays), 1e-5
    slopes = [det(moved(singular, step * e)) - det(moved(singular, -step * e)) for e in np.eye(6)[:, None]]
    normal = np.stack(slopes, 1) / np.linalg.norm(slopes, axis=0)[:, None]
    for tangent in (False, True):
        twist = random.normal(size=(count, 6))
        twist -= tangent * (twist * normal).sum(1)[:, None] * normal
        twist *= 0.3 / np.linalg.norm(twist, axis=1)[:, None]
        back, forth = random.uniform(0.3, 1, (2, count, 1))
        start, end = moved(singular, -back * twist), moved(singular, forth * twist)
        assert not regular(machine, start, end).any()
        crosses = np.sign(det(start)) != np.sign(det(end))
        assert (~crosses if tangent else crosses).sum() > 5


@pytest.mark.parametrize("sign", [1, -1])
def test_a_quarter_turn_is_singular(preset, sign):
    """At ±90° about the axis all six legs are tangents of one screw, at any height [Fichter 1986]."""
    for height in (0.0, 0.03, -0.05):
        start = RigidTransform.from_translation(preset.home.translation + np.array([0, 0, height]))

        def turned(degrees, start=start):
            return start * RigidTransform.from_rotation(Rotation.from_euler("z", sign * degrees, degrees=True))

        assert regular(preset, start, turned(88)).all()
        assert not regular(preset, start, turned(90)).any()
        assert not regular(preset, start, turned(92)).any()
        assert regular(preset, turned(92), turned(150)).all()


def test_flat_platforms_are_singular(preset):
    """All joints in one plane: no leg resists lifting, however the platform moves in that plane."""
    flat = RigidTransform.from_translation([0, 0, 0.0225])
    shifted = RigidTransform.from_components([0.01, 0.02, 0.0225], Rotation.from_euler("z", 20, degrees=True))
    assert not regular(preset, flat, flat).any()
    assert not regular(preset, flat, shifted).any()
    assert not regular(preset, shifted, preset.home).any()


def test_certified_answers_come_along_regular_motions(machine, poses_about):
    """Wherever its start led Newton: what is certified has the lengths asked for, and a motion free of zeros."""
    random = np.random.default_rng(13)
    far = poses_about(machine.home, machine, 300, 1.8)
    near = poses_about(machine.home, machine, 300, 0.2, seed=3)
    q = machine.inverse(far) * random.choice([1.0, 0.98, 1.02], (300, len(machine.axes)))
    found = machine.forward(q, near)
    crosses, _ = sampled(machine, near, found.pose)
    solved = found.residual < 1e-9
    assert (solved & crosses).any()  # Newton does arrive in other modes
    assert not (found.certified & crosses).any()
    assert not (found.certified & ~solved).any()
    assert found.certified.any()


def test_a_machine_that_is_singular_everywhere_is_answered_soon():
    """Similar hexagons joined corner to corner never resist all six motions: nothing to certify, and no long search."""
    base, platform = joint_circle(0.2, np.pi / 3, 0.0), joint_circle(0.1, np.pi / 3, 0.0)
    home = RigidTransform.from_translation([0, 0, 0.2])
    machine = Hexapod(base, platform, axes=[Axis(f"leg{n}") for n in range(1, 7)], home=home)
    began = perf_counter()
    found = machine.forward(np.tile(machine.home_q, (30, 1)))
    assert not found.certified.any()
    assert perf_counter() - began < 2  # one motion takes milliseconds where the search is cut short


# what cannot be answered


@pytest.mark.parametrize(
    "q",
    [np.zeros(5), np.zeros((2, 5)), np.zeros((2, 3, 6)), 0.2, [], [np.nan] * 6, [0.2] * 5 + [np.inf]],
    ids=["five", "pairs of five", "three dimensions", "a number", "nothing", "nan", "infinite"],
)
def test_what_are_no_coordinates_is_refused(preset, q):
    with pytest.raises(MotionError, match=r"machine hexapod: forward takes finite coordinates \(N, 6\)"):
        preset.forward(q)


@pytest.mark.parametrize("count", [1, 3])
def test_as_many_starts_as_coordinates(preset, count):
    near = RigidTransform.from_translation(preset.home.translation + np.zeros((2, 3)))
    with pytest.raises(MotionError):
        preset.forward(np.tile(preset.home_q, (count, 1)), near)


def test_no_coordinates_have_no_poses(preset):
    with suppress(MotionError):
        found = preset.forward(np.zeros((0, 6)))
        assert len(found.pose) == len(found.residual) == len(found.certified) == 0


@pytest.mark.parametrize(
    "q",
    [
        np.zeros(6),
        np.full(6, -0.22),
        np.full(6, 1e-9),
        np.full(6, 1e6),
        np.full(6, 1e200),
        [0.1, 0.5, 0.1, 0.5, 0.1, 0.5],
        [0.22, 0.22, 0.22, 0.22, 0.22, 5.0],
    ],
    ids=["zero", "negative", "tiny", "far", "beyond squares", "alternating", "one of another machine"],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_lengths_that_no_pose_has_are_not_certified(preset, q):
    began = perf_counter()
    found = preset.forward(q)
    assert not found.certified
    assert not found.residual < 1e-12
    assert perf_counter() - began < 5


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("height", [0.0225, -1e-9, 1e6])
def test_a_bad_start_is_not_certified(preset, height):
    """In the plane of the base, and out of all proportion: the answer may be wrong, but it is not called certified."""
    began = perf_counter()
    start = RigidTransform.from_translation([[0, 0, height]])
    found = preset.forward(preset.home_q[None], start)
    crosses, _ = sampled(preset, start, found.pose)
    assert not (found.certified & crosses).any()
    assert perf_counter() - began < 5
