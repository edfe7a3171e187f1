"""Assembly modes: poses of the same lengths; a certified answer is the one that the legs really
lead to.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Hexapod
from kinematics.analysis.singularity import prove_regular

STEPS = 300
"""Of a continuation: its poses then differ by less than 1 % of the machine's size, and Newton keeps
to its branch.
"""


SAME = 1e-9
"""m and rad: lengths good to 1e-15, through least singular values of 1e-6 and more; modes are 0.1
apart at least.
"""


def lengths_at(machine, position, rotation):
    """Lengths (N, 6) and their slope (N, 6, 6) along a twist about the platform's origin, by numpy
    alone.
    """
    arms = machine.platform @ rotation.swapaxes(1, 2)
    legs = position[:, None] + arms - machine.base
    lengths = np.linalg.norm(legs, axis=2)
    along = legs / lengths[:, :, None]
    return lengths, np.concatenate([along, np.cross(arms, along)], 2)


def followed(machine, start, lengths):
    """The poses (N) that machines reach from `start` whose legs go through `lengths` (steps, N, 6):
    Newton at each.
    """
    position, rotation = start.translation, start.rotation.as_matrix()
    for wanted in [*lengths, *lengths[-1:] * 4]:
        for _ in range(2):
            now, slope = lengths_at(machine, position, rotation)
            twist = np.linalg.solve(slope, (wanted - now)[:, :, None])[:, :, 0]
            # beyond a singularity nothing holds it
            twist /= np.maximum(1, np.linalg.norm(twist, axis=1) / 0.1)[:, None]
            position = position + twist[:, :3]
            rotation = Rotation.from_rotvec(twist[:, 3:]).as_matrix() @ rotation
    return RigidTransform.from_components(position, Rotation.from_matrix(rotation))


def lengths_along(machine, start, end):
    """Lengths (steps, N, 6) of the N straight motions, turning steadily about one axis."""
    turn = (start.rotation.inv() * end.rotation).as_rotvec()
    shift = end.translation - start.translation
    return [
        lengths_at(
            machine,
            start.translation + u * shift,
            (start.rotation * Rotation.from_rotvec(u * turn)).as_matrix(),
        )[0]
        for u in np.linspace(0, 1, STEPS + 1)[1:]
    ]


def apart(found, expected):
    """(N,) of each pair of poses: m and rad together."""
    between = found.inv() * expected
    return np.linalg.norm(between.translation, axis=1) + between.rotation.magnitude()


def mirrored(pose, base=0.0115, platform=-0.011):
    """The image of the preset's platform below the plane of its base joints: the same leg
    lengths.
    """
    mirror = np.diag([1.0, 1.0, -1.0])
    rotation = pose.rotation.as_matrix()
    centre = pose.apply(np.array([0, 0, platform]))  # of the platform's joints
    turned = Rotation.from_matrix(mirror @ rotation @ mirror)
    image = centre * [1, 1, -1] + [0, 0, 2 * base]
    return RigidTransform.from_components(image - turned.apply([0, 0, platform]), turned)


def test_near_chooses_the_assembly_mode(preset, poses_about, distance):
    """The platform above its base and its image below share their leg lengths; each is found from
    its own side.
    """
    above = poses_about(preset.home, preset, 50, 0.2)
    below = RigidTransform.concatenate([mirrored(pose) for pose in above])
    q = preset.inverse(above)
    assert preset.inverse(below) == pytest.approx(q, rel=1e-14)
    from_below = preset.forward(q, mirrored(preset.home))
    assert distance(from_below.pose, below) < 1e-12
    assert from_below.certified.all()
    assert distance(preset.forward(q).pose, above) < 1e-12


def test_the_image_below_the_base_is_never_certified_from_above(preset, poses_about):
    """Reflection turns the sign of det J round, so every motion between the two crosses a
    singularity.
    """
    above, other = (poses_about(preset.home, preset, 100, 0.3, seed) for seed in (1, 2))
    below = RigidTransform.concatenate([mirrored(pose) for pose in other])
    assert not prove_regular(preset, above, below).any()
    assert not prove_regular(preset, below, above).any()
    assert prove_regular(preset, above, other).all()
    assert prove_regular(
        preset, below, RigidTransform.concatenate([mirrored(pose) for pose in above])
    ).all()


def test_inside_the_travel_legs_lead_to_the_answer_on_their_own_straight_way(preset):
    """Each leg at a steady speed from home, as synchronised moves go: not the motion that the
    certificate looks at.
    """
    random = np.random.default_rng(21)
    q = preset.home_q + random.uniform(0, 0.0508, (500, 6))
    found = preset.forward(q)
    inside = (found.residual < 1e-12) & preset.check(found.pose).ok
    assert inside.sum() > 100
    assert found.certified[inside].all()
    start = preset.home_q + np.zeros((inside.sum(), 6))
    home = preset.forward(start).pose
    reached = followed(
        preset, home, [start + u * (q[inside] - start) for u in np.linspace(0, 1, STEPS + 1)[1:]]
    )
    assert apart(reached, found.pose[inside]).max() < SAME


def test_far_answers_are_those_that_the_legs_lead_to(any_hexapod, poses_about):
    """From starts and for poses anywhere in reach, legs going through the lengths of the motion
    that was certified.
    """
    near = poses_about(any_hexapod.home, any_hexapod, 60, 0.4)
    far = poses_about(any_hexapod.home, any_hexapod, 60, 1.5, seed=1)
    found = any_hexapod.forward(any_hexapod.inverse(far), near)
    assert 5 < found.certified.sum() < 60
    start, end = near[found.certified], found.pose[found.certified]
    reached = followed(any_hexapod, start, lengths_along(any_hexapod, start, end))
    assert apart(reached, end).max() < SAME


@pytest.fixture(scope="module")
def forty(published):
    """A machine with 40 real assembly modes for one set of lengths [Dietmaier 1998], and Newton's
    answers.
    """
    data = published["dietmaier"]
    home = RigidTransform.from_translation(data["one_position"])
    machine = Hexapod(
        data["base"], data["platform"], axes=[Axis(f"leg{n}") for n in range(1, 7)], home=home
    )
    random = np.random.default_rng(15)
    on_a_sphere = random.normal(size=(1000, 3))  # the first leg joins both origins and has length 1
    on_a_sphere /= np.linalg.norm(on_a_sphere, axis=1)[:, None]
    near = RigidTransform.from_components(on_a_sphere, Rotation.random(1000, rng=random))
    found = machine.forward(np.tile(data["lengths"], (1000, 1)), near)
    return machine, near, found


def modes_of(found):
    """One pose of each mode that was found."""
    modes = []
    for pose in found.pose[found.residual < 1e-12]:
        if all(np.abs(pose.as_matrix() - mode.as_matrix()).max() > 1e-5 for mode in modes):
            modes.append(pose)
    return RigidTransform.concatenate(modes)


def test_the_modes_of_dietmaier_are_found_and_kept(forty, published):
    machine, _, found = forty
    data = published["dietmaier"]
    modes = modes_of(found)
    assert data["real_modes"] - 2 <= len(modes) <= data["real_modes"]  # 1000 starts find 38 to 40
    offset = np.abs(modes.translation - data["one_position"]).max(1)
    assert offset.min() < 1e-9  # as printed
    row = modes[int(offset.argmin())].rotation.as_matrix()[0]
    assert row == pytest.approx(data["one_rotation_row_1"], rel=0, abs=1e-6)  # printed to 1e-6
    kept = machine.forward(np.tile(data["lengths"], (len(modes), 1)), modes)
    assert kept.certified.all()
    assert apart(kept.pose, modes).max() < SAME


def test_no_other_mode_of_dietmaier_is_certified(forty):
    """Newton arrives in all of them; what is certified, and only some is, is where the legs lead
    from that start.
    """
    machine, near, found = forty
    solved = found.residual < 1e-12
    start, end, certified = near[solved], found.pose[solved], found.certified[solved]
    reached = followed(machine, start, lengths_along(machine, start, end))
    off = apart(reached, end)
    assert off[certified].max() < SAME
    assert certified.sum() > 300
    assert (
        off[~certified] > 0.01
    ).sum() > 30  # the legs do lead elsewhere where a singularity lies between


def test_modes_may_be_changed_on_a_proved_way(forty):
    """Two modes can be joined without a singularity: a certificate speaks of the way from `near`,
    not of the mode.
    """
    machine, _, found = forty
    modes = modes_of(found)
    pairs = (
        RigidTransform.concatenate([modes] * len(modes)),
        modes[np.repeat(np.arange(len(modes)), len(modes))],
    )
    near = (apart(*pairs) > SAME) & (apart(*pairs) < 1)
    start, end = (poses[near] for poses in pairs)
    proved = prove_regular(machine, start, end)
    assert proved.any()
    start, end = start[proved], end[proved]
    assert apart(followed(machine, start, lengths_along(machine, start, end)), end).max() < SAME
