"""Machine files: the preset's figures, the two ways to give a geometry, overrides per axis, and
faults.
"""

from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import FileError, MotionError, load_machine, machine_names
from kinematics.foundation.names import find
from kinematics.machine.machine_file import read_summary

WHOLE = (files("kinematics") / "presets" / "hexapod.toml").read_text(encoding="utf-8")
PRESET = WHOLE.partition("[platform]")[0]
"""Without its masses, so that its last table is [axes]."""


@pytest.fixture
def load(tmp_path):
    def loaded(text):
        path = tmp_path / "rig.toml"
        path.write_text(text, encoding="utf-8")
        return load_machine(path)

    return loaded


def joint(radius, azimuth, height):
    """A point on a circle, in degrees: the few lines of [Sahbaz 2007] again, independent of the
    package.
    """
    return [radius * np.cos(np.deg2rad(azimuth)), radius * np.sin(np.deg2rad(azimuth)), height]


BASE = [joint(0.149, a, 0.0115) for a in (15, 105, 135, 225, 255, 345)]
PLATFORM = [joint(0.1, a, -0.011) for a in (30, 90, 150, 210, 270, 330)]


def test_the_preset_has_the_figures_of_the_thesis():
    machine = load_machine("hexapod")
    assert machine.name == "hexapod"
    assert [axis.name for axis in machine.axes] == [f"leg{n}" for n in range(1, 7)]
    for axis in machine.axes:
        assert (axis.kind, axis.travel, axis.pulse, axis.direction) == (
            "linear",
            (0.0, 0.0508),
            0.75e-6,
            -1,
        )
        assert (axis.max_speed, axis.max_acceleration, axis.max_jerk, axis.max_force) == (
            0.02,
            0.225,
            4.0,
            220.0,
        )
        assert axis.torque_speed is None
        assert axis.max_pulse_rate is None
    np.testing.assert_allclose(machine.max_tilt, np.deg2rad(35), rtol=1e-15)
    np.testing.assert_array_equal(machine.home.as_matrix()[:3, 3], [0, 0, 0.2336362])
    # printed to 0.1 µm: 219.0774 mm, all six
    np.testing.assert_allclose(machine.home_q, 0.2190774, atol=0.5e-7)


def test_the_preset_s_legs_are_the_distances_between_its_joints():
    position, rotation = np.array([0.01, -0.02, 0.26]), Rotation.from_rotvec([0.1, -0.2, 0.05])
    legs = position + rotation.apply(PLATFORM) - BASE
    q = load_machine("hexapod").inverse(RigidTransform.from_components(position, rotation))
    np.testing.assert_allclose(q, np.linalg.norm(legs, axis=1), rtol=1e-14)


def points(rows):
    return (
        "["
        + ", ".join("[" + ", ".join(f'"{x!r} m"' for x in map(float, row)) + "]" for row in rows)
        + "]"
    )


def with_geometry(geometry):
    """The preset with another [geometry]."""
    head, rest = PRESET.split("[geometry]")
    return f"{head}[geometry]\n{geometry}\n[axes]{rest.split('[axes]')[1]}"


def test_joints_may_be_given_one_by_one(load):
    geometry = f"""
base_joints = {points(BASE)}
platform_joints = {points(PLATFORM)}
home = {{ to = ["0 mm", "0 mm", "233.6362 mm"] }}
base_rest = [0, 0, 2]
platform_rest = {[[0, 0.1, 1]] * 6}
max_tilt = ["35 deg", "20 deg"]
"""
    machine = load(with_geometry(geometry))
    preset = load_machine("hexapod")
    assert machine.name == "rig"
    np.testing.assert_allclose(machine.base, preset.base, atol=1e-15)
    np.testing.assert_allclose(machine.platform, preset.platform, atol=1e-15)
    np.testing.assert_allclose(machine.max_tilt, np.deg2rad([35] * 6 + [20] * 6), rtol=1e-15)
    np.testing.assert_allclose(machine.base_rest, [[0, 0, 1]] * 6)
    np.testing.assert_allclose(machine.platform_rest, [np.array([0, 0.1, 1]) / np.sqrt(1.01)] * 6)


def test_home_turns_about_the_moving_axes(load):
    rotated = PRESET.replace(
        'rotate = ["0 deg", "0 deg", "0 deg"]', 'rotate = ["90 deg", "0 deg", "90 deg"]'
    )
    # Rx(90°) takes y to z, z to -y; Rz(90°) before it takes x to y: x -> y -> z
    np.testing.assert_allclose(load(rotated).home.rotation.apply([1, 0, 0]), [0, 0, 1], atol=1e-15)


