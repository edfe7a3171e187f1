"""Measurement files: the thesis' own, every way to say a pose, and every fault told in one pass."""

from importlib.resources import files

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics import FileError, MotionError, load_measurements

CMM = (files("kinematics.calibration") / "presets" / "cmm.toml").read_text(encoding="utf-8")
WHOLE = '[[pose]]\ncommanded = [1, 2, 3, 4, 5, 6]\nmeasured = ["1.1 mm", "79 mil", 3, 4, "0.1 rad", 6]\n'


@pytest.fixture
def load(tmp_path):
    def loaded(text):
        path = tmp_path / "measured.toml"
        path.write_text(text, encoding="utf-8")
        return load_measurements(path)

    return loaded


@pytest.fixture
def faults(load):
    def found(text):
        with pytest.raises(FileError) as raised:
            load(text)
        return str(raised.value)

    return found


def test_the_tables_of_the_thesis():
    """[Sahbaz 2007, Tables 6.2 to 6.4]: eight poses, one turn."""
    data = load_measurements("cmm")
    assert len(data) == 9
    np.testing.assert_array_equal(data.fit, [True] * 8 + [False])
    assert data.labels[0] == "pose 1 (6.2)"
    assert data.labels[8] == "rotation 1 (6.4)"
    assert data.noise is None
    # error = desired - measured; mm and µm
    np.testing.assert_allclose(data.commanded.translation[4], [5e-3, 5e-3, 35e-3], rtol=1e-15)
    np.testing.assert_allclose(
        data.measured.translation[4],
        np.array([5e-3, 5e-3, 35e-3]) - [20.4429e-6, -98.5143e-6, -459.5e-6],
        rtol=1e-12,
    )
    # the measured z axis has the measured direction angles, to their redundancy
    angles = np.rad2deg(np.arccos(data.measured.rotation.as_matrix()[8][:, 2]))
    np.testing.assert_allclose(angles, [97.3239, 95.8442, 9.34232], atol=0.05)
    turned = data.commanded.rotation[8].as_matrix()
    np.testing.assert_allclose(
        turned, Rotation.from_euler("XYZ", [6, -7, 0], degrees=True).as_matrix(), atol=1e-15
    )
    np.testing.assert_array_equal(data.seen[0], [True] * 3 + [False] * 3 + [True] * 2)
    np.testing.assert_array_equal(data.seen[8], [False] * 6 + [True] * 2)
    np.testing.assert_allclose(data.spread[3, :3], [5e-6, 3e-6, 3.8e-6], rtol=1e-12)


@pytest.mark.parametrize("axis", [[1e-3, 2e-3, 1], [0.3, -0.2, 0.9], [-0.5, 0.5, 0.7]])
def test_direction_angles_give_the_turn_that_has_them(load, axis):
    angles = np.rad2deg(np.arccos(axis / np.linalg.norm(axis))).tolist()
    data = load(
        f"[[pose]]\ndesired = [0, 0, 10, {angles[0]!r}, {angles[1]!r}, {angles[2]!r}]\nerror = [0, 0, 0, 0, 0, 0]"
    )
    for pose in (data.commanded, data.measured):
        matrix = pose.rotation.as_matrix()[0]
        np.testing.assert_allclose(matrix[:, 2], axis / np.linalg.norm(axis), atol=1e-12)
        # no turn about itself: the last of the angles about the moving axes is zero
        assert pose.rotation.as_euler("XYZ")[0, 2] == pytest.approx(0, abs=1e-12)


def test_whole_poses_and_positions_with_any_units(load):
    data = load(WHOLE + "[[pose]]\ncommanded = [0, 0, 0, 0, 0, 0]\nmeasured = [0, 0, 0.5]\n")
    np.testing.assert_allclose(
        data.measured.translation[0], [1.1e-3, 79 * 25.4e-6, 3e-3], rtol=1e-14
    )
    angles = [np.deg2rad(4), 0.1, np.deg2rad(6)]
    np.testing.assert_allclose(data.measured.rotation[0].as_euler("XYZ"), angles, rtol=1e-12)
    np.testing.assert_array_equal(data.seen, [[True] * 6 + [False] * 2, [True] * 3 + [False] * 5])


def test_declared_units(load):
    text = 'length = "in"\nangle = "rad"\nerror = "mil"\n[noise]\nposition = "5 um"\nrotation = "20 arcsec"\n'
    text += "[[pose]]\ndesired = [1, 0, 0, 1.5707963267948966, 1.5707963267948966, 0]\nerror = [2, 0, 0, 0, 0, 0]\n"
    data = load(text)
    assert data.measured.translation[0, 0] == pytest.approx(0.0254 - 2 * 25.4e-6, rel=1e-14)
    assert data.noise.position == pytest.approx(5e-6)
    assert data.noise.rotation == pytest.approx(np.deg2rad(20 / 3600))


