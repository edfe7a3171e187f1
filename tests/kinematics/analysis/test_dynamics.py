"""Actuator forces: hand calculation, power balance against energies of another making, the arm's
Lagrangian.
"""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.evidence.published import initial_design
from kinematics import (
    Arm,
    Axis,
    Body,
    Joints,
    Leg,
    MotionError,
    OutOfReach,
    cylinder,
    forces,
    load_machine,
    motion_of_axes,
    motion_of_poses,
)
from kinematics.machine.load import GRAVITY
from kinematics.machine.pose import COMPONENTS
from tests.kinematics.bodies import combine_bodies

G = -GRAVITY[2]
PLATFORM = Body(
    3.0, [0.01, -0.02, 0.03], [[0.03, 0.002, 0.001], [0.002, 0.04, -0.003], [0.001, -0.003, 0.05]]
)
WRENCH = np.array([12.0, -7.0, -40.0, 1.0, -2.0, 0.5])
SIZES = {
    "arm": (0.1, 0),
    "hexapod": (0.02, 0.1),
    "linkage": (0.03, 0),
    "traverser": (0.2, 2),
    "tripod": (0.03, 0),
}


@pytest.fixture(scope="module", params=SIZES)
def machine(request):
    if request.param == "arm":
        pytest.importorskip("pinocchio")
    return load_machine(request.param)


def test_rates_of_a_motion_are_its_derivatives(machine, spectrum):
    """Against the spectrum's derivatives of q and of the poses that `forward` finds: 1e-8, rounding
    times N⁴.
    """
    motion = spectrum.smooth(machine, *SIZES[machine.name])
    carried = machine.forward(motion.q, machine.home).pose
    assert np.abs(carried.as_matrix() - motion.pose.as_matrix()).max() < 1e-10
    twist = np.concatenate(
        [spectrum.rate(carried.translation), spectrum.turning(carried.rotation.as_matrix())], 1
    )
    for found, expected in (
        (motion.qd, spectrum.rate(motion.q)),
        (motion.qdd, spectrum.rate(motion.qd)),
        (motion.twist, twist),
        (motion.acceleration, spectrum.rate(twist)),
    ):
        assert np.abs(found - expected).max() < 1e-8 * max(1.0, np.abs(expected).max())


def test_axes_tell_the_motion_of_the_platform(machine, spectrum):
    motion = spectrum.smooth(machine, *SIZES[machine.name])
    found = motion_of_axes(machine, motion)
    for name in ("twist", "acceleration", "qdd"):
        assert getattr(found, name) == pytest.approx(getattr(motion, name), rel=1e-10, abs=1e-10)


def test_the_actuators_power_is_the_rate_of_energy_less_the_wrench_s(machine, spectrum):
    """Σ f q̇ = dE/dt − wrench · ν to 1e-8 of the largest power; energies from places alone."""
    motion = spectrum.smooth(machine, *SIZES[machine.name])
    total = spectrum.energy(PLATFORM, motion.pose.translation, motion.pose.rotation.as_matrix())
    if machine.name == "arm":
        frames = chain(motion.q)
        total = total + sum(
            spectrum.energy(Body(mass, centre, np.diag(inertia)), *frame)
            for (mass, centre, inertia), frame in zip(LINKS, frames, strict=True)
        )
    given = forces(machine, motion, platform=PLATFORM, wrench=WRENCH, gravity=GRAVITY).power.sum(1)
    needed = spectrum.rate(total) - motion.twist @ WRENCH
    assert np.abs(given - needed).max() < 1e-8 * np.abs(needed).max()


def test_reflected_inertia_is_carried_by_its_own_axis(machine, spectrum):
    motion = spectrum.smooth(machine, *SIZES[machine.name])
    with_it, without = (
        forces(machine, motion, platform=PLATFORM, reflected=m).force for m in (0.7, 0.0)
    )
    assert with_it - without == pytest.approx(0.7 * motion.qdd, rel=1e-9, abs=1e-9)


