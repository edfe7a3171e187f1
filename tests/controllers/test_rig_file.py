"""Rig files: the bundled ones say what the thesis says, and a faulty one says everything that is
wrong with it.
"""

from importlib.resources import files

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from controllers import load_rig, rig_names
from controllers.rig import Sine, disturb_rig
from kinematics import FileError, MotionError

TEXT = (files("controllers") / "presets" / "servo-rig.toml").read_text()


@pytest.fixture
def load(tmp_path):
    def from_text(text):
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return load_rig(path)

    return from_text


@pytest.mark.parametrize("name", rig_names())
def test_every_preset_is_a_rig_whose_tasks_are_motions_of_its_machine(name):
    rig = load_rig(name)
    assert rig.name == name
    assert rig.tasks
    for task in rig.tasks:
        q = task.motion.at(np.linspace(0, task.motion.duration, 5)).q
        assert q.shape == (5, len(rig.machine.axes))


def test_the_thesis_rig_is_table_7_4():
    rig = load_rig("servo-rig")
    yaw, shoulder, elbow = rig.drives
    assert yaw == shoulder
    assert [(d.position_gain, d.speed_loop, d.integral_time) for d in (yaw, elbow)] == [
        (30, 30, 0.03),
        (20, 20, 0.045),
    ]
    # Pn103: the load's inertia over the rotor's; the motor's side is 74 times as fast as the axis
    assert yaw.inertia == pytest.approx(4.49e-6 * (1 + 11.8) * 74**2, rel=1e-12)
    assert yaw.torque_limit == pytest.approx(0.955 * 74, rel=1e-12)
    # 2048 pulses and 2048 x 4 counts a turn of the motor
    for drive, axis in zip(rig.drives, rig.machine.axes, strict=True):
        assert drive.encoder * axis.pulse == pytest.approx(4.0, rel=1e-9)
        assert 2 * np.pi / axis.pulse == pytest.approx(2048 * 74, rel=1e-9)


def test_the_thesis_reference_is_its_line_in_its_time():
    """From (0.51171, 0.3705, 0) to (0, 0.5, 0.3) m in 5 s, straight; 41 samples of 0.125 s; V₀ of
    Appendix B.
    """
    rig = load_rig("servo-rig")
    line = rig.task("line")
    assert line.dt == 0.125
    t = np.linspace(0, 5, 41)
    state = line.motion.at(t)
    place = rig.machine.forward(state.q, near=state.pose).pose.translation
    start, end = np.array([0.51171, 0.3705, 0]), np.array([0, 0.5, 0.3])
    np.testing.assert_allclose(place[[0, -1]], [start, end], atol=1e-12)
    along = (end - start) / np.linalg.norm(end - start)
    away = (place - start) - np.outer((place - start) @ along, along)
    assert np.abs(away).max() < 1e-12
    omega = np.pi / 2
    top = np.linalg.norm(end - start) / (2 / omega + 5 - 2)
    # the profile's parts of constant jerk follow the sine to 2.3e-6 of its largest speed
    assert np.linalg.norm(state.tool_velocity[20]) == pytest.approx(top, rel=3e-6)
    assert np.linalg.norm(state.tool_velocity[4]) == pytest.approx(
        top * np.sin(omega / 2), rel=3e-6
    )


def test_the_second_reference_is_its_sine():
    rig = load_rig("servo-rig")
    sine = rig.task("sine")
    assert isinstance(sine.motion, Sine)
    assert sine.dt == 0.05025
    t = np.array([0.0, 5.0, 10.0, 20.0])
    moved = np.rad2deg(sine.motion.at(t).q - rig.machine.home_q)
    np.testing.assert_allclose(moved[:, 0], 360 * np.sin(np.pi * t / 20), atol=1e-9)
    assert not moved[:, 2].any()


def test_a_path_with_corners_rests_in_them():
    square = load_rig("servo-rig").task("square").motion
    breaks = square.path.breaks
    for corner in breaks[1:-1]:
        at = square.knots[:-1][np.isclose(square.s, corner, rtol=0, atol=1e-12)]
        assert np.abs(square.at(at).qd).max() < 1e-12


def test_a_disturbed_rig_has_drives_that_do_not_know():
    rig = load_rig("servo-rig")
    other = disturb_rig(rig, inertia=1.3, friction=0.7)
    assert other.drives[0].inertia == rig.drives[0].inertia
    assert other.drives[0].inertia_factor == 1.3
    assert other.drives[0].coulomb == pytest.approx(0.7 * rig.drives[0].coulomb)


def test_all_faults_are_told_at_once_with_their_lines(load):
    broken = (
        TEXT.replace('speed_loop = "30 Hz"', 'speed_lop = "30 Hz"')
        .replace('position_gain = "20 1/s"', 'position_gain = "20 mm"')
        .replace('name = "elbow"', 'name = "elbo"')
        .replace('model = "PCI-8164"', 'model = "PCI-8146"')
        .replace('name = "circle-back"', 'name = "circle"')
        .replace("samples = 41", 'samples = 41\nstep = "1 s"')
    )
    with pytest.raises(FileError) as refusal:
        load(broken)
    told = {fault.key: fault for fault in refusal.value.faults}
    assert 'nearest is "speed_loop"' in told["servo.speed_lop"].message
    assert told["servo.speed_loop"].message.startswith("missing: write e.g.")
    assert "not convertible" in told["axis[1].servo.position_gain"].message
    assert 'nearest is "elbow"' in told["axis[1].name"].message
    assert 'nearest is "PCI-8164"' in told["card.model"].message
    assert "already" in told["task[4].name"].message
    assert "either step" in told["task[1]"].message
    lines = broken.splitlines()
    assert "speed_lop" in lines[told["servo.speed_lop"].line - 1]


