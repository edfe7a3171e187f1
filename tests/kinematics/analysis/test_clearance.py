"""Clearance: exact distances of segments and discs, legs and plates, and the thesis' choice of its
joint gap.
"""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Disc, Hexapod, MotionError, joint_circle
from kinematics.analysis.clearance import Bodies, segment_disc_distance, segment_distance
from kinematics.machine.pose import to_numbers

EXACT = 1e-15
"""Share of the coordinates: some rounding of a square root."""
SEARCHED = 1e-7
"""What the search in these tests is good to: a distance near zero is the root of a square near
1e-16.
"""


def smallest(function):
    """Of a convex function on [0, 1], by thirds."""
    low, high = 0.0, 1.0
    for _ in range(90):
        a, b = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, b) if function(a) <= function(b) else (a, high)
    return min(map(function, (0.0, low, high, 1.0)))


def to_segment(point, start, end):
    along = end - start
    square = along @ along
    share = np.clip((point - start) @ along / square, 0, 1) if square else 0
    return np.linalg.norm(point - start - share * along)


def to_disc(point, disc):
    """By the nearest point of the cylinder."""
    offset = point - disc.centre
    height = offset @ disc.normal
    flat = offset - height * disc.normal
    radius = np.linalg.norm(flat)
    inside = flat * min(1.0, disc.radius / radius) if radius else flat
    return np.linalg.norm(
        offset - inside - np.clip(height, -disc.thickness / 2, disc.thickness / 2) * disc.normal
    )


def between(p0, p1, q0, q1):
    return smallest(lambda s: to_segment(p0 + s * (p1 - p0), q0, q1))


def from_disc(start, end, disc):
    return smallest(lambda s: to_disc(start + s * (end - start), disc))


# whole numbers of a small range: parallel, crossing, touching, collinear and zero-length segments
# come by themselves
few = arrays(float, (4, 3), elements=st.integers(-2, 2).map(float))
many = arrays(float, (4, 3), elements=st.floats(-2, 2, allow_subnormal=False))


@settings(max_examples=75, deadline=None)
@given(few | many)
def test_segments(ends):
    p0, p1, q0, q1 = ends
    found = float(segment_distance(p0, p1, q0, q1))
    assert found == pytest.approx(between(p0, p1, q0, q1), rel=0, abs=SEARCHED)
    assert float(segment_distance(q1, q0, p0, p1)) == pytest.approx(found, rel=0, abs=8 * EXACT)


@pytest.mark.parametrize(
    ("ends", "distance"),
    [
        (([-1, 0, 0], [1, 0, 0], [0, -1, 0.5], [0, 1, 0.5]), 0.5),  # crossing above each other
        (([-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0]), 0),  # crossing
        (([0, 0, 0], [1, 0, 0], [0.2, 3, 0], [0.7, 3, 0]), 3),  # parallel, side by side
        (
            ([0, 0, 0], [1, 0, 0], [4, 4, 0], [6, 4, 0]),
            5,
        ),  # parallel, one behind the other: 3, 4, 5
        (([0, 0, 0], [1, 0, 0], [3, 0, 0], [2, 0, 0]), 1),  # on one line
        (([0, 0, 0], [2, 0, 0], [1, 0, 0], [3, 0, 0]), 0),  # on one line, overlapping
        (([0, 0, 0], [0, 0, 0], [0, 3, 4], [0, 3, 4]), 5),  # two points
        (([0, 0, 0], [2, 0, 0], [1, 1, 0], [1, 1, 0]), 1),  # a point
        (
            ([-1, 0, 0], [1, 0, 0], [-1, -1e-9, 1], [1, 1e-9, 1]),
            1,
        ),  # nearly parallel, crossing above each other
        (([-1, 0, 0], [1, 0, 0], [-1, -1e-5, 0], [1, 1e-5, 0]), 0),  # nearly parallel, crossing
    ],
)
def test_segments_of_known_distance(ends, distance):
    assert float(segment_distance(*np.array(ends, float))) == pytest.approx(
        distance, rel=0, abs=2 * EXACT
    )


