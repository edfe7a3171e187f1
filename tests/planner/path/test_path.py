"""Paths in space: what lines, arcs, turns and dwells become, piece by piece."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Hexapod, MotionError, load_machine
from planner import Arc, Dwell, Line, Program, Spline, Turn
from planner.path.actuation import actuate
from planner.path.chain import chain_pieces

ROUNDING = 1e-15  # m: a few roundings of coordinates of decimetres
UP = (0.0, 0.0, 0.025)
RIM = RigidTransform.from_components([0.015, 0, 0.025], Rotation.identity())


def drawn(machine, *segments, start=RIM, frame="home"):
    """The path of some segments in the machine's actuators."""
    return actuate(Program(segments, frame=frame, start=start), machine)


def along(path, piece=0, points=101):
    """s (N,) over a piece, positions (N, 3) and rotations (N, 3, 3) there."""
    s = np.linspace(path.breaks[piece], path.breaks[piece + 1], points)
    numbers = path.pose_numbers(s, np.full(points, piece))
    return s, numbers[:, :3], numbers[:, 3:].reshape(-1, 3, 3)


def degrees(x, y, z):
    return Rotation.from_euler("XYZ", [x, y, z], degrees=True)


def angle_between(first, second):
    """Angle of the rotation between matrices, from the chord ‖A − B‖ = 2√2 sin(θ/2): exact near
    zero.
    """
    return 2 * np.arcsin(np.clip(np.linalg.norm(first - second, axis=(-2, -1)) / np.sqrt(8), 0, 1))


points = st.tuples(*[st.floats(-0.05, 0.05)] * 3).map(np.array)
directions = (
    st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)
)
angles = st.floats(-4 * np.pi, 4 * np.pi).filter(lambda angle: abs(angle) > 0.01)


@settings(max_examples=40, deadline=None)
@given(start=points, end=points)
def test_a_line_runs_straight_and_at_unit_speed(hexapod, start, end):
    length = np.linalg.norm(end - start)
    assume(length > 1e-4)
    pose = RigidTransform.from_components(start, Rotation.identity())
    path = drawn(hexapod, Line(end), start=pose)
    s, position, _ = along(path)
    assert path.breaks[-1] == pytest.approx(length, abs=ROUNDING)
    straight = hexapod.home.translation + start + (end - start) * (s / length)[:, None]
    assert np.abs(position - straight).max() < ROUNDING
    # the direction is a difference of decimetres over the length: its rounding grows as the line
    # shrinks
    speed = np.linalg.norm(path.pose_derivatives(s, np.zeros(len(s), int))[1][:, :3], axis=1)
    assert np.abs(speed - 1).max() < ROUNDING / length + 1e-15


@settings(max_examples=40, deadline=None)
@given(
    centre=points, normal=directions, radial=directions, radius=st.floats(1e-3, 0.05), angle=angles
)
def test_an_arc_keeps_radius_and_plane_and_turns_by_its_signed_angle(
    hexapod, rodrigues, centre, normal, radial, radius, angle
):
    unit = normal / np.linalg.norm(normal)
    u = np.cross(unit, radial)
    assume(np.linalg.norm(u) > 0.05)
    u *= radius / np.linalg.norm(u)
    pose = RigidTransform.from_components(centre + u, Rotation.identity())
    path = drawn(hexapod, Arc(centre, normal, angle), start=pose)
    s, position, _ = along(path)
    assert path.breaks[-1] == pytest.approx(radius * abs(angle), rel=1e-13)
    spoke = position - hexapod.home.translation - centre
    assert np.abs(np.linalg.norm(spoke, axis=1) - radius).max() < 2 * ROUNDING
    assert np.abs(spoke @ unit).max() < 2 * ROUNDING
    # more than 360° and negative angles: the right hand about the normal, all the way
    swept = rodrigues(unit, angle * (s - s[0]) / (s[-1] - s[0])) @ u
    assert np.abs(spoke - swept).max() < 1e-14
    assert (
        np.abs(
            np.linalg.norm(path.pose_derivatives(s, np.zeros(len(s), int))[1][:, :3], axis=1) - 1
        ).max()
        < 1e-12
    )
    # path length is true length: the chord of an arc of length d is 2 r sin(d/2r)
    chord = np.linalg.norm(np.diff(position, axis=0), axis=1)
    assert np.abs(chord - 2 * radius * np.abs(np.sin(np.diff(s) / (2 * radius)))).max() < 1e-14


