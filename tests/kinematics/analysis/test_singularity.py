"""The certificate of forward kinematics: what it claims holds in every assembly mode, and
singularities stop it.
"""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Hexapod, Machine, joint_circle, load_machine
from kinematics.analysis.singularity import _bound_cells, prove_regular
from kinematics.machine.pose import straight_parameters
from tests.pace import cpu_limit


def along(start, end, count):
    """(count, N) poses of the N straight motions, turning steadily about one axis: by SciPy
    alone.
    """
    turn = (start.rotation.inv() * end.rotation).as_rotvec()
    share = np.linspace(0, 1, count)[:, None, None]
    shift = start.translation + share * (end.translation - start.translation)
    rotations = [start.rotation * Rotation.from_rotvec(u * turn) for u in share[:, 0, 0]]
    return [RigidTransform.from_components(p, r) for p, r in zip(shift, rotations, strict=True)]


@pytest.fixture(scope="session")
def sampled(scaled_jacobian):
    """Of N straight motions: whether the sign of det J changes (N,), and the least singular value
    of J met (N,).
    """

    def make(machine, start, end, count=129):
        jacobians = np.stack(
            [scaled_jacobian(machine, poses) for poses in along(start, end, count)]
        )
        sign = np.sign(np.linalg.det(jacobians))
        return (sign != sign[0]).any(0), np.linalg.svd(jacobians, compute_uv=False)[..., -1].min(0)

    return make


def test_cells_that_are_proved_hold_no_singularity(legged, poses_about, scaled_jacobian):
    """Of any width, by themselves: det J at 17 instants of each.

    Every term of the proof is needed for that.
    """
    machine = legged
    count, random = 1000, np.random.default_rng(14)
    start, end = (poses_about(machine.home, machine, count, 2.0, seed) for seed in (4, 5))
    width = 2.0 ** random.uniform(-6, 0, count)
    low = random.uniform(0, 1 - width)
    size, centre = _bound_cells(
        machine,
        straight_parameters(start, end, 1.0),
        np.tile(machine.home_q, (count, 1)),
        low,
        width,
    )
    turn = (start.rotation.inv() * end.rotation).as_rotvec()
    signs = []
    for share in (low + u * width for u in np.linspace(0, 1, 17)):
        shift = share[:, None] * (end.translation - start.translation)
        rotation = start.rotation * Rotation.from_rotvec(share[:, None] * turn)
        pose = RigidTransform.from_components(start.translation + shift, rotation)
        signs.append(np.sign(np.linalg.det(scaled_jacobian(machine, pose))))
    crosses = np.ptp(signs, axis=0) > 0
    proved = size < 1
    assert not proved[crosses].any()
    assert centre[proved].all()
    assert min(proved.sum(), crosses.sum()) > 30


@pytest.mark.parametrize(("shift", "turn"), [(0.7, 0.3), (2.0, 0.8), (3.0, 3.0)])
def test_motions_that_cross_a_singularity_are_never_certified(
    legged, poses_about, sampled, shift, turn
):
    """Against det J at 129 poses of each motion; those that keep well away from zero are all
    proved.
    """
    machine = legged
    start, end = (poses_about(machine.home, machine, 20, (shift, turn), seed) for seed in (11, 12))
    crosses, least = sampled(machine, start, end)
    proved = prove_regular(machine, start, end)
    assert crosses.any() or shift < 1
    assert not proved[crosses].any()
    # a cell of 2⁻¹² of such a motion changes J by some 1e-3: twenty times that is well away
    assert proved[~crosses & (least > 0.02)].all()


def test_motions_through_a_singular_pose_are_never_certified(any_hexapod, scaled_jacobian):
    """In every direction, also where the motion only touches the singular surface and det J keeps
    its sign.
    """
    machine = any_hexapod
    random = np.random.default_rng(12)

    def moved(pose, twist):
        """Along straight motions: scaled shift in the base frame, turn in the platform's."""
        shift, turn = np.split(np.atleast_2d(twist), 2, axis=1)
        return RigidTransform.from_components(
            pose.translation + machine.characteristic_length * shift,
            pose.rotation * Rotation.from_rotvec(turn),
        )

    def det(pose):
        return np.linalg.det(scaled_jacobian(machine, pose))

    # singular poses: bisection of det J on rays from home
    rays = random.uniform(-1.5, 1.5, (24, 6))
    home = det(machine.home)
    rays = rays[np.sign(det(moved(machine.home, rays))) != np.sign(home)]
    low, high = np.zeros(len(rays)), np.ones(len(rays))
    for _ in range(60):
        middle = (low + high) / 2
        same = np.sign(det(moved(machine.home, middle[:, None] * rays))) == np.sign(home)
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    singular = moved(machine.home, low[:, None] * rays)
    # the direction in which det J changes fastest, by differences: a tangent needs no more than
    # three digits
    count, step = len(rays), 1e-5
    slopes = [
        det(moved(singular, step * e)) - det(moved(singular, -step * e)) for e in np.eye(6)[:, None]
    ]
    normal = np.stack(slopes, 1) / np.linalg.norm(slopes, axis=0)[:, None]
    for tangent in (False, True):
        twist = random.normal(size=(count, 6))
        twist -= tangent * (twist * normal).sum(1)[:, None] * normal
        twist *= 0.3 / np.linalg.norm(twist, axis=1)[:, None]
        back, forth = random.uniform(0.3, 1, (2, count, 1))
        start, end = moved(singular, -back * twist), moved(singular, forth * twist)
        assert not prove_regular(machine, start, end).any()
        crosses = np.sign(det(start)) != np.sign(det(end))
        assert (~crosses if tangent else crosses).sum() > 3


