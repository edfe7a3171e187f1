"""LinuxCNC's suite in small: files by its rules are planned, or refused with their line."""

import pytest

from benchmarks.evidence.cases import linuxcnc_suite
from benchmarks.evidence.cases.linuxcnc_suite import read_machine

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
    "violation_checks/arcs.ngc": "G20 G90 G17 G64\n#1=0.5\nF60 G0 X0 Y0\no1 repeat [2]\n"
    "G3 X[#1] Y0 I0.25 J0 P2\nG1 X0 Y0.1\nY0\no1 endrepeat\n/X9\nG18 G2 X0.2 Z0 I0.1\nM30\n",
    "quick/g61.ngc": "G20 G61 F100 M3 S100\nG1 X1\nY1\nX2 Y1.001\nM2\n",
    "quick/bad.ngc": "G20 F10\nG1 X1\nG33 Z1 K0.1\n",
}


@pytest.fixture
def folder(tmp_path):
    for name, text in FILES.items():
        file = tmp_path / "nc_files" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    (tmp_path / "configs").mkdir()
    (tmp_path / "configs" / "XYZ.ini").write_text(INI)
    return tmp_path / "nc_files"


def test_a_configuration_is_read(folder):
    machine, unit = read_machine(folder.parent / "configs" / "XYZ.ini")
    assert unit == "inch"
    x, y, z, _ = machine.axes
    inch = 0.0254
    speeds = [axis.max_speed / inch for axis in (x, y, z)]
    accelerations = [axis.max_acceleration / inch for axis in (x, y, z)]
    assert speeds == pytest.approx([8, 8, 4])
    assert accelerations == pytest.approx([30, 20, 30])
    assert z.travel[1] == pytest.approx(0.25400254)


def test_files_are_planned_or_refused_with_their_line(folder):
    blocks = linuxcnc_suite.measure(folder)
    rows = {(name, order): cells for name, order, *cells in next(blocks).rows}
    assert len(rows) == 2 * len(FILES)
    for (name, order), (segments, duration, proved, *uses, _, refusal) in rows.items():
        if name == "quick/bad.ngc":
            assert refusal.startswith("line 3: G33 is not supported")
            continue
        assert refusal is None
        assert segments > 2
        assert 0 < duration < 100
        assert uses[2:] == [None] or order == 3
        largest = max(use for use in uses if use is not None)
        assert 0.98 < largest <= 1 + 1e-6  # differences are means over a period
        assert largest <= proved + 1e-6 <= 1 + 2e-6
    assert [row[:3] for row in next(blocks).rows] == [[2, 2, 1], [3, 2, 1]]