@pytest.mark.parametrize(
    ("angle", "end"), [(90, (0, 15)), (-90, (0, -15)), (450, (0, 15)), (-720, (15, 0))]
)
def test_an_arc_ends_where_its_angle_says(hexapod, angle, end):
    path = drawn(hexapod, Arc(UP, [0, 0, 1], np.deg2rad(angle)))
    offset = (along(path)[1][-1] - hexapod.home.translation) * 1e3
    assert offset == pytest.approx([*end, 25], abs=1e-12)


@settings(max_examples=30, deadline=None)
@given(angle=angles, rise=st.floats(-0.05, 0.05), normal=directions)
def test_a_helix_climbs_in_proportion_to_its_angle(hexapod, rodrigues, angle, rise, normal):
    """Length √((rφ)² + h²), curvature r φ²/L², torsion h φ/L²: analytic, from its derivatives by
    path length.
    """
    unit = normal / np.linalg.norm(normal)
    u = np.cross(unit, [1.0, 0, 0] if abs(unit[0]) < 0.8 else [0, 1.0, 0])
    u *= 0.012 / np.linalg.norm(u)
    centre = np.array([0.01, -0.02, 0.03])
    pose = RigidTransform.from_components(centre + u, Rotation.identity())
    path = drawn(hexapod, Arc(centre, normal, angle, rise=rise), start=pose)
    length = np.hypot(0.012 * angle, rise)
    s, position, _ = along(path)
    assert s[-1] == pytest.approx(length, rel=1e-13)
    share = (s / length)[:, None]
    drawn_by_hand = centre + rodrigues(unit, angle * s / length) @ u + share * rise * unit
    assert np.abs(position - hexapod.home.translation - drawn_by_hand).max() < 1e-14
    _, p1, p2, p3 = (x[:, :3] for x in path.pose_derivatives(s, np.zeros(len(s), int)))
    assert np.abs(np.linalg.norm(p1, axis=1) - 1).max() < 1e-12
    curvature = 0.012 * angle**2 / length**2
    assert np.linalg.norm(p2, axis=1) == pytest.approx(curvature, rel=1e-9)
    torsion = (np.cross(p1, p2) * p3).sum(1) / (p2**2).sum(1)
    assert torsion == pytest.approx(rise * angle / length**2, rel=1e-9, abs=1e-9)


def test_a_helix_ends_where_its_rise_says_and_the_path_goes_on_there(hexapod):
    path = drawn(hexapod, Arc(UP, [0, 0, 2], np.deg2rad(-450), rise=-0.003), Line([0, 0, 0.022]))
    assert (along(path, 0)[1][-1] - hexapod.home.translation) * 1e3 == pytest.approx(
        [0, -15, 22], abs=1e-12
    )
    assert path.breaks[-1] - path.breaks[1] == pytest.approx(0.015, rel=1e-12)


@pytest.mark.parametrize(
    "segment",
    [Line([0.0, 0.01, 0.03], degrees(3, -8, 20)), Arc(UP, [0, 0, 1], 4, degrees(3, -8, 20))],
)
def test_orientation_turns_the_shorter_way_in_proportion_to_path_length(
    hexapod, rodrigues, segment
):
    start = RigidTransform.from_components(RIM.translation, degrees(-5, 2, -170))
    end = segment.rotate.as_matrix()
    path = drawn(hexapod, segment, start=start)
    s, _, rotation = along(path)
    share = (s - s[0]) / (s[-1] - s[0])
    total = angle_between(rotation[0], end)
    assert total == pytest.approx(
        np.arccos((np.trace(rotation[0].T @ end) - 1) / 2), abs=1e-9
    )  # ≤ 180° by nature
    assert angle_between(rotation, rotation[0]) == pytest.approx(total * share, abs=1e-14)
    assert np.abs(rotation[-1] - end).max() < 1e-14
    # one axis all the way, fixed in the platform
    skew = rotation[0].T @ rotation[50]
    axis = np.array([skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0], skew[1, 0] - skew[0, 1]])
    assert np.abs(rotation - rotation[0] @ rodrigues(axis, total * share)).max() < 1e-13


