"""Weights: every bundled machine at rest at home, with a mass at its platform's origin, against
forces by hand.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import (
    Axis,
    Body,
    Load,
    Traverser,
    forces,
    load_machine,
    machine_toml,
    motion_of_poses,
)

WEIGHT = 100.0
MASS = WEIGHT / 9.80665

# Of a linear delta and of the parallel machines: each leg has the same share of the weight, along
# itself.
PARALLEL = (
    "hexapod",
    "hexapod-initial",
    "tripod",
    "delta",
    "delta-rotary",
    "hexaglide",
    "hexapod-rotary",
)


def rest(machine):
    return motion_of_poses(machine, machine.home)


def forces_at_home(machine, **options):
    return forces(machine, rest(machine), **options).force[0]


@pytest.mark.parametrize(
    ("name", "by_hand"),
    [
        ("traverser", {"X": WEIGHT}),
        ("cartesian", {"Z": WEIGHT}),
        ("corexy", {"z_screw": WEIGHT}),
        ("gantry", {"Z": WEIGHT}),
        ("scara", {"lift": WEIGHT}),
        ("linkage", {}),
    ],
)
def test_slides_carry_the_weight_along_the_vertical(name, by_hand):
    machine = load_machine(name).carrying(Load(Body(MASS)))
    expected = [by_hand.get(axis.name, 0.0) for axis in machine.axes]
    assert forces_at_home(machine) == pytest.approx(expected, abs=1e-9)
    assert forces_at_home(load_machine(name), platform=Body(MASS)) == pytest.approx(
        expected, abs=1e-9
    )


def test_an_arm_s_joints_carry_the_weight_at_its_levers():
    """Shoulder and elbow turn about horizontal axes, upwards: torque = weight · horizontal distance
    to the tool.
    """
    pytest.importorskip("pinocchio")
    arm = load_machine("arm")
    added = forces_at_home(arm, platform=Body(MASS)) - forces_at_home(arm)
    out = np.linalg.norm(arm.home.translation[:2])  # the shoulder stands on the axis of yaw
    elbow = 0.4 * np.cos(np.radians(40))
    assert added == pytest.approx([0, WEIGHT * out, WEIGHT * (out - elbow)], abs=1e-9)


@pytest.mark.parametrize("name", PARALLEL)
def test_the_axes_of_parallel_machines_hold_the_weight(name):
    """Work by hand: a small move of the platform along each coordinate costs Σ f Δq = weight ·
    Δz.
    """
    machine = load_machine(name).carrying(Load(Body(MASS)))
    force = forces_at_home(machine)
    step = 1e-6
    for k, component in enumerate(machine.freedom):
        turned = Rotation.from_rotvec(step * np.eye(3)[k - 3]) if k >= 3 else Rotation.identity()
        moved = step * np.eye(3)[k] if k < 3 else np.zeros(3)
        up, down = (
            RigidTransform.from_components(
                machine.home.translation + sign * moved,
                (turned if sign > 0 else turned.inv()) * machine.home.rotation,
            )
            for sign in (1, -1)
        )
        change = machine.inverse(up, near=machine.home_q) - machine.inverse(
            down, near=machine.home_q
        )
        rise = WEIGHT if component == "z" else 0.0
        assert force @ change / (2 * step) == pytest.approx(rise, abs=1e-5 * WEIGHT)


def test_the_fifty_pounds_of_the_source_hang_on_x():
    """A vertical slide of 50 lb [Sasidhar 1981]: 222.4 N."""
    machine = load_machine("traverser").carrying(Load(Body(50 * 0.45359237)))
    assert forces_at_home(machine)[0] == pytest.approx(222.4, abs=0.05)
    assert forces_at_home(machine)[1:] == pytest.approx([0, 0, 0], abs=1e-12)


AXES = [Axis(name, travel=(-1, 1), pulse=1e-5) for name in "XYZ"] + [
    Axis("R", kind="rotary", pulse=1e-3)
]


def test_gravity_follows_a_slide_x_of_another_direction():
    """X along z of the base: still the vertical one.

    A wrench, and gravity that is stated, stay as they are.
    """
    upright = Traverser(
        axes=AXES,
        home=RigidTransform.identity(),
        directions=[[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        load=Load(Body(MASS)),
    )
    assert forces_at_home(upright) == pytest.approx([WEIGHT, 0, 0, 0], abs=1e-9)
    assert upright.gravity == pytest.approx([0, 0, -9.80665], abs=0)
    stated = upright.carrying(Load(Body(MASS), gravity=[0, -9.80665, 0]))
    assert forces_at_home(stated) == pytest.approx([0, WEIGHT, 0, 0], abs=1e-9)


@pytest.mark.parametrize("gravity", [None, [0, 0, -9.80665]])
@pytest.mark.parametrize("complete", [False, True])
def test_a_written_machine_keeps_its_gravity(tmp_path, gravity, complete):
    machine = Traverser(
        axes=AXES, home=RigidTransform.identity(), load=Load(Body(MASS), gravity=gravity)
    )
    file = tmp_path / "machine.toml"
    file.write_text(machine_toml(machine, complete=complete), "utf-8")
    assert load_machine(file).gravity == pytest.approx(machine.gravity, abs=0)
    assert forces_at_home(load_machine(file)) == pytest.approx(forces_at_home(machine), abs=1e-12)
