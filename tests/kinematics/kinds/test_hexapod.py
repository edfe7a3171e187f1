"""The hexapod: published numbers, independent geometry, invariances, margins, and what it
refuses.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Hexapod, MotionError, OutOfReach, joint_circle
from kinematics.kinds.load_keys import HomeTable
from kinematics.machine.pose import make_pose

LEGS = tuple(f"leg{n}" for n in range(1, 7))
HEIGHT = 0.2336362 - 0.0115 - 0.011
"""m between the joint planes of the preset at home."""


def leg_vectors(machine, pose):
    """(N, 6, 3) from base joint to platform joint, in the base frame."""
    moved = np.stack([np.atleast_2d(pose.apply(joint)) for joint in machine.platform], 1)
    return moved - machine.base


def angle_between(a, b):
    """By the sine and the cosine: good for every angle."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1))


def tilts(machine, pose):
    """(N, 12) rad: base joints, then platform joints, each leg seen from its own joint's frame."""
    legs = leg_vectors(machine, pose)
    seen = np.stack([np.atleast_2d(pose.rotation.inv().apply(legs[:, k])) for k in range(6)], 1)
    return np.concatenate(
        [angle_between(legs, machine.base_rest), angle_between(seen, machine.platform_rest)], 1
    )


def from_home(machine, shift, turn=(0.0, 0.0, 0.0)):
    """Poses shifted (m) and turned (rotation vector, rad) from a home that is not turned."""
    return RigidTransform.from_components(
        np.add(machine.home.translation, shift), Rotation.from_rotvec(turn)
    )


def above_home(machine, *heights):
    return from_home(machine, np.outer(heights, [0, 0, 1]), np.zeros((len(heights), 3)))


def with_limits(machine, **changes):
    """The preset's geometry with other limits."""
    arguments = {"axes": [Axis(leg) for leg in LEGS], "home": machine.home} | changes
    return Hexapod(machine.base, machine.platform, **arguments)


# published numbers


def test_leg_directions_of_table_4_3():
    base, platform = (
        joint_circle(0.149, np.deg2rad(30), 0.0),
        joint_circle(0.149, np.deg2rad(60), -0.0105),
    )
    home = RigidTransform.from_translation([0, 0, 0.4])
    machine = Hexapod(base, platform, axes=[Axis(leg) for leg in LEGS], home=home)
    # the three rows of a pure translation in the Jacobian are the legs' directions
    x, y, z = machine.jacobian(machine.home)[:, :3].T
    found = np.rad2deg([np.arctan2(-y, z), np.arcsin(x)])
    printed = [
        [-5.27128754, -0.746796351, 4.52990963, -4.52990963, 0.746796351, 5.27128754],
        [-2.17930829, 5.65389711, -3.46806031, -3.46806031, 5.65389711, -2.17930829],
    ]
    # printed to 1e-8, but rounded on the way: this formula in any precision differs by 1.02e-7 at
    # most
    assert found == pytest.approx(np.array(printed), rel=0, abs=1.05e-7)


def test_direction_angles_of_the_platform_axis():
    """Files turn about the moving axes in turn: θ = (6, −7, 0)° [Sahbaz 2007, Table 6.4]."""
    home = HomeTable(to=("0 mm",) * 3, rotate=("6 deg", "-7 deg", "0 deg"))
    axis = make_pose(home.to, home.rotate).rotation.apply([0, 0, 1])
    alpha, beta, gamma = np.rad2deg(np.arccos(axis))
    assert alpha == pytest.approx(97, rel=1e-14)  # cos α = sin θy
    # half of the last digit; Table 6.4 prints γ as 9.20972, which is off by 9e-5
    assert beta == pytest.approx(95.955, rel=0, abs=5e-4)
    assert gamma == pytest.approx(9.2098, rel=0, abs=5e-5)


