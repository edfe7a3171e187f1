"""One pose with all that belongs to it: against the thesis' angles, the maps, plain geometry, and
back again.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError, OutOfReach, load_machine, posture_of_axes, posture_of_pose
from kinematics.machine.motion import describe_singularity


def at(machine, position, angles=(0.0, 0.0, 0.0)):
    """Relative to home: mm, degrees."""
    turned = Rotation.from_euler("XYZ", angles, degrees=True)
    return machine.home * RigidTransform.from_components(np.asarray(position) * 1e-3, turned)


def test_the_platforms_directions_are_the_thesis_own(preset):
    """[Sahbaz 2007, Table 6.4] prints 97, 95.955 and 9.20972° for θ = (6, −7, 0)°; the last is
    9.2098°.
    """
    found = posture_of_pose(preset, at(preset, [0, 0, 25], [6, -7, 0]))
    assert np.degrees(found.directions) == pytest.approx([97, 95.955, 9.2098], abs=5e-4)
    assert np.degrees(posture_of_pose(preset, preset.home).directions).tolist() == [90, 90, 0]


def test_lengths_and_tilts_of_a_hexapod_are_those_of_plain_geometry(preset):
    """Six lengths, twelve tilts: the leg against z below, and against the platform's z, in its
    frame, above.
    """
    pose = at(preset, [5, 5, 35], [3, -4, 2])
    found = posture_of_pose(preset, pose)
    legs = pose.apply(np.asarray(preset.platform)) - np.asarray(preset.base)
    lengths = np.linalg.norm(legs, axis=1)
    above = pose.rotation.inv().apply(legs)
    tilts = np.degrees(np.arccos(np.concatenate([legs[:, 2], above[:, 2]]) / np.tile(lengths, 2)))
    assert found.q == pytest.approx(lengths, abs=1e-15)
    assert np.degrees(found.tilt) == pytest.approx(tilts, abs=1e-9)
    assert found.counts.tolist() == np.rint((lengths - preset.home_q) / 0.75e-6).tolist()
    assert found.from_home.as_matrix() == pytest.approx(
        (preset.home.inv() * pose).as_matrix(), abs=1e-15
    )
    assert found.certified
    assert found.violations == ()


def test_the_axes_lead_back_to_the_pose(machine, poses_about):
    """Every kind: forward of inverse is the pose, with what follows filled in."""
    for pose in poses_about(machine.home, machine, 3, 0.1):
        there = posture_of_pose(machine, pose)
        back = posture_of_axes(machine, there.q)
        assert back.pose.as_matrix() == pytest.approx(there.pose.as_matrix(), abs=1e-9)
        assert back.certified == there.certified
        assert max(back.residual, there.residual) < 1e-9
        assert len(str(there)) > 300


def test_what_is_broken_is_named_with_its_value(preset):
    found = posture_of_pose(preset, at(preset, [0, 0, 60], [0, 0, 0]))
    assert len(found.violations) == 6
    stroke = 1e3 * (preset.inverse(found.pose) - preset.home_q)[0]
    told = f"leg1 travel: {stroke:.6g} mm from home, outside 0 to 50.8 mm; choose a pose"
    assert found.violations[0].startswith(told)
    assert not found.margins.ok.any()
    turned = posture_of_pose(preset, at(preset, [0, 0, 5], [0, 0, 60]))
    assert any(
        " platform joint tilt: " in told and "more than 35°" in told for told in turned.violations
    )
    tipped = posture_of_pose(preset, at(preset, [0, 0, 0], [0, -45, 0]))
    gap = float(tipped.margins.clearance.min())
    assert any(
        f"clearance: they overlap by {-1e3 * gap:.4g} mm" in told for told in tipped.violations
    )


def test_another_assembly_is_not_certified(preset):
    """The same lengths with the platform below its legs' mirror image: a pose, but not where the
    machine comes to.
    """
    q = preset.home_q
    below = RigidTransform.from_components(-preset.home.translation, preset.home.rotation)
    found = posture_of_axes(preset, q, near=below)
    assert found.pose.translation[2] < 0 < preset.home.translation[2]
    assert found.residual < 1e-9
    assert not found.certified
    assert posture_of_axes(preset, q).certified


def test_a_pose_that_home_does_not_lead_to_has_its_lengths_all_the_same(preset):
    found = posture_of_pose(preset, at(preset, [0, 0, 25], [180, 0, 0]))
    assert not found.certified
    assert len(found.violations) > 6


def test_what_is_no_posture_is_refused(preset):
    with pytest.raises(MotionError, match="a posture is of one pose, not of 2"):
        posture_of_pose(preset, RigidTransform.concatenate([preset.home, preset.home]))
    with pytest.raises(MotionError, match="one row of coordinates"):
        posture_of_axes(preset, np.zeros((2, 6)))
    with pytest.raises(OutOfReach, match="no pose was found that has the lengths"):
        posture_of_axes(load_machine("tripod"), [0.1, 0.1, 0.1])


@pytest.mark.parametrize("elbow", [0.0, 1e-9])
def test_a_stretched_arm_is_said_to_be_one(elbow):
    """Its tool cannot move outward, whatever the axes do; nothing is free that they do not hold."""
    found = posture_of_axes(load_machine("arm"), [0.0, np.radians(30), np.radians(elbow)])
    assert not found.certified
    assert "no motion of the axes moves the tool in some direction" in found.doubt
    assert "check" not in found.doubt  # which refuses it as well


def test_legs_that_all_meet_one_line_do_not_hold_the_turn_about_it(preset):
    """Six legs whose lines all meet the z axis, each at a place of its own [Fichter 1986]."""
    angles = np.radians(60 * np.arange(6))
    around = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1)
    height = 0.2 + 0.03 * np.arange(6)
    jacobian = np.stack(
        [scaled_row(0.2 * a, 0.1 * a + [0, 0, h]) for a, h in zip(around, height, strict=True)]
    )
    assert np.abs(jacobian @ [0, 0, 0, 0, 0, 1]).max() < 1e-15  # a turn about z moves no leg
    assert "do not constrain the platform" in describe_singularity(preset, jacobian)


def scaled_row(base, joint):
    """Of ∂length/∂(v, ω), turns at 0.1 m."""
    along = (joint - base) / np.linalg.norm(joint - base)
    return np.concatenate([along, np.cross(joint, along) / 0.1])
