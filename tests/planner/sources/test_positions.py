"""Position lists: edited as values, read from CSV and from the source's own files, and run by its
rule or by ours.
"""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from kinematics import FileError, MotionError, load_machine
from planner import (
    Arc,
    Blend,
    Line,
    PositionList,
    Program,
    Stop,
    Turn,
    import_program,
    load_positions,
    plan,
    save_positions,
)
from planner.export.format import ExportSource
from planner.export.formats.kmitl import KmitlArms, KmitlByte, KmitlPositions
from planner.sources.position_list import positions_csv
from planner.sources.positions import Positions

POSES = np.array(
    [
        [0.01, 0, 0.025, 0, 0, 0],
        [0.01, 0.004, 0.025, 0.1, 0, 0],
        [0.01, 0.004, 0.025, 0.2, -0.1, 0.05],
        [-0.005, 0, 0.02, 0, 0, 0],
    ]
)


@pytest.fixture
def write(tmp_path):
    def written(text, name="list.csv"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path / name

    return written


# --- the list as a value
# --------------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.data())
def test_it_does_what_a_list_does(data):
    """Held against Python's own list, edit by edit."""
    listed, known = PositionList(np.zeros((0, 6))), []
    for k in range(data.draw(st.integers(1, 12))):
        pose = [float(k), 0, 0, 0, 0, 0]
        what = (
            data.draw(st.sampled_from(["record", "insert", "remove", "part"]))
            if known
            else "record"
        )
        number = data.draw(st.integers(1, max(1, len(known))))
        last = data.draw(st.integers(number, max(number, len(known))))
        if what == "record":
            listed, known = listed.record(pose), [*known, k]
        elif what == "insert":
            listed, known = (
                listed.insert(number, pose),
                [*known[: number - 1], k, *known[number - 1 :]],
            )
        elif what == "remove":
            listed, known = listed.remove(number, last), known[: number - 1] + known[last:]
        else:
            assert listed.part(number, last).poses[:, 0].tolist() == known[number - 1 : last]
        assert listed.poses[:, 0].tolist() == known
        assert not listed.poses.flags.writeable


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda two: two.remove(3), "no pose 3; it has poses 1 to 2"),
        (lambda two: two.insert(4, [0] * 6), "no pose 4"), (lambda two: two.insert(0, [0] * 6), "no pose 0"),
        (lambda two: two.part(2, 1), "from 2 to 1"),
        (lambda two: two.record([0, 0, 0]), "a pose"), (lambda two: two.record([float("nan")] * 6), "a pose"),
        (lambda two: two.record([1e9, 0, 0, 0, 0, 0]), "at most"), (lambda two: two.remove(1, 2).part(), "no pose yet"),
        (lambda two: PositionList(two.poses, "zyx"), "zyx"),
    ],
)  # fmt: skip
def test_edits_that_make_no_sense(edit, words):
    with pytest.raises(MotionError, match=words):
        edit(PositionList(POSES[:2]))


@pytest.mark.parametrize("order", ["xyz", "yzx"])
def test_angles_combine_as_the_order_says(order):
    listed = PositionList(np.array([[0, 0, 0, 0.3, -0.7, 1.1]]), order)
    about = {
        axis: Rotation.from_rotvec(angle * np.eye(3)[k])
        for k, (axis, angle) in enumerate(zip("xyz", (0.3, -0.7, 1.1), strict=True))
    }
    product = about[order[0]] * about[order[1]] * about[order[2]]
    assert listed.rotations[0].as_matrix() == pytest.approx(product.as_matrix(), abs=1e-15)


# --- CSV
# ------------------------------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None, derandomize=True)
@given(
    st.lists(st.lists(st.floats(-1e3, 1e3), min_size=6, max_size=6), min_size=1, max_size=4),
    st.sampled_from(["xyz", "yzx"]),
)
def test_what_is_written_is_read_back(tmp_path_factory, rows, order):
    listed = PositionList(np.array(rows), order, "base")
    path = tmp_path_factory.mktemp("csv") / "list.csv"
    path.write_text(positions_csv(listed), encoding="utf-8")
    again, told = Positions().load(path)
    save_positions(again, path)
    assert load_positions(path).poses == pytest.approx(again.poses, rel=5e-16, abs=0)
    assert [file.name for file in path.parent.iterdir()] == ["list.csv"]
    assert (again.order, again.frame, told) == (order, "base", [])
    # mm and degrees, and back: two roundings
    assert again.poses == pytest.approx(listed.poses, rel=5e-16, abs=0)