def test_faults_of_tasks_are_told_with_the_others(load):
    broken = (
        TEXT.replace('speed_loop = "30 Hz"', 'speed_lop = "30 Hz"')
        .replace('program = "arm-line"', 'program = "arm-lin"')
        .replace('"yaw", "shoulder"', '"yaw", "sholder"')
    )
    with pytest.raises(FileError) as refusal:
        load(broken)
    told = {fault.key: fault.message for fault in refusal.value.faults}
    assert set(told) == {
        "servo.speed_lop",
        "servo.speed_loop",
        "task[1].program",
        "task[2].sine.axes[2]",
    }
    assert 'nearest is "arm-line"' in told["task[1].program"]
    assert 'nearest is "shoulder"' in told["task[2].sine.axes[2]"]
    lines = [fault.line for fault in refusal.value.faults]
    assert lines == sorted(lines)


@pytest.mark.parametrize(
    ("change", "key", "words"),
    [
        (('machine = "arm"', 'machine = "leg"'), "machine", "no machine is called"),
        (('machine = "arm"\n', ""), "machine", "missing: write the name of a machine"),
        (
            ('gear = { ratio = 74, play = "2 arcmin" }', ""),
            "servo.gear",
            "missing: write e.g. { ratio = 74 }",
        ),
        (
            ("gear = { ratio", 'screw = { lead = "2 mm" }\ngear = { ratio'),
            "servo.screw",
            "are rotary: give a gear",
        ),
        (("[servo]", "[stepper]"), "axis[1].servo.gear", "missing"),
        (
            ('program = "arm-line"', 'program = "arm-lin"'),
            "task[1].program",
            'nearest is "arm-line"',
        ),
        (('ramp = "1 s"', 'ramp = "3 s"'), "task[1]", "does not fit twice"),
        (
            ('"yaw", "shoulder"', '"yaw", "sholder"'),
            "task[2].sine.axes[2]",
            'nearest is "shoulder"',
        ),
        (('timer = "counter"', 'timer = "clock"'), "host.timer", "is not"),
    ],
)
def test_what_is_wrong_is_named(load, change, key, words):
    with pytest.raises(FileError) as refusal:
        load(TEXT.replace(*change))
    found = {fault.key: fault.message for fault in refusal.value.faults}
    assert words in found[key]


def test_unknown_names_are_told_with_the_nearest():
    with pytest.raises(MotionError, match='nearest is "servo-rig"'):
        load_rig("servorig")
    pytest.importorskip("pinocchio")
    with pytest.raises(MotionError, match='nearest is "circle"'):
        load_rig("servo-rig").task("circel")


def test_files_beside_a_rig_are_found(load, tmp_path):
    (tmp_path / "path.toml").write_text(
        (files("planner") / "presets" / "arm-line.toml").read_text()
    )
    rig = load(TEXT.replace('program = "arm-line"', 'program = "path.toml"'))
    assert rig.task("line").motion.duration == pytest.approx(5.0)


@settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.integers(0, len(TEXT)),
    st.integers(0, 12),
    st.one_of(
        st.text(max_size=4),
        st.sampled_from(
            [
                "nan",
                "-1",
                "1e999",
                "[",
                "]]",
                "{",
                '"',
                "[[axis]]\n",
                "[stepper]\n",
                "true",
                '"inf s"',
            ]
        ),
    ),
)
def test_any_damage_to_a_file_is_a_rig_or_a_motion_error(load, at, cut, patch):
    damaged = TEXT[:at] + patch + TEXT[at + cut :]
    try:
        outcome = len(load(damaged.encode("utf-8", "replace").decode()).drives)
    except MotionError as refusal:
        outcome = str(refusal)
    assert outcome == 3 or isinstance(outcome, str), "a rig of the arm's three axes, or a refusal"


def test_a_card_is_set_as_the_file_says(load):
    card = load(
        TEXT.replace('speed_range = "100000 1/s"', 'speed_range = "50 kHz", while_moving = "queue"')
    ).card
    assert (card.name, card.while_moving) == ("PCI-8164", "queue")
    assert card.speed_range == pytest.approx(5e4)
    options = 'start_from = "current", short_moves = "keep time"'
    card = load(TEXT.replace('speed_range = "100000 1/s"', options)).card
    assert (card.start_from, card.short_moves, card.speed_range) == ("current", "keep time", None)
    options = 'current_speed = "magnitude", while_moving = "queue"'
    text = TEXT.replace('speed_range = "100000 1/s"', options)
    text = text.replace("seed = 1 }", 'seed = 1, speed_from = "card", closing_stop = "1 ms" }')
    rig = load(text)
    assert (rig.card.current_speed, rig.host.speed_from, rig.host.closing_stop) == (
        "magnitude",
        "card",
        1e-3,
    )
    plain = load(
        TEXT.replace('{ model = "PCI-8164", speed_range = "100000 1/s" }', '"PCI-8164"')
    ).card
    assert plain.speed_range is None
