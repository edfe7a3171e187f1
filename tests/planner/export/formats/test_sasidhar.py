"""The remote line protocol: read as its controller reads it, one key after another."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics import MotionError, load_machine
from planner import Arc, Blend, Dwell, Line, Program, Turn, plan
from planner.export.format import ExportSource
from planner.export.formats.sasidhar import Sasidhar


def source_of(*segments, machine=None):
    made = plan(Program(segments), machine or load_machine("traverser"))
    return ExportSource("☃ \r P X + 1", made.machine, made.trajectory, made.pulses)


def controller(data):
    """Registers after every line: P, then letter, sign and steps, parted by spaces, up to the
    carriage return.
    """
    registers, after = dict.fromkeys("XYZR", 0), []
    *lines, rest = data.decode("ascii").split("\r")
    assert rest == ""
    for line in lines:
        p, *words = line.split(" ")
        assert p == "P"
        assert len(words) % 3 == 0
        assert len(words) > 0
        for letter, sign, steps in zip(words[::3], words[1::3], words[2::3], strict=True):
            assert int(steps) > 0
            registers[letter] += {"+": 1, "-": -1}[sign] * int(steps)
        after.append([registers[letter] for letter in "XYZR"])
    return after


STEP = 0.25 * 0.0254 / 400


def off_triangles(way):
    """Steps by which triangles at one acceleration leave the straight line to `way`, looked at in
    20 000 places.
    """
    way = np.array(way, float)
    whole = 2 * np.sqrt(way)
    t = np.linspace(0, whole.max(), 20_001)[:, None]
    at = np.where(t < whole / 2, t**2 / 2, way - np.maximum(whole - t, 0) ** 2 / 2)
    along = np.clip(at @ way / (way @ way), 0, 1)[:, None]
    return np.linalg.norm(at - along * way, axis=1).max()


def test_the_source_s_own_example_is_written_so(tmp_path):
    """`P X + 100 Y - 40 Z + 80` + RETURN [Sasidhar 1981, F.4]."""
    there, way = np.array([1000, 1000, 1000]), np.array([100, -40, 80])
    made = source_of(Line(there * STEP), Line((there + way) * STEP))
    done = Sasidhar().write(made, tmp_path / "lines")
    assert (
        tmp_path / "lines"
    ).read_bytes() == b"P X + 1000 Y + 1000 Z + 1000\rP X + 100 Y - 40 Z + 80\r"
    assert done.moves == 2
    # what is claimed is of all the way: X is there before the others, by what independent triangles
    # make of 100:40:80
    assert done.error == pytest.approx(off_triangles([100, 40, 80]), rel=1e-3)


def test_registers_stand_at_the_counts_of_every_stop(tmp_path):
    turn = Turn(Rotation.from_rotvec([0, 0, 0.3]))
    made = source_of(
        Line([0.02, 0.01, 0]),
        Dwell(0.3),
        Arc([0.01, 0.01, 0], [0, 0, 1], np.pi),
        turn,
        Line([0, 0, 0]),
    )
    done = Sasidhar().write(made, tmp_path / "lines")
    wanted = np.array([[0.02, 0.01, 0, 0], [0, 0.01, 0, 0], [0, 0.01, 0, 0.3], [0, 0, 0, 0.3]])
    found = controller((tmp_path / "lines").read_bytes())
    assert abs(np.array(found) - wanted / [STEP, STEP, STEP, np.deg2rad(0.9)]).max() <= 0.5
    assert found[-1] == [axis.final for axis in made.pulses.axes]
    # half a circle of 10 mm is cut short along its diameter
    assert "leave it by 10 mm" in done.notes[1]
    assert done.error == pytest.approx(0.01 / STEP, rel=1e-3)
    assert done.against.startswith("the path, each move by independent trapezoids")
    assert "0.3 s of rests" in done.notes[-1]


def test_a_straight_move_of_one_axis_is_followed(tmp_path):
    done = Sasidhar().write(source_of(Line([0.02, 0, 0])), tmp_path / "lines")
    assert "leave it by 0 mm" in done.notes[1] or "e-1" in done.notes[1]
    assert "rests" not in done.notes[-1]


def test_clockwise_is_the_wirings_positive_count(tmp_path):
    machine = load_machine("traverser")
    axes = tuple(replace(axis, direction=-1 if axis.name == "Y" else 1) for axis in machine.axes)
    made = source_of(
        Line([100 * STEP, 40 * STEP, 0]), machine=type(machine)(axes=axes, home=machine.home)
    )
    assert Sasidhar().write(made, tmp_path / "lines").moves == 1
    assert (tmp_path / "lines").read_bytes() == b"P X + 100 Y - 40\r"


def test_a_motion_that_stops_nowhere_on_its_way_is_refused(tmp_path):
    """It used to leave an empty file that claimed to be 0 pulses off."""
    corners = np.array([[0.02, 0, 0], [0.02, 0.01, 0], [0, 0.01, 0]])
    blended = [Line(corner, join=Blend(1e-4)) for corner in corners]
    with pytest.raises(MotionError, match=r"stops only where it starts.*join = .stop"):
        Sasidhar().write(source_of(*blended, Line([0, 0, 0])), tmp_path / "lines")
    # with one stop on the way the loop after it is lost, and what is claimed says so: the corner is
    # 10 mm off
    made = source_of(
        Line([0.001, 0, 0]),
        *blended[:1],
        Line([0.02, 0.01, 0], join=Blend(1e-4)),
        Line([0.001, 0, 0]),
    )
    done = Sasidhar().write(made, tmp_path / "lines")
    assert (tmp_path / "lines").read_bytes() == b"P X + 63\r"
    assert done.error > 0.019 / STEP


def test_a_motion_below_a_step_has_no_line(tmp_path):
    done = Sasidhar().write(source_of(Line([STEP / 3, 0, 0])), tmp_path / "lines")
    assert (tmp_path / "lines").read_bytes() == b""
    assert done.notes[0].startswith("0 moves")


@pytest.mark.parametrize("name", ["X1", "x", "Ж", "X Y"])
def test_axes_that_the_protocol_cannot_name_are_refused(tmp_path, name):
    machine = load_machine("traverser")
    axes = tuple(replace(axis, name=name) if axis.name == "Z" else axis for axis in machine.axes)
    made = source_of(Line([0.001, 0, 0]), machine=type(machine)(axes=axes, home=machine.home))
    with pytest.raises(
        MotionError, match=f"axis '{name}' of machine traverser is not a capital letter"
    ):
        Sasidhar().write(made, tmp_path / "lines")
    assert not list(tmp_path.iterdir())
