"""Written machine files: read back, they are the same machine."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import (
    Axis,
    Body,
    Disc,
    Hexapod,
    Leg,
    Load,
    MotionError,
    Traverser,
    load_machine,
    machine_toml,
)

PER_AXIS = [
    {},
    {"pulse": 0.76253e-6, "direction": -1},
    {"max_speed": 1 / 3, "torque_speed": ((0.0, 220.0), (0.07, 1 / 7))},
    {"travel": (-0.01, 1 / 30), "resonance": ((0.003, 0.004),), "resonance_time": 1 / 7},
    {
        "max_pulse_rate": 3000.0,
        "max_force": 1e5 / 7,
        "resonance": ((0.003, 0.01 / 3), (0.007, 0.008)),
    },
    {
        "max_acceleration": (9.80665, 1 / 7),
        "max_jerk": (1e-9, 1.0),
        "friction": 1 / 7,
        "reflected": 0.3,
    },
]


@pytest.fixture
def again(tmp_path):
    def read(machine, comment=""):
        path = tmp_path / "machine.toml"
        path.write_text(machine_toml(machine, comment), encoding="utf-8")
        return load_machine(path)

    return read


def same(a, b):
    """What the files hold as it is comes back exactly; matrices and unit vectors to rounding."""
    np.testing.assert_array_equal(a.base, b.base)
    np.testing.assert_array_equal(a.platform, b.platform)
    assert a.axes == b.axes
    np.testing.assert_array_equal(a.max_tilt, b.max_tilt)
    np.testing.assert_allclose(a.home.as_matrix(), b.home.as_matrix(), atol=1e-15)
    np.testing.assert_allclose(a.home_q, b.home_q, rtol=1e-14)
    for rest in ("base_rest", "platform_rest"):
        np.testing.assert_allclose(getattr(a, rest), getattr(b, rest), atol=1e-15)


def test_the_zoo_comes_back(any_hexapod, again):
    axes = [replace(axis, travel=(-0.05, 0.05)) for axis in any_hexapod.axes]
    machine = Hexapod(
        any_hexapod.base,
        any_hexapod.platform,
        axes=axes,
        home=any_hexapod.home,
        base_rest=any_hexapod.base_rest,
        platform_rest=any_hexapod.platform_rest,
        max_tilt=(float(any_hexapod.max_tilt[0]), float(any_hexapod.max_tilt[6])),
    )
    same(again(machine), machine)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(1e-9, 1e3))
def test_any_numbers_come_back(tmp_path_factory, seed, size):
    random = np.random.default_rng(seed)
    home = RigidTransform.from_components(size * random.normal(size=3), Rotation.random(rng=random))
    axes = [
        Axis(f"leg{n}", travel=(-size, 2 * size), pulse=size * 1e-5 * random.uniform(0.1, 1))
        for n in range(1, 7)
    ]
    points = size * random.normal(size=(2, 6, 3))
    machine = Hexapod(*points, axes=axes, home=home, max_tilt=random.uniform(0.1, 3))
    path = tmp_path_factory.mktemp("written") / "machine.toml"
    path.write_text(machine_toml(machine), encoding="utf-8")
    same(load_machine(path), machine)


def test_every_field_of_an_axis_comes_back(preset, again):
    axes = [
        Axis(f"leg{n}", **{"travel": (0.0, 0.0508), "pulse": 0.75e-6, **own})
        for n, own in enumerate(PER_AXIS, start=1)
    ]
    machine = Hexapod(preset.base, preset.platform, axes=axes, home=preset.home)
    same(again(machine), machine)


def test_what_takes_up_room_comes_back(preset, again):
    room = {
        "leg_radius": 0.0304,
        "leg_ends": 0.0,
        "base_disc": Disc(0.174, 0.011, (0.0, 0.001, -0.002), (0.0, 0.1, 1.0)),
    }
    machine = Hexapod(preset.base, preset.platform, axes=preset.axes, home=preset.home, **room)
    bodies = again(machine).bodies
    assert (bodies.leg_radius, bodies.leg_ends, bodies.platform_disc) == (0.0304, 0.0, None)
    assert (bodies.base_disc.radius, bodies.base_disc.thickness) == (0.174, 0.011)
    np.testing.assert_allclose(bodies.base_disc.normal, machine.bodies.base_disc.normal, atol=1e-15)
    np.testing.assert_array_equal(bodies.base_disc.centre, [0.0, 0.001, -0.002])


def test_what_it_moves_comes_back(preset, again):
    moments = [[3e-4, 1e-6, 0], [1e-6, 3e-4, -2e-6], [0, -2e-6, 1e-5]]
    leg = Leg(Body(0.2, [0, 1e-3, 0.06], moments), Body(1 / 7), [0.3, 1, 0])
    load = Load(
        Body(4 / 3, [0, 0, 0.1], np.diag([0.1, 0.2, 0.15])),
        leg,
        [0.1, 0, 9.8],
        [0, 1, -10, 0.2, 0, 0],
    )
    found = again(preset.carrying(load)).load
    pairs = [(found.platform, load.platform)]
    pairs += [(getattr(found.legs[0], part), getattr(leg, part)) for part in ("barrel", "rod")]
    for a, b in pairs:
        assert a.mass == b.mass
        np.testing.assert_array_equal(a.centre, b.centre)
        np.testing.assert_array_equal(a.inertia, b.inertia)
    for name in ("gravity", "wrench"):
        np.testing.assert_array_equal(getattr(found, name), getattr(load, name))
    np.testing.assert_array_equal(found.legs[0].first_axis, leg.first_axis)
    with pytest.raises(
        MotionError, match="legs of different masses have no place in a machine file"
    ):
        machine_toml(preset.carrying(Load(legs=[leg] * 6)))


def test_the_preset_comes_back_under_a_comment(preset, again):
    text = machine_toml(preset, "two\nlines")
    assert text.startswith("# two\n# lines\nschema = 1\n")
    assert 'pulse = "0.75 um"' in text
    assert text.count("pulse") == 1  # all axes share it
    same(again(preset, "two\nlines"), preset)
    assert again(preset).bodies is not None


def test_what_a_file_cannot_say(preset):
    endless = [replace(axis, travel=(-inf, inf)) for axis in preset.axes]
    with pytest.raises(MotionError, match="leg1 has unlimited travel"):
        machine_toml(Hexapod(preset.base, preset.platform, axes=endless, home=preset.home))

    renamed = [replace(axis, name=f"strut{n}") for n, axis in enumerate(preset.axes)]
    with pytest.raises(
        MotionError, match=r"axes are called strut0, .* in a file of a hexapod they are leg1"
    ):
        machine_toml(Hexapod(preset.base, preset.platform, axes=renamed, home=preset.home))
    pytest.importorskip("pinocchio")
    with pytest.raises(MotionError, match="kind arm cannot be written"):
        machine_toml(load_machine("arm"))


@pytest.mark.parametrize("name", ["tripod", "linkage", "traverser"])
def test_other_kinds_come_back(name, again):
    """With everything that an axis may state: drives become pulses; wiring, backlash and lead
    errors stay.
    """
    machine, back = load_machine(name), again(load_machine(name))
    assert back.axes == machine.axes
    np.testing.assert_allclose(back.home.as_matrix(), machine.home.as_matrix(), atol=1e-15)
    np.testing.assert_allclose(back.home_q, machine.home_q, rtol=1e-14)
    assert back.characteristic_length == pytest.approx(machine.characteristic_length, rel=1e-14)
    moved = machine.home * RigidTransform.from_translation(
        [0.01, -0.005, 0.02 if name != "linkage" else 0]
    )
    np.testing.assert_allclose(back.inverse(moved), machine.inverse(moved), rtol=1e-13)
    np.testing.assert_allclose(back.check(moved).tilt, machine.check(moved).tilt, atol=1e-13)


def test_odd_directions_and_wiring_come_back(again):
    machine = load_machine("traverser")
    axes = [
        replace(axis, card="PCI-8164", channel=n, direction=-1)
        for n, axis in enumerate(machine.axes)
    ]
    odd = Traverser(
        axes=axes, home=machine.home, directions=[[1, 0, 0.1], [0, 1, 0], [0, 0, -2]], length=0.3
    )
    back = again(odd)
    assert back.axes == odd.axes
    np.testing.assert_allclose(back.directions, odd.directions, atol=1e-15)
