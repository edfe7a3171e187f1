"""Assembly modes listed: all forty of Dietmaier's platform, and against searches of other kinds."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Hexapod, MotionError
from kinematics.analysis.assembly_modes import (
    GENERIC_SOLUTIONS,
    LegParameters,
    assembly_modes,
    solve_generic,
    solve_modes,
)

LEGS = tuple(f"leg{n}" for n in range(1, 7))
SAME = 1e-8
"""m and rad: lengths good to 1e-15, through least singular values of 1e-6 and more."""


def random_machine(seed):
    random = np.random.default_rng(seed)
    base, platform = random.normal(size=(2, 6, 3))
    home = RigidTransform.from_components(random.normal(size=3), Rotation.random(rng=random))
    return Hexapod(base, platform, axes=[Axis(leg) for leg in LEGS], home=home)


def apart(one, other):
    """(N, M) largest difference of the matrices of N and of M poses."""
    return np.abs(one.as_matrix()[:, None] - other.as_matrix()).max((2, 3))


def check(machine, q, modes):
    """Solutions, and none twice."""
    assert np.abs(machine.inverse(modes) - q).max() <= 1e-12
    between = apart(modes, modes) + np.diag(np.full(len(modes), np.inf))
    assert between.min() > 1e-5


@pytest.fixture(scope="module")
def dietmaier(published):
    data = published["dietmaier"]
    home = RigidTransform.from_translation(data["one_position"])
    return Hexapod(
        data["base"], data["platform"], axes=[Axis(leg) for leg in LEGS], home=home
    ), data


def test_all_forty_of_dietmaier_whatever_the_seed(dietmaier):
    machine, data = dietmaier
    one, other = (assembly_modes(machine, data["lengths"], seed=seed) for seed in (0, 1))
    assert len(one) == len(other) == data["real_modes"]
    assert apart(one, other).min(1).max() < SAME
    check(machine, data["lengths"], one)
    offset = np.abs(one.translation - data["one_position"]).max(1)
    assert offset.min() < 1e-9  # as printed
    row = one[int(offset.argmin())].rotation.as_matrix()[0]
    assert row == pytest.approx(data["one_rotation_row_1"], rel=0, abs=1e-6)  # printed to 1e-6


def test_newton_from_anywhere_finds_no_other():
    """1000 starts over all orientations and the whole reach of a leg; and the pose whose lengths
    they are is listed.
    """
    machine = random_machine(0)
    q, modes = machine.home_q, machine.assembly_modes(machine.home_q)
    check(machine, q, modes)
    assert apart(modes, RigidTransform.concatenate([machine.home])).min() < SAME
    random = np.random.default_rng(100)
    turns = Rotation.random(1000, rng=random)
    along = random.normal(size=(1000, 3))
    along *= q[0] / np.linalg.norm(along, axis=1)[:, None]
    starts = RigidTransform.from_components(
        machine.base[0] + along - turns.apply(np.array(machine.platform[0])), turns
    )
    found = machine.forward(np.tile(q, (1000, 1)), starts)
    others = found.pose[found.residual < 1e-12]
    assert len(others) > 200
    assert apart(others, modes).min(1).max() < SAME
    assert apart(modes, others).min(1).max() < SAME


def test_a_generic_machine_has_forty_complex_solutions():
    """Each solves the equations of the legs, written out anew, and its complex conjugate solves
    those of a real one.
    """
    legs, y = solve_generic(0)
    assert len(y) == GENERIC_SOLUTIONS == 40
    machine = random_machine(7)
    a, b = machine.platform / 2, machine.base / 2
    c = (a**2).sum(1) + (b**2).sum(1) - (machine.home_q / 2) ** 2
    real = LegParameters(*(x[None].astype(complex) for x in (a, b, c)))
    for theta, found in ((legs, y), (real, solve_modes(real, 0))):
        assert len(found) == 40
        e, h = found[:, :4], found[:, 4:]
        x, yy, z, w = e.T
        square = (e * e).sum(1)
        rotation = np.array(
            [
                [w * w + x * x - yy * yy - z * z, 2 * (x * yy - z * w), 2 * (x * z + yy * w)],
                [2 * (x * yy + z * w), w * w - x * x + yy * yy - z * z, 2 * (yy * z - x * w)],
                [2 * (x * z - yy * w), 2 * (yy * z + x * w), w * w - x * x - yy * yy + z * z],
            ]
        )
        rotation = np.moveaxis(rotation, 2, 0) / square[:, None, None]
        # the vector part of h e*, by the rules of quaternions
        position = (
            w[:, None] * h[:, :3] - h[:, 3:] * e[:, :3] - np.cross(h[:, :3], e[:, :3])
        ) / square[:, None]
        legs_of = position[:, None] + theta.a[0] @ rotation.swapaxes(1, 2) - theta.b[0]
        squares = (theta.a[0] ** 2).sum(1) + (theta.b[0] ** 2).sum(1) - theta.c[0]
        off = np.abs((legs_of**2).sum(2) - squares)
        assert off.max() < 1e-8 * max(1, np.abs(legs_of).max() ** 2)
        poses = np.concatenate([position, rotation.reshape(-1, 9)], 1)
        between = np.abs(poses[:, None] - poses).max(2) + np.diag(np.full(40, np.inf))
        assert between.min() > 1e-4
    conjugates = np.abs(poses[:, None] - poses.conj()).max(2)
    assert conjugates.min(1).max() < 1e-6


def test_the_preset_has_its_mirror_images(preset, poses_about):
    """Coplanar joints: every mode above the base has one below with the same lengths."""
    plane, top = preset.base[0, 2], preset.platform[0, 2]
    mirror = np.diag([1.0, 1.0, -1.0])
    for pose in poses_about(preset.home, preset, 2, 0.2):
        q = preset.inverse(pose)
        modes = preset.assembly_modes(q)
        check(preset, q, modes)
        assert apart(modes, RigidTransform.concatenate([pose])).min() < SAME
        turns = Rotation.from_matrix(mirror @ modes.rotation.as_matrix() @ mirror)
        centres = modes.apply(np.array([0, 0, top])) * [1, 1, -1] + [0, 0, 2 * plane]
        images = RigidTransform.from_components(centres - turns.apply([0, 0, top]), turns)
        assert apart(images, modes).min(1).max() < SAME


def test_of_every_hexapod_the_pose_is_listed(any_hexapod, poses_about):
    """Joints in one place, frames anywhere, platforms that hang."""
    poses = poses_about(any_hexapod.home, any_hexapod, 1, 0.2)
    q = any_hexapod.inverse(poses[0])
    modes = any_hexapod.assembly_modes(q)
    check(any_hexapod, q, modes)
    assert apart(modes, poses).min() < SAME * max(1, any_hexapod.home_q.max())


def test_a_singular_pose_is_listed(preset):
    """Two modes that have become one (turned by 90°): known to the root of the rounding only."""
    pose = RigidTransform.from_components([0, 0, 0.25], Rotation.from_rotvec([0, 0, np.pi / 2]))
    modes = preset.assembly_modes(preset.inverse(pose))
    assert np.abs(preset.inverse(modes) - preset.inverse(pose)).max() <= 1e-12
    assert apart(modes, RigidTransform.concatenate([pose])).min() < 1e-5


def test_lengths_that_no_pose_has_give_none(preset):
    """One leg longer than all others and both platforms together."""
    assert len(preset.assembly_modes([0.2, 0.2, 0.2, 0.2, 0.2, 1.5])) == 0


@pytest.mark.parametrize(
    "q", [[0.2] * 5, [0.2] * 5 + [np.nan], [0.2] * 5 + [0.0], np.full((2, 6), 0.2)]
)
def test_what_are_no_lengths_is_refused(preset, q):
    with pytest.raises(
        MotionError, match=r"lengths of its legs must be finite numbers \(6,\) in m above 0"
    ):
        preset.assembly_modes(q)