def test_units_stand_in_the_header_or_in_options(write):
    stated = write("z [mm]; x (in); θy [rad]\n25; 1; 0.5\n\n-3e1; .5; -1.\n")
    listed, told = Positions().load(stated)
    assert listed.poses == pytest.approx(
        np.array([[0.0254, 0, 0.025, 0, 0.5, 0], [0.0127, 0, -0.03, 0, -1, 0]])
    )
    assert told == ["no column y: 0 was taken"]
    bare = write("x,y,z,rx\n1,2,3,90\n", "bare.csv")
    with pytest.raises(
        FileError, match=r"bare.csv:1: column x has no unit: write it as \"x \[mm\]\".*length"
    ) as refused:
        Positions().load(bare)
    assert len(refused.value.faults) == 4
    assert Positions(length="cm", angle="deg").load(bare)[0].poses[0] == pytest.approx(
        [0.01, 0.02, 0.03, np.pi / 2, 0, 0]
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no header"), ("x [mm]\n", "no pose"), ("x [mm], q [mm]\n1,2\n", ":1: column \"q \\[mm\\]\""),
        ("x [mm], x [mm]\n1,2\n", "appears twice"), ("x [deg]\n1\n", "not convertible"),
        ("x [mm]\nnan\n", ':2: column x: "nan" is not'),
        ("x [mm]\n1\ninf\n", ':3: column x: "inf" is not'), ("x [mm]\n1e300\n", "must be at most 1e.08"),
        ("x [mm]\n1,2\n", "2 entries for 1"),
        ("x [mm]\n1_0\n", "is not a number"), ("x [mm];y [mm]\n1,5;2\n", '"1,5" is not a number'),
        ("# frame = moon\nx [mm]\n1\n", ':1: "# frame = moon"'), ("# hello\nx [mm]\n1\n", "before the header"),
        ("\x00\x01\x02", "column"), ("x [mm]\n" + "1,\n" * 200, "not checked"), ("x [mm]\n\udcff\n", "not a number"),
    ],
)  # fmt: skip
def test_faults_of_a_list_are_told_with_their_lines(tmp_path, text, words):
    (tmp_path / "list.csv").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(FileError, match=words):
        import_program(tmp_path / "list.csv")


# --- the two ways to run a list
# --------------------------------------------------------------------------------------


def test_through_the_poses(write):
    path = write(positions_csv(PositionList(np.vstack([POSES, POSES[-1:]]))))
    found = import_program(path, blend=1e-4, speed=0.01)
    first, second, turn, last = found.program.segments
    assert [type(part) for part in found.program.segments] == [Line, Line, Turn, Line]
    for part, pose in zip((first, second, last), POSES[[0, 1, 3]], strict=True):
        assert part.to == pytest.approx(pose[:3], rel=1e-15)
        assert (part.speed, part.join) == (0.01, Blend(1e-4))
    assert first.rotate is None
    assert turn.to.as_matrix() == pytest.approx(
        Rotation.from_euler("XYZ", POSES[2, 3:]).as_matrix()
    )
    assert isinstance(turn.join, Stop)
    assert found.warnings == ("skipped 1 pose equal to the pose before",)
    assert found.entities == {"poses": 5}
    assert len(import_program(path, first=2, last=3).program.segments) == 2
    with pytest.raises(MotionError, match="no pose 6"):
        import_program(path, last=6)


