"""LinuxCNC's suite in small: files by its rules are planned, or refused with their line."""

import numpy as np
import pytest

from benchmarks.evidence.peers import linuxcnc_suite
from benchmarks.evidence.peers.linuxcnc_suite import PERIOD, Differences, build_machine, plan_file, read_limits

# Of the shape of LinuxCNC's configs/XYZ.ini.
INI = """
[TRAJ]
LINEAR_UNITS =          inch
# MAX_VELOCITY = 99
[AXIS_0]
MAX_VELOCITY =                  8   # in/s
MAX_ACCELERATION =              30
MIN_LIMIT =                     -40.0
MAX_LIMIT =                     40.0
[JOINT_1]
MAX_VELOCITY = 8
MAX_ACCELERATION = 20
MIN_LIMIT = -40.0
MAX_LIMIT = 40.0
[AXIS_2]
MAX_VELOCITY = 4
MAX_ACCELERATION = 30
MIN_LIMIT = -10.0
MAX_LIMIT = 10.0001
[AXIS_3]
MAX_VELOCITY = 25
"""
# Words of every kind that its files have, none of it from them.
FILES = {
    "violation_checks/arcs.ngc": "G20 G90 G17 G64\n#1=0.5\nF60 G0 X0 Y0\no1 repeat [2]\nG3 X[#1] Y0 I0.25 J0 P2\n"
    "G1 X0 Y0.1\nY0\no1 endrepeat\n/X9\nG18 G2 X0.2 Z0 I0.1\nM30\n",
    "quick/g61.ngc": "G20 G61 F100 M3 S100\nG1 X1\nY1\nX2 Y1.001\nM2\n",
    "quick/bad.ngc": "G20 F10\nG1 X1\nG33 Z1 K0.1\n",
}


@pytest.fixture
def suite(tmp_path):
    for name, text in FILES.items():
        file = tmp_path / "nc_files" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    (tmp_path / "configs").mkdir()
    (tmp_path / "configs" / "XYZ.ini").write_text(INI)
    return tmp_path / "nc_files"


@pytest.fixture
def slides(suite):
    return build_machine(read_limits(suite.parent / "configs" / "XYZ.ini")[0])


def test_a_configuration_is_read(suite):
    limits, unit = read_limits(suite.parent / "configs" / "XYZ.ini")
    assert unit == "inch"
    assert [one.speed for one in limits] == pytest.approx([8 * 0.0254, 8 * 0.0254, 4 * 0.0254])
    assert [one.acceleration for one in limits] == pytest.approx([30 * 0.0254, 20 * 0.0254, 30 * 0.0254])
    assert limits[2].high == pytest.approx(0.25400254)


def test_differences_are_those_of_the_motion_whose_positions_they_are():
    """Of q = a t²/2 and of q = j t³/6: speeds to a half step, acceleration and jerk exactly; in parts as in all."""
    t = np.arange(0, 201) * PERIOD
    q = np.stack([t**2, t**3 / 6], 1)
    limits = np.array([[0.4, 0.04], [4.0, 0.4], [1.0, 2.0]])
    whole, parts = Differences(limits), Differences(limits)
    whole.add(q)
    for part in np.array_split(q, 37):
        parts.add(part)
    np.testing.assert_allclose(parts.largest, whole.largest, rtol=1e-9)
    assert whole.largest[0] == pytest.approx([0.3990 / 0.4, (0.2**2 / 2 - 1e-4) / 0.04], rel=1e-3)
    assert whole.largest[1] == pytest.approx([0.5, 0.199 / 0.4], rel=1e-6)
    assert whole.largest[2, 1] == pytest.approx(0.5, rel=1e-4)


@pytest.mark.parametrize("order", [2, 3])
def test_files_are_planned_in_their_order_or_refused_with_their_line(suite, slides, order):
    files = linuxcnc_suite.find_files(suite)
    assert [file.name for file in files] == ["arcs.ngc", "bad.ngc", "g61.ngc"]
    rows = list(linuxcnc_suite.compare(files, suite, slides, [order], 25e-6, "inch"))
    assert rows[1][2].startswith("line 3: G33 is not supported")
    for file, row in zip(files, rows, strict=True):
        if file.name == "bad.ngc":
            continue
        uses = [float(use) for use in row[4].split(" / ")]
        assert 0.98 < max(uses) <= 1.0001  # differences over a period, printed with four digits
        assert max(uses) <= float(row[3]) + 1e-4
        found = plan_file(file, slides, order, 25e-6, "inch")
        assert float(row[2]) == pytest.approx(found.duration, abs=1e-3)
