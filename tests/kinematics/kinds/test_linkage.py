"""The linkage against its source's own formulas, its closed-form realised position, and plane
geometry.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Linkage, MotionError, OutOfReach, load_machine, machine_toml
from tests.pace import LONG

AXES = [Axis("a"), Axis("b")]


@pytest.fixture(scope="module")
def preset():
    return load_machine("linkage")


def poses(count=500, seed=0):
    rng = np.random.default_rng(seed)
    return RigidTransform.from_translation(
        np.column_stack(
            [rng.uniform(0.05, 0.35, count), rng.uniform(0.35, 0.55, count), np.zeros(count)]
        )
    )


def test_the_source_s_inverse(preset):
    """[Motion 2-D]: la', θ_la', γ, θ by sines, and lb by the theorem of Pythagoras."""
    x, y, _ = poses().translation.T
    h, angle, q = preset.offset, preset.angle, preset.base_b[0]
    way, tip = np.hypot(x, y), np.arcsin(h * np.sin(angle) / np.hypot(x, y))
    theta = np.arctan2(y, x) - tip
    a = way * np.sin(np.pi - angle - tip) / np.sin(angle)
    b = np.sqrt((q - a * np.cos(theta)) ** 2 + (a * np.sin(theta)) ** 2)
    assert np.abs(preset.inverse(poses()) - np.stack([a, b], 1)).max() < 1e-15


def test_the_closed_form_and_the_forward_solver_agree_with_the_inverse(preset):
    q = preset.inverse(poses())
    found = preset.forward(q)
    assert found.certified.all()
    assert np.abs(preset.realised(q) - poses().translation[:, :2]).max() < 1e-14
    assert np.abs(found.pose.translation - poses().translation).max() < 1e-12


def test_the_frame_turns_with_actuator_a(preset):
    """Law of cosines for θ, from the lengths alone; at home the frame is parallel to the base's."""
    q = preset.inverse(poses())
    base = preset.base_b[0]
    a, b = np.concatenate([q, preset.home_q[None]]).T
    *theta, at_home = np.arccos((a**2 + base**2 - b**2) / (2 * base * a))
    theta = np.array(theta) - at_home
    turned = preset.forward(q).pose.rotation.as_matrix()
    assert np.abs(turned - Rotation.from_euler("Z", theta[:, None]).as_matrix()).max() < 1e-11


@settings(max_examples=100 if LONG else 25)
@given(
    st.floats(0, 0.3),
    st.floats(-np.pi, np.pi),
    st.floats(0.2, 0.6),
    st.floats(0, 2 * np.pi),
    st.floats(-3, 3),
)
def test_distances_are_those_of_the_drawn_joint(offset, angle, length, theta, turn):
    """Draw the joint and the point from (q_a, θ); the inverse gives the distances back, wherever
    the base lies.
    """
    base_a, base_b = (
        np.array([0.1, -0.2]),
        np.array([0.1, -0.2]) + 0.4 * np.array([np.cos(turn), np.sin(turn)]),
    )
    if abs(length - offset * np.cos(angle)) < 0.01:  # between the branches
        return
    joint = base_a + length * np.array([np.cos(theta), np.sin(theta)])
    point = joint - offset * np.array([np.cos(theta - angle), np.sin(theta - angle)])
    home = RigidTransform.from_translation([*point, 0.0])
    near = [length, 0.0]
    machine = Linkage(base_a, base_b, offset, angle, axes=AXES, home=home, near=near)
    assert machine.home_q == pytest.approx([length, np.hypot(*(joint - base_b))], abs=1e-12)
    across = (base_b - base_a)[0] * (joint - base_a)[1] - (base_b - base_a)[1] * (joint - base_a)[0]
    if abs(across) > 1e-3:
        assert machine.realised(machine.home_q) == pytest.approx(point, abs=1e-9)
        assert machine.realised(machine.home_q[None], int(np.sign(across)))[0] == pytest.approx(
            point, abs=1e-9
        )
        found = machine.forward(machine.home_q)
        assert found.certified
        assert found.pose.translation[:2] == pytest.approx(point, abs=1e-9)