def test_the_stepping_rule_of_the_source(write):
    """Its steps, by its own loop: Ve − Vs over the largest of them; angles only where nothing else
    changes.
    """
    path = write(
        "# rotation = yzx\nx [mm],y [mm],z [mm],rx [deg],ry [deg],rz [deg]\n"
        "0,0,0,0,0,0\n10,-4,2,0,30,0\n10,-4,2,6,-3,0\n10,-4,0.5,0,0,0\n"
    )
    found = import_program(path, rule="kmitl")
    segments = found.program.segments
    assert all(isinstance(part.join, Stop) for part in segments)
    moves, turns, down = segments[:10], segments[10:16], segments[16:]
    # ten steps of (1, −0.4, 0.2); the 30° beside them are dropped
    assert np.array([part.to for part in moves]) == pytest.approx(
        np.arange(1, 11)[:, None] * [1e-3, -0.4e-3, 0.2e-3], abs=1e-18
    )
    assert all(part.rotate is None for part in moves)
    # six steps of 1° about x, and half as many about y: from the angles that it has, none
    for k, part in enumerate(turns, 1):
        ry, rz, rx = -0.5 * k, 0, k
        wanted = Rotation.from_euler("Y", ry, degrees=True) * Rotation.from_euler(
            "ZX", [rz, rx], degrees=True
        )
        assert (part.to.inv() * wanted).magnitude() < 1e-12
    # one and a half units down: a step of one, and what is left
    assert np.array([part.to[2] for part in down]) == pytest.approx([1e-3, 0.5e-3])
    assert found.warnings == (
        "2 rotations combined with a translation were dropped, as the stepping rule requires",
    )
    assert (
        len(import_program(path, rule="kmitl", unit_length=1e-4).program.segments) == 100 + 6 + 15
    )
    with pytest.raises(MotionError, match="more than 100000"):
        import_program(path, rule="kmitl", unit_length=1e-8)


def test_the_default_is_faster_than_the_steps_through_the_same_poses(write):
    tripod = load_machine("tripod")
    path = write("x [mm],y [mm],z [mm]\n5,0,0\n5,5,3\n0,0,0\n")
    optimal, steps = (
        plan(import_program(path, rule=rule).program, tripod, order=2)
        for rule in ("optimal", "kmitl")
    )
    assert optimal.certificate.holds
    assert steps.certificate.holds
    ends = [
        made.trajectory.at(made.trajectory.duration).pose.translation for made in (optimal, steps)
    ]
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)
    assert optimal.trajectory.duration < steps.trajectory.duration


def test_the_tools_centre(write):
    """The source's end point lies below its plate: a turn about it swings the plate, and leaves it
    where it is.
    """
    path = write("x [mm],z [mm],rx [deg]\n0,-50,0\n0,-50,10\n")
    program = import_program(path, tool="0 mm, 0 mm, -50 mm").program
    assert [type(part) for part in program.segments] == [Turn]
    assert program.tool.translation == pytest.approx([0, 0, -0.05])


def test_where_nothing_moves(write):
    with pytest.raises(FileError, match="nothing moves"):
        import_program(write("x [mm]\n0\n0\n"))


# --- the files of the source, and its evidence
# -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def circle():
    """Its demonstration: the end point traces a circle, 20 mm around the home pose's own height, 10
    mm down.
    """
    program = Program((Line([0.02, 0, -0.01]), Arc([0, 0, -0.01], [0, 0, 1], 2 * np.pi)))
    made = plan(
        program,
        load_machine("tripod"),
        order=2,
        rule="dda:spacing=10ms,pulses_per_count=50,rate=400kHz",
    )
    assert made.certificate.holds
    return ExportSource("circle", made.machine, made.trajectory, made.pulses)


def test_the_end_point_traces_a_circle(circle):
    t = np.linspace(0, circle.trajectory.duration, 2001)
    state = circle.trajectory.at(t)
    place = (state.pose.translation - circle.machine.home.translation) * 1e3
    round_ = state.s > circle.trajectory.path.breaks[1]
    assert np.hypot(*place[round_, :2].T) == pytest.approx(20, abs=1e-9)
    assert place[round_, 2] == pytest.approx(-10, abs=1e-9)
    turned = np.unwrap(np.arctan2(place[round_, 1], place[round_, 0]))
    assert turned[-1] - turned[0] == pytest.approx(2 * np.pi, abs=0.05)


