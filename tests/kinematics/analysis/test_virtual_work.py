"""Forces as one expression: against pinocchio and the twist formulation, and against energies of
another making.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import (
    Axis,
    Body,
    Hexapod,
    Leg,
    Load,
    MotionError,
    Traverser,
    forces,
    load_machine,
    motion_of_poses,
)
from kinematics.machine.pose import to_numbers

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
TILTED = np.array([1.0, -2.0, -9.4])
SIZES = {"arm": (0.1, 0), "linkage": (0.03, 0), "traverser": (0.2, 2), "tripod": (0.03, 0)}


def inputs(motion):
    """x, ẋ, ẍ, q, q̇, q̈: Ṙ = ω× R, R̈ = (ω̇× + ω×ω×) R."""

    def crossed(w):
        o = np.zeros(len(w))
        rows = [o, -w[:, 2], w[:, 1], w[:, 2], o, -w[:, 0], -w[:, 1], w[:, 0], o]
        return np.stack(rows, 1).reshape(-1, 3, 3)

    x = to_numbers(motion.pose)
    rotation, spin = x[:, 3:].reshape(-1, 3, 3), crossed(motion.twist[:, 3:])
    turns = spin @ rotation, (crossed(motion.acceleration[:, 3:]) + spin @ spin) @ rotation
    rates = [
        np.concatenate([linear[:, :3], turn.reshape(-1, 9)], 1)
        for linear, turn in zip((motion.twist, motion.acceleration), turns, strict=True)
    ]
    return np.concatenate([x, *rates, motion.q, motion.qd, motion.qdd], 1)


def moved(machine, spectrum):
    size = SIZES.get(machine.name, (0.05 * machine.characteristic_length, 0.05))
    return spectrum.smooth(machine, *size)


def agree_along_a_path(machine, motion):
    """A motion's rates serve as derivatives by path length: the forces of ṡ = 1 are its own."""
    every, n = inputs(motion), len(machine.axes)
    x, x1, x2 = np.split(every[:, :36], 3, 1)
    q, q1, q2 = np.split(every[:, 36:], 3, 1)
    motions = (0 * x, 0 * x, 0 * q, 0 * q), (0 * x, x1, 0 * q, q1), (x1, x2, q1, q2)
    expected = [
        machine.force_map(np.concatenate([x, dx, ddx, q, dq, ddq], 1))
        for dx, ddx, dq, ddq in motions
    ]
    found = machine.force_terms_map(every).reshape(-1, 3, n)
    assert np.abs(found - np.stack(expected, 1)).max() < 1e-12 * np.abs(expected).max()


def agree(machine, motion, tolerance):
    expected = forces(machine, motion).force
    found = machine.force_map(inputs(motion))
    assert np.abs(found - expected).max() < tolerance * np.abs(expected).max()
    still = motion_of_poses(machine, motion.pose, near=machine.home_q)
    held = machine.holding_map(np.concatenate([to_numbers(still.pose), still.q], 1))
    assert np.abs(held - forces(machine, still).force).max() < tolerance * np.abs(held).max()
    agree_along_a_path(machine, motion)


def test_forces_are_the_twist_formulation_s(machine, spectrum):
    """Every kind: platform, wrench, a base that leans.

    Jacobians there, transposed derivatives here: rounding only.
    """
    if machine.name == "arm":
        pytest.importorskip("pinocchio")
    agree(machine.carrying(Load(PLATFORM, (), TILTED, WRENCH)), moved(machine, spectrum), 1e-12)


def test_forces_of_legs_are_pinocchio_s(any_hexapod, spectrum):
    """Closed loops with 18 joint forces there, one transposed derivative here."""
    pytest.importorskip("pinocchio")
    loaded = any_hexapod.carrying(Load(PLATFORM, LEG, TILTED, WRENCH))
    agree(loaded, moved(any_hexapod, spectrum), 1e-10)


def test_each_leg_may_be_another(preset, spectrum):
    pytest.importorskip("pinocchio")
    legs = [
        Leg(BARREL, Body(0.1 * (k + 1), ROD.centre, ROD.inertia), [1, 0.2 * k, 0]) for k in range(6)
    ]
    agree(preset.carrying(Load(PLATFORM, legs)), moved(preset, spectrum), 1e-10)


