"""Five axes: the tool's direction counts and its spin follows, so level tools are no more singular
than others.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import (
    Body,
    OutOfReach,
    forces,
    load_machine,
    motion_of_axes,
    motion_of_poses,
    posture_of_pose,
)
from kinematics.analysis.singularity import sensitivity
from kinematics.machine.pose import to_numbers
from planner import Line, Program, check, plan

MACHINE = load_machine("five-axis")
ANGLES = [10, 60, 85, 89.999, 90, 90.001, 95, 100, 120, 150]


def tilted(a, c=0.0, position=(0.01, 0.02, 0.03)):
    """The pose of axes A and C (degrees), by hand: the table turns by −C about z, then −A about
    x.
    """
    rotation = Rotation.from_euler("ZX", [-c, -a], degrees=True)
    return RigidTransform.from_components(np.asarray(position), rotation)


@pytest.mark.parametrize("c", [0, 40, 90, -135])
@pytest.mark.parametrize("a", ANGLES)
def test_every_tilt_is_certified(a, c):
    near = [0, 0, 0, np.radians(a), np.radians(c)]
    posture = posture_of_pose(MACHINE, tilted(a, c), near)
    assert np.degrees(posture.q[3:]) == pytest.approx([a, c], abs=1e-9)
    assert posture.certified
    # it is sin A at the pole of the table, times how metres and radians meet
    assert posture.margins.conditioning[0] > 0.08 * np.sin(np.radians(a))


@pytest.mark.parametrize("a", [30, 90, 110])
def test_axes_tell_the_motion_of_the_tool(a):
    """The twist of a unit of each axis against differences of `forward`: the tool's tip and its
    direction.
    """
    q = MACHINE.inverse(tilted(a, 25), near=[0, 0, 0, np.radians(a), np.radians(25)])
    pose = MACHINE.forward(q).pose
    unit = sensitivity(MACHINE, to_numbers(pose), q[None])[0]
    for k in range(5):
        ends = [MACHINE.forward(q + sign * 1e-6 * np.eye(5)[k]).pose for sign in (1, -1)]
        rate = (ends[0].translation - ends[1].translation) / 2e-6
        turn = (ends[0].rotation * ends[1].rotation.inv()).as_rotvec() / 2e-6
        assert unit[:, k] == pytest.approx([*rate, *turn], abs=1e-7)


@pytest.mark.parametrize("a", [30, 90, 110])
def test_power_is_balanced_at_every_tilt(a):
    """Σ f q̇ of a wrench on the tool is the power that it takes, for motions of all axes."""
    q = MACHINE.inverse(tilted(a, 25), near=[0, 0, 0, np.radians(a), np.radians(25)])
    moving = motion_of_poses(MACHINE, MACHINE.forward(q).pose, near=q)

    class State:
        pose = moving.pose
        q, qd, qdd = moving.q, np.array([[0.1, -0.2, 0.3, 0.4, -0.5]]), np.zeros((1, 5))

    motion = motion_of_axes(MACHINE, State)
    wrench = np.array([10.0, -20, 30, 0.4, 0.5, -0.6])
    power = forces(MACHINE, motion, platform=Body(), wrench=wrench, gravity=[0, 0, 0]).power.sum()
    assert power == pytest.approx(-motion.twist[0] @ wrench, rel=1e-9)


def test_a_tool_along_the_axis_of_the_table_is_singular_still(limit_search):
    limit_search(0.0)
    standing = check(Program([Line([0.01, 0, 0.03], Rotation.identity())], frame="base"), MACHINE)
    assert isinstance(standing.violations[0], OutOfReach)
    assert "singular" in str(standing.violations[0])


@pytest.mark.parametrize("order", [2, 3])
def test_a_motion_past_a_level_tool_is_planned(order):
    """From A = 80 to 100 along a line: five-sided machining passes a level tool."""
    start = tilted(80, position=(0, 0, 0.02))
    end = tilted(100, position=(0.02, 0.01, 0.03))
    program = Program([Line(end.translation, end.rotation)], start=start, frame="base")
    made = plan(program, MACHINE, order=order)
    assert made.certificate.holds
    tilt = np.degrees(made.trajectory.at([0, made.trajectory.duration]).q[:, 3])
    assert tilt == pytest.approx([80, 100], abs=1e-6)
    assert not check(program, MACHINE).warnings
