"""Hexapods whose legs have inertia: forward dynamics, power balance, limits, hand calculation."""

import sys

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Body, Leg, MotionError, cylinder, forces, motion_of_poses
from kinematics.analysis.dynamics import closed_loop, local_wrench, states
from kinematics.machine.load import GRAVITY

pin = pytest.importorskip("pinocchio")

G = -GRAVITY[2]
PLATFORM = Body(
    3.0, [0.01, -0.02, 0.03], [[0.03, 0.002, 0.001], [0.002, 0.04, -0.003], [0.001, -0.003, 0.05]]
)
BARREL = Body(
    0.4,
    [0.004, -0.003, 0.06],
    [[8e-4, 2e-5, 1e-5], [2e-5, 9e-4, -1e-5], [1e-5, -1e-5, 3e-4]],
    "barrel",
)
ROD = Body(0.15, [0.001, 0.002, -0.07], [[3e-4, 0, 1e-5], [0, 3e-4, 0], [1e-5, 0, 1e-5]], "rod")
LEG = Leg(BARREL, ROD, [0.9, 0.3, 0.1])
WRENCH = np.array([12.0, -7.0, -40.0, 1.0, -2.0, 0.5])


def moved(machine, spectrum):
    """A motion of a size that fits the machine's."""
    return spectrum.smooth(machine, 0.05 * machine.characteristic_length, 0.05)


def test_forward_dynamics_give_the_accelerations_back(any_hexapod, spectrum):
    """pinocchio's constrained forward dynamics of the forces, to 1e-9 of the largest
    acceleration.
    """
    motion, legs = moved(any_hexapod, spectrum), (LEG,) * 6
    force = forces(any_hexapod, motion, platform=PLATFORM, wrench=WRENCH, legs=legs).force
    loop = closed_loop(any_hexapod, legs, PLATFORM, np.array(GRAVITY))
    constraints, closings = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    constraints.extend(loop.constraints)
    closings.extend([constraint.createData() for constraint in loop.constraints])
    data = loop.model.createData()
    pin.initConstraintDynamics(loop.model, data, constraints, closings)
    outside = local_wrench(motion, np.tile(WRENCH, (len(motion), 1)))
    for k, (q, v, a) in enumerate(zip(*states(any_hexapod, legs, motion), strict=True)):
        generalized = np.zeros(loop.model.nv)
        generalized[:6], generalized[loop.driven] = outside[k], force[k]
        settings = pin.ProximalSettings(1e-13, 0.0, 1)
        found = pin.constraintDynamics(
            loop.model, data, q, v, generalized, constraints, closings, settings
        )
        assert np.abs(found - a).max() < 1e-9 * np.abs(a).max()


def test_the_loops_are_closed_and_stay_so(any_hexapod, spectrum):
    """Rod and platform meet in the joint's centre at every instant; rates are derivatives, both to
    rounding.
    """
    motion, legs = moved(any_hexapod, spectrum), (LEG,) * 6
    loop = closed_loop(any_hexapod, legs, PLATFORM, np.array(GRAVITY))
    data = loop.model.createData()
    q, v, a = states(any_hexapod, legs, motion)
    for row in q:
        pin.forwardKinematics(loop.model, data, row)
        for constraint in loop.constraints:
            end = data.oMi[constraint.joint1_id] * constraint.joint1_placement
            joint = data.oMi[constraint.joint2_id] * constraint.joint2_placement
            assert end.translation == pytest.approx(joint.translation, abs=1e-13)
    assert q[:, 9::3] == pytest.approx(motion.q, rel=1e-13)
    assert v[:, 6:] == pytest.approx(spectrum.rate(q[:, 7:]), abs=1e-9)
    assert a == pytest.approx(spectrum.rate(v), abs=1e-8)


def test_the_actuators_power_is_the_rate_of_energy_less_the_wrench_s(any_hexapod, spectrum):
    """Σ f q̇ = dE/dt − wrench · ν to 1e-8 of the largest power.

    A leg's frame by cross products, not by angles:

    z along the leg, y (the universal joint's second axis) across it and the first axis.
    """
    motion = moved(any_hexapod, spectrum)
    turned, place = motion.pose.rotation.as_matrix(), motion.pose.translation
    total = spectrum.energy(PLATFORM, place, turned)
    for base, end in zip(any_hexapod.base, any_hexapod.platform, strict=True):
        tip = place + turned @ end
        z = (tip - base) / np.linalg.norm(tip - base, axis=1)[:, None]
        home = any_hexapod.home.translation + any_hexapod.home.rotation.as_matrix() @ end - base
        first = np.asarray(LEG.first_axis) - (LEG.first_axis @ home) * home / (home @ home)
        y = np.cross(z, first)
        y /= np.linalg.norm(y, axis=1)[:, None]
        frame = np.stack([np.cross(y, z), y, z], 2)
        total = total + spectrum.energy(BARREL, np.tile(base, (len(motion), 1)), frame)
        total = total + spectrum.energy(ROD, tip, frame)
    given = forces(any_hexapod, motion, platform=PLATFORM, wrench=WRENCH, legs=LEG).power.sum(1)
    needed = spectrum.rate(total) - motion.twist @ WRENCH
    assert np.abs(given - needed).max() < 1e-8 * np.abs(needed).max()