def test_a_leg_s_forces_hold_the_platform_in_balance(any_hexapod, poses_about):
    """Σ f u and Σ a × f u are minus the wrench and the weight: rounding of forces up to 1e5 N."""
    pose = poses_about(any_hexapod.home, any_hexapod, 20, 0.05)
    force = forces(
        any_hexapod, motion_of_poses(any_hexapod, pose), platform=PLATFORM, wrench=WRENCH
    ).force
    for k in range(20):
        turned = pose[k].rotation.as_matrix()
        arms = any_hexapod.platform @ turned.T
        legs = pose[k].translation + arms - any_hexapod.base
        pushes = force[k][:, None] * legs / np.linalg.norm(legs, axis=1)[:, None]
        weight = np.array([0, 0, -PLATFORM.mass * G])
        moments = np.cross(arms, pushes).sum(0) + np.cross(turned @ PLATFORM.centre, weight)
        assert pushes.sum(0) + WRENCH[:3] + weight == pytest.approx(np.zeros(3), abs=1e-8)
        assert moments + WRENCH[3:] == pytest.approx(np.zeros(3), abs=1e-8)


def test_weights_by_hand():
    """A slide lifts the weight; three arms that hang share it, each pulling by its slope."""
    traverser = load_machine("traverser")
    weight = forces(traverser, motion_of_poses(traverser, traverser.home), platform=Body(2.0)).force
    assert weight[0] == pytest.approx([2 * G, 0, 0, 0], abs=1e-12)
    tripod = load_machine("tripod")
    slope = 250 / np.hypot((300 - 60) / np.sqrt(3), 250)
    pull = forces(tripod, motion_of_poses(tripod, tripod.home), platform=Body(2.0)).force
    assert pull[0] == pytest.approx(np.full(3, -2 * G / (3 * slope)), rel=1e-9)


def test_a_linkage_s_turning_platform_loads_its_actuators():
    """With its centre off the point, the platform's turn counts: the wrench in the plane's z by
    virtual work, 1e-7.
    """
    linkage = load_machine("linkage")
    step, moment = 1e-6, np.array([0, 0, 0, 0, 0, 3.0])
    force = forces(linkage, motion_of_poses(linkage, linkage.home), wrench=moment).force[0]
    for axis in range(2):
        ends = [linkage.home_q + way * step * np.eye(2)[axis] for way in (1, -1)]
        up, down = (linkage.forward(q).pose.rotation for q in ends)
        turned = (up * down.inv()).as_rotvec()[2] / (2 * step)
        assert force[axis] == pytest.approx(-3.0 * turned, rel=1e-7)


def test_the_initial_design_s_force_is_ours():
    """45.01 N where [Sahbaz 2007, chapter 2] prints 54.563 N, by a second solution of the same
    statics.
    """
    result = initial_design.static_forces()
    initial, pose = result.machine, result.motion.pose
    arms = initial.platform @ pose.rotation.as_matrix().swapaxes(1, 2)
    legs = pose.translation[:, None] + arms - initial.base
    units = legs / np.linalg.norm(legs, axis=2, keepdims=True)
    screws = np.concatenate([units, np.cross(arms, units)], 2).swapaxes(1, 2)
    force = np.linalg.solve(screws, np.tile(-np.array(initial_design.WRENCH)[:, None], (21, 1, 1)))[
        :, :, 0
    ]
    assert initial_design.needs()[0].force == pytest.approx(np.abs(force).max(), rel=1e-12)
    assert np.abs(force).max() == pytest.approx(45.01, abs=0.005)


# The bundled arm's links as its URDF has them: mass, centre and principal moments in each link's
# frame.
LINKS = (
    (3.0, [0, 0, -0.05], [0.01, 0.01, 0.006]),
    (2.0, [0.2, 0, 0], [0.002, 0.03, 0.03]),
    (1.2, [0.175, 0, 0], [0.001, 0.014, 0.014]),
)


def chain(q):
    """Place (N, 3) and rotation (N, 3, 3) of the three links' frames."""
    upper = Rotation.from_euler("ZY", np.stack([q[:, 0], -q[:, 1]], 1))
    fore = Rotation.from_euler("ZY", np.stack([q[:, 0], -q[:, 1] - q[:, 2]], 1))
    shoulder = np.tile([0, 0, 0.2], (len(q), 1))
    elbow = shoulder + upper.apply(np.array([0.4, 0, 0]))
    yaw = Rotation.from_euler("Z", q[:, :1])
    return [(shoulder, yaw.as_matrix()), (shoulder, upper.as_matrix()), (elbow, fore.as_matrix())]