@settings(max_examples=50, deadline=None)
@given(few | many, st.sampled_from([0.0, 0.5, 2.0]), st.floats(0.1, 2))
def test_segments_and_discs(ends, thickness, radius):
    start, end, centre, normal = ends
    disc = Disc(radius, thickness, centre, normal if np.linalg.norm(normal) > 1e-3 else [0, 0, 1])
    assert float(segment_disc_distance(start, end, disc)) == pytest.approx(
        from_disc(start, end, disc), rel=0, abs=SEARCHED
    )


@pytest.mark.parametrize(
    ("ends", "distance"),
    [
        (([0, 0, 3], [0, 0, 5]), 2),  # above
        (([0, 0, -3], [0, 0, 5]), 0),  # through the middle
        (([3, 0, 0], [5, 0, 9]), 1),  # aside
        (([4, -5, 0], [4, 5, 0]), 2),  # past the rim
        (([5, 0, 5], [9, 0, 9]), 5),  # from the edge: 3, 4, 5
        (([-9, 0, 2], [9, 0, 2]), 1),  # over it, both ends beyond the rim
        (([0, 0, 0.5], [1, 0, 0.5]), 0),  # inside
        (([3, 0, 1], [2, 0, 2]), np.sqrt(0.5)),  # past the edge, at 45°
    ],
)
def test_discs_of_known_distance(ends, distance):
    disc = Disc(radius=2, thickness=2)
    assert float(segment_disc_distance(*np.array(ends, float), disc)) == pytest.approx(
        distance, rel=0, abs=4 * EXACT
    )


# legs and plates


def test_clearances_of_a_hexapod(preset, poses_about):
    """Every pair by the search, from joint centres that SciPy moves; tips of the legs end in the
    joints.
    """
    poses = poses_about(preset.home, preset, 6, 0.2)
    margins = preset.check(poses)
    bodies, ends = preset.bodies, preset.bodies.leg_radius
    for k, pose in enumerate(poses):
        joints = pose.apply(np.array(preset.platform))
        along = (joints - preset.base) / np.linalg.norm(joints - preset.base, axis=1)[:, None]
        low, high = preset.base + ends * along, joints - ends * along
        inwards = [pose.inv().apply(points) for points in (low, high)]
        for name, found in zip(margins.clearance_names, margins.clearance[k], strict=True):
            one, other = name.split("–")
            i = int(one[-1]) - 1
            if other.startswith("leg"):
                j = int(other[-1]) - 1
                apart = between(low[i], high[i], low[j], high[j]) - ends
            else:
                disc = bodies.base_disc if other == "base" else bodies.platform_disc
                a, b = (points[i] for points in ((low, high) if other == "base" else inwards))
                apart = from_disc(a, b, disc)
            assert found == pytest.approx(apart - ends, rel=0, abs=SEARCHED)
    assert len(margins.clearance_names) == 15 + 12


def test_at_home_the_clearance_is_that_of_the_drawing(preset):
    """Joints 6 mm off the plates; legs upright enough that their lower ends are nearest to the
    lower plate.
    """
    margins = preset.check(preset.home)
    clearance = dict(zip(margins.clearance_names, margins.clearance[0], strict=True))
    height = (0.2336362 - 0.0225) / preset.home_q[0]  # cosine of the legs' tilt
    assert clearance["leg1–base"] == pytest.approx(
        0.006 + 0.0304 * height - 0.0304, rel=0, abs=1e-15
    )
    assert clearance["leg1–platform"] == pytest.approx(clearance["leg1–base"], rel=0, abs=1e-15)


def test_no_translation_changes_a_distance_by_more_than_itself(any_hexapod, poses_about):
    """What proofs over whole cells of positions rely on."""
    random = np.random.default_rng(3)
    plates = Disc(0.1, 0.01, [0, 0, -0.02]), Disc(0.07, 0.01, [0, 0, 0.02], [0, 0.1, 1])
    legs = tuple(axis.name for axis in any_hexapod.axes)
    bodies = Bodies(any_hexapod.base, any_hexapod.platform, legs, 0.01, 0.03, *plates)
    poses = poses_about(any_hexapod.home, any_hexapod, 2000, 0.5)
    shift = random.normal(size=(2000, 3)) * 10.0 ** random.uniform(-6, -1, (2000, 1))
    before, after = (
        bodies.distances(to_numbers(p))
        for p in (poses, RigidTransform.from_translation(shift) * poses)
    )
    change = np.abs(after - before).max(1) / np.linalg.norm(shift, axis=1)
    assert change.max() < 1 + 1e-8  # rounding of 1e-15 in a step of 1e-6
    assert change.max() > 0.3


