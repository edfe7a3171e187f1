"""The files of the three-armed machine: read by its own program's rules, retold here line by
line.
"""

import re
from itertools import pairwise

import numpy as np
import pytest

from kinematics import MotionError, load_machine
from planner import Arc, Dwell, Line, Program, plan
from planner.export.format import ExportSource
from planner.export.formats import kmitl
from planner.export.formats.kmitl import KEYS, KmitlArms, KmitlByte, KmitlPositions, cut_number

FIXED = np.array([[173.2050808, 0, 0], [-86.6025404, 150, 0], [-86.6025404, -150, 0]])
MOVED = np.array([[34.6410162, 0, 0], [-17.3205081, 30, 0], [-17.3205081, -30, 0]])
"""Joints of base and plate, mm, from the machine file; the end point is 50 mm below the plate."""


def arms(end_points):
    """Arm lengths (N, 3) in mm at end points (N, 3): Sqr of the sums of squares, as the source has
    them.
    """
    joints = end_points[:, None] + [0, 0, 50] + MOVED
    return np.sqrt(((joints - FIXED) ** 2).sum(2))


@pytest.fixture(scope="module")
def source():
    """A line, a rest, a circle of 2 mm, and a slope; from the home pose at (0, 0, -300) mm."""
    bend = Arc([0, 0, 0], [0, 0, 1], 2 * np.pi)
    made = plan(
        Program((Line([0.002, 0, 0]), Dwell(0.1), bend, Line([0, 0.001, 0.003]))),
        load_machine("tripod"),
    )
    return ExportSource("a */ ☃\n", made.machine, made.trajectory, made.pulses)


def read_arms(path):
    """Command26_Click: columns 9 to 13 are the number, 14 to 20 the length; numbers rise from
    10001.
    """
    lengths, m = [], 10_001
    row = {}
    for line in path.read_bytes().decode("ascii").split("\r\n"):
        for arm in (1, 2, 3):
            if line[:8] == f"PointL{arm}_" and int(line[8:13]) == m:
                row[arm] = float(line[13:20])
        if len(row) == 3:
            lengths.append([row[1], row[2], row[3]])
            row, m = {}, m + 1
    return np.array(lengths)


def going(position, target):
    """The source's DDA: counts after every turn of its loop, from where it stands to a target in
    counts.
    """
    way = target - position
    k = abs(way).max()
    q, out = np.zeros(3), [position.copy()]
    i = 0
    while i <= k - 1:
        q += abs(way)
        for axis in range(3):
            if q[axis] >= k - 1 and way[axis] != 0:
                q[axis] -= k
                position[axis] += np.sign(way[axis])
        out.append(position.copy())
        i += 1
    return np.array(out)


def test_the_arm_list_reads_as_its_program_reads_it(source, tmp_path):
    done = KmitlArms().write(source, tmp_path / "arms.txt")
    text = (tmp_path / "arms.txt").read_bytes().decode("ascii")
    lengths = read_arms(tmp_path / "arms.txt")
    assert f"{len(lengths)} points" in done.notes[0]
    assert text.count("\n") == text.count("\r\n") == 4 * len(lengths)
    assert text.startswith("PointL1_10001285.832\r\nPointL2_10001")
    assert all(
        line == "" or re.fullmatch(r"PointL[123]_\d{5}[\d.]{7}", line)
        for line in text.split("\r\n")
    )
    # it begins at home and ends where the program does; seven characters leave 0.0005 mm
    assert lengths[0] == pytest.approx(arms(np.array([[0, 0, -300.0]]))[0], abs=5.1e-4)
    assert lengths[-1] == pytest.approx(arms(np.array([[0, 1.0, -297.0]]))[0], abs=5.1e-4)
    # the circle and both lines, in steps of 1 mm at most
    assert len(lengths) == 1 + 2 + 13 + np.ceil(np.sqrt(4 + 1 + 9))