def test_an_axis_table_overrides_what_it_states(load):
    machine = load(
        PRESET
        + '[[axis]]\nname = "leg3"\nmax_speed = "18 mm/s"\ndirection = 1\nmax_pulse_rate = "3000 1/s"\n'
    )
    changed = {
        axis.name: (axis.max_speed, axis.direction, axis.max_pulse_rate, axis.max_jerk)
        for axis in machine.axes
    }
    assert changed.pop("leg3") == (0.018, 1, 3000.0, 4.0)
    assert set(changed.values()) == {(0.02, -1, None, 4.0)}


def own_pulses(names):
    return "".join(
        f'\n[[axis]]\nname = "{name}"\npulse = "{n} um"\n' for n, name in enumerate(names, 1)
    )


def test_a_pulse_of_all_axes_is_needed_only_where_an_axis_has_none_of_its_own(load):
    """Of a kind whose axes are all alike, and of one whose turning axis has a table of its own."""
    bare = "\n".join(
        line for line in PRESET.splitlines() if not line.startswith(("pulse =", "drive ="))
    )
    legs = [f"leg{n}" for n in range(1, 7)]
    assert [axis.pulse for axis in load(bare + own_pulses(legs)).axes] == pytest.approx(
        np.arange(1, 7) * 1e-6
    )
    with pytest.raises(FileError, match=r"axes\.pulse: missing"):
        load(bare + own_pulses(legs[:-1]))
    whole = (files("kinematics") / "presets" / "traverser.toml").read_text(encoding="utf-8")
    common, rest = whole.partition("[[axis]]")[0].split("[rotary]")
    slides = "\n".join(
        line for line in common.splitlines() if not line.startswith(("pulse =", "drive ="))
    )
    made = load(f"{slides}\n[rotary]{rest}" + own_pulses("XYZ"))
    assert [axis.pulse for axis in made.axes][:3] == pytest.approx([1e-6, 2e-6, 3e-6])
    assert made.axes[3].pulse == load(whole).axes[3].pulse
    with pytest.raises(FileError, match=r"axes\.pulse: missing"):
        load(f"{slides}\n[rotary]{rest}" + own_pulses("XY"))


@pytest.mark.parametrize("steps", [24, 48, 93, 100, 200, 400, 96, 768, 4800, 51_200])
def test_drives_have_the_steps_of_the_motors_in_the_source(load, steps):
    """[KMITL 2005, table 2.1]: 400, 200, 100, 93, 48 and 24 steps per revolution, here also divided
    by a drive.
    """
    (pulse,) = [line for line in PRESET.splitlines() if line.startswith(("pulse =", "drive ="))]
    machine = load(PRESET.replace(pulse, f'drive = {{ steps = {steps}, lead = "6 mm" }}'))
    assert machine.axes[0].pulse == pytest.approx(6e-3 / steps, rel=1e-15)
    arm = (files("kinematics") / "presets" / "traverser.toml").read_text(encoding="utf-8")
    head, rotary = arm.split("[rotary]")
    turning = load(head + "[rotary]" + rotary.replace("steps = 400", f"steps = {steps}"))
    assert turning.axes[3].pulse == pytest.approx(2 * np.pi / steps, rel=1e-15)


def test_a_gear_of_a_screw_divides_its_pulse(load):
    """[Motion 2-D]: N = 200 R n (l - l0), with the gear ratio R and n threads per unit of
    length.
    """
    (pulse,) = [line for line in PRESET.splitlines() if line.startswith(("pulse =", "drive ="))]
    ratio, threads = 3.5, 500.0  # per m
    machine = load(
        PRESET.replace(pulse, f'drive = {{ steps = 200, lead = "2 mm", gear = {ratio} }}')
    )
    assert 1e-3 / machine.axes[0].pulse == pytest.approx(200 * ratio * threads * 1e-3, rel=1e-14)
    for wrong in ("0.0", "-2.0", "inf", '"two"', "1e7"):
        with pytest.raises(FileError, match=r"axes\.drive\.gear"):
            load(PRESET.replace(pulse, f'drive = {{ steps = 200, lead = "2 mm", gear = {wrong} }}'))


def test_a_bound_may_differ_towards_smaller_and_greater_positions(load):
    sided = PRESET.replace('max_speed = "20 mm/s"', 'max_speed = ["18 mm/s", "20 mm/s"]')
    own = '[[axis]]\nname = "leg2"\nmax_jerk = ["2 m/s^3", "3 m/s^3"]\n'
    axes = load(sided + own).axes
    assert {axis.max_speed for axis in axes} == {(0.018, 0.02)}
    assert [axis.max_jerk for axis in axes[:3]] == [4.0, (2.0, 3.0), 4.0]
    for wrong in (
        '["18 mm/s"]',
        '["18 mm/s", "0 mm/s"]',
        '["1 mm/s", "1 mm/s", "1 mm/s"]',
        '["18 mm", "20 mm/s"]',
    ):
        with pytest.raises(FileError, match="max_speed"):
            load(PRESET.replace('max_speed = "20 mm/s"', f"max_speed = {wrong}"))