def test_home_of_the_preset(preset):
    """Every leg spans 15° of azimuth between circles of 149 and 100 mm: law of cosines, and
    219.0774 mm.
    """
    across = 0.149**2 + 0.1**2 - 2 * 0.149 * 0.1 * np.cos(np.deg2rad(15))
    assert preset.home_q == pytest.approx(np.sqrt(across + HEIGHT**2), rel=1e-15)
    assert preset.home_q == pytest.approx(0.2190774, rel=0, abs=5e-8)  # seven decimals printed
    assert [axis.name for axis in preset.axes] == list(LEGS)
    assert {axis.travel for axis in preset.axes} == {(0.0, 0.0508)}


def test_length_changes_of_the_rubin_observatory(published):
    """Turned about a pivot on the axis: the platform's origin moves along."""
    data = published["rubin_simulink"]
    base, platform = (1e-6 * np.array(data[end]) for end in ("base", "platform"))
    machine = Hexapod(
        base, platform, axes=[Axis(leg) for leg in LEGS], home=RigidTransform.identity()
    )
    shift, pivot = np.array(data["pose"][:3]), np.array(data["pivot_m"])
    turn = Rotation.from_euler("XYZ", data["pose"][3:])
    pose = RigidTransform.from_components(shift + pivot - turn.apply(pivot), turn)
    change = machine.inverse(pose) - machine.home_q
    assert change == pytest.approx(
        data["length_change_m"], rel=0, abs=5e-6
    )  # half of the last digit


def test_home_lengths_of_mini_tetra(published):
    data = published["mini_tetra"]
    home = RigidTransform.from_translation(data["home"])
    machine = Hexapod(data["base"], data["platform"], axes=[Axis(leg) for leg in LEGS], home=home)
    assert machine.home_q == pytest.approx(
        data["home_lengths"], rel=0, abs=5e-6
    )  # half of the last digit


# independent geometry


def test_lengths_are_distances_between_the_joints(any_hexapod, poses_about):
    poses = poses_about(any_hexapod.home, any_hexapod, 50, 0.5)
    lengths = np.linalg.norm(leg_vectors(any_hexapod, poses), axis=2)
    assert any_hexapod.inverse(poses) == pytest.approx(lengths, rel=1e-14)


def test_tilts_are_angles_between_leg_and_rest_axis(any_hexapod, poses_about):
    poses = poses_about(any_hexapod.home, any_hexapod, 50, 0.4)
    angles = tilts(any_hexapod, poses)
    assert np.ptp(angles) > 0.1  # a sample worth its name
    # 1e-15 in a cosine is 4e-8 rad next to the rest axis, and 1e-13 from 0.01 rad on
    tolerance = np.where(angles > 0.01, 1e-12, 1e-7)
    margins = any_hexapod.check(poses)
    assert (np.abs(margins.tilt * any_hexapod.max_tilt - angles) < tolerance).all()
    assert margins.tilt_names == tuple(
        f"{leg} {end} joint" for end in ("base", "platform") for leg in LEGS
    )


def test_moving_both_frames_changes_nothing(any_hexapod, poses_about):
    """The same machine described in other frames: lengths, tilts and margins stay."""
    random = np.random.default_rng(7)
    poses = poses_about(any_hexapod.home, any_hexapod, 20, 0.3)
    size = any_hexapod.characteristic_length
    below, above = (
        RigidTransform.from_components(size * random.uniform(-1, 1, 3), Rotation.random(rng=random))
        for _ in range(2)
    )
    moved = Hexapod(
        below.apply(np.array(any_hexapod.base)),  # SciPy takes no read-only arrays
        above.apply(np.array(any_hexapod.platform)),
        axes=any_hexapod.axes,
        home=below * any_hexapod.home * above.inv(),
        base_rest=below.rotation.apply(np.array(any_hexapod.base_rest)),
        platform_rest=above.rotation.apply(np.array(any_hexapod.platform_rest)),
        max_tilt=(any_hexapod.max_tilt[0], any_hexapod.max_tilt[6]),
    )
    elsewhere = below * poses * above.inv()
    assert moved.inverse(elsewhere) == pytest.approx(any_hexapod.inverse(poses), rel=1e-14)
    before, after = any_hexapod.check(poses), moved.check(elsewhere)
    assert after.travel == pytest.approx(before.travel, rel=0, abs=1e-12)
    assert np.cos(after.tilt * moved.max_tilt) == pytest.approx(
        np.cos(before.tilt * any_hexapod.max_tilt), abs=1e-14
    )