@pytest.mark.parametrize(
    ("to", "turn", "name"),
    [([0.2, 0.45, 1e-3], [0, 0, 0], "z"), ([0.2, 0.45, 0], [0.01, 0, 0], "rx")],
)
def test_a_pose_off_its_plane_is_refused_by_component(preset, to, turn, name):
    pose = RigidTransform.from_components(to, Rotation.from_rotvec(turn))
    with pytest.raises(OutOfReach, match=f"holds {name}: pose 0 has {name}"):
        preset.inverse(pose)


def test_the_orientation_that_follows_is_ignored(preset):
    plain, turned = (
        RigidTransform.from_components([0.2, 0.45, 0], Rotation.from_euler("Z", angle))
        for angle in (0, 1)
    )
    assert (preset.inverse(plain) == preset.inverse(turned)).all()


def test_lengths_that_close_no_triangle_are_refused(preset):
    with pytest.raises(OutOfReach, match=r"do not close a triangle.*400 mm"):
        preset.realised([0.1, 0.1])


@pytest.mark.parametrize(
    ("values", "phrase"),
    [
        ({"base_b": [0, 0]}, "the same point"),
        ({"base_a": [0, 0, 0]}, "base_a"),
        ({"base_b": [np.nan, 0]}, "base_b"),
        ({"offset": -0.1}, "offset"),
        ({"angle": np.inf}, "angle"),
        ({"axes": AXES[:1]}, "1 axis; a linkage has 2"),
    ],
)
def test_what_is_no_linkage_is_refused(values, phrase):
    given = {
        "base_a": [0, 0],
        "base_b": [0.4, 0],
        "offset": 0.12,
        "angle": 2.6,
        "axes": AXES,
    } | values
    with pytest.raises(MotionError, match=phrase):
        Linkage(**given, home=RigidTransform.from_translation([0.15, 0.45, 0]))


def test_both_branches_of_an_acute_offset(tmp_path):
    """P is 0.14 m from a, h = 0.3 m at 20 deg: q_a = h cos ± √(|P|² − h² sin²), both lengths
    real.
    """
    across, along = 0.3 * np.sin(np.deg2rad(20)), 0.3 * np.cos(np.deg2rad(20))
    home = RigidTransform.from_translation([0.0, 0.14, 0.0])
    both = along + np.array([1, -1]) * np.sqrt(0.14**2 - across**2)
    for length in both:
        machine = Linkage(
            [0, 0], [0.4, 0], 0.3, np.deg2rad(20), axes=AXES, home=home, near=[length, 0.3]
        )
        assert machine.home_q[0] == pytest.approx(length, abs=1e-15)
        path = tmp_path / "linkage.toml"
        bounded = [Axis(axis.name, travel=(-0.01, 0.01), pulse=1e-5) for axis in AXES]
        machine = Linkage(
            [0, 0], [0.4, 0], 0.3, np.deg2rad(20), axes=bounded, home=home, near=[length, 0.3]
        )
        path.write_text(machine_toml(machine))
        assert load_machine(path).home_q == pytest.approx(machine.home_q, abs=1e-15)
        assert machine.inverse(home, near=both[[0, 0]])[0] == pytest.approx(both[0], abs=1e-15)


def test_no_length_is_below_zero():
    """θ_h = 180 deg: P lies on the actuator, h beyond J as seen from a; nearer to a than h, no J is
    left.
    """
    machine = Linkage(
        [0, 0], [0.4, 0], 0.1, np.pi, axes=AXES, home=RigidTransform.from_translation([0.2, 0.4, 0])
    )
    with pytest.raises(OutOfReach):
        machine.inverse(RigidTransform.from_translation([0.03, 0.0, 0.0]))
    with pytest.raises(
        MotionError, match=r"axis a measures .* no actuator is shorter than nothing"
    ):
        Linkage(
            [0, 0],
            [0.4, 0],
            0.1,
            np.pi,
            axes=[Axis("a", travel=(-0.5, 0.1)), Axis("b")],
            home=RigidTransform.from_translation([0.2, 0.4, 0]),
        )


@pytest.mark.parametrize("q", [[0.1], [[0.1, 0.2, 0.3]], [-0.1, 0.4], [np.nan, 0.4], [0.0, 0.4]])
def test_realised_takes_lengths(preset, q):
    with pytest.raises(MotionError, match=r"lengths must be finite numbers .* above 0"):
        preset.realised(q)
    with pytest.raises(MotionError, match="side 0"):
        preset.realised(preset.home_q, 0)