def test_the_shorter_way_crosses_half_a_turn(hexapod):
    start = RigidTransform.from_components(RIM.translation, degrees(0, 0, 170))
    path = drawn(hexapod, Turn(degrees(0, 0, -170)), start=start)
    heading = np.rad2deg(Rotation.from_matrix(along(path, points=5)[2]).as_rotvec()[:, 2])
    assert heading % 360 == pytest.approx([170, 175, 180, 185, 190], abs=1e-10)


def test_orientation_is_kept_where_none_is_asked_for(hexapod):
    turned = degrees(3, -4, 5)
    path = drawn(hexapod, Turn(turned), Line([0, 0, 0.02]), Arc([0, 0.01, 0.02], [1, 0, 0], 1.0))
    for piece in (1, 2):
        assert np.abs(along(path, piece)[2] - turned.as_matrix()).max() < 1e-14


def test_a_turn_is_as_long_as_its_angle_times_the_characteristic_length(hexapod, rodrigues):
    vector, angle = np.array([1.0, -2.0, 0.5]), 0.3
    to = Rotation.from_matrix(rodrigues(vector, [angle])[0])
    path = drawn(hexapod, Turn(to))
    # of the hexapod: root mean square distance of the platform's joints from its origin
    assert hexapod.characteristic_length == pytest.approx(np.hypot(0.1, 0.011), rel=1e-14)
    assert path.breaks[-1] == pytest.approx(angle * np.hypot(0.1, 0.011), rel=1e-13)
    s, position, rotation = along(path)
    assert np.abs(position - position[0]).max() == 0
    assert np.abs(rotation - rodrigues(vector, angle * s / s[-1])).max() < 1e-14


def test_frames(hexapod):
    """A program in the frame "home" is the same program in the base frame, moved by the home
    pose.
    """
    home = RigidTransform.from_components([0.01, -0.02, 0.24], degrees(10, -20, 30))
    matrix = home.rotation.as_matrix()
    machine = Hexapod(hexapod.base, hexapod.platform, axes=hexapod.axes, home=home)
    start = RigidTransform.from_components([0.0, 0.0, 0.01], degrees(1, 2, 3))
    line, arc, turn = segments = (
        Line([0.01, 0, 0.01], degrees(4, 5, 6)),
        Arc([0, 0, 0.01], [0, -0.6, 0.8], -5.0, degrees(0, 0, 1)),
        Turn(degrees(-2, 0, 0)),
    )
    moved = (
        Line(matrix @ line.to + home.translation, home.rotation * line.rotate),
        Arc(
            matrix @ arc.centre + home.translation,
            matrix @ arc.normal,
            arc.angle,
            home.rotation * arc.rotate,
        ),
        Turn(home.rotation * turn.to),
    )
    relative = drawn(machine, *segments, start=start, frame="home")
    absolute = drawn(machine, *moved, start=home * start, frame="base")
    for piece in range(3):
        _, position, rotation = along(relative, piece)
        _, position_base, rotation_base = along(absolute, piece)
        assert np.abs(position - position_base).max() < 1e-14
        assert np.abs(rotation - rotation_base).max() < 1e-14
    # and it lies where the home pose says
    assert np.abs(along(relative, 0)[1][-1] - matrix @ line.to - home.translation).max() < 1e-14


@pytest.mark.parametrize("frame", ["home", "base"])
def test_a_program_without_a_start_starts_at_home(hexapod, frame):
    to = [0.0, 0, 0.02] if frame == "home" else [0, 0, 0.25]
    _, position, rotation = along(drawn(hexapod, Line(to), start=None, frame=frame))
    assert np.abs(position[0] - hexapod.home.translation).max() < ROUNDING
    assert np.abs(rotation[0] - np.eye(3)).max() < ROUNDING


