"""The serial arm: its closed form against pinocchio's forward kinematics of the same URDF."""

from importlib.resources import as_file, files

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import (
    Arm,
    Axis,
    FileError,
    Joints,
    MotionError,
    OutOfReach,
    load_machine,
    read_urdf,
)

pin = pytest.importorskip("pinocchio")
NAMES = ("yaw", "shoulder", "elbow")
AXES = [Axis(name, kind="rotary") for name in NAMES]

# Three joints with every offset that the form allows: an upright axis off the origin that turns
# left, a shoulder out and aside, links bent at zero, an elbow that turns the other way than the
# shoulder, a tool aside and askew.
BENT = """<robot name="bent"><link name="w"/><link name="a"/><link name="b"/><link name="c"/><link name="t"/>
<joint name="yaw" type="continuous"><parent link="w"/><child link="a"/><origin xyz="0.1 -0.2 0.3" rpy="0 0 0.4"/>
<axis xyz="0 0 -1"/></joint>
<joint name="shoulder" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0.07 0.03 0.1" rpy="0 0 0.3"/>
<axis xyz="0 1 0"/></joint>
<joint name="elbow" type="continuous"><parent link="b"/><child link="c"/><origin xyz="0.3 0.02 0.15" rpy="0 0.5 0"/>
<axis xyz="0 -1 0"/></joint>
<joint name="flange" type="fixed"><parent link="c"/><child link="t"/><origin xyz="0.2 -0.04 -0.1" rpy="0.1 0.2 0.3"/>
</joint></robot>"""
LIMITED = BENT.replace("continuous", "revolute").replace(
    "<axis", '<limit lower="-2" upper="2" effort="9" velocity="9"/><axis'
)


@pytest.fixture(scope="module", params=["preset", "bent"])
def urdf(request, tmp_path_factory):
    if request.param == "preset":
        with as_file(files("kinematics") / "presets" / "arm.urdf") as path:
            yield path, "tool"
    else:
        path = tmp_path_factory.mktemp("urdf") / "bent.urdf"
        path.write_text(BENT)
        yield path, "t"


@pytest.fixture(scope="module")
def joints(urdf):
    return read_urdf(urdf[0], NAMES, urdf[1])


def by_pinocchio(urdf, q):
    path, tool = urdf
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    poses = []
    for angles in np.atleast_2d(q):
        turning = [  # a joint without limits is a point on the circle
            [np.cos(angle), np.sin(angle)] if joint.nq == 2 else [angle]
            for joint, angle in zip(model.joints[1:], angles, strict=True)
        ]
        pin.framesForwardKinematics(model, data, np.concatenate(turning))
        poses.append(data.oMf[model.getFrameId(tool)].homogeneous.copy())
    return np.array(poses)


def drawn(joints, count=300, seed=0, elbow=1):
    """Joint angles on one elbow's side, away from the stretched and the folded arm."""
    rng = np.random.default_rng(seed)
    machine = Arm(joints, axes=AXES, home=[0.1, 0.2, 0.9])
    bend = elbow * rng.uniform(0.3, 2.8, count)
    q = np.column_stack([rng.uniform(-3, 3, count), rng.uniform(-3, 3, count), bend])
    q[:, 2] = (bend - machine._zero[2]) / machine._sense[2]
    return q


@pytest.mark.parametrize("elbow", [1, -1])
def test_the_inverse_finds_the_angles_of_pinocchio_s_poses(urdf, joints, elbow):
    """Both elbows, over the back too: near decides."""
    machine = Arm(joints, axes=AXES, home=[0.1, 0.2, 0.9])
    q = drawn(joints, elbow=elbow)
    poses = RigidTransform.from_matrix(by_pinocchio(urdf, q))
    found = np.array(
        [machine.inverse(pose, near=angles + 0.05) for pose, angles in zip(poses, q, strict=True)]
    )
    # where the tool passes over the yaw axis its angle is lost: an error of 1e-16 m counts as
    # 1e-16/ρ rad
    reach = np.hypot(*(poses.translation[:, :2] - joints.points[0, :2]).T)
    assert np.abs(found - q)[reach > 0.1].max() < 1e-12
    assert (reach > 0.1).mean() > 0.7


def test_forward_is_pinocchio_s(urdf, joints):
    """Position and the orientation that follows; certified from a pose nearby."""
    machine = Arm(joints, axes=AXES, home=[0.1, 0.2, 0.9])
    q = np.concatenate([drawn(joints, elbow=1), drawn(joints, elbow=-1)])
    found = machine.forward(q)
    assert np.abs(found.pose.as_matrix() - by_pinocchio(urdf, q)).max() < 1e-12
    near = machine.forward(q + 0.01).pose
    assert machine.forward(q, near=near).certified.mean() > 0.95