def test_bands_of_resonance_rise(load):
    stated = 'resonance = [["3 mm/s", "4 mm/s"], ["7 mm/s", "8 mm/s"]]\nresonance_time = "50 ms"\n'
    axis = load(PRESET + stated).axes[0]
    assert (axis.resonance, axis.resonance_time) == (((0.003, 0.004), (0.007, 0.008)), 0.05)
    for wrong in (
        "[]",
        '[["4 mm/s", "3 mm/s"]]',
        '[["3 mm/s", "5 mm/s"], ["4 mm/s", "6 mm/s"]]',
        '[["0 mm/s", "1 mm/s"]]',
    ):
        with pytest.raises(FileError, match="resonance"):
            load(PRESET + f"resonance = {wrong}\n")
    with pytest.raises(MotionError, match="resonance_time without resonance"):
        load(PRESET + 'resonance_time = "50 ms"\n')


def test_bands_of_resonance_in_pulse_rate_are_speeds_of_each_axis(load):
    """180 pulses/s of 0.75 µm are 0.135 mm/s; an axis of another pulse, or behind a gear, has other
    speeds there.
    """
    stated = 'resonance = [["180 1/s", "0.22 kHz"]]\nresonance_time = "50 ms"\n'
    own = '[[axis]]\nname = "leg3"\npulse = "1.5 um"\n[[axis]]\nname = "leg4"\nelectronic_gear = [3, 2]\n'
    axes = load(PRESET + stated + own).axes
    for axis, pulse in zip(
        axes, (0.75e-6, 0.75e-6, 1.5e-6, 0.5e-6 * 9 / 4, 0.75e-6, 0.75e-6), strict=True
    ):
        assert axis.pulse == pytest.approx(pulse)
        assert axis.resonance == (pytest.approx((180 * pulse, 220 * pulse)),)
    for wrong, told in (
        ('[["180 1/s", "1 mm/s"]]', "mixes speeds and pulse rates"),
        ('[["220 1/s", "180 1/s"]]', "rising and apart"),
        ('[["0 1/s", "180 1/s"]]', "must be above 0 1/s"),
        ('[["180", "220 1/s"]]', "resonance"),
        ('[["10 deg/s", "20 deg/s"]]', "resonance"),
    ):
        with pytest.raises(FileError, match=told):
            load(PRESET + f"resonance = {wrong}\n")


def test_a_torque_curve_is_pairs_of_speed_and_force(load):
    curve = 'torque_speed = [["0 mm/s", "220 N"], ["10 mm/s", "50 lbf"]]\n'
    assert load(PRESET + curve).axes[5].torque_speed == ((0.0, 220.0), (0.01, 222.411080763025))


LOADED = """\
friction = "20 N*s/m"
reflected = "300 g"
[platform]
mass = "1.3 kg"
inertia = ["100 kg*cm^2", "0.01 kg*m^2", "0.018 kg*m^2"]
force = ["0 N", "0 N", "-10 N"]
[legs]
barrel = { mass = "200 g", centre = ["0 mm", "0 mm", "60 mm"] }
rod = { mass = "41 g" }
"""


def test_masses_are_stated_in_tables(load):
    machine = load(
        PRESET.replace("[geometry]", 'gravity = ["0 m/s^2", "0 m/s^2", "9.8 m/s^2"]\n[geometry]')
        + LOADED
    )
    own = machine.load
    assert {(axis.friction, axis.reflected) for axis in machine.axes} == {(20.0, 0.3)}
    assert (own.platform.mass, own.legs[0].barrel.mass, own.legs[0].rod.mass) == (1.3, 0.2, 0.041)
    np.testing.assert_allclose(own.platform.inertia, np.diag([0.01, 0.01, 0.018]), rtol=1e-15)
    np.testing.assert_allclose(own.legs[0].barrel.centre, [0, 0, 0.06], rtol=1e-15)
    np.testing.assert_array_equal(own.wrench, [0, 0, -10, 0, 0, 0])
    np.testing.assert_array_equal(own.gravity, [0, 0, 9.8])
    np.testing.assert_array_equal(load(PRESET).load.gravity, [0, 0, -9.80665])
    assert not load(PRESET).loaded


def test_masses_that_no_rigid_body_has_are_a_fault(load):
    with pytest.raises(FileError, match="no rigid body's") as refusal:
        load(PRESET + '[platform]\nmass = "1 kg"\ninertia = ["1 kg*m^2", "0 kg*m^2", "0 kg*m^2"]\n')
    assert [fault.key for fault in refusal.value.faults] == ["platform"]