def test_dwells_lie_between_the_pieces_and_add_up(hexapod):
    path = drawn(
        hexapod,
        Dwell(0.1),
        Dwell(0.2),
        Line([0, 0, 0.02]),
        Line([0, 0, 0.03]),
        Dwell(0.5),
        Turn(degrees(1, 0, 0)),
        Dwell(0.25),
    )
    assert path.dwells == pytest.approx([0.1 + 0.2, 0, 0.5, 0.25], abs=0)
    assert [path.segment(piece) for piece in range(3)] == [3, 4, 6]
    assert path.stops(2).all()
    assert path.stops(3).all()


def test_pieces_meet(hexapod, planned):
    """Every piece of the preset `circle` starts in the pose in which the one before it ends, and
    the last at home.
    """
    path = planned("circle", 2).path
    ends = [along(path, piece, points=2) for piece in range(len(path.pieces))]
    for (_, before, turned), (_, after, turned_after) in pairwise(ends):
        assert np.abs(before[-1] - after[0]).max() < ROUNDING
        assert np.abs(turned[-1] - turned_after[0]).max() < ROUNDING
    assert np.abs(ends[-1][1][-1] - hexapod.home.translation).max() < ROUNDING


def test_tool_speed_caps_belong_to_their_segment(hexapod):
    chained = chain_pieces(
        Program([Line([0, 0, 0.02]), Line([0, 0, 0.03], speed=0.01), Turn(degrees(1, 0, 0))]),
        hexapod,
    )
    assert [piece.tool_speed for piece in chained.pieces] == [None, 0.01, None]


@pytest.mark.parametrize(
    ("segments", "phrases"),
    [
        (
            [Line([0, 0, 0.03]), Line([0, 0, 0.03], degrees(1, 0, 0))],
            ["segment 2, line", "ends where it starts", "[0, 0, 30] mm", "turn"],
        ),
        (
            [Dwell(0.1), Arc([0, 0, 0.022], [0, 0, 1], 1.0)],
            [
                "segment 2, arc",
                "3 mm out of the plane",
                "move the centre by [0, 0, 3] mm",
                "normal",
            ],
        ),
        (
            [Arc(RIM.translation, [0, 0, 1], 1.0)],
            ["segment 1, arc", "the arc's centre", "[15, 0, 25] mm", "give another centre"],
        ),
        (
            [Turn(Rotation.identity())],
            ["segment 1, turn", "already has that orientation", "omit it"],
        ),
        (
            [Dwell(0.1), Spline([RIM.translation, [0, 0, 0.02]])],
            ["segment 2, spline", "point 1 is the current point of the path", "[15, 0, 25] mm"],
        ),
        (
            [Spline([[0, 0, 0.025], [0.01, 0, 0.025], [-0.01, 0, 0.025], [0.01, 1e-4, 0.025]])],
            ["segment 1, spline", "turns back", "add points"],
        ),
        (
            [
                Spline(
                    [[0, 0, 0.025], [0, 0.01, 0.025]],
                    Rotation.from_euler("z", [[90], [-60]], degrees=True),
                )
            ],
            ["segment 1, spline", "point 2 turns by 150° from point 1", "at most 120°"],
        ),
        ([Dwell(1.0)], ["nothing moves", "add a line"]),
    ],
)
def test_what_cannot_be_drawn_is_refused_by_name(hexapod, segments, phrases):
    with pytest.raises(MotionError) as refusal:
        drawn(hexapod, *segments)
    for phrase in phrases:
        assert phrase in str(refusal.value)


def test_a_refusal_names_the_line_of_the_file(hexapod):
    with pytest.raises(MotionError, match=r"segment 1, line \(line 12\)"):
        drawn(hexapod, Line(RIM.translation, line_number=12))


