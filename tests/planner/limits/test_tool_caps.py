"""What a program caps: acceleration of the tool on a circle, turning on the spot, defaults for
every segment.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.special import beta

from kinematics import FileError, MotionError
from planner import Arc, Dwell, Line, Program, Turn, load_program, plan
from planner.path.chain import chain_pieces

RADIUS, PUSH = 0.01, 0.02
BESIDE = RigidTransform.from_components([RADIUS, 0, 0.025], Rotation.identity())


def test_a_circle_under_a_tool_acceleration(hexapod):
    """(x′/2)² + (x/r)² = a² with x = v²: the ramp is x = r a sin(2s/r), then v = √(r a).

    Its time is r/(2 √(r a)) ∫ sin^(−½) over a quarter, = r B(¼, ½)/(4 √(r a)), on a way of π r/4.
    """
    way, cruise = 2.5 * np.pi * RADIUS, np.sqrt(RADIUS * PUSH)
    made = plan(
        Program([Arc([0, 0, 0.025], [0, 0, 1], 2.5 * np.pi, acceleration=PUSH)], start=BESIDE),
        hexapod,
        order=2,
    )
    ideal = 2 * RADIUS * beta(0.25, 0.5) / (4 * cruise) + (way - np.pi * RADIUS / 2) / cruise
    assert made.certificate.holds
    assert made.certificate.worst["tool acceleration"] == pytest.approx(1.0, abs=1e-6)
    # at cruise a corner of the facets is met; on the ramps they lose 1 − cos(π/64) of a at most,
    # half of it in time
    assert made.trajectory.v.max() == pytest.approx(cruise, rel=1e-6)
    assert ideal * (1 - 1e-9) <= made.trajectory.duration <= ideal * (1 + 6.1e-4)
    assert str(made.certificate.where["tool acceleration"]).startswith("tool, s = ")
    t = np.linspace(0, made.trajectory.duration, 40001)
    poses = made.trajectory.at(t).pose.translation
    sampled = np.linalg.norm(poses[2:] - 2 * poses[1:-1] + poses[:-2], axis=1) / (t[1] - t[0]) ** 2
    # differences of positions of decimetres over 0.1 ms squared round by 1e-6 of the acceleration
    assert 0.999 * PUSH < sampled.max() <= PUSH * (1 + 1e-5)


def test_a_circle_under_a_tool_acceleration_and_jerk_limits(hexapod):
    made = plan(
        Program([Arc([0, 0, 0.025], [0, 0, 1], np.pi, acceleration=PUSH)], start=BESIDE),
        hexapod,
        order=3,
    )
    quicker = plan(
        Program([Arc([0, 0, 0.025], [0, 0, 1], np.pi, acceleration=PUSH)], start=BESIDE),
        hexapod,
        order=2,
    )
    assert made.certificate.holds
    assert made.trajectory.v.max() == pytest.approx(np.sqrt(RADIUS * PUSH), rel=1e-5)
    # legs' jerk of 4 m/s³ builds 0.02 m/s² within 5 ms or so, four times
    assert (
        quicker.trajectory.duration < made.trajectory.duration < quicker.trajectory.duration + 0.02
    )


@pytest.mark.parametrize("order", [2, 3])
def test_a_turn_on_the_spot(hexapod, order):
    """At a cap far below what the legs could, T ≈ angle / cap: longer by the ramps only."""
    angle, cap = np.deg2rad(8), np.deg2rad(4)
    made = plan(
        Program([Turn(Rotation.from_euler("z", angle), angular_speed=cap)], start=BESIDE),
        hexapod,
        order=order,
    )
    assert made.certificate.holds
    assert made.certificate.worst["angular speed"] == pytest.approx(1.0, abs=5e-6)  # as solvers aim
    assert angle / cap < made.trajectory.duration < angle / cap + 0.1
    poses = made.trajectory.at(np.linspace(0, made.trajectory.duration, 20001)).pose
    turned = (
        (poses[:-1].rotation.inv() * poses[1:].rotation).magnitude()
        * 20000
        / made.trajectory.duration
    )
    assert turned.max() == pytest.approx(cap, rel=1e-5)


def test_a_program_s_caps_are_the_defaults_of_its_segments(hexapod):
    segments = [
        Line([0, 0, 0.02], speed=0.01),
        Turn(Rotation.from_euler("z", 0.1), angular_speed=0.2),
        Dwell(0.1),
        Line([0, 0, 0.01], Rotation.identity(), acceleration=0.5),
    ]
    pieces = chain_pieces(
        Program(segments, speed=0.03, acceleration=0.1, angular_speed=0.3), hexapod
    ).pieces
    caps = [(piece.tool_speed, piece.tool_acceleration, piece.angular_speed) for piece in pieces]
    assert caps == [(0.01, 0.1, 0.3), (None, None, 0.2), (0.03, 0.5, 0.3)]
    pieces = chain_pieces(Program(segments), hexapod).pieces
    caps = [(piece.tool_speed, piece.tool_acceleration, piece.angular_speed) for piece in pieces]
    assert caps == [(0.01, None, None), (None, None, 0.2), (None, 0.5, None)]


def test_caps_in_a_file(tmp_path):
    file = tmp_path / "capped.toml"
    file.write_text(
        'schema = 1\nlength = "mm"\nangle = "deg"\nspeed = "30 mm/s"\nacceleration = "2 m/s^2"\n'
        'angular_speed = "30 deg/s"\n'
        '[[segment]]\nline = { to = [0, 0, 10] }\nacceleration = "0.5 m/s^2"\nangular_speed = "0.1 rad/s"\n'
        '[[segment]]\narc = { centre = [5, 0, 10], normal = [0, 0, 1], angle = 90 }\nacceleration = "1 m/s^2"\n'
        '[[segment]]\nturn = { to = [0, 0, 5] }\nangular_speed = "10 deg/s"\n'
    )
    program = load_program(file)
    assert (program.speed, program.acceleration) == (0.03, 2.0)
    assert program.angular_speed == pytest.approx(np.pi / 6, rel=1e-15)
    line, arc, turn = program.segments
    assert (line.speed, line.acceleration, line.angular_speed) == (None, 0.5, 0.1)
    assert (arc.acceleration, arc.angular_speed) == (1.0, None)
    assert turn.angular_speed == pytest.approx(np.pi / 18, rel=1e-15)
    file.write_text(file.read_text() + 'acceleration = "1 m/s^2"\n')
    with pytest.raises(FileError, match="acceleration"):
        load_program(file)  # a turn on the spot has none


@pytest.mark.parametrize("name", ["acceleration", "angular_speed"])
def test_a_cap_is_positive(name):
    with pytest.raises(MotionError, match=f"line: {name} -1.0 .* must be positive"):
        Line([0, 0, 1], **{name: -1.0})
    with pytest.raises(MotionError, match=f"program p: {name} 0.0 .* must be positive"):
        Program([Line([0, 0, 1])], name="p", **{name: 0.0})
    with pytest.raises(MotionError, match=r"turn: angular_speed nan rad/s must be positive"):
        Turn(Rotation.identity(), angular_speed=float("nan"))