def test_the_jacobian_is_pinocchio_s(urdf, joints):
    path, tool = urdf
    machine = Arm(joints, axes=AXES, home=[0.1, 0.2, 0.9])
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    q = machine.home_q
    turning = [
        [np.cos(a), np.sin(a)] if j.nq == 2 else [a]
        for j, a in zip(model.joints[1:], q, strict=True)
    ]
    frame = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    forward = pin.computeFrameJacobian(
        model, data, np.concatenate(turning), model.getFrameId(tool), frame
    )[:3]
    assert machine.jacobian(machine.home)[:, :3] @ forward == pytest.approx(np.eye(3), abs=1e-12)
    assert (machine.jacobian(machine.home)[:, 3:] == 0).all()


def test_the_thesis_end_points_are_within_reach():
    """And so is the straight line between them, on one elbow, inside the travel."""
    arm = load_machine("arm")
    ends = np.array([[0.51171, 0.3705, 0.0], [0.0, 0.5, 0.3]])
    line = ends[0] + np.linspace(0, 1, 101)[:, None] * (ends[1] - ends[0])
    q = arm.inverse(RigidTransform.from_translation(line))
    assert arm.check(RigidTransform.from_translation(line)).ok.all()
    assert np.abs(np.diff(q, axis=0)).max() < 0.05
    assert (q[:, 2] < 0).all()


def test_margins_where_the_arm_is_singular():
    """Over the yaw axis, and stretched out: its angles have no finite rates there, and that is told
    as it is.
    """
    arm = load_machine("arm")
    over = RigidTransform.from_translation([0, 0, 0.5])
    stretched = arm.pose_of(np.array([0.3, 0.5, 0.0]))
    for pose in (over, stretched):
        margins = arm.check(RigidTransform.concatenate([arm.home, pose]))
        assert margins.conditioning[1] == margins.singularity[1] == 0
        assert margins.conditioning[0] == arm.check(arm.home).conditioning[0] > 0.1
        with pytest.raises(MotionError, match="machine arm is singular at the pose, position"):
            arm.jacobian(pose)
    # and that is what its neighbours come close to
    near = [
        arm.check(arm.pose_of(np.array([0.3, 0.5, bend]))).conditioning[0]
        for bend in (-1e-1, -1e-2, -1e-3, -1e-4)
    ]
    assert np.diff(np.log10(near)) == pytest.approx(-1, abs=0.15)


def test_margins_of_the_other_elbow():
    arm = load_machine("arm")
    other = arm.inverse(arm.home, near=[0.5, 0.0, 1.4])
    low, high = np.array([axis.travel for axis in arm.axes]).T
    expected = np.abs(other - arm.home_q - (low + high) / 2) / ((high - low) / 2)
    assert arm.check(arm.home, near=other).travel[0] == pytest.approx(expected, abs=1e-12)
    assert np.abs(arm.check(arm.home).travel[0] - expected).max() > 0.1
    with pytest.raises(MotionError, match=r"near must be finite numbers \(3,\)"):
        arm.check(arm.home, near=[1, 2])


def test_from_home_the_other_elbow_is_not_certified():
    """Between them lies the stretched arm.

    Full turns do not matter; asked from elsewhere, q says how it stands.
    """
    arm = load_machine("arm")
    poses = arm.forward(arm.home_q + np.random.default_rng(0).uniform(-0.3, 0.3, (50, 3))).pose
    here = np.array([arm.inverse(pose) for pose in poses])
    there = np.array([arm.inverse(pose, near=[0.5, 0.0, 1.4]) for pose in poses])
    assert (here[:, 2] < 0).all()
    assert (there[:, 2] > 0).all()
    assert arm.forward(here).certified.all()
    assert arm.forward(here + np.array([2, 0, -2]) * np.pi).certified.all()
    assert not arm.forward(there).certified.any()
    assert not arm.forward(there, near=arm.home).certified.any()
    assert arm.forward(there).residual.max() < 1e-12
    assert arm.forward(there, near=arm.forward(there + 0.01).pose).certified.all()


def test_an_axis_table_of_no_joint_is_told_where_it_stands(tmp_path):
    presets = files("kinematics") / "presets"
    (tmp_path / "arm.urdf").write_text((presets / "arm.urdf").read_text())
    text = (presets / "arm.toml").read_text() + '[[axis]]\nname = "elbo"\nmax_speed = "1 rad/s"\n'
    path = tmp_path / "rig.toml"
    path.write_text(text)
    line = len(text.splitlines()) - 1
    with pytest.raises(
        FileError,
        match=rf'rig.toml:{line}: axis\[\d\].name: "elbo" is no joint, nearest is "elbow"; joints: yaw',
    ):
        load_machine(path)


def test_out_of_reach(joints):
    machine = Arm(joints, axes=AXES, home=[0.1, 0.2, 0.9])
    for to in ([2.0, 0, 0], [*joints.points[0, :2], 5.0]):
        with pytest.raises(OutOfReach, match="no actuator coordinates reach the pose, position"):
            machine.inverse(RigidTransform.from_translation(to))