def test_legs_that_weigh_nothing_are_legs_without_mass(any_hexapod, spectrum):
    motion = moved(any_hexapod, spectrum)
    without = forces(any_hexapod, motion, platform=PLATFORM, wrench=WRENCH).force
    empty = forces(
        any_hexapod, motion, platform=PLATFORM, wrench=WRENCH, legs=Leg(Body(), Body())
    ).force
    assert np.abs(empty - without).max() < 1e-10 * np.abs(without).max()


def test_the_difference_falls_with_the_legs_mass(preset, spectrum):
    """Inverse dynamics are linear in the masses: a thousandth of them, a thousandth of the
    difference.
    """
    motion = moved(preset, spectrum)

    def extra(share):
        leg = Leg(
            *(Body(share * b.mass, b.centre, share * np.asarray(b.inertia)) for b in (BARREL, ROD))
        )
        return forces(preset, motion, platform=PLATFORM, legs=leg).force - massless

    massless = forces(preset, motion, platform=PLATFORM).force
    assert 1e3 * extra(1e-3) == pytest.approx(extra(1.0), abs=1e-7 * np.abs(extra(1.0)).max())


def test_weights_of_legs_at_rest_by_virtual_work(preset):
    """At rest f · δq = δU for every small move of the platform, U from heights alone; central
    differences of 1e-6.
    """
    up = preset.home.translation + np.array([0.01, 0.02, 0.02])
    pose = RigidTransform.from_components(up, Rotation.from_rotvec([0.1, 0.05, 0]))
    barrel, rod = cylinder(0.4, 0.02, 0, 0.12), cylinder(0.15, 0.005, -0.14, 0)
    force = forces(
        preset, motion_of_poses(preset, pose), platform=PLATFORM, legs=Leg(barrel, rod)
    ).force[0]

    def height_energy(at):
        tips = at.translation + preset.platform @ at.rotation.as_matrix().T
        legs = tips - preset.base
        units = legs / np.linalg.norm(legs, axis=1)[:, None]
        weights = (
            barrel.mass * (preset.base + 0.06 * units)[:, 2]
            + rod.mass * (tips - 0.07 * units)[:, 2]
        )
        return G * (
            weights.sum()
            + PLATFORM.mass * (at.translation + at.rotation.as_matrix() @ PLATFORM.centre)[2]
        )

    step = 1e-6
    for twist in np.eye(6):
        ends = [
            RigidTransform.from_components(
                pose.translation + way * twist[:3],
                Rotation.from_rotvec(way * twist[3:]) * pose.rotation,
            )
            for way in (step, -step)
        ]
        rise = (height_energy(ends[0]) - height_energy(ends[1])) / (2 * step)
        assert force @ preset.jacobian(pose) @ twist == pytest.approx(rise, abs=1e-7)


def test_a_round_leg_s_forces_do_not_depend_on_how_its_joint_is_turned(preset, spectrum):
    """Slender rods have no spin to tell: the first axis of the universal joint does not matter."""
    motion = moved(preset, spectrum)
    found = [
        forces(
            preset, motion, legs=Leg(cylinder(0.4, 0, 0, 0.12), cylinder(0.15, 0, -0.14, 0), axis)
        ).force
        for axis in (None, [1, 0, 0], [0.3, 1, 0])
    ]
    for other in found[1:]:
        assert np.abs(other - found[0]).max() < 1e-10 * np.abs(found[0]).max()


def test_each_leg_may_be_another(preset):
    """One rod with a mass point in its platform joint: as if the platform carried it there."""
    motion, light = motion_of_poses(preset, preset.home), Leg(Body(), Body())
    heavy = Leg(Body(), Body(1.0, name="rod"))
    for k in range(6):
        legs = [heavy if k == leg else light for leg in range(6)]
        on_platform = forces(preset, motion, platform=Body(1.0, preset.platform[k])).force
        assert forces(preset, motion, legs=legs).force == pytest.approx(on_platform, abs=1e-9)


def test_what_cannot_be_is_refused(preset):
    still = motion_of_poses(preset, preset.home)
    with pytest.raises(
        MotionError, match=r"5 legs with inertia \(Leg\); give one Leg for all, or six"
    ):
        forces(preset, still, legs=[LEG] * 5)
    along = preset.home.translation + np.array(preset.platform[0]) - preset.base[0]
    with pytest.raises(
        MotionError, match="first axis of leg1's universal joint lies along the leg at home"
    ):
        forces(preset, still, legs=Leg(BARREL, ROD, along))


def test_without_pinocchio_it_says_so(preset, monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    still = motion_of_poses(preset, preset.home)
    assert np.isfinite(forces(preset, still, platform=PLATFORM).force).all()
    with pytest.raises(MotionError, match="a hexapod whose legs have inertia needs pin "):
        forces(preset, still, legs=LEG)