def test_an_arm_s_torques_are_its_lagrangian_s():
    """τ = d/dt ∂L/∂q̇ − ∂L/∂q, by CasADi from speeds in cylinder coordinates, 1e-11 of the
    largest.
    """
    pytest.importorskip("pinocchio")
    arm = load_machine("arm")
    random = np.random.default_rng(1)
    q = arm.home_q + random.uniform(-0.4, 0.4, (30, 3))
    qd, qdd = random.uniform(-3, 3, (2, 30, 3))
    a, v, w = (ca.SX.sym(name, 3) for name in "avw")
    lagrangian = (0.006 * v[0] ** 2) / 2 - 3.0 * G * 0.15
    for angle, pitch, (mass, centre, inertia), reach, height in (
        (a[1], v[1], LINKS[1], 0.0, 0.0),
        (a[1] + a[2], v[1] + v[2], LINKS[2], 0.4 * ca.cos(a[1]), 0.4 * ca.sin(a[1])),
    ):
        r, z = reach + centre[0] * ca.cos(angle), height + centre[0] * ca.sin(angle)
        dr, dz = ca.jtimes(r, a, v), ca.jtimes(z, a, v)
        about_yaw = inertia[0] * ca.sin(angle) ** 2 + inertia[2] * ca.cos(angle) ** 2
        lagrangian += mass * (dr**2 + dz**2 + (r * v[0]) ** 2) / 2
        lagrangian += (inertia[1] * pitch**2 + about_yaw * v[0] ** 2) / 2 - mass * G * z
    momentum = ca.gradient(lagrangian, v)
    torque = ca.jtimes(momentum, a, v) + ca.jtimes(momentum, v, w) - ca.gradient(lagrangian, a)
    expected = np.array(ca.Function("torque", [a, v, w], [torque]).map(30)(q.T, qd.T, qdd.T)).T

    class State:
        pose = arm.pose_of(q)

    State.q, State.qd, State.qdd = q, qd, qdd
    found = forces(arm, State())
    assert found.motion.qdd == pytest.approx(qdd, rel=1e-9, abs=1e-9)
    assert np.abs(found.force - expected).max() < 1e-11 * np.abs(expected).max()


def test_an_arm_of_given_joints_weighs_nothing():
    pytest.importorskip("pinocchio")
    upright = np.array([[0, 0, 1.0], [0, -1, 0], [0, -1, 0]])
    joints = Joints(
        np.array([[0, 0, 0], [0, 0, 0.2], [0.4, 0, 0.2]]),
        upright,
        np.array([0.7, 0, 0.2]),
        np.eye(3),
    )
    arm = Arm(joints, axes=[Axis(f"j{n}", "rotary") for n in range(3)], home=[0, 0.5, -0.9])
    assert np.abs(forces(arm, motion_of_poses(arm, arm.home)).force).max() == 0
    lifted = forces(arm, motion_of_poses(arm, arm.home), platform=Body(2.0)).force[0]
    r = 0.4 * np.cos(0.5) + 0.3 * np.cos(0.4)
    assert lifted == pytest.approx([0, 2 * G * r, 2 * G * 0.3 * np.cos(0.4)], abs=1e-10)


def test_a_cylinder_is_a_stack_of_discs():
    """Sums over 2000 discs: the error is 1/2000² of the moments."""
    body, z = cylinder(2.0, 0.03, -0.05, 0.15), np.linspace(-0.05, 0.15, 2001)
    middle = (z[1:] + z[:-1]) / 2
    across = (2.0 / 2000 * (0.03**2 / 4 + (middle - middle.mean()) ** 2)).sum()
    assert body.centre == pytest.approx([0, 0, middle.mean()])
    assert np.diag(body.inertia) == pytest.approx([across, across, 2.0 * 0.03**2 / 2], rel=1e-6)