def test_the_worst_of_all_is_a_pair_of_legs(preset):
    """Legs as wide as the gap between their joints overlap; the margins name them and by how
    much.
    """
    thick = Hexapod(
        preset.base,
        preset.platform,
        axes=preset.axes,
        home=preset.home,
        leg_radius=0.045,
        leg_ends=0.0,
    )
    up = RigidTransform.from_translation([0, 0, 0.025]) * preset.home
    margins = thick.check(up)
    low, high = thick.base, up.apply(np.array(thick.platform))
    apart = between(low[1], high[1], low[2], high[2])
    assert not margins.ok.any()
    assert margins.worst() in {
        f"leg{pair} clearance: {1e3 * (apart - 0.09):.3g} mm"
        for pair in ("1–leg6", "2–leg3", "4–leg5")
    }
    assert margins.clearance.min() == pytest.approx(apart - 0.09, rel=0, abs=SEARCHED)
    assert preset.check(up).ok.all()


def test_without_a_radius_nothing_is_near(preset):
    bare = Hexapod(preset.base, preset.platform, axes=preset.axes, home=preset.home)
    assert bare.check(preset.home).clearance.shape == (1, 0)
    assert bare.check(preset.home).ok.all()


# conditioning


def test_conditioning_has_no_unit(preset, poses_about):
    """A machine twice as large, at poses twice as far: the same values."""
    poses = poses_about(preset.home, preset, 20, 0.3)
    double = Hexapod(
        2 * preset.base,
        2 * preset.platform,
        axes=[Axis(axis.name) for axis in preset.axes],
        home=RigidTransform.from_translation(2 * preset.home.translation),
    )
    larger = RigidTransform.from_components(2 * poses.translation, poses.rotation)
    before, after = preset.check(poses), double.check(larger)
    assert after.conditioning == pytest.approx(before.conditioning, rel=1e-12)
    assert after.singularity == pytest.approx(before.singularity, rel=1e-12)
    assert after.characteristic_length == 2 * before.characteristic_length


def test_turned_by_a_right_angle_a_regular_hexapod_is_singular(preset):
    """Fichter's singularity: platform above the base, turned by 90° about their common axis.

    [Fichter 1986]
    """
    turns = Rotation.from_rotvec(np.outer(np.deg2rad([0, 60, 89, 90, 91]), [0, 0, 1]))
    margins = preset.check(RigidTransform.from_components([0, 0, 0.25], turns))
    assert margins.singularity[3] < 1e-15
    assert margins.conditioning[3] < 1e-15
    assert (np.delete(margins.singularity, 3) > 1e-3).all()
    assert (np.diff(margins.singularity[:4]) < 0).all()


def test_a_leg_of_no_length_is_singular_and_turned_over(preset):
    """It has no direction: no rates, no tilt.

    One such pose leaves the others of its batch alone.
    """
    machine = Hexapod(
        preset.base, preset.platform, axes=preset.axes, home=preset.home, max_tilt=1.0
    )
    poses = RigidTransform.concatenate(
        [preset.home, RigidTransform.from_translation(preset.base[2] - preset.platform[2])]
    )
    margins = machine.check(poses)
    assert machine.inverse(poses[1])[2] == 0
    assert margins.conditioning[1] == margins.singularity[1] == 0
    assert margins.conditioning[0] == machine.check(preset.home).conditioning[0] > 0
    assert margins.tilt[1, [2, 8]] == pytest.approx(np.pi)
    assert margins.ok.tolist() == [True, False]
    with pytest.raises(
        MotionError, match=r"machine hexapod is singular at pose 1, position .* no finite rates"
    ):
        machine.jacobian(poses)


def test_a_joint_without_a_limit_is_never_the_worst(preset):
    """Turned far over, beyond any tilt that a limit would allow."""
    machine = Hexapod(
        preset.base,
        preset.platform,
        axes=preset.axes,
        home=preset.home,
        max_tilt=(None, np.deg2rad(120)),
    )
    turned = RigidTransform.from_components(
        preset.home.translation, Rotation.from_rotvec([0, 1.2, 0])
    )
    margins = machine.check(turned)
    free = Hexapod(
        preset.base, preset.platform, axes=[Axis(f"leg{n}") for n in range(6)], home=preset.home
    )
    assert "base joint" not in margins.worst()
    assert free.check(turned).use == 0
    assert free.check(turned).ok.all()