@pytest.mark.parametrize(
    ("height", "refused"), [(1e-6, True), (-1e-6, True), (1e-9, False), (-1e-9, False)]
)
def test_an_arc_may_start_out_of_its_plane_by_rounding_only(hexapod, height, refused):
    """A micron at a radius of 15 mm is refused; a nanometre is taken into the plane of the start
    itself.
    """
    segment = Arc([0, 0, 0.025 + height], [0, 0, 1], 1.0)
    if refused:
        with pytest.raises(MotionError, match=r"0\.001 mm out of the plane"):
            drawn(hexapod, segment)
    else:
        position = along(drawn(hexapod, segment))[1] - hexapod.home.translation
        assert np.abs(position[:, 2] - 0.025).max() < ROUNDING


def test_moving_the_centre_as_told_mends_an_arc_out_of_its_plane(hexapod):
    normal = np.array([0, -np.sin(0.3), np.cos(0.3)])
    centre = np.array([0.001, 0.002, 0.02])
    with pytest.raises(MotionError) as refusal:
        drawn(hexapod, Arc(centre, normal, 1.0))
    told = str(refusal.value).split("move the centre by [")[1].split("]")[0]
    moved = centre + np.array([float(number) for number in told.split(",")]) * 1e-3
    _, position, _ = along(drawn(hexapod, Arc(moved, normal, 1.0)))
    assert (
        np.abs((position - hexapod.home.translation - moved) @ normal).max() < 1e-8
    )  # told to six digits
    assert np.abs(position[0] - hexapod.home.translation - RIM.translation).max() < ROUNDING


@pytest.mark.parametrize("angle", [np.deg2rad(720), -np.deg2rad(200), 1e-3])
def test_a_turn_by_any_angle_goes_all_the_way_round(angle):
    """A traverser's rotary axis counts every turn; the pose at the end is SciPy's."""
    machine = load_machine("traverser")
    away = RigidTransform.from_components([0.1, 0.2, 0.3], Rotation.identity())
    program = Program([Turn(about=[0, 0, 2], angle=angle)], start=away)
    path = actuate(program, machine)
    length = abs(angle) * machine.characteristic_length
    assert path.breaks[-1] == pytest.approx(length, rel=1e-12)
    last = len(path.breaks) - 2
    q = path.derivatives(np.array([length / 2, length]), np.array([last // 2, last]))[0]
    assert q[1, 3] - machine.home_q[3] == pytest.approx(angle, rel=1e-12)
    assert np.abs(q[:, :3] - q[0, :3]).max() < 1e-15


def test_a_turn_about_an_axis_of_the_work_frame(hexapod):
    """R_end = exp(angle · about) R_start in the program's frame, whatever the frame and the
    start.
    """
    start = RigidTransform.from_components(
        [0, 0, 0.02], Rotation.from_euler("XYZ", [3, -2, 4], degrees=True)
    )
    work = RigidTransform.from_components([0.001, 0, 0], Rotation.from_euler("Z", 0.3))
    program = Program([Turn(about=[1, 2, 0], angle=0.1)], start=start, work=work)
    path = actuate(program, hexapod)
    axis = np.array([1, 2, 0]) / np.sqrt(5)
    end = (
        hexapod.home
        * work
        * RigidTransform.from_components(
            start.translation, Rotation.from_rotvec(0.1 * axis) * start.rotation
        )
    )
    x = path.pose_numbers(path.breaks[-1:], np.array([0]))[0]
    assert np.abs(x[3:].reshape(3, 3) - end.rotation.as_matrix()).max() < 1e-14
    assert np.abs(x[:3] - end.translation).max() < 1e-15


def test_a_turn_says_one_thing():
    for said in ({}, {"to": Rotation.identity(), "about": [0, 0, 1], "angle": 1.0}):
        with pytest.raises(MotionError, match="exactly one of the two"):
            Turn(**said)
    with pytest.raises(MotionError, match=r"angle 0\.0 rad must be"):
        Turn(about=[0, 0, 1])
    with pytest.raises(MotionError, match="about is zero"):
        Turn(about=[0, 0, 0], angle=1.0)