def test_bodies_together_need_what_each_needs(spectrum):
    """A plate with a payload gives the sum of both forces; inverse dynamics are linear in bodies,
    Steiner or not.
    """
    hexapod = load_machine("hexapod")
    motion, payload = (
        spectrum.smooth(hexapod, 0.02, 0.1),
        Body(2.0, [0.05, 0, 0.1], np.diag([0.01, 0.02, 0.015])),
    )
    one = forces(hexapod, motion, platform=combine_bodies(PLATFORM, payload, Body())).force
    two = sum(forces(hexapod, motion, platform=body).force for body in (PLATFORM, payload))
    assert one == pytest.approx(two, rel=1e-10, abs=1e-10)


@pytest.mark.parametrize(
    ("made", "phrase"),
    [
        (lambda: Body(-1.0), "mass -1.0 kg must be finite"),
        (lambda: Body(np.nan), "mass must be one finite number"),
        (lambda: Body(1.0, [0, 0]), r"centre must be finite numbers \(3,\)"),
        (
            lambda: Body(1.0, [0, 0, 0], np.diag([1.0, 1, 3])),
            "principal moments 1, 1, 3 .* no rigid body's",
        ),
        (lambda: Body(1.0, [0, 0, 0], np.diag([-1.0, 1, 1])), "no rigid body's"),
        (lambda: Body(1.0, [0, 0, 0], [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]), "must be symmetric"),
        (lambda: Body(0.0, [0, 0, 0], np.eye(3)), "inertia without mass"),
        (lambda: cylinder(1.0, 0.1, 0.2, 0.2), "must lie below"),
        (lambda: Leg(Body(), Body(), [0, 0, 0]), "first_axis is a direction"),
    ],
)
def test_no_such_body(made, phrase):
    with pytest.raises(MotionError, match=phrase):
        made()


@pytest.mark.parametrize(
    ("options", "phrase"),
    [
        ({"wrench": [1, 2, 3]}, "wrench must be finite numbers"),
        ({"wrench": 5.0}, "wrench must be finite numbers"),
        ({"wrench": [0, 0, np.inf, 0, 0, 0]}, "wrench must be finite numbers"),
        ({"gravity": -9.8}, "gravity must be finite numbers"),
        ({"reflected": -1.0}, "must not be below 0"),
        ({"legs": Leg(Body(), Body())}, "machine tripod is not a hexapod"),
    ],
)
def test_loads_that_say_nothing_are_refused(options, phrase):
    tripod = load_machine("tripod")
    with pytest.raises(MotionError, match=phrase):
        forces(tripod, motion_of_poses(tripod, tripod.home), **options)


def test_a_twist_off_the_freedom_and_a_singular_pose_are_refused():
    tripod = load_machine("tripod")
    with pytest.raises(OutOfReach, match=f"holds {COMPONENTS[4]}: the twist at instant 0 has 0.1"):
        motion_of_poses(tripod, tripod.home, [0, 0, 0, 0, 0.1, 0])
    with pytest.raises(
        MotionError, match=r"tripod has 3 axes: q must be finite, \(1, 3\) for 1 pose, not \(1, 6\)"
    ):
        motion_of_axes(
            tripod, motion_of_poses(load_machine("hexapod"), load_machine("hexapod").home)
        )
    with pytest.raises(MotionError, match=r"twist must be finite numbers \(1, 6\) or \(6,\), not"):
        motion_of_poses(tripod, tripod.home, np.zeros((2, 6)))
    # all arms in one plane bear nothing across it
    level = RigidTransform.from_translation([0, 0, tripod.base[0, 2] - tripod.platform[0, 2]])
    with pytest.raises(
        MotionError, match="machine tripod is singular at the pose, position 0, 0, -50 mm"
    ):
        forces(tripod, motion_of_poses(tripod, level), platform=Body(1.0))


def test_a_figure_and_a_table(spectrum):
    hexapod = load_machine("hexapod")
    found = forces(hexapod, spectrum.smooth(hexapod, 0.02, 0.1), platform=PLATFORM)
    ax = found.plot(t=spectrum.t)
    assert [line.get_label() for line in ax.get_lines()][:6] == [axis.name for axis in hexapod.axes]
    assert ax.get_lines()[2].get_ydata() == pytest.approx(found.force[:, 2])
    assert str(found).splitlines()[4].split()[:2] == ["leg3", f"{found.force[:, 2].min():.6g}"]
    assert found.use == pytest.approx(np.abs(found.force).max(0) / 220)
