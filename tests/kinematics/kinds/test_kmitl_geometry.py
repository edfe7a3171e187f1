"""The geometry file of [KMITL 2005]: columns as its reader takes them, and the machine that they
are.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import FileError, load_machine

POINTS = {
    "Past": (173.205, 0, 0), "Pand": (-86.602, 150, 0), "Pard": (-86.602, -150, 0),
    "Pbst": (34.641, 0, -250), "Pbnd": (-17.32, 30, -250), "Pbrd": (-17.32, -30, -250), "Cent": (0, 0, -250),
}  # fmt: skip
LENGTHS = {"Endeffector": 50, "Lengtherror": 0}


def seven(value):
    """A number in seven characters."""
    return f"{value:.6f}"[:7]


def text_of(points=POINTS, lengths=LENGTHS, unit=1):
    lines = [f"{key} {seven(x)} {seven(y)}{seven(z)}" for key, (x, y, z) in points.items()]
    lines += [f"{key:<12}{value}" for key, value in lengths.items()]
    return "\r\n".join([*lines, f"BLU {unit}", ""])


@pytest.fixture
def load(tmp_path):
    def loaded(text, name="Basiclength.txt"):
        (tmp_path / name).write_bytes(text.encode())
        return load_machine(tmp_path / name)

    return loaded


def test_the_preset_s_own_numbers_make_the_preset(load):
    """The preset's geometry, to the three decimals of the file: its joints, its home and its
    arms.
    """
    found, known = load(text_of()), load_machine("tripod")
    np.testing.assert_allclose(found.base, known.base, atol=0.7e-6)
    np.testing.assert_allclose(found.platform, known.platform, atol=0.7e-6)
    np.testing.assert_allclose(found.home.translation, [0, 0, -0.3], atol=1e-12)
    np.testing.assert_allclose(found.home_q, known.home_q, atol=1e-6)
    assert (found.name, found.axes) == ("Basiclength", known.axes)
    assert found.check(found.home).ok.all()


def test_the_plate_hangs_below_its_joints_and_the_end_point_below_the_plate(load):
    """Leng lowers the plate and its centre, Ende the end point; the arms are as long as the points
    say.
    """
    points = {**POINTS, "Cent": (1, 2, -250)}
    machine = load(text_of(points, {"Endeffector": 40, "Lengtherror": 7.5}))
    np.testing.assert_allclose(machine.home.translation, [1e-3, 2e-3, -0.2975], atol=1e-12)
    base, plate = (
        np.array([POINTS[key] for key in keys])
        for keys in (("Past", "Pand", "Pard"), ("Pbst", "Pbnd", "Pbrd"))
    )
    np.testing.assert_allclose(
        machine.home_q * 1e3, np.linalg.norm(plate - base, axis=1), rtol=1e-9
    )


def test_a_pyramid_that_stands_has_joints_that_point_up(load):
    turned = {key: (x, y, -z) for key, (x, y, z) in POINTS.items()}
    machine = load(text_of(turned))
    assert (machine.base_rest[:, 2] > 0).all()
    assert machine.check(machine.home).tilt.max() < np.pi / 3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("150.000", "150,000"), r":2: Pand: columns 14 to 20 .* \"150,000\""),
        (lambda text: text.replace("Pard -86.602 -150.00", "Pard -86.602-150.00 "), r":3: Pard: \"-\" stands outside"),
        (lambda text: text + "Past 1.00000 1.00000 1.00000\r\n", ":11: Past: appears twice"),
        (lambda text: text.replace("Cent", "Zent"), r":7: \"Zent\" begins no line of this file, nearest is \"Cent\""),
        (lambda text: text.replace("Endeffector 50", ""), "missing: Ende; each begins"),
        (lambda text: text.replace("Endeffector 50", "Endeffector fifty"), r":8: Ende: columns 13 to 21 .* \"fifty\""),
        (lambda text: text.replace("-250.00", "0.00000"), "singular"),
        (lambda text: text.replace("BLU 1", "BLU 1\xff"), "BLU"),
    ],
)  # fmt: skip
def test_faults_are_told_with_line_and_columns(load, change, words):
    text = change(text_of())
    assert text != text_of()
    with pytest.raises(FileError, match=words):
        load(text)


def test_a_toml_file_by_another_suffix_is_still_one(load):
    from importlib.resources import files

    preset = (files("kinematics") / "presets" / "tripod.toml").read_text()
    assert load(preset, "mine.txt").axes == load_machine("tripod").axes


def test_arm_lengths_are_those_of_the_machine_where_it_keeps_its_plate_and_of_any_pose_else():
    machine = load_machine("tripod")
    places = machine.home.translation + np.array([[0, 0, 0], [0.02, -0.01, 0.03]])
    held = RigidTransform.from_translation(places)
    np.testing.assert_allclose(machine.arm_lengths(held), machine.inverse(held), rtol=1e-14)
    np.testing.assert_allclose(machine.arm_lengths(machine.home), machine.home_q, rtol=1e-14)
    # joint by joint, R = Ry · Rz · Rx about the end point as [KMITL 2005, roll] writes it out
    alpha, theta, beta = 0.2, -0.1, 0.3
    rx, ry, rz = (
        Rotation.from_euler(axis, angle).as_matrix()
        for axis, angle in zip("xyz", (beta, alpha, theta), strict=True)
    )
    turned = RigidTransform.from_components(places[1], Rotation.from_matrix(ry @ rz @ rx))
    ca, sa, ct, st, cb, sb = (
        np.cos(alpha),
        np.sin(alpha),
        np.cos(theta),
        np.sin(theta),
        np.cos(beta),
        np.sin(beta),
    )
    for arm in range(3):
        x, y, z = machine.platform[arm]
        joint = places[1] + [
            x * ca * ct - y * ca * st * cb + y * sa * sb + z * ca * st * sb + z * sa * cb,
            x * st + y * ct * cb - z * ct * sb,
            -x * sa * ct + y * sa * st * cb + y * ca * sb - z * sa * st * sb + z * ca * cb,
        ]
        length = np.linalg.norm(joint - machine.base[arm])
        assert machine.arm_lengths(turned)[arm] == pytest.approx(length, rel=1e-14)