# margins


def test_travel_is_measured_from_the_middle(preset):
    """Straight up, all legs grow alike, by a known amount: from the one end of the travel to the
    other.
    """
    across = preset.home_q[0] ** 2 - HEIGHT**2

    def height_for(stroke):
        return np.sqrt((preset.home_q[0] + stroke) ** 2 - across) - HEIGHT

    um = 1e-6
    strokes = np.array([0, 0.0254, 0.0508, 0.0381, -um, 0.0508 + um])
    margins = preset.check(above_home(preset, *map(height_for, strokes)))
    # rounding of decimetres in a stroke of 25 mm
    assert margins.travel == pytest.approx(
        np.abs(strokes / 0.0254 - 1)[:, None] * np.ones(6), rel=0, abs=1e-13
    )
    assert margins.ok.tolist() == [True, True, True, True, False, False]
    home = preset.check(preset.home)
    assert home.ok.tolist() == [True]
    assert (home.travel == 1).all()
    assert home.travel_names == LEGS


def test_the_worst_violation_is_named(preset):
    """Turned by 18° in twelve directions, each leg suffers most once: which and how much by
    independent geometry.
    """
    seen = set()
    for azimuth in np.deg2rad(6 + 30 * np.arange(12)):
        pose = from_home(
            preset, [0, 0, 0.025], np.deg2rad(18) * np.array([np.cos(azimuth), np.sin(azimuth), 0])
        )
        stroke = np.linalg.norm(leg_vectors(preset, pose)[0], axis=1) - preset.home_q
        use = np.abs(stroke - 0.0254) / 0.0254
        worst = int(np.argmax(use))
        assert use[worst] > max(1, tilts(preset, pose).max() / np.deg2rad(35))
        margins = preset.check(pose)
        assert not margins.ok.any()
        assert margins.worst() == f"leg{worst + 1} travel: {use[worst]:.1%} of its limit"
        seen.add(worst)
    assert seen == set(range(6))


def test_the_worst_of_several_poses_is_told_by_its_number(preset):
    """Sideways, the joints are the first to give in."""
    machine = with_limits(preset, axes=preset.axes, max_tilt=np.deg2rad(20))
    poses = from_home(machine, [[0, 0, 0.02], [0.05, 0.002, 0.02], [0, 0, 0.03]], np.zeros((3, 3)))
    angles = tilts(machine, poses)
    margins = machine.check(poses)
    assert margins.ok.tolist() == [True, False, True]
    joint = margins.tilt_names[int(np.argmax(angles[1]))]
    assert (
        margins.worst()
        == f"{joint} tilt: {angles[1].max() / np.deg2rad(20):.1%} of its limit at pose 1"
    )


@pytest.mark.parametrize("end", ["base", "platform"])
def test_tilt_limits_hold_at_their_own_end(preset, end):
    """Limits a hair above and below the largest angle at one end, none at the other."""
    pose = from_home(preset, [0.01, 0.005, 0.02], [0.06, -0.05, 0.1])
    mine = slice(0, 6) if end == "base" else slice(6, 12)
    angle = tilts(preset, pose)[0, mine].max()
    for factor, allowed in ((1 + 1e-7, True), (1 - 1e-7, False)):
        limit = (factor * angle, None) if end == "base" else (None, factor * angle)
        margins = with_limits(preset, max_tilt=limit).check(pose)
        assert margins.ok.tolist() == [allowed]
        assert f"{end} joint tilt: 100.0%" in margins.worst()


def test_travel_without_ends_is_never_used_up(preset):
    assert not with_limits(preset).check(above_home(preset, -0.1, 0, 1000)).travel.any()


# what it refuses, and what it keeps


