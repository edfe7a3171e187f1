"""Skeletons: the same geometry as the inverse map, found again by hand from the drawn points."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Machine, load_machine
from kinematics.machine.kind import Skeleton, ring
from kinematics.machine.model import place_skeleton
from kinematics.machine.pose import to_numbers

NEAR = 1e-12
"""m: rounding of coordinates below a few metres."""


def sorts(machine, sort):
    return [k for k, bar in enumerate(machine.parts.bars) if bar.sort == sort]


def around(machine, count=20):
    """Poses near home, over the machine's freedom alone, and their coordinates."""
    random = np.random.default_rng(7)
    shift = random.uniform(-0.02, 0.02, (count, 3)) * [name in machine.freedom for name in "xyz"]
    turn = random.uniform(-0.1, 0.1, (count, 3)) * [
        name in machine.freedom for name in ("rx", "ry", "rz")
    ]
    home = machine.home
    poses = RigidTransform.from_components(
        home.translation + shift, Rotation.from_rotvec(turn) * home.rotation
    )
    return poses, machine.inverse(poses)


def test_legs_measure_their_coordinates_between_the_joints(legged):
    poses, q = around(legged)
    placed = place_skeleton(legged, to_numbers(poses), q)
    legs = placed.bars[:, sorts(legged, "actuator")]
    np.testing.assert_allclose(np.linalg.norm(legs[:, :, 1] - legs[:, :, 0], axis=2), q, atol=NEAR)
    for k, pose in enumerate(poses):
        np.testing.assert_allclose(legs[k, :, 0], legged.base, atol=NEAR)
        np.testing.assert_allclose(legs[k, :, 1], pose.apply(legged.platform), atol=NEAR)
    np.testing.assert_array_equal(placed.pivots, np.concatenate([legs[:, :, 0], legs[:, :, 1]], 1))
    assert tuple(pivot.name for pivot in legged.parts.pivots) == legged.tilt_names
    assert [legged.parts.bars[k].axis for k in sorts(legged, "actuator")] == [
        axis.name for axis in legged.axes
    ]


def test_platforms_are_rigid_and_end_in_the_origin(legged):
    poses, q = around(legged)
    bars = place_skeleton(legged, to_numbers(poses), q).bars
    for sort in ("frame", "platform"):
        lengths = np.linalg.norm(np.diff(bars[:, sorts(legged, sort)], axis=2), axis=3)
        np.testing.assert_allclose(lengths, np.broadcast_to(lengths[0], lengths.shape), atol=NEAR)
    np.testing.assert_allclose(bars[:, -1, 1], poses.translation, atol=NEAR)


def test_the_linkage_closes():
    machine = load_machine("linkage")
    poses, q = around(machine)
    placed = place_skeleton(machine, to_numbers(poses), q)
    (a, b, joint), point = np.moveaxis(placed.pivots, 1, 0), poses.translation
    np.testing.assert_allclose(np.linalg.norm(joint - a, axis=1), q[:, 0], atol=NEAR)
    np.testing.assert_allclose(np.linalg.norm(joint - b, axis=1), q[:, 1], atol=NEAR)
    np.testing.assert_allclose(np.linalg.norm(point - joint, axis=1), machine.offset, atol=NEAR)
    # the angle at the joint between a and the point, as the file states it
    cosine = np.einsum("ij,ij->i", a - joint, point - joint) / (q[:, 0] * machine.offset)
    np.testing.assert_allclose(cosine, np.cos(machine.angle), atol=1e-9)
    np.testing.assert_allclose(placed.bars[:, -1, 1], point, atol=NEAR)


