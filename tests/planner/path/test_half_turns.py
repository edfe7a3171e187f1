"""Half turns: neither way is shorter, so they are refused wherever a segment turns to an
orientation.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError, load_machine
from planner import Arc, Line, Program, Synchronised, Turn, load_program
from planner.path.actuation import actuate

TRAVERSER = load_machine("traverser")
TO = [0.3, 0.4, 0.5]
SEGMENTS = {
    "line": lambda rotation: Line(TO, rotation),
    "arc": lambda rotation: Arc([0.35, 0.2, 0.2], [0, 0, 1], 1.0, rotation),
    "turn": Turn,
    "synchronised": lambda rotation: Synchronised(TO, rotation),
}


def about_z(degrees):
    return Rotation.from_euler("z", degrees, degrees=True)


def program(name, begin, end):
    start = RigidTransform.from_components([0.3, 0.2, 0.2], about_z(begin))
    return Program([SEGMENTS[name](about_z(end))], start=start, frame="base")


@pytest.mark.parametrize("name", SEGMENTS)
@pytest.mark.parametrize(
    ("begin", "end"),
    [(30, 210), (30, -150), (0, 180), (-90, 90), (0.1, 180.1), (17.3, 197.3 + 360)],
)
def test_half_a_turn_is_refused_by_its_segment(name, begin, end):
    with pytest.raises(
        MotionError,
        match=f"segment 1, {name}: it turns by half a turn, 180°.*orientation in between",
    ):
        actuate(program(name, begin, end), TRAVERSER)


@pytest.mark.parametrize("radians", [3.1415927, 3.14159265])
def test_half_a_turn_of_eight_digits_is_one(radians):
    start = RigidTransform.from_translation([0.3, 0.2, 0.2])
    with pytest.raises(MotionError, match="half a turn"):
        actuate(
            Program([Turn(Rotation.from_rotvec([0, 0, radians]))], start=start, frame="base"),
            TRAVERSER,
        )


@pytest.mark.parametrize("name", SEGMENTS)
@pytest.mark.parametrize("angle", [179.999, -179.999])
def test_just_under_half_a_turn_goes_the_shorter_way(name, angle):
    path = actuate(program(name, 30, 30 + angle), TRAVERSER)
    s = np.linspace(0, path.breaks[-1], 101)
    piece = np.clip(np.searchsorted(path.breaks, s, side="right") - 1, 0, len(path.pieces) - 1)
    turned = np.degrees(path.derivatives(s, piece, 0)[0][:, 3])
    assert turned[-1] - turned[0] == pytest.approx(angle, abs=1e-9)
    assert (np.diff(turned) * np.sign(angle) >= -1e-9).all()


def test_half_a_turn_by_two_letters_is_one(hexapod):
    """Rx(180°) leads to the same orientation as Ry(180°) · Rz(180°): about any machine's axes, in
    any frame.
    """
    work = RigidTransform.from_components([0.01, 0, 0], Rotation.from_rotvec([0.1, 0.2, 0.3]))
    both = Rotation.from_euler("XYZ", [0, 180, 180], degrees=True)
    with pytest.raises(MotionError, match=r"segment 1, turn: it turns by half a turn"):
        actuate(Program([Turn(both)], work=work, start=RigidTransform.identity()), hexapod)


def test_a_signed_angle_says_the_way(tmp_path):
    """The remedy of the message, in a file; and the file's line where it is missing."""
    text = 'schema = 1\nangle = "deg"\nframe = "base"\nstart = ["1 in", "1 in", "1 in"]\n\n[[segment]]\n'
    file = tmp_path / "turn.toml"
    for angle in (180, -180):
        file.write_text(f"{text}turn = {{ about = [0, 0, 1], angle = {angle} }}\n", "utf-8")
        q = actuate(load_program(file), TRAVERSER)
        ends = np.degrees(
            q.derivatives(q.breaks[[0, -1]], np.array([0, len(q.pieces) - 1]), 0)[0][:, 3]
        )
        assert ends[1] - ends[0] == pytest.approx(angle, abs=1e-9)
    file.write_text(f"{text}turn = {{ to = [0, 0, 180] }}\n", "utf-8")
    with pytest.raises(
        MotionError, match=r"turn.toml:6: segment\[1\].turn: it turns by half a turn"
    ):
        actuate(load_program(file), TRAVERSER)