LEVEL = "[[pose]]\ndesired = [0, 0, 10, 90, 90, 0]\nerror = [0, 0, 0, 0, 0, 0]\n"
BAD = {
    "nothing measured": ("", ["pose", "missing"]),
    "empty": ("pose = []", ["at least one [[pose]]"]),
    "not a number": (
        LEVEL.replace("10", "nan"),
        ["measured.toml:2: pose[1].desired[3]", "nan", "not a finite number"],
    ),
    "too short": (
        LEVEL.replace(", 0]", "]", 1),
        ["pose[1].desired: [", "has 5 entries instead of 6"],
    ),
    "too long": (
        LEVEL.replace("[0, 0, 10", "[0, 0, 0, 10"),
        ["pose[1].desired", "7 entries instead of 6"],
    ),
    "no direction": (
        LEVEL.replace("90, 90, 0", "90, 90, 90"),
        ["desired", "not direction angles of an axis", "cos²"],
    ),
    "error of metres": (
        LEVEL.replace("[0, 0, 0, 0", "[0, 0, 0, 60"),
        ["pose[1]", "not direction angles of an axis"],
    ),
    "both ways": (LEVEL + "measured = [0, 0, 0]\n", ["pose[1]", "exclude each other"]),
    "unknown key": (LEVEL + "sprad = [0, 0, 0, 0, 0, 0]\n", ["measured.toml:4", "sprad", "spread"]),
    "unknown table": (LEVEL + "[[rotaton]]\n", ["rotaton", 'nearest is "rotation"']),
    "another dimension": (
        LEVEL.replace("10", '"10 deg"'),
        ["pose[1].desired[3]", "not convertible to mm"],
    ),
    "unit of another": ('length = "deg"\n' + LEVEL, ["measured.toml:1: length", "not convertible"]),
    "noise of nothing": (
        LEVEL + '[noise]\nposition = "0 um"\nrotation = "1 urad"\n',
        ["noise.position", "above 0"],
    ),
    "theta is another turn": (
        LEVEL + "[[rotation]]\ntheta = [6, -7, 0]\ndesired = [90, 90, 0]\nerror = [0, 0, 0]\n",
        ["rotation[1]", "desired is not the direction of z after theta, 97"],
    ),
    "two faults at once": (LEVEL.replace("10", "inf") + "n = 0\n", ["desired[3]", "pose[1].n"]),
}


@pytest.mark.parametrize(("text", "told"), BAD.values(), ids=BAD)
def test_faults(faults, text, told):
    message = faults(text)
    for part in told:
        assert part in message


def test_names(tmp_path):
    with pytest.raises(MotionError, match='no measurement file is called "cnm", nearest is "cmm"'):
        load_measurements("cnm")
    with pytest.raises(FileError, match=r"none\.toml"):
        load_measurements(tmp_path / "none.toml")


def test_the_shape_of_the_thesis_file_needs_no_key_of_ours(load):
    """As it was published: without schema, units or the position of the turn."""
    assert "schema" not in CMM
    assert load(CMM.replace("at = [0, 0, 25]\n", "")).commanded.translation[8].tolist() == [0, 0, 0]
    assert load("schema = 1\n" + CMM).commanded.translation[8].tolist() == [0, 0, 0.025]


def test_arrays_and_numbers_that_are_too_large(faults):
    told = faults("[[pose]]\ncommanded = [1, 2, 3, 4, 5, 6]\nmeasured = [1, 2, 3, 4, 5, 6, 7]\n")
    assert "measured: [1, 2, 3, 4, 5, 6, 7] has 7 entries instead of 6" in told
    told = faults("[[pose]]\ncommanded = [1, 2, 3, 4, 5, 6]\nmeasured = [1e300, 2, 3]\n")
    assert ":3: pose[1].measured[1]: 1e+300 must be at least -1e+06 mm and at most 1e+06 mm" in told
    told = faults('[noise]\nposition = "5 um"\n' + WHOLE)
    assert 'noise.rotation: missing: write e.g. "20 urad"' in told


def test_what_the_file_leaves_open_is_noted(load):
    text = CMM.replace("\nat = [0, 0, 25]", "")
    assert text != CMM
    (note,) = load(text).notes
    assert note == "rotation 1: the file gives no position `at` of the rotation, so home is assumed"
    assert load_measurements("cmm").notes == ()