def test_its_error_is_what_the_dda_makes_of_it(source, tmp_path):
    done = KmitlArms().write(source, tmp_path / "arms.txt")
    lengths = read_arms(tmp_path / "arms.txt")
    path, worst = source.trajectory.path, 0.0
    position, n = np.zeros(3), 0
    for piece in range(len(path.breaks) - 1):
        steps = int(np.ceil(np.diff(path.breaks)[piece] / 1e-3 - 1e-9))
        ends = np.linspace(path.breaks[piece], path.breaks[piece + 1], steps + 1)
        for begin, end in pairwise(ends):
            n += 1
            counts = going(position, (lengths[n] - lengths[0]) * 500)
            s = np.linspace(begin, end, len(counts))
            pose = path.pose_numbers(s, np.full(len(s), piece))[:, :3] * 1e3
            wanted = (arms(pose) - arms(np.array([[0, 0, -300.0]]))) * 25_000
            worst = max(worst, abs(counts * 50 - wanted).max())
    assert n == len(lengths) - 1
    # rounding of the decimals of the machine file: 5e-8 mm, 1e-3 pulses
    assert worst == pytest.approx(done.error, abs=0.01)
    # 50 pulses are a count; the sagitta of 1 mm on a circle of 2 mm is 0.06 mm, and arms move by no
    # more than that
    assert 50 < worst < 0.0635 * 25_000


def test_closer_points_leave_the_counts_alone(source, tmp_path):
    done = KmitlArms(point_step=1e-4).write(source, tmp_path / "arms.txt")
    # its DDA fires up to a count early, and leaves up to a count of each way to the next; the text
    # of two lengths rounds by half a count, and the sagitta of 0.1 mm on a circle of 2 mm is 0.6 µm
    assert 50 < done.error < 2.5 * 50 + 0.63e-3 * 25_000


def read_positions(path):
    """By key, as the source's reader does: 14 columns are compared, and the number is in columns 15
    to 21.
    """
    poses = [{}]
    for line in path.read_bytes().decode("ascii").split("\r\n"):
        if not line:
            poses.append({})
            continue
        n = len(poses)
        name = f"Polar{n}"
        assert line.startswith(name)
        key, value = line[len(name) :].split(" ")
        if n < 10:
            assert line[:14] == f"Polar{n}{key}"
            # a blank and six characters, cut off
            assert abs(float(line[14:21]) - float(value)) < 10.0 ** -(5 - value.index("."))
        poses[-1][key] = float(value)
    return [pose for pose in poses if pose]


def test_the_position_list_reads_by_its_keys(source, tmp_path):
    done = KmitlPositions().write(source, tmp_path / "positions.txt")
    poses = read_positions(tmp_path / "positions.txt")
    assert f"{len(poses)} poses" in done.notes[0]
    first, last = poses[0], poses[-1]
    assert list(first) == KEYS
    assert KEYS[0] == "_____cex"
    assert KEYS[3] == "______cx"
    assert (KEYS[8], KEYS[9], KEYS[-1]) == ("______rz", "_mov(1)x", "move(3)z")
    # the source takes off the end point's height at its start as it writes, and adds it again;
    # joints are absolute
    zos = np.array([0, 0, -300])
    assert [first[f"_____ce{c}"] for c in "xyz"] == [0, 0, 0]
    assert [first[f"______c{c}"] for c in "xyz"] == [0, 0, 50]
    assert [last[f"_____ce{c}"] for c in "xyz"] == [0, 1, 3]
    for pose in poses:
        end = np.array([pose[f"_____ce{c}"] for c in "xyz"]) + zos
        assert [pose[f"______r{c}"] for c in "xyz"] == [0, 0, 0]
        for joint in (1, 2, 3):
            at = np.array([pose[f"_mov({joint}){c}"] for c in "xyz"])
            # seven characters: 0.005 mm where there are three digits and a sign before the point
            assert at == pytest.approx(end + [0, 0, 50] + MOVED[joint - 1], abs=0.011)
            below = np.array([pose[f"move({joint}){c}"] for c in "xyz"])
            # the plate's joints lie in the plate, as `Lengtherror` of the preset is 0
            assert below == pytest.approx(at, abs=0.011)
    # the circle as a polygon: all its corners on it, its sides within the tolerance
    ends = np.array([[pose[f"_____ce{c}"] for c in "xyz"] for pose in poses])[1:-1]
    assert np.hypot(*ends[:, :2].T) == pytest.approx(2, abs=1e-3)
    middle = (ends[1:] + ends[:-1]) / 2
    assert 2 - np.hypot(*middle[:, :2].T).min() <= 0.01 + 1e-3
    # both ends of every straight line and no more between
    assert len(ends) == 1 + 2 ** np.ceil(np.log2(np.pi / np.arccos(1 - 0.01 / 2)))


