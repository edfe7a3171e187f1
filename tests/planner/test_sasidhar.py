"""The remote line protocol: read as its controller reads it, one key after another."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics import load_machine
from kinematics.errors import MotionError
from planner import Arc, Dwell, Line, Program, Turn, plan
from planner.export.format import Source
from planner.export.sasidhar import Sasidhar


def source_of(*segments, machine=None):
    made = plan(Program(segments), machine or load_machine("traverser"))
    return Source("☃ \r P X + 1", made.machine, made.trajectory, made.pulses)


def controller(data):
    """Registers after every line: P, then letter, sign and steps, parted by spaces, up to the carriage return."""
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


def test_the_source_s_own_example_is_written_so(tmp_path):
    """`P X + 100 Y - 40 Z + 80` + RETURN [Sasidhar 1981, F.4]."""
    there, way = np.array([1000, 1000, 1000]), np.array([100, -40, 80])
    made = source_of(Line(there * STEP), Line((there + way) * STEP))
    done = Sasidhar().write(made, tmp_path / "lines")
    assert (tmp_path / "lines").read_bytes() == b"P X + 1000 Y + 1000 Z + 1000\rP X + 100 Y - 40 Z + 80\r"
    assert done.error == 0


def test_registers_stand_at_the_counts_of_every_stop(tmp_path):
    turn = Turn(Rotation.from_rotvec([0, 0, 0.3]))
    made = source_of(Line([0.02, 0.01, 0]), Dwell(0.3), Arc([0.01, 0.01, 0], [0, 0, 1], np.pi), turn, Line([0, 0, 0]))
    done = Sasidhar().write(made, tmp_path / "lines")
    wanted = np.array([[0.02, 0.01, 0, 0], [0, 0.01, 0, 0], [0, 0.01, 0, 0.3], [0, 0, 0, 0.3]])
    found = controller((tmp_path / "lines").read_bytes())
    assert abs(np.array(found) - wanted / [STEP, STEP, STEP, np.deg2rad(0.9)]).max() <= 0.5
    assert found[-1] == [axis.final for axis in made.pulses.axes]
    # half a circle of 10 mm is cut short along its diameter
    assert "leave it by 10 mm" in done.notes[1]
    assert "0.3 s of rests" in done.notes[-1]


def test_a_straight_move_of_one_axis_is_followed(tmp_path):
    done = Sasidhar().write(source_of(Line([0.02, 0, 0])), tmp_path / "lines")
    assert "leave it by 0 mm" in done.notes[1] or "e-1" in done.notes[1]
    assert "rests" not in done.notes[-1]


def test_clockwise_is_the_wirings_positive_count(tmp_path):
    machine = load_machine("traverser")
    axes = tuple(replace(axis, direction=-1 if axis.name == "Y" else 1) for axis in machine.axes)
    made = source_of(Line([100 * STEP, 40 * STEP, 0]), machine=type(machine)(axes=axes, home=machine.home))
    assert Sasidhar().write(made, tmp_path / "lines").error == 0
    assert (tmp_path / "lines").read_bytes() == b"P X + 100 Y - 40\r"


def test_a_motion_below_a_step_has_no_line(tmp_path):
    done = Sasidhar().write(source_of(Line([STEP / 3, 0, 0])), tmp_path / "lines")
    assert (tmp_path / "lines").read_bytes() == b""
    assert done.notes[0].startswith("0 moves")


@pytest.mark.parametrize("name", ["X1", "x", "Ж", "X Y"])
def test_axes_that_the_protocol_cannot_name_are_refused(tmp_path, name):
    machine = load_machine("traverser")
    axes = tuple(replace(axis, name=name) if axis.name == "Z" else axis for axis in machine.axes)
    made = source_of(Line([0.001, 0, 0]), machine=type(machine)(axes=axes, home=machine.home))
    with pytest.raises(MotionError, match=f"axis '{name}' of machine traverser is no capital letter"):
        Sasidhar().write(made, tmp_path / "lines")
    assert not list(tmp_path.iterdir())