def test_its_position_list_is_read_back(circle, tmp_path):
    KmitlPositions().write(circle, tmp_path / "list.txt")
    listed, _ = Positions().load(tmp_path / "list.txt")
    assert (listed.order, listed.frame) == ("yzx", "base")
    ends = listed.poses[:, :3] * 1e3
    assert ends[0] == pytest.approx([0, 0, -300])
    # seven characters leave 0.005 mm where three digits and a sign stand before the point
    assert np.hypot(*ends[1:, :2].T) == pytest.approx(20, abs=0.005)
    assert ends[1:, 2] == pytest.approx(-310, abs=0.005)
    program = import_program(tmp_path / "list.txt").program
    assert program.start.translation * 1e3 == pytest.approx([0, 0, -300])
    assert len(program.segments) == len(listed) - 1


def test_its_arm_lengths_are_read_back(circle, tmp_path):
    """Poses from three lengths: the meeting of three spheres, solved here by hand."""
    KmitlArms().write(circle, tmp_path / "arms.txt")
    listed, _ = Positions().load(tmp_path / "arms.txt")
    rows = [line for line in (tmp_path / "arms.txt").read_text("ascii").split() if line]
    lengths = np.array([float(row[13:]) for row in rows]).reshape(-1, 3)
    assert len(listed) == len(lengths)
    # |p + m_i − b_i| = l_i: centres c_i = b_i − m_i on a circle of 138.564 mm about the origin, at 0°, ±120°
    radius = 173.2050808 - 34.6410162
    x = (lengths[:, 1] ** 2 + lengths[:, 2] ** 2 - 2 * lengths[:, 0] ** 2) / (6 * radius)
    y = (lengths[:, 2] ** 2 - lengths[:, 1] ** 2) / (2 * np.sqrt(3) * radius)
    z = -np.sqrt((lengths**2).mean(1) - radius**2 - x**2 - y**2) - 50
    assert listed.poses[:, :3] * 1e3 == pytest.approx(np.column_stack([x, y, z]), abs=1e-5)
    assert np.hypot(x, y)[-20:] == pytest.approx(20, abs=2e-3)
    program = import_program(tmp_path / "arms.txt").program
    assert len(program.segments) == len(listed) - 1


def test_500_counts_a_unit_and_50_pulses_a_count(circle):
    q = circle.trajectory.at([circle.trajectory.duration]).q[0] - circle.machine.home_q
    for axis, way, schedule in zip(circle.machine.axes, q, circle.pulses.axes, strict=True):
        assert axis.pulse == pytest.approx(1e-3 / (500 * 50))
        counts = schedule.final / 50
        assert counts == round(counts)
        assert counts == pytest.approx(way / 1e-3 * 500, abs=1)  # the DDA ends within a count
        bursts = schedule.ticks.reshape(-1, 50)
        assert np.diff(bursts, axis=1).max() <= circle.pulses.clock_hz / 400e3 + 1
        assert (
            schedule.direction.reshape(-1, 50) == schedule.direction.reshape(-1, 50)[:, :1]
        ).all()


def test_its_port_bytes(circle, tmp_path):
    """X+ 1, X− 3, Y+ 4, Y− 12, Z+ 16, Z− 48; what steps in the same tick is added."""
    KmitlByte().write(circle, tmp_path / "steps.bin")
    codes = {1: (0, 1), 3: (0, -1), 4: (1, 1), 12: (1, -1), 16: (2, 1), 48: (2, -1)}
    sums = {}
    for x in (0, 1, 3):
        for y in (0, 4, 12):
            for z in (0, 16, 48):
                step = np.zeros(3, int)
                for code in filter(None, (x, y, z)):
                    step[codes[code][0]] = codes[code][1]
                sums[x + y + z] = step
    times = np.bincount(np.fromfile(tmp_path / "steps.bin", np.uint8))
    counts = sum(times[byte] * sums[byte] for byte in np.flatnonzero(times))
    assert counts.tolist() == [axis.final for axis in circle.pulses.axes]