def test_an_arm_is_a_chain_of_its_joints_turns():
    pytest.importorskip("pinocchio")
    machine = load_machine("arm")
    q = np.random.default_rng(3).uniform(-1, 1, (20, 3)) * [2.0, 0.8, 0.9] + [0, 0.4, -1.4]
    poses = machine.pose_of(q)
    placed = place_skeleton(machine, to_numbers(poses), q)
    joints = machine.joints
    for k, angles in enumerate(q):
        first, second, third = (
            Rotation.from_rotvec(angle * axis)
            for angle, axis in zip(angles, joints.directions, strict=True)
        )
        shoulder = joints.points[0] + first.apply(joints.points[1] - joints.points[0])
        elbow = shoulder + (first * second).apply(joints.points[2] - joints.points[1])
        tip = elbow + (first * second * third).apply(joints.tool - joints.points[2])
        np.testing.assert_allclose(
            placed.bars[k, -2:], [[shoulder, elbow], [elbow, tip]], atol=NEAR
        )
        np.testing.assert_allclose(tip, poses[k].translation, atol=NEAR)
    assert [bar.axis for bar in machine.parts.bars] == [axis.name for axis in machine.axes]


def test_rails_lie_along_the_slides_and_the_hand_turns():
    machine = load_machine("traverser")
    where = np.random.default_rng(5).uniform(0.1, 1.0, (20, 3))
    turns = np.linspace(-3, 3, 20)
    poses = RigidTransform.from_components(where, Rotation.from_rotvec(turns[:, None] * [0, 0, 1]))
    q = machine.inverse(poses)
    placed = place_skeleton(machine, to_numbers(poses), q)
    for k, axis in enumerate(machine.axes[:3]):
        rail = placed.bars[:, k]
        travel = axis.travel[1] - axis.travel[0]
        np.testing.assert_allclose(
            np.linalg.norm(rail[:, 1] - rail[:, 0], axis=1), travel, atol=NEAR
        )
        # the carriage is on its rail: parallel to it, and as far along as the slide stands
        np.testing.assert_allclose(
            placed.pivots[:, k] - rail[:, 0], q[:, [k]] * machine.directions[k], atol=NEAR
        )
    np.testing.assert_allclose(placed.pivots[:, 2], where, atol=NEAR)
    hand = placed.bars[:, 3, 1] - placed.bars[:, 3, 0]
    expected = machine.characteristic_length * np.stack(
        [np.cos(turns), np.sin(turns), 0 * turns], 1
    )
    np.testing.assert_allclose(hand, expected, atol=NEAR)


def test_every_machine_shows_its_tool_and_all_its_axes(machine):
    placed = place_skeleton(machine, to_numbers(machine.home), machine.home_q[None])
    ends = placed.bars[0].reshape(-1, 3)
    assert np.linalg.norm(ends - machine.home.translation, axis=1).min() < 1e-9
    assert {bar.axis for bar in machine.parts.bars} - {""} == {axis.name for axis in machine.axes}


def test_a_machine_that_was_drawn_still_goes_to_other_processes(machine):
    before = place_skeleton(machine, to_numbers(machine.home), machine.home_q[None])
    other = pickle.loads(pickle.dumps(machine))
    after = place_skeleton(other, to_numbers(other.home), other.home_q[None])
    np.testing.assert_allclose(after.bars, before.bars, atol=NEAR)


def test_a_kind_that_says_nothing_has_no_bars(preset):
    class Bare(type(preset)):
        skeleton = Machine.skeleton

    other = Bare(preset.base, preset.platform, axes=preset.axes, home=preset.home)
    assert other.parts == Skeleton()
    placed = place_skeleton(other, to_numbers(other.home), other.home_q[None])
    assert placed.bars.shape == (1, 0, 2, 3)
    assert placed.pivots.shape == (1, 0, 3)


@settings(derandomize=True, max_examples=50, deadline=None)
@given(st.integers(3, 9), st.integers(0, 10_000))
def test_a_ring_goes_once_round_in_any_plane(count, seed):
    random = np.random.default_rng(seed)
    angle = 2 * np.pi * np.arange(count) / count
    flat = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    order = random.permutation(count)
    pairs = ring((Rotation.random(rng=random).apply(flat) + random.normal(size=3))[order])
    assert len(pairs) == count
    for i, j in pairs:  # neighbours of the regular polygon
        assert abs(int(order[i]) - int(order[j])) in (1, count - 1)


def test_a_ring_of_points_on_a_line_is_the_line():
    assert {frozenset(pair) for pair in ring([[0, 0, 0], [2, 2, 2], [1, 1, 1]])} == {
        frozenset({0, 2}),
        frozenset({1, 2}),
    }