def test_a_tripod_s_legs_take_the_rate_of_their_energy(spectrum):
    """Σ f q̇ = dE/dt to 1e-8 of the largest power; energies from places alone."""
    tripod = load_machine("tripod").carrying(Load(PLATFORM, LEG))
    motion = moved(tripod, spectrum)
    along = tripod.home.apply(tripod.platform) - tripod.base
    total = spectrum.energy(PLATFORM, motion.pose.translation, motion.pose.rotation.as_matrix())
    for k in range(3):
        rest = along[k] / np.linalg.norm(along[k])
        first = LEG.first_axis - (LEG.first_axis @ rest) * rest
        tip = motion.pose.apply(tripod.platform[k])
        z = (tip - tripod.base[k]) / np.linalg.norm(tip - tripod.base[k], axis=1)[:, None]
        y = np.cross(z, first)
        y /= np.linalg.norm(y, axis=1)[:, None]
        frame = np.stack([np.cross(y, z), y, z], 2)
        total = total + spectrum.energy(BARREL, np.tile(tripod.base[k], (len(motion), 1)), frame)
        total = total + spectrum.energy(ROD, tip, frame)
    power = (tripod.force_map(inputs(motion)) * motion.qd).sum(1)
    needed = spectrum.rate(total)
    assert np.abs(power - needed).max() < 1e-8 * np.abs(needed).max()


def test_what_an_axis_carries_by_itself_is_added(preset, spectrum):
    """friction · q̇ + reflected · q̈, to rounding; `forces` adds the same."""
    axes = [
        replace(axis, friction=10.0 * k, reflected=0.1 * k) for k, axis in enumerate(preset.axes)
    ]
    own = Hexapod(preset.base, preset.platform, axes=axes, home=preset.home, load=Load(PLATFORM))
    motion = moved(preset, spectrum)
    extra = own.force_map(inputs(motion)) - preset.carrying(Load(PLATFORM)).force_map(
        inputs(motion)
    )
    expected = 10.0 * np.arange(6) * motion.qd + 0.1 * np.arange(6) * motion.qdd
    assert extra == pytest.approx(expected, rel=1e-9, abs=1e-11)
    agree(own, motion, 1e-12)


def test_what_has_to_be_pushed(preset):
    """A machine without masses, friction or wrench has nothing to push; an arm's links weigh what
    its URDF says.
    """
    assert not preset.loaded
    for load in (Load(PLATFORM), Load(legs=LEG), Load(wrench=WRENCH)):
        assert preset.carrying(load).loaded
    assert not preset.carrying(Load(gravity=TILTED)).loaded
    for field in ("friction", "reflected"):
        axes = [Axis(n) for n in "XYZ"] + [Axis("R", "rotary", **{field: 0.1})]
        assert Traverser(axes=axes, home=RigidTransform.identity()).loaded


def test_another_load_leaves_the_machine_as_it_is(preset):
    pose = RigidTransform.from_components(
        preset.home.translation + np.array([0, 0, 0.02]), Rotation.identity()
    )
    at = np.concatenate([to_numbers(pose), [preset.inverse(pose)]], 1)
    light, heavy = (preset.carrying(Load(Body(mass))) for mass in (1.0, 2.0))
    once = light.holding_map(at)
    assert heavy.carrying(light.load).holding_map(at) == pytest.approx(once, rel=1e-15)
    assert heavy.holding_map(at) == pytest.approx(2 * once, rel=1e-12)
    assert preset.holding_map(at) == pytest.approx(np.zeros((1, 6)), abs=0)


def test_a_singular_pose_gives_no_force():
    """All arms of a tripod in one plane bear nothing across it."""
    tripod = load_machine("tripod").carrying(Load(PLATFORM))
    level = RigidTransform.from_translation([0, 0, tripod.base[0, 2] - tripod.platform[0, 2]])
    at = np.concatenate([to_numbers(level), [tripod.inverse(level)]], 1)
    assert not np.isfinite(tripod.holding_map(at)).any()


@pytest.mark.parametrize(
    ("made", "phrase"),
    [
        (lambda: Load(gravity=[0, 0]), "gravity must be finite numbers"),
        (lambda: Load(wrench=[0, 0, np.nan, 0, 0, 0]), "wrench must be finite numbers"),
        (lambda: load_machine("linkage").carrying(Load(legs=LEG)), "machine linkage has no legs"),
        (
            lambda: load_machine("tripod").carrying(Load(legs=[LEG] * 6)),
            "6 legs with masses; give one for all, or 3",
        ),
        (
            lambda: Axis("z", friction=-1.0),
            "friction must be one finite number not below 0, not -1.0",
        ),
        (lambda: Axis("z", reflected=np.inf), "reflected must be .* not inf"),
    ],
)
def test_loads_that_cannot_be_are_refused(made, phrase):
    with pytest.raises(MotionError, match=phrase):
        made()