def test_its_list_runs_by_its_own_rule(write):
    """The circle as its operator would teach it: 24 poses, and unit steps between them."""
    angles = np.linspace(0, 2 * np.pi, 25)
    poses = np.column_stack([20 * np.cos(angles), 20 * np.sin(angles), np.full(25, -10.0)])
    path = write("x [mm],y [mm],z [mm]\n" + "".join(f"{x},{y},{z}\n" for x, y, z in poses.tolist()))
    segments = import_program(path, rule="kmitl").program.segments
    at = np.array([part.to for part in segments]) * 1e3
    largest = [abs(b - a).max() for a, b in pairwise(poses)]
    assert len(segments) == 1 + sum(np.ceil(np.array(largest) - 1e-9))
    assert max(abs(b - a).max() for a, b in pairwise(at)) <= 1 + 1e-12
    assert np.hypot(*at[:, :2].T).min() > 20 * np.cos(np.pi / 24) - 1e-9


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Polar1____cex 1.0\n", "position 1 has no cey, cez, rx, ry, rz"),
        ("Polar1____cex 1.0\nPolar1____cex 2.0\n", ":2: cex of position 1 appears twice"),
        ("Polar1____cef 1.0\n", ":1: .*not a line of a position list"), ("Polar1____cex nan\n", "not a line"),
        ("Polar2____cex 1.0\n", "position 1 is missing"), ("Polar1____cex 1.0E999\n", "not a line"),
        ("PointL1_10001285.832\n", "point 10001 has 1 lengths of 3"),
        ("PointL2_10001285.832\n", 'expected "PointL1_10001"'),
        ("PointL1_10001285.832\nPointL2_10001285.832\nPointL3_10002285.832\n", ':3: .*expected "PointL3_10001"'),
        ("PointL1_10001abc\n", "and a length"),
    ],
)  # fmt: skip
def test_broken_files_of_the_source(write, text, words):
    with pytest.raises(FileError, match=words):
        import_program(write(text, "list.txt"))


def test_arms_that_do_not_meet(write):
    text = "".join(
        f"PointL{arm}_10001{length}\n"
        for arm, length in ((1, "10.0000"), (2, "10.0000"), (3, "500.000"))
    )
    with pytest.raises(FileError, match="point 10001: tripod has no pose"):
        import_program(write(text, "list.txt"))
    with pytest.raises(MotionError, match="need a tripod"):
        import_program(write(text, "list.txt"), arms="hexapod")


def test_both_writers_of_the_source_are_read(write):
    """One puts blanks around its underscores, the other does not; joints are read over."""
    keys = ["_____cex", "_____cey", "_____cez", "______rx", "______ry", "______rz"]
    tight = (
        "".join(f"Polar1{key} {k}.5\n" for k, key in enumerate(keys))
        + "Polar1_mov(1)x 3\nPolar1move(3)z -1.5E-2\n\n"
    )
    loose = "".join(f"Polar1 _____ {key.strip('_')} {k}.5\n" for k, key in enumerate(keys))
    for text in (tight, loose):
        listed, _ = Positions(unit_length=2e-3).load(write(text, "list.txt"))
        # z counts from the end point's height at home, 300 mm below the base
        assert listed.poses[0] == pytest.approx(
            [1e-3, 3e-3, -0.3 + 5e-3, *np.radians([3.5, 4.5, 5.5])]
        )


@pytest.mark.parametrize("cell", ["1" * 140_000, '"' + "1" * 140_000])
def test_cells_longer_than_a_csv_reader_takes_are_faults_with_their_line(tmp_path, cell):
    """Python's reader takes 131 072 characters."""
    (tmp_path / "long.csv").write_text(f"x [mm], y [mm], z [mm]\n0,0,1\n0,0,{cell}\n0,0,x\n")
    with pytest.raises(FileError) as refused:
        import_program(tmp_path / "long.csv")
    lines = str(refused.value).splitlines()
    assert [line.partition("long.csv:")[2].partition(":")[0] for line in lines] == ["3", "4"]
    assert "not CSV: field larger than field limit (131072)" in lines[0]
