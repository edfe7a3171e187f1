"""References from files: what they say is what the host commands, and what is wrong with them is
named.
"""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from benchmarks.sweep import Grid, read_setting, sweep
from benchmarks.sweep.run import Digests
from controllers import load_rig
from controllers.reference_file import Recorded, estimate_speed
from controllers.simulate import sample
from kinematics import FileError

HEAD = """
schema = 1
machine = "arm"
card = { model = "PCI-8164", speed_range = "100000 1/s" }
[servo]
gear = { ratio = 74 }
position_gain = "30 1/s"
speed_loop = "30 Hz"
integral_time = "30 ms"
rotor_inertia = "4.49e-6 kg*m^2"
torque_limit = "0.955 N*m"
counts = 8192
sample = "0.25 ms"
[[task]]
name = "recorded"
reference = "own.csv"
"""


@pytest.fixture
def load(tmp_path):
    def from_text(table, rate='step = "50 ms"'):
        (tmp_path / "own.csv").write_text(table)
        (tmp_path / "mine.toml").write_text(f"{HEAD}{rate}\n")
        return load_rig(tmp_path / "mine.toml")

    return from_text


T = np.linspace(0, 4, 41)
YAW, YAW_SPEED = 30 * np.sin(T), 30 * np.cos(T)
ELBOW = 10 * (1 - np.cos(2 * T))


def table(speeds=True, delimiter=", ", start=0.0):
    names = ["time [s]", "yaw [deg]", "Elbow [deg]"] + ["yaw speed [deg/s]"] * speeds
    rows = [names]
    for t, yaw, rate, elbow in zip(T, YAW, YAW_SPEED, ELBOW, strict=True):
        rows.append(
            [f"{value:.15g}" for value in (t + start, yaw, elbow, *([rate] if speeds else []))]
        )
    return "\n".join(delimiter.join(row) for row in rows) + "\n"


@pytest.mark.parametrize("delimiter", [", ", ";"])
def test_positions_and_speeds_are_those_of_the_file(load, delimiter):
    rig = load(table(delimiter=delimiter, start=7.0))
    task = rig.task("recorded")
    assert task.dt == 0.05
    assert task.motion.duration == pytest.approx(4.0)
    state = task.motion.at(T)
    moved = np.rad2deg(state.q - rig.machine.home_q)
    np.testing.assert_allclose(moved[:, 0], YAW, atol=1e-9)
    np.testing.assert_allclose(moved[:, 2], ELBOW, atol=1e-9)
    assert not moved[:, 1].any()
    np.testing.assert_allclose(np.rad2deg(state.qd[:, 0]), YAW_SPEED, atol=1e-9)
    # and what the host gets of it, in pulses of 1/(2048·74) turn
    reference = sample(task.motion, rig.machine, task.dt)
    np.testing.assert_allclose(reference.position[::2, 0], YAW / 360 * 2048 * 74, atol=1e-6)
    np.testing.assert_allclose(reference.speed[::2, 0], YAW_SPEED / 360 * 2048 * 74, atol=1e-6)


def test_between_samples_it_is_the_hermite_cubic(load):
    """By scipy; with speeds it is within h⁴/384 of the sine: 30° · 0.1⁴/384 = 8e-6°."""
    rig = load(table())
    t = np.linspace(0, 4, 1001)
    state = rig.task("recorded").motion.at(t)
    moved = np.rad2deg(state.q - rig.machine.home_q)[:, 0]
    own = CubicHermiteSpline(T, YAW, YAW_SPEED)
    np.testing.assert_allclose(moved, own(t), atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(state.qd[:, 0]), own(t, 1), atol=1e-8)
    inside = slice(1, -1)
    np.testing.assert_allclose(
        np.rad2deg(state.qdd[inside, 0])[::7], own(t[inside], 2)[::7], atol=1e-6
    )
    assert np.abs(moved - 30 * np.sin(t)).max() < 8.1e-6
    # without stated speeds the parabolas' are h²/6 of the third derivative off: 30° · 0.01/6 =
    # 0.05°/s
    plain = load(table(speeds=False)).task("recorded").motion.at(T).qd[:, 0]
    assert np.abs(np.rad2deg(plain) - YAW_SPEED)[1:-1].max() < 0.051


