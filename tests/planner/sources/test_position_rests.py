"""Rests at the poses of a list: read, edited, written, run."""

import numpy as np
import pytest

from kinematics import FileError, MotionError, load_machine
from planner import (
    Dwell,
    Line,
    PositionList,
    Stop,
    import_program,
    load_positions,
    plan,
    save_positions,
)
from planner.export.formats.kmitl import list_text

TEXT = "x [mm], z [mm], dwell [ms]\n0, 10, 200\n5, 10, 0\n-5, 10, 500\n"


@pytest.fixture
def listing(tmp_path):
    path = tmp_path / "poses.csv"

    def write(text):
        path.write_text(text)
        return path

    return write


def test_a_column_says_how_long_it_rests(listing):
    program = import_program(listing(TEXT), blend=1e-4).program
    rests = [segment.duration for segment in program.segments if isinstance(segment, Dwell)]
    assert rests == [0.2, 0.5]
    assert [type(segment) for segment in program.segments] == [Line, Dwell, Line, Line, Dwell]
    assert isinstance(program.segments[0].join, Stop)  # where it rests nothing is rounded
    assert program.segments[2].join.tolerance == 1e-4


def test_the_motion_stands_there_so_long(listing, hexapod):
    """Rests of 0.2 and 0.5 s among three stops add exactly those to the plan."""
    with_rests = plan(
        import_program(listing(TEXT), join="stop").program, hexapod, order=2
    ).trajectory
    bare = plan(
        import_program(listing(TEXT.replace("200", "0").replace("500", "0")), join="stop").program,
        hexapod,
        order=2,
    )
    assert with_rests.duration == pytest.approx(bare.trajectory.duration + 0.7, abs=1e-9)
    t = np.linspace(0, with_rests.duration, 20_001)
    still = np.abs(with_rests.at(t).qd).max(1) == 0
    assert still.mean() * with_rests.duration == pytest.approx(0.7, abs=3 * t[1])


@pytest.mark.parametrize("rule", ["optimal", "kmitl"])
def test_the_option_rests_at_every_pose(listing, rule):
    program = import_program(listing(TEXT), dwell=0.1, rule=rule).program
    assert [segment.duration for segment in program.segments if isinstance(segment, Dwell)] == [
        0.1
    ] * 3


def test_a_list_keeps_its_rests_through_every_edit(tmp_path):
    one = (
        PositionList(np.zeros((0, 6)))
        .record(np.zeros(6))
        .record(np.full(6, 0.01), 0.25)
        .insert(1, np.ones(6), 0.125)
    )
    assert one.rests.tolist() == [0.125, 0.0, 0.25]
    assert one.remove(2).rests.tolist() == [0.125, 0.25]
    assert one.part(2, 3).rests.tolist() == [0.0, 0.25]
    save_positions(one, tmp_path / "saved.csv")
    assert load_positions(tmp_path / "saved.csv").rests.tolist() == one.rests.tolist()
    bare = one.part(2, 2)
    save_positions(bare, tmp_path / "bare.csv")
    assert "dwell" not in (tmp_path / "bare.csv").read_text()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x [mm], dwell\n1, 2\n", r'column dwell has no unit: write it as "dwell \[s\]"$'),
        ("x [mm], dwell [mm]\n1, 2\n", "not convertible to s"),
        ("x [mm], dwell [s]\n1, -2\n", '2: column dwell: "-2" must be at least 0 s'),
        ("x [mm], dwell [s]\n1, 1e9\n", "must be at most 100000 of its unit"),
    ],
)
def test_what_is_no_rest_is_refused(listing, text, told):
    with pytest.raises(FileError, match=told):
        import_program(listing(text))


def test_a_rest_that_cannot_be_is_refused(listing):
    with pytest.raises(MotionError, match=r"dwell -1\.0 s must be positive"):
        import_program(listing(TEXT), dwell=-1.0)
    with pytest.raises(MotionError, match="dwells"):
        PositionList(np.zeros((1, 6)), dwells=[-1.0])
    with pytest.raises(MotionError, match="pose 1 has a dwell, which the format cannot hold"):
        list_text(PositionList(np.zeros((1, 6)), dwells=[1.0]), load_machine("tripod"))