@pytest.mark.parametrize(
    ("text", "line", "key", "phrase"),
    [
        ("schema = 1\n", 1, "kind", "missing; kinds: "),
        (
            'schema = 1\nkind = "hexpod"\n',
            2,
            "kind",
            '"hexpod" is not a kind of machine, nearest is "hexapod"',
        ),
        ("schema = 1\nkind = [1]\n", 2, "kind", "is not a kind of machine"),
        (
            with_geometry('home = { to = ["0 m", "0 m", "1 m"] }'),
            None,
            "geometry",
            "incomplete: give base_radius, ",
        ),
        (
            with_geometry(f'base_gap = "1 deg"\nbase_joints = {points(BASE)}'),
            None,
            "geometry",
            "base_gap and base_joints exclude each other",
        ),
        # its square is beyond any float
        (
            PRESET.replace('"149 mm"', '"1e203 mm"'),
            10,
            "geometry.base_radius",
            "too large: at most 1e+08 mm",
        ),
    ],
)
def test_what_makes_no_machine_is_a_fault(load, text, line, key, phrase):
    with pytest.raises(FileError) as refusal:
        load(text)
    (fault,) = refusal.value.faults
    assert fault.key == key
    assert phrase in fault.message
    expected = line if line is not None else text.splitlines().index("[geometry]") + 1
    assert fault.line == expected


def test_names_are_the_bundled_files():
    assert "hexapod" in machine_names()
    for name in machine_names():
        assert load_machine(name).name == name


@pytest.mark.parametrize("name", machine_names())
def test_the_summary_of_a_file_is_that_of_its_machine(name):
    """Read without the machine, but for the shapers that a [[vibration]] gives its axes."""
    machine = load_machine(name)
    summary = read_summary(find("kinematics", "machine", name))
    assert [replace(axis, shaper=None) for axis in summary.axes] == [
        replace(axis, shaper=None) for axis in machine.axes
    ]
    assert summary.freedom == machine.freedom
    assert (summary.name, summary.kind) == (name, type(machine).__name__.lower())


def test_an_unknown_name_brings_the_nearest_and_all_others():
    with pytest.raises(MotionError) as refusal:
        load_machine("hexpod")
    assert 'no machine is called "hexpod", nearest is "hexapod"; bundled: arm, cartesian, ' in str(
        refusal.value
    )
    assert not isinstance(refusal.value, FileError)


def test_a_path_is_never_taken_for_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for path in ("hexapod.toml", "./hexapod", "folder/hexapod", tmp_path / "hexapod"):
        with pytest.raises(FileError):
            load_machine(path)
    (tmp_path / "hexapod.toml").write_text(PRESET.replace("20 mm/s", "10 mm/s"), encoding="utf-8")
    assert load_machine("hexapod.toml").axes[0].max_speed == 0.01
    assert load_machine("hexapod").axes[0].max_speed == 0.02


def test_wiring_is_by_axis(load):
    """[Sahbaz 2007]: motors 1 and 2 on a two-axis card, 3 to 6 on a four-axis one."""
    wired = [(axis.card, axis.channel) for axis in load_machine("hexapod").axes]
    assert wired == [("PCI-8132", 0), ("PCI-8132", 1), *(("PCI-8164", n) for n in range(4))]
    assert {(axis.card, axis.channel) for axis in load_machine("tripod").axes} == {(None, None)}
    with pytest.raises(FileError, match=r'"leg7" is no axis.*axes: leg1, leg2'):
        load(PRESET.replace('leg6 = ["PCI', 'leg7 = ["PCI'))
    with pytest.raises(FileError, match=r"wiring.leg6\[2\]"):
        load(PRESET.replace('leg6 = ["PCI-8164", 3]', 'leg6 = ["PCI-8164", -1]'))


def test_a_word_that_a_bundled_machine_has_is_no_kind_but_the_way_to_its_file(tmp_path):
    (tmp_path / "mine.toml").write_text('schema = 1\nkind = "corexy"\n')
    with pytest.raises(
        FileError,
        match=r'"corexy" is not a kind .* a machine of kind "equations": .*--machine corexy',
    ):
        load_machine(tmp_path / "mine.toml")


def test_copies_of_a_bundled_machine_share_its_maps_and_have_axes_of_their_own():
    one = load_machine("tripod")
    other = load_machine("tripod")
    assert other.inverse_map is one.inverse_map
    one.axes = tuple(replace(axis, max_speed=1e-3) for axis in one.axes)
    assert other.axes == load_machine("tripod").axes != one.axes
