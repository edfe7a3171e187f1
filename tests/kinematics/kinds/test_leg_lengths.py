"""Hexapods as a table of joint coordinates states them: plain numbers, and legs by their
lengths.
"""

import re

import numpy as np
import pytest

from kinematics import FileError, load_machine, machine_toml
from kinematics.machine.machine_file import read_summary

JOINTS = """
base_joints = [
    [298.64, 63.03, 28.56], [-94.34, 290, 28.47], [-204.39, 226.62, 28.37],
    [-203.59, -226.63, 28.45], [-94.29, -290.17, 28.34], [298.28, -63.34, 28.46],
]
platform_joints = [
    [156.16, 140.5, -22], [43.82, 205.47, -22.05], [-199.74, 64.95, -21.81],
    [-199.75, -64.92, -21.9], [43.57, -205.44, -21.91], [156.12, -140.51, -21.93],
]
"""
LENGTHS = 'leg_length = ["498 mm", "698 mm"]'


@pytest.fixture
def write(tmp_path):
    """Write a machine file and return its path."""

    def write_file(head='length = "mm"', joints=JOINTS, home="[0, 0, 625]", axes=LENGTHS, more=""):
        path = tmp_path / "mine.toml"
        path.write_text(
            f'schema = 1\nkind = "hexapod"\n{head}\n[geometry]{joints}home = {{ to = {home} }}\n'
            f'[axes]\n{axes}\npulse = "1 um"\nmax_speed = "50 mm/s"\nmax_acceleration = "500 mm/s^2"\n{more}'
        )
        return path

    return write_file


def refused(path):
    with pytest.raises(FileError) as error:
        load_machine(path)
    return str(error.value)


def test_plain_numbers_have_the_unit_of_the_file(write):
    machine = load_machine(write())
    with_units = re.sub(r"(-?\d+(?:\.\d+)?)", r'"\1 mm"', JOINTS)
    other = load_machine(write(head="", joints=with_units, home='["0 mm", "0 mm", "625 mm"]'))
    np.testing.assert_allclose(machine.base, other.base, rtol=1e-15)  # rounding of the unit
    np.testing.assert_allclose(machine.platform, other.platform, rtol=1e-15)
    np.testing.assert_allclose(machine.base[0], [0.29864, 0.06303, 0.02856], rtol=1e-15)
    inches = load_machine(
        write(head='length = "in"', home="[0, 0, 625]", axes='travel = ["-1 mm", "1 mm"]')
    )
    np.testing.assert_allclose(inches.base, 25.4 * machine.base, rtol=1e-14)


def test_leg_lengths_are_those_of_the_legs_at_the_ends_of_travel(write):
    machine = load_machine(write())
    for axis, length in zip(machine.axes, machine.home_q, strict=True):
        assert length + axis.travel[0] == pytest.approx(0.498, abs=1e-15)
        assert length + axis.travel[1] == pytest.approx(0.698, abs=1e-15)
    assert np.ptp([axis.travel[0] for axis in machine.axes]) > 1e-5  # these legs differ at home
    assert read_summary(write()).axes == machine.axes
    plain = load_machine(write(axes="leg_length = [498, 698]"))
    for one, other in zip(plain.axes, machine.axes, strict=True):
        np.testing.assert_allclose(one.travel, other.travel, rtol=0, atol=1e-15)


def test_one_leg_may_have_its_own_lengths_or_travel(write):
    common = load_machine(write()).axes
    own = '[[axis]]\nname = "leg3"\nleg_length = [500, 690]\n[[axis]]\nname = "leg4"\ntravel = ["-1 mm", "2 mm"]\n'
    machine = load_machine(write(more=own))
    assert machine.axes[3].travel == (-0.001, 0.002)
    assert machine.home_q[2] + machine.axes[2].travel[0] == pytest.approx(0.5, abs=1e-15)
    assert [axis for n, axis in enumerate(machine.axes) if n not in (2, 3)] == [
        axis for n, axis in enumerate(common) if n not in (2, 3)
    ]
    every = "".join(f'[[axis]]\nname = "leg{n}"\n{LENGTHS}\n' for n in range(1, 7))
    assert load_machine(write(axes="", more=every)).axes == common