@pytest.mark.parametrize("sign", [1, -1])
def test_a_quarter_turn_is_singular(preset, sign):
    """At ±90° about the axis all six legs are tangents of one screw, at any height [Fichter
    1986].
    """
    for height in (0.0, 0.03, -0.05):
        start = RigidTransform.from_translation(preset.home.translation + np.array([0, 0, height]))

        def turned(degrees, start=start):
            return start * RigidTransform.from_rotation(
                Rotation.from_euler("z", sign * degrees, degrees=True)
            )

        assert prove_regular(preset, start, turned(88)).all()
        assert not prove_regular(preset, start, turned(90)).any()
        assert not prove_regular(preset, start, turned(92)).any()
        assert prove_regular(preset, turned(92), turned(150)).all()


class Cubic(Machine):
    """q = (x − x³, y, z, R₃₂, R₁₃, R₂₁): det J = 1 − 3x² without a turn, whose slope vanishes in
    the middle.
    """

    characteristic_length = 1.0

    def expression(self, position, rotation, near):
        x, y, z = ca.vertsplit(position)
        return ca.vertcat(x - x**3, y, z, rotation[2, 1], rotation[0, 2], rotation[1, 0])


@pytest.mark.parametrize(
    ("reach", "free"), [(0.5, True), (0.577, True), (0.578, False), (0.7, False), (3.0, False)]
)
def test_curvature_alone_can_reach_a_singularity(reach, free):
    """From −x to x, singular at ±1/√3: the same sign at both ends, and no first-order change over
    the whole motion.
    """
    machine = Cubic(
        "cubic",
        [Axis(name) for name in ("x", "y", "z", "rx", "ry", "rz")],
        RigidTransform.identity(),
    )
    ends = (RigidTransform.from_translation([[sign * reach, 0.3 * sign, 0]]) for sign in (-1, 1))
    assert prove_regular(machine, *ends).tolist() == [free]


def test_flat_platforms_are_singular(preset):
    """All joints in one plane: no leg resists lifting, however the platform moves in that plane."""
    flat = RigidTransform.from_translation([0, 0, 0.0225])
    shifted = RigidTransform.from_components(
        [0.01, 0.02, 0.0225], Rotation.from_euler("z", 20, degrees=True)
    )
    assert not prove_regular(preset, flat, flat).any()
    assert not prove_regular(preset, flat, shifted).any()
    assert not prove_regular(preset, shifted, preset.home).any()


def test_certified_answers_come_along_regular_motions(any_hexapod, poses_about, sampled):
    """Wherever its start led Newton: what is certified has the lengths asked for, and a motion free
    of zeros.
    """
    # machines of fewer legs have a mirror image only, to which Newton hardly strays
    machine = any_hexapod
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


def test_a_machine_that_is_singular_everywhere_is_answered_soon(poses_about, monkeypatch):
    """Similar hexagons joined corner to corner never resist all six motions: nothing to certify,
    and no long search.
    """
    monkeypatch.setattr(
        "kinematics.kinds.legged._refuse_coincident", lambda *_: None
    )  # else it is no machine
    base, platform = joint_circle(0.2, np.pi / 3, 0.0), joint_circle(0.1, np.pi / 3, 0.0)
    home = RigidTransform.from_translation([0, 0, 0.2])
    machine = Hexapod(base, platform, axes=[Axis(f"leg{n}") for n in range(1, 7)], home=home)
    start, end = (poses_about(home, machine, 100, 0.2, seed) for seed in (1, 2))
    with cpu_limit(2.0):  # one motion takes milliseconds where the search is cut short
        assert not prove_regular(machine, start, end).any()
        assert not machine.forward(np.tile(machine.home_q, (30, 1))).certified.any()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("height", [0.0225, -1e-9, 1e6])
def test_a_bad_start_is_not_certified(preset, sampled, height):
    """In the plane of the base, and out of all proportion: the answer may be wrong, but it is not
    called certified.
    """
    start = RigidTransform.from_translation([[0, 0, height]])
    with cpu_limit(5.0):
        found = preset.forward(preset.home_q[None], start)
    crosses, _ = sampled(preset, start, found.pose)
    assert not (found.certified & crosses).any()


def test_a_linkage_does_not_cross_its_base_line():
    """The joint of the two actuators lies on one side of a–b or on the other, and on the line they
    are singular.
    """
    linkage = load_machine("linkage")
    q = linkage.home_q + np.random.default_rng(15).uniform(-0.05, 0.05, (200, 2))
    here, beyond = (
        RigidTransform.from_translation(np.pad(linkage.realised(q, side), ((0, 0), (0, 1))))
        for side in (1, -1)
    )
    home = RigidTransform.from_matrix(np.tile(linkage.home.as_matrix(), (200, 1, 1)))
    assert prove_regular(linkage, home, here).all()
    assert not prove_regular(linkage, home, beyond).any()
    for near, there in ((None, here), (beyond[0], beyond)):
        found = linkage.forward(q, near)
        assert found.certified.all()
        assert np.abs(found.pose.translation - there.translation).max() < 1e-12


def test_slides_and_turns_are_regular_everywhere():
    """The traverser's axes do one thing each, wherever they are."""
    traverser = load_machine("traverser")
    home = traverser.home
    far = RigidTransform.from_components([[1.2, 1.2, 1.8]], Rotation.from_rotvec([[0, 0, 3.1]]))
    assert prove_regular(traverser, RigidTransform.from_matrix(home.as_matrix()[None]), far).all()