def test_the_position_lists_error_is_that_of_its_chords(source, tmp_path):
    coarse = KmitlPositions(chord=1e-3).write(source, tmp_path / "coarse.txt").error
    fine = KmitlPositions(chord=1e-5).write(source, tmp_path / "fine.txt").error
    # no arm changes by more than the end point moves; the text of numbers adds up to 0.005 mm
    assert fine <= (0.01 + 0.006) * 25_000
    assert fine < coarse <= (1 + 0.006) * 25_000


def test_a_byte_steps_its_axes(source, tmp_path):
    done = KmitlByte().write(source, tmp_path / "steps.bin")
    assert done.error == 0
    counts = [0, 0, 0]
    for byte in (tmp_path / "steps.bin").read_bytes():
        assert byte < 64
        for axis in range(3):
            if byte & 1 << 2 * axis:
                counts[axis] += -1 if byte & 2 << 2 * axis else 1
            else:
                assert not byte & 2 << 2 * axis  # no direction without a step
    assert counts == [axis.final for axis in source.pulses.axes]
    assert len((tmp_path / "steps.bin").read_bytes()) == len(
        {t for a in source.pulses.axes for t in a.ticks.tolist()}
    )


@pytest.mark.parametrize("format_", [KmitlArms, KmitlPositions, KmitlByte])
def test_other_machines_are_refused_by_name(tmp_path, hexapod, format_):
    made = plan(Program((Line([0, 0, 0.001]),)), hexapod)
    with pytest.raises(MotionError, match=r"machine hexapod (is a hexapod|has 6 axes)"):
        format_().write(
            ExportSource("up", hexapod, made.trajectory, made.pulses), tmp_path / "file"
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("format_", "told"),
    [
        (KmitlArms(point_step=0.0), "point step 0.0 m"),
        (KmitlArms(unit_length=float("nan")), "unit length nan m"),
        (KmitlArms(unit_length=1e-9), "more than 7 characters"),
        (KmitlArms(point_step=5e-7), "the source counts to 32767"),
        (KmitlPositions(chord=-1.0), "chord -1.0 m"),
        (KmitlPositions(unit_length=1e-9), "more than 7 characters"),
        (KmitlPositions(chord=1e-13), "asks for more than 32767 poses"),
    ],
)
def test_what_a_list_cannot_hold_is_refused_before_anything_is_written(
    source, tmp_path, format_, told
):
    with pytest.raises(MotionError, match=told):
        format_.write(source, tmp_path / "file")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.00000"), (-0.0000001, "0.0000"), (285.8321, "285.832"), (-285.8321, "-285.83"),
        (1234567.2, "1234567"),
        (999999.7, "1000000"), (-0.5, "-0.5000"), (99.99999, "100.000"),
    ],
)  # fmt: skip
def test_numbers_fill_seven_characters(value, text):
    assert kmitl.number(value, "it") == text
    assert len(text) <= 7
    assert float(text) == pytest.approx(value, abs=0.5)


SOURCE_KEYS = [
    *(
        "_____cex",
        "_____cey",
        "_____cez",
        "______cx",
        "______cy",
        "______cz",
        "______rx",
        "______ry",
        "______rz",
    ),
    *(f"{kind}({joint}){c}" for kind in ("_mov", "move") for joint in (1, 2, 3) for c in "xyz"),
]


def test_every_line_is_one_that_the_sources_reader_takes(source, tmp_path):
    """`If Left(rec0, 14) = "Polar" & n & key Then … = CDbl(Trim(Mid(rec0, 15, 7)))` [KMITL 2005,
    Module3].
    """
    assert {len(key) for key in KEYS} == {8}
    KmitlPositions().write(source, tmp_path / "positions.txt")
    lines = (tmp_path / "positions.txt").read_text("ascii").splitlines()
    for n in range(1, 10):
        taken = {}
        for line in lines:
            for key in SOURCE_KEYS:
                if line[:14] == f"Polar{n}{key}":
                    taken[key] = float(line[14:21].strip())
        assert list(taken) == SOURCE_KEYS, n


def test_a_number_without_a_point_in_six_characters_is_refused():
    """The source's reader would take a tenth of it."""
    assert cut_number(12345.6, "cex") == "12345.6"
    assert cut_number(-325.004, "cex") == "-325.00"
    with pytest.raises(MotionError, match="needs more than 6 characters"):
        cut_number(1234567, "cex")