def test_the_nearest_singular_jacobian_is_as_far_as_told(preset, poses_about):
    """By the characteristic polynomial instead of singular values: det(J Jᵀ − σ² 1) = 0 for no
    smaller σ.
    """
    pose = poses_about(preset.home, preset, 1, 0.3)
    jacobian = preset.jacobian(pose)[0] * np.repeat([1.0, 1 / preset.characteristic_length], 3)
    squares = np.linalg.eigvalsh(jacobian @ jacobian.T)
    margins = preset.check(pose)
    assert margins.singularity[0] == pytest.approx(np.sqrt(squares[0]), rel=1e-10)
    assert margins.conditioning[0] == pytest.approx(np.sqrt(squares[0] / squares[-1]), rel=1e-10)


# the thesis


@pytest.mark.parametrize(("gap", "expected"), [(20, -10.13), (30, 12.60)])
def test_clearance_decided_the_gap(preset, gap, expected):
    """With joint gaps of 20° legs overlap at the ends of travel, with 30° they do not.

    [Sahbaz 2007, chapter 4] observed its parts there, and prints no dimension of a leg. The radius
    is an assumption: that of a bar around the actuator's body, 43 mm square in its data sheet. The
    limit of tilt is that of the thesis' program.
    """
    machine = Hexapod(
        joint_circle(0.149, np.deg2rad(gap), 0.0115),
        preset.platform,
        axes=preset.axes,
        home=preset.home,
        max_tilt=np.deg2rad(35),
        leg_radius=0.0304,
        leg_ends=0.0,
    )
    ends = machine.home_q + list(product(*(axis.travel for axis in machine.axes)))
    reached = machine.forward(ends)
    margins = machine.check(reached.pose[reached.certified])
    clearance = margins.clearance[(margins.tilt <= 1).all(1)]
    assert 1e3 * clearance.min() == pytest.approx(expected, abs=5e-3)


# what it refuses


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"leg_radius": 0.0}, "leg_radius .* in m above 0, not 0.0"),
        ({"leg_radius": np.nan}, "leg_radius .* not nan"),
        ({"leg_radius": 0.01, "leg_ends": -0.001}, "leg_ends .* not below 0, not -0.001"),
        ({"base_disc": Disc(0.1, 0.01)}, "leg_radius; state it"),
        ({"leg_ends": 0.01}, "leg_radius; state it"),
    ],
)
def test_bodies_that_are_none_are_refused(preset, changes, told):
    with pytest.raises(MotionError, match=told):
        Hexapod(preset.base, preset.platform, axes=preset.axes, home=preset.home, **changes)


@pytest.mark.parametrize(
    "values",
    [
        (0, 0.01),
        (0.1, -0.01),
        (np.inf, 0),
        (0.1, 0, [0, 0]),
        (0.1, 0, [0, 0, 0], [0, 0, 0]),
        (0.1, np.nan),
    ],
)
def test_discs_that_are_none_are_refused(values):
    with pytest.raises(MotionError, match="disc"):
        Disc(*values)


def test_a_file_states_what_takes_up_room(document, preset):
    from importlib.resources import files

    from kinematics.files.schema import build
    from kinematics.kinds.hexapod import HexapodFile

    text = (files("kinematics") / "presets/hexapod.toml").read_text()
    plate = '{ radius = "17.4 cm", thickness = "11 mm", centre = ["0 mm", "1 mm", "0 mm"], normal = [0, 0, 2] }'
    changed = text.replace('{ radius = "174 mm", thickness = "11 mm" }', plate)
    disc = build(document(changed), HexapodFile).geometry.base_disc.disc
    assert (disc.radius, disc.thickness, tuple(disc.centre), tuple(disc.normal)) == (
        0.174,
        0.011,
        (0, 0.001, 0),
        (0, 0, 1),
    )
    with pytest.raises(MotionError, match=r"leg_radius.*greater than 0|leg_radius.*above 0"):
        build(document(text.replace('"30.4 mm"', '"0 mm"')), HexapodFile)
