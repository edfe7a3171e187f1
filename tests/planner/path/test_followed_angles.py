"""Rotations by an angle that follows: refused where they would be all of a segment, named where
they are a part.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError, load_machine
from planner import Line, Program, Turn, import_program
from planner.path.chain import chain_pieces
from planner.path.followed_angles import (
    describe_lost_angles,
    find_changed_angles,
    list_turned_angles,
)
from pulsepath.inputs import Origin, read_inputs

Z_TURNS = {
    "five-axis": [("z", 170), ("z", 360), ("z", -720)],
    "arm": [("z", 30), ("x", 30), ("y", 360)],
    "linkage": [("z", 90)],
}


@pytest.mark.parametrize(
    ("name", "axis", "angle"), [(name, *turn) for name, turns in Z_TURNS.items() for turn in turns]
)
def test_a_turn_for_which_no_axis_moves_is_refused(name, axis, angle):
    """The inverse map confirms it: the axes have the same coordinates at every part of the turn."""
    machine = load_machine(name)
    parts = Rotation.from_euler(axis, np.linspace(0, np.radians(angle), 5)[:, None])
    poses = machine.home * RigidTransform.from_rotation(parts)
    np.testing.assert_allclose(machine.inverse(poses), np.tile(machine.home_q, (5, 1)), atol=1e-9)
    about = Rotation.identity().as_matrix()["xyz".index(axis)]
    for turn in (Turn(about=about, angle=np.radians(angle)), Turn(parts[1])):
        with pytest.raises(
            MotionError, match=f"it changes only .*r{axis}.*, which the other axes of {name} decide"
        ):
            chain_pieces(Program([Line([1e-3, 0, 0]), turn]), machine)


def test_turns_that_move_an_axis_are_drawn():
    turn = Turn(Rotation.from_euler("z", 10, degrees=True))
    assert (
        len(chain_pieces(Program([Line([1e-3, 0, 0]), turn]), load_machine("traverser")).pieces)
        == 2
    )
    assert len(chain_pieces(Program([turn]), load_machine("hexapod")).pieces) == 1
    tilt = Turn(Rotation.from_euler("XYZ", [5, 0, 30], degrees=True))
    assert len(chain_pieces(Program([tilt]), load_machine("five-axis")).pieces) == 1


@pytest.mark.parametrize(
    ("text", "turned"),
    [
        ("G1 X10 C20\nX20 C10", {"rz"}), ("G1 X10 A5", {"rx"}), ("G1 X10 A5 B3", {"rx", "ry"}), ("G1 X10", set()),
        ("G1 X10\nA5\nC360", {"rx", "rz"}),
    ],
)  # fmt: skip
def test_words_of_angles_that_follow_are_named(text, turned, tmp_path, capsys):
    """Read as a whole, as a stream, and on the command line."""
    file = tmp_path / "part.nc"
    file.write_text(f"G21 G90 F600\n{text}\n")
    done = import_program(file)
    assert done.turned == turned
    assert list_turned_angles(done.program) == turned
    warning = describe_lost_angles(done.turned, load_machine("five-axis"))
    assert ("decide rz (C)" in warning) == ("rz" in turned)
    read_inputs(str(file), "five-axis", origin=Origin("gcode", {}, ".nc"))
    assert ("rotations by it have no effect" in capsys.readouterr().err) == ("rz" in turned)
    read_inputs(str(file), "hexapod", origin=Origin("gcode", {}, ".nc"))
    assert "no effect" not in capsys.readouterr().err


def test_angles_at_the_pole_are_none_of_their_own():
    up = Rotation.from_euler("XYZ", [0, 90, 0], degrees=True)
    assert (
        find_changed_angles(up, Rotation.from_euler("XYZ", [20, 90, 0], degrees=True))
        == frozenset()
    )
    assert find_changed_angles(
        Rotation.identity(), up * Rotation.from_euler("y", -80, degrees=True)
    ) == {"ry"}