@pytest.mark.parametrize(
    ("directions", "phrase"),
    [
        ([[0, 0.1, 1], [0, 1, 0], [0, 1, 0]], "must be upright"),
        ([[0, 0, 1], [0, 1, 0.1], [0, 1, 0]], "must be level"),
        ([[0, 0, 1], [0, 1, 0], [0.1, 1, 0]], "must be parallel"),
    ],
)
def test_another_form_is_refused(directions, phrase):
    unit = np.array(directions, float) / np.linalg.norm(directions, axis=1)[:, None]
    points = np.array([[0, 0, 0], [0, 0, 0.2], [0.4, 0, 0.2]])
    with pytest.raises(MotionError, match=phrase):
        Arm(Joints(points, unit, np.array([0.7, 0, 0.2]), np.eye(3)), axes=AXES, home=[0, 0.2, 0.9])


def test_a_link_of_no_length_is_refused():
    points = np.array([[0, 0, 0], [0, 0, 0.2], [0, 0.1, 0.2]])
    upright = np.array([[0, 0, 1.0], [0, 1, 0], [0, 1, 0]])
    with pytest.raises(MotionError, match="neither may vanish"):
        Arm(
            Joints(points, upright, np.array([0.7, 0, 0.2]), np.eye(3)),
            axes=AXES,
            home=[0, 0.2, 0.9],
        )


@pytest.mark.parametrize(
    ("text", "joints", "tool", "phrase"),
    [
        ("<robot", NAMES, "t", "urdf"),
        (BENT, ("yaw", "shoulder", "wrist"), "t", r"wrist.*yaw, shoulder, elbow"),
        (BENT, NAMES, "gripper", 'no frame "gripper"'),
        (BENT, ("yaw", "elbow", "shoulder"), "t", "do not follow each other"),
        (BENT, ("yaw", "shoulder", "shoulder"), "t", "three joints that turn"),
        (BENT, NAMES, "b", "'b' is carried by 'shoulder'"),
        (BENT, NAMES, "w", "'w' is carried by nothing that moves"),
        (
            LIMITED.replace('"elbow" type="revolute"', '"elbow" type="prismatic"'),
            NAMES,
            "t",
            "'elbow' does not turn",
        ),
        (
            BENT.replace('"b"/><child link="c"', '"a"/><child link="c"'),
            NAMES,
            "t",
            "do not follow each other",
        ),
        (LIMITED.replace('"0 -1 0"', '"0 0 0"'), NAMES, "t", "'elbow' has no axis"),
        (BENT.replace('"0.2 -0.04 -0.1"', '"1e300 0 0"'), NAMES, "t", "within 1e.06 m"),
    ],
)
def test_a_urdf_that_does_not_hold_what_is_named(tmp_path, text, joints, tool, phrase):
    path = tmp_path / "bad.urdf"
    path.write_text(text)
    with pytest.raises(FileError, match=phrase):
        read_urdf(path, joints, tool)


def test_turned_about_itself(joints):
    """The orientation asked for is ignored: it follows."""
    machine = Arm(joints, axes=AXES, home=[0.1, 0.2, 0.9])
    turned = RigidTransform.from_components(machine.home.translation, Rotation.from_euler("X", 1.0))
    assert machine.inverse(turned) == pytest.approx(machine.home_q, abs=1e-14)


@pytest.mark.parametrize("near", [[0, 0, 0], [0.3, 0.4, 0.0], [0.3, np.pi / 2, 0.0]])
def test_near_a_straight_elbow_still_means_one_of_the_two(near):
    """Neither elbow is nearer; the answer is one that reaches the pose."""
    machine = load_machine("arm")
    q = machine.inverse(machine.home, near=near)
    assert machine.pose_of(q).translation == pytest.approx(machine.home.translation, abs=1e-12)


def test_an_arm_whose_home_is_straight():
    """At the edge of its reach; every pose within is reached all the same."""
    preset = load_machine("arm")
    machine = Arm(preset.joints, axes=preset.axes, home=[0.1, 0.2, 0.0])
    q = machine.inverse(preset.home)
    assert machine.pose_of(q).translation == pytest.approx(preset.home.translation, abs=1e-12)


def test_the_other_side_is_taken_where_only_it_reaches(joints):
    """Near a posture over the back, a pose that only the front reaches: `near` picks among what
    there is.
    """
    bent = Arm(joints, axes=AXES, home=[0.1, 0.2, 0.9])
    rng = np.random.default_rng(5)
    poses = bent.pose_of(rng.uniform(-1.2, 1.2, (200, 3)))
    over = np.array([0.1 + np.pi, 2.6, -0.9])
    q = bent.inverse(poses, near=over)
    assert np.abs(bent.pose_of(q).translation - poses.translation).max() < 1e-9
    each = [bent.jacobian(pose, near=found) for pose, found in zip(poses, q, strict=True)]
    assert bent.jacobian(poses, near=over) == pytest.approx(np.array(each), rel=1e-9)