def test_a_machine_by_lengths_is_written_and_read_again(write, tmp_path):
    machine = load_machine(write())
    (tmp_path / "again.toml").write_text(machine_toml(machine))
    again = load_machine(tmp_path / "again.toml")
    assert again.axes == machine.axes
    assert (again.base == machine.base).all()


@pytest.mark.parametrize("home", ["[0, 0, 300]", "[0, 0, 0]", "[0, 0, 900]"])
def test_an_unreachable_home_names_heights_that_fit(write, home):
    text = refused(write(home=home))
    assert text.startswith(f"{write(home=home)}:")
    assert "geometry.home" in text
    assert re.search(r"6 of 6 legs do not reach home: leg\d is [\d.]+ mm long there", text)
    assert "leg_length is 498 mm to 698 mm" in text
    low, high, middle = (
        float(number)
        for number in re.search(
            r"between ([\d.]+) mm and ([\d.]+) mm, such as ([\d.]+) mm", text
        ).groups()
    )
    for height in (low + 1e-3, high - 1e-3, middle):
        load_machine(write(home=f"[0, 0, {height}]"))
    for height in (low - 1e-2, high + 1e-2):
        refused(write(home=f"[0, 0, {height}]"))


def test_swapped_rows_are_suspected_where_some_legs_reach_home(write):
    """A wrong height would put all legs of a symmetric machine out of reach."""
    lengths = 'leg_length = ["580 mm", "610 mm"]'
    load_machine(write(axes=lengths))
    first, second = "[156.16, 140.5, -22]", "[43.82, 205.47, -22.05]"
    swapped = JOINTS.replace(first, "first").replace(second, first).replace("first", second)
    text = refused(write(joints=swapped, axes=lengths))
    assert "2 of 6 legs do not reach home" in text
    assert "the others do: leg1 and leg2 are 644.3" in text
    assert "all legs would be 596.87" in text
    assert "check whether their rows are swapped in one of the lists" in text
    unequal = JOINTS.replace("[43.82, 205.47, -22.05]", "[43.82, 205.47, 21.05]")
    assert "check the order of the legs first" in refused(write(joints=unequal, axes=lengths))
    assert "the others do" not in refused(write(home="[0, 0, 300]"))


def test_a_hanging_platform_is_told_heights_below(write):
    text = refused(write(home="[0, 0, -100]"))
    height = float(re.search(r"such as (-[\d.]+) mm", text)[1])
    assert (
        load_machine(write(home=f"[0, 0, {height}]"))
        .check(np.array([[0, 0, height / 1e3]]))
        .ok.all()
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"head": ""}, r'298.64: a number without a unit: add the line length = "mm" at the top'),
        (
            {"head": 'length = "m"'},
            r"no z of home.to changes that: check the units, and the order of the legs",
        ),
        (
            {"axes": "leg_length = [698, 498]"},
            r"\[698, 498\]: empty range: the first value must be the smaller: swap",
        ),
        (
            {"axes": f'travel = ["0 mm", "9 mm"]\n{LENGTHS}'},
            r"travel and leg_length exclude each other: give one",
        ),
        (
            {"axes": ""},
            r'axes.travel: missing: write e.g. \["0 mm", "50 mm"\], counted from home, or leg_length = ',
        ),
        (
            {"joints": JOINTS.replace("[298.64, 63.03, 28.56], ", "")},
            r"has 5 entries instead of 6: give six rows",
        ),
        (
            {"joints": JOINTS.replace(" -22]", "]")},
            r"platform_joints\[1\]: \[156.16, 140.5\] has 2 entries instead",
        ),
        (
            {"joints": JOINTS.replace("298.64", "298,64")},
            r"has 4 entries instead of 3: .* with decimal points",
        ),
        ({"joints": JOINTS.replace("63.03", "63,03")}, r"a decimal comma is written as a point: "),
        (
            {"joints": re.sub(r"-2[12](?:\.\d+)?\]", "603]", JOINTS)},
            r"if they are in the base frame, state them in",
        ),
        (
            {"home": "[0, 0]"},
            r"geometry.home.to: \[0, 0\] has 2 entries instead of 3: give x, y, z",
        ),
    ],
)
def test_mistakes_of_the_first_hour_have_a_remedy(write, change, message):
    path = write(**change)
    text = refused(path)
    assert re.search(message, text)
    assert re.match(rf"{re.escape(str(path))}:\d+: ", text)