def first_key(value):
    return next(iter(value)) if isinstance(value, dict) else ""


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"base": np.zeros((5, 3))}, r"mine: base .*\(6, 3\).*\(5, 3\)"),
        ({"base": np.zeros((6, 2))}, r"mine: base .*\(6, 2\)"),
        ({"platform": np.full((6, 3), np.nan)}, "mine: platform .*finite"),
        ({"platform": np.full((6, 3), np.inf)}, "mine: platform .*finite"),
        ({"axes": [Axis("leg1")]}, "mine: 1 axis.*6"),
        ({"axes": [Axis("leg1")] * 6}, "mine: .*same name"),
        ({"base_rest": [0, 0, 0]}, "mine: base_rest .*not zero"),
        ({"platform_rest": [0, 0, np.nan]}, "mine: platform_rest .*finite"),
        ({"base_rest": np.ones((5, 3))}, r"mine: base_rest .*\(3,\) or \(6, 3\)"),
        ({"base_rest": [0, 0, 0, 1]}, "mine: base_rest"),
        ({"base_rest": 1.0}, "mine: base_rest"),
        ({"max_tilt": 0.0}, "mine: max_tilt"),
        ({"max_tilt": -0.5}, "mine: max_tilt"),
        ({"max_tilt": np.nan}, "mine: max_tilt"),
        ({"max_tilt": (0.5,)}, "mine: max_tilt"),
        ({"max_tilt": (0.5, 0.5, 0.5)}, "mine: max_tilt"),
        ({"home": RigidTransform.from_translation(np.zeros((2, 3)))}, "mine: home"),
        ({"home": RigidTransform.from_translation([0, 0, np.nan])}, "mine"),
    ],
    ids=first_key,
)
def test_what_no_hexapod_is_made_of_is_refused(preset, changes, told):
    arguments = {"base": preset.base, "platform": preset.platform, "home": preset.home}
    arguments |= {"axes": [Axis(leg) for leg in LEGS], "name": "mine"} | changes
    with pytest.raises(MotionError, match=told):
        Hexapod(arguments.pop("base"), arguments.pop("platform"), **arguments)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"travel": (1.0, 1.0)}, "leg1: travel 1.0 .. 1.0 .*smaller"),
        ({"travel": (0.0, np.nan)}, "leg1: travel"),
        # |q − middle| / half range has no meaning with one end: better no such travel than one that nothing checks
        ({"travel": (0.0, np.inf)}, "leg1: travel 0.0 .. inf m has one end only; give both"),
        ({"travel": (-np.inf, 0.0)}, "leg1: travel -inf .. 0.0 m has one end only"),
        ({"kind": "rotary", "travel": (-np.inf, 0.0)}, "leg1: travel -inf .. 0.0 rad has one end"),
        ({"direction": 0}, "leg1: direction 0"),
        ({"pulse": 0.0}, "leg1: pulse must be .* above 0, not 0.0"),
        ({"pulse": -1e-6}, "leg1: pulse"),
        ({"pulse": np.inf}, "leg1: pulse"),
        ({"max_speed": 0.0}, "leg1: max_speed .*None: unlimited.* above 0, not 0.0"),
        ({"max_speed": np.inf}, "leg1: max_speed .* not inf"),
        ({"max_acceleration": -1.0}, "leg1: max_acceleration"),
        ({"max_jerk": np.nan}, "leg1: max_jerk"),
        ({"max_force": 0.0}, "leg1: max_force"),
        ({"max_pulse_rate": -1.0}, "leg1: max_pulse_rate"),
    ],
    ids=first_key,
)
def test_what_no_axis_can_be_is_refused(values, told):
    with pytest.raises(MotionError, match=told):
        Axis("leg1", **values)


def test_a_pose_that_is_nowhere_is_out_of_reach(preset):
    poses = RigidTransform.from_translation([[0, 0, 0.25], [0, np.nan, 0.25]])
    with pytest.raises(OutOfReach, match=r"machine hexapod: .*pose 1"):
        preset.inverse(poses)


def test_a_machine_cannot_be_changed_from_outside(preset):
    base = np.array(preset.base)
    machine = Hexapod(base, preset.platform, axes=preset.axes, home=preset.home)
    base += 1
    assert np.array_equal(machine.inverse(machine.home), preset.home_q)
    for array in (
        machine.base,
        machine.platform,
        machine.home_q,
        machine.base_rest,
        machine.max_tilt,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