def test_a_pause_is_left_as_it_is():
    """Where the speed is not stated, a pause swings by no more than its neighbours ask for."""
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    x = np.array([0.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    motion = Recorded(np.zeros(1), t, x[:, None], estimate_speed(t, x)[:, None])
    pause = motion.at(np.linspace(2, 3, 101)).q
    np.testing.assert_allclose(pause, 1.0, atol=1e-12)
    assert motion.at(np.linspace(0, 5, 501)).q.max() < 1.2
    # at rest before and after
    outside = motion.at(np.array([-1.0, 9.0]))
    np.testing.assert_allclose(outside.q[:, 0], [0.0, 0.0], atol=1e-12)
    assert not outside.qd.any()


def test_samples_divide_the_files_own_time(load):
    assert load(table(), "samples = 81").task("recorded").dt == pytest.approx(0.05)


def test_a_sweep_runs_it_and_knows_it_by_its_content(load, tmp_path):
    rig = load(table())
    grid = Grid((read_setting("3"),), ("recorded",))
    (first, *_) = sweep(grid, rig, tmp_path / "runs").results.values()
    assert first.failure == ""
    # ṙ/K behind: 30°/s / 30 1/s = 1° at most, 0.017 rad
    assert 0.005 < first.figures["tracking_rms"] < 0.03
    other = load(table().replace("\n4, ", "\n4.5, "))
    assert Digests(other).tasks != Digests(rig).tasks


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("", 1, "no header"),
        ("time [s], yaw [deg]\n", 1, "0 rows below the header"),
        ("time [s], yaw [deg]\n0, 1\n", 1, "1 rows below the header"),
        ("yaw [deg]\n1\n2\n", 1, "no column time"),
        ("time [s]\n1\n2\n", 1, "no column with the position of an axis"),
        ("time [s], yow [deg]\n0, 1\n1, 2\n", 1, 'nearest is "yaw"'),
        ("time [s], yaw\n0, 1\n1, 2\n", 1, r'has no unit: write e.g. "yaw \[deg\]"'),
        ("time [s], yaw [mm]\n0, 1\n1, 2\n", 1, "mm"),
        ("time [s], yaw [deg], yaw [rad]\n0, 1, 1\n1, 2, 1\n", 1, "yaw appears twice"),
        (
            "time [s], yaw [deg], elbow speed [deg/s]\n0, 1, 1\n1, 2, 1\n",
            1,
            "elbow speed without elbow",
        ),
        ("time [s], yaw [deg]\n0, 1\n0, 2\n", 3, "time 0 s does not rise from 0 s"),
        ("time [s], yaw [deg]\n0, 1\n1, nan\n", 3, '"nan" is not a finite number'),
        ("time [s], yaw [deg]\n0, 1\n1, x\n", 3, '"x" is not a finite number'),
        ("time [s], yaw [deg]\n0, 1\n1, 2, 3\n", 3, "3 values for 2 columns"),
        ("time [h], yaw [deg]\n0, 1\n1000, 2\n", 3, "beyond 1e\\+06 s"),
        ("position [deg]\n1\n", 1, 'column "position'),
    ],
)
def test_what_is_wrong_with_a_file_is_named_with_its_line(load, text, line, reason):
    with pytest.raises(FileError, match=rf"own\.csv:{line}: .*{reason}"):
        load(text)


def test_a_file_that_is_not_there_is_named(load, tmp_path):
    (tmp_path / "mine.toml").write_text(f'{HEAD.replace("own.csv", "none.csv")}step = "50 ms"\n')
    with pytest.raises(FileError, match=r"task\[1\]\.reference: .*none\.csv: No such file"):
        load_rig(tmp_path / "mine.toml")
