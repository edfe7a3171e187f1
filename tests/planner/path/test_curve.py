"""Curves by equations: against arcs, integrals and derivatives of their own, and where there is no
such curve.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.special import ellipe

from kinematics import FileError, MotionError
from planner import Arc, Blend, Curve, Free, Line, Program, Through, Trigger, load_program, plan
from planner.path.chain import chain_pieces
from planner.path.curve import curve, ends
from planner.program.program_writer import program_toml
from planner.sources.outline import outline

MM = 1e-3
LISSAJOUS = ("10*sin(3*t)", "10*sin(2*t)", "25")
NONE = RigidTransform.identity()


def drawn(position, begin, end, **said):
    """The pieces of a curve in mm, from where it begins."""
    made = Curve(position, begin, end, length=MM, **said)
    return curve(ends(made)[0], made, NONE, 1)


def whole(pieces, count=201):
    """Places, tangents, curvature vectors and third derivatives (N, 3) each, piece after piece."""
    parts = [
        piece.derivatives(piece.start + np.linspace(0, piece.length, count)) for piece in pieces
    ]
    return [np.concatenate([part[k][:, :3] for part in parts]) for k in range(4)]


@pytest.mark.parametrize("order", [2, 3])
def test_a_circle_takes_as_long_as_the_arc(hexapod, order):
    """The same, however t runs through it, within 1e-6, at order 3 to what their grids lose; and
    its proof holds.
    """
    there, centre = Line([0.01, 0, 0.025]), np.array([0, 0, 0.025])
    arc = Arc(centre, [0, 0, 1], 2 * np.pi)
    one = plan(Program((there, arc, Line([0, 0, 0.025]))), hexapod, order=order)
    equations = Curve(
        ("r*cos(t)", "r*sin(t)", "25"), 0, 2 * np.pi, constants=(("r", 10.0),), length=MM
    )
    other = plan(Program((there, equations, Line([0, 0, 0.025]))), hexapod, order=order)
    assert other.trajectory.duration == pytest.approx(
        one.trajectory.duration, rel=1e-6 if order == 2 else 3e-5
    )
    assert other.certificate.holds
    state, place = (
        other.trajectory.at(np.linspace(0, other.trajectory.duration, 500)),
        hexapod.home.translation,
    )
    on = state.pose.translation - place - centre
    far = np.linalg.norm(on[state.piece == 1], axis=1)
    assert np.abs(far - 0.01).max() < 1e-12


def test_a_lissajous_figure_is_planned_and_proved(hexapod):
    made = Curve(
        LISSAJOUS, 0, 2 * np.pi, ("4*sin(t)", "0", "3*sin(2*t)"), length=MM, angle=math.radians(1)
    )
    planned = plan(Program((Line([0, 0, 0.025]), made)), hexapod, order=2)
    assert planned.certificate.holds
    end = planned.trajectory.at(planned.trajectory.duration)
    np.testing.assert_allclose(
        end.pose.translation[0] - hexapod.home.translation, [0, 0, 0.025], atol=1e-12
    )
    # the tool leaves no point of the figure: the nearest of many is not farther than their distance
    state = planned.trajectory.at(np.linspace(0, planned.trajectory.duration, 300))
    t = np.linspace(0, 2 * np.pi, 40_001)
    figure = MM * np.stack([10 * np.sin(3 * t), 10 * np.sin(2 * t), 0 * t + 25], 1)
    places = (state.pose.translation - hexapod.home.translation)[state.piece > 0]
    away = [np.linalg.norm(figure - place, axis=1).min() for place in places]
    assert max(away) < 4e-6


@pytest.mark.parametrize(("position", "begin", "end", "length"), [
    (("20*cos(t)", "20*sin(t)", "5*t"), 0, 4 * np.pi, 4 * np.pi * math.hypot(20, 5)),
    (("20*cos(t)", "12*sin(t)", "0"), 0, 2 * np.pi, 80 * ellipe(1 - 0.36)),
    (("3*t", "-4*t", "t-t"), 2, -5, 35.0),
    (("t", "t**2", "0"), 0, 3, (3 * math.sqrt(37) + math.asinh(6) / 2) / 2),
    (("exp(t)*cos(t)", "exp(t)*sin(t)", "0"), 0, 3, math.sqrt(2) * (math.exp(3) - 1)),
    (("t", "cosh", "0"), 0, 2, math.sinh(2)),
    (("t", "log(cos(t))", "0"), 0, 1, math.asinh(math.tan(1))),
    (("exp(5*t)", "2*exp(5*t)", "0"), 0, 2, math.sqrt(5) * (math.exp(10) - 1)),
])  # fmt: skip
def test_lengths_are_those_of_the_integrals(position, begin, end, length):
    """In closed form: helix, ellipse, line, parabola, logarithmic spiral, catenary, one of equal
    strength, growth.
    """
    position = tuple("(exp(t)+exp(-t))/2" if text == "cosh" else text for text in position)
    found = sum(piece.length for piece in drawn(position, begin, end))
    assert found == pytest.approx(length * MM, rel=1e-9)


def test_the_parameter_is_the_way_and_derivatives_are_its_own():
    """|p'| = 1; p'' and p''' are those of the curve by t, and continuous from piece to piece."""
    pieces = drawn(LISSAJOUS, 0.1, 6)
    place, tangent, bend, third = whole(pieces)
    assert np.abs(np.linalg.norm(tangent, axis=1) - 1).max() < 1.1e-10
    # (p' × p'')/|p'|³ by t, at the t that has the same place
    t = np.linspace(0.1, 6, 200_001)
    figure = MM * np.stack([10 * np.sin(3 * t), 10 * np.sin(2 * t), 0 * t + 25], 1)
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(figure, axis=0), axis=1))])
    s = np.concatenate(
        [
            sum(p.length for p in pieces[:k]) + np.linspace(0, piece.length, 201)
            for k, piece in enumerate(pieces)
        ]
    )
    when = np.interp(s, way, t)
    rate = MM * np.stack([30 * np.cos(3 * when), 20 * np.cos(2 * when), 0 * when], 1)
    rate2 = MM * np.stack([-90 * np.sin(3 * when), -40 * np.sin(2 * when), 0 * when], 1)
    curvature = np.cross(rate, rate2)[:, 2] / np.linalg.norm(rate, axis=1) ** 3
    np.testing.assert_allclose(
        np.cross(tangent, bend)[:, 2], curvature, atol=1e-4 * np.abs(curvature).max()
    )
    assert np.abs((tangent * bend).sum(1)).max() < 1e-6 * np.abs(bend).max()
    for k in range(1, len(pieces)):  # where one piece ends the next begins
        for values, size in (
            (place, 1.0),
            (tangent, 1.0),
            (bend, np.abs(bend).max()),
            (third, np.abs(third).max()),
        ):
            np.testing.assert_allclose(values[201 * k - 1], values[201 * k], atol=2e-6 * size)
    assert np.abs(place[-1] - figure[-1]).max() < 1e-14
    length, _ = quad(
        lambda u: MM * math.hypot(30 * math.cos(3 * u), 20 * math.cos(2 * u)),
        0.1,
        6,
        epsrel=1e-12,
        limit=200,
    )
    assert sum(piece.length for piece in pieces) == pytest.approx(length, rel=1e-9)


def test_orientation_goes_along(hexapod):
    """Rx Ry Rz of the formulas, from the current orientation; else it is kept."""
    angles = ("10*t", "5*sin(t)", "-8*t")
    made = Curve(("20*t", "0", "25"), 0, 1, angles, length=MM, angle=math.radians(1))
    pieces = chain_pieces(Program((Line([0, 0, 0.025]), made)), hexapod).pieces[1:]
    last = pieces[-1].poses(np.array([pieces[-1].start + pieces[-1].length]))[0, 3:].reshape(3, 3)
    wanted = hexapod.home.rotation * Rotation.from_euler(
        "XYZ", [10, 5 * math.sin(1), -8], degrees=True
    )
    np.testing.assert_allclose(last, wanted.as_matrix(), atol=1e-12)
    kept = Program((Line([0, 0, 0.025], Rotation.from_euler("X", 0.1)), replace(made, rotate=None)))
    poses = [
        piece.poses(np.array([0.0, piece.length]))[:, 3:]
        for piece in chain_pieces(kept, hexapod).pieces[1:]
    ]
    np.testing.assert_allclose(np.ptp(np.concatenate(poses), axis=0), 0, atol=1e-15)


def test_curves_lie_in_the_work_frame_and_under_the_tool(hexapod):
    """The same pieces as of an arc, tool, work frame and all."""
    frames = {
        "work": RigidTransform.from_components(
            [0.002, 0.001, 0.02], Rotation.from_euler("XYZ", [0.1, -0.05, 0.3])
        ),
        "tool": RigidTransform.from_components([0.001, 0, 0.03], Rotation.from_euler("Z", 0.2)),
    }
    arc = Arc([0, 0, 0.005], [0, 0, 1], 4.0)
    equations = Curve(("8*cos(t)", "8*sin(t)", "5"), 0, 4, length=MM)
    ways = []
    for part in (arc, equations):
        program = Program((Line([0.008, 0, 0.005]), part), **frames)
        (piece,) = chain_pieces(program, hexapod).pieces[1:]
        ways.append(piece.poses(piece.start + np.linspace(0, 1, 50) * piece.length))
    np.testing.assert_allclose(ways[0], ways[1], atol=1e-14)


def test_joins_with_neighbours(hexapod):
    """A tangent line is passed by order 2 and a stop for order 3, as curvature jumps; corners are
    blended.
    """
    quarter = Curve(("8*sin(t)", "8-8*cos(t)", "25"), 0, math.pi / 2, length=MM)
    tangent = Program((Line([-0.01, 0, 0.025]), Line([0, 0, 0.025], join=Through()), quarter))
    stops = chain_pieces(tangent, hexapod).stops
    assert stops[2] == 3
    corner = Program((Line([0, -0.01, 0.025]), Line([0, 0, 0.025], join=Blend(2e-4)), quarter))
    made = chain_pieces(corner, hexapod)
    (told,) = made.blends
    assert 0.97 * 2e-4 <= told.deviation <= 2e-4
    halves = Program(
        (
            Line([0, 0, 0.025]),
            replace(quarter, end=0.7, join=Through()),
            replace(quarter, begin=0.7),
        )
    )
    assert (
        chain_pieces(halves, hexapod).stops[2] == 0
    )  # of one curve in two parts: smooth, whatever the order


def test_triggers_and_freedom_are_those_of_other_segments(hexapod):
    """An event half its way along; a turn about the tool's own axis that is left free, and costs no
    time.
    """
    made = Curve(LISSAJOUS, 0, 1, length=MM, trigger=Trigger("half", 0.5))
    planned = plan(Program((Line([0, 0, 0.025]), made)), hexapod, order=2)
    (event,) = planned.triggers
    first, last = planned.path.breaks[[1, -1]]
    assert (event.where.s - first) / (last - first) == pytest.approx(0.5, abs=1e-9)
    pieces = chain_pieces(
        Program((Line([0, 0, 0.025]), replace(made, free=Free()))), hexapod
    ).pieces
    for piece, same in zip(pieces, planned.path.pieces, strict=True):
        assert piece.length == same.length


def test_constant_speed_needs_no_other_parameter(hexapod):
    made = Curve(("t", "t**2/20", "25"), 0, 12, length=MM, speed=0.005, speed_constant=True)
    planned = plan(Program((Line([0, 0, 0.025]), made)), hexapod, order=2)
    assert planned.certificate.holds
    assert planned.constant_speeds


@pytest.mark.parametrize(("position", "begin", "end", "words"), [
    (("abs(t)", "t", "25"), -1, 1, "not smooth, or not finite, at t = 0:"),
    (("t", "max(t, 0.3)", "25"), -1, 1, "at t = 0.3:"),
    (("t", "min(t, 0.5, 2*t)", "25"), 0.1, 1, "at t = 0.5:"),
    (("sqrt(t)", "t", "25"), -1, 1, "no finite value at t = -1"),
    (("sqrt(t)", "t", "25"), 0, 1, "at t = 0:"),
    (("sqrt(1-t**2)", "t", "25"), -1, 1, "at t = -1:"),
    (("sqrt(t**2-0.25)", "t", "25"), -1, 1, "at t = -0.5"),
    (("1/(t-0.3)", "t", "25"), -1, 1, "at t = 0.3:"),
    (("tan(t)", "t", "25"), 0, 3, "at t = 1.5708:"),
    (("log(t+2)", "1/t", "25"), -1, 1, "at t = 0:"),
    (("asin(t)", "t", "25"), 0, 1, "at t = 1:"),
    (("t**3", "t**2", "25"), -1, 1, "it stands still at t = 0:"),
    (("cos(t)", "cos(t)", "25"), 0.1, 4, "it stands still at t = 3.14159:"),
    (("3", "4", "25"), 0, 1, "it stands still at t ="),
    (("sin(1e8*t)", "t", "25"), 0, 1, "change so fast around t ="),
    (("exp(exp(t))", "t", "25"), 0, 9, "t ="),
    (("t**3+1e-9*t", "0", "25"), -1, 1, "it nearly stops around t = 0, "),
    (("(t-0.3)**3+1e-9*t", "0", "25"), -1, 1, "it nearly stops around t = 0.3, "),
])  # fmt: skip
def test_where_there_is_no_smooth_way(position, begin, end, words):
    for one, other in ((begin, end), (end, begin)):
        with pytest.raises(MotionError) as refused:
            drawn(position, one, other)
        assert words in str(refused.value) or (
            words.startswith("no finite") and "t = " in str(refused.value)
        )


def test_what_is_too_fine_is_not_said_to_stand_still():
    """|dp/dt| of (t, sin 1000 t) is at least 1."""
    with pytest.raises(
        MotionError, match=r"changes too often between t = 0 and 10 .*; shorten the interval"
    ):
        drawn(("t", "sin(1000*t)", "25"), 0, 10)


def test_a_kink_beside_the_interval_is_none():
    """The same abs where its argument keeps its sign, on either side."""
    for begin, end in ((0.1, 2), (-2, -0.1)):
        assert sum(
            piece.length for piece in drawn(("abs(t)", "0", "25"), begin, end)
        ) == pytest.approx(1.9 * MM)


def test_it_begins_where_the_path_stands(hexapod):
    made = Curve(("10*cos(t)", "10*sin(t)", "25"), 0, 1, length=MM, line_number=9)
    with pytest.raises(
        MotionError,
        match=r"segment 2, curve \(line 9\): its equations begin at \[10, 0, 25\] mm, 1 mm",
    ):
        chain_pieces(Program((Line([0.009, 0, 0.025]), made)), hexapod)
    turned = replace(made, rotate=("0.2", "0", "t"))
    with pytest.raises(
        MotionError, match=r"begin turned \[11.4592, 0, 0\]°, 11.4592° from the current orientation"
    ):
        chain_pieces(Program((Line([0.01, 0, 0.025]), turned)), hexapod)
    # rounding is made up for: the path has no gap
    near = Program((Line([0.01, 4e-10, 0.025]), made))
    one, other = chain_pieces(near, hexapod).pieces
    gap = one.poses(np.array([one.length])) - other.poses(np.array([0.0]))
    assert np.abs(gap[0, :3]).max() < 1e-16


TOML = """schema = 1
length = "in"
angle = "deg"
[[segment]]
line = {{ to = [1, 0, 0] }}
[[segment]]
curve = {{ {} }}
"""


def test_files_say_it_and_are_written(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text(TOML.format('x = "r*cos(t)", y = "r*sin(t)", z = 0, rz = "10*t", from = 0, to = "pi/n", '
                                'constants = { r = 1, n = 2 }'))  # fmt: skip
    read = load_program(path)
    made = read.segments[1]
    assert (made.begin, made.end) == (0, math.pi / 2)
    assert made.rotate == ("0", "0", "10*t")
    for part in (made, *[load_program(_written(read, tmp_path / "again.toml")).segments[1]]):
        _, last = ends(part)
        np.testing.assert_allclose(last.translation, [0, 0.0254, 0], atol=1e-17)
        assert last.rotation.as_euler("XYZ", degrees=True)[2] == pytest.approx(10 * math.pi / 2)
    found = outline(read)
    assert found.length == pytest.approx(0.0254 * (1 + math.pi / 2))
    np.testing.assert_allclose(found.high, [0.0254, 0.0254, 0], atol=1e-12)


def _written(program, path):
    path.write_text(program_toml(program))
    return path


@pytest.mark.parametrize(("text", "words"), [
    ('x = "os.x", y = 0, z = 0, from = 0, to = 1', "c.toml:7: segment[2].curve.x: \"os.x\": "),
    ('x = "radus", y = 0, z = 0, from = 0, to = 1, constants = { radius = 1 }', 'nearest is "radius"'),
    ('x = "t", y = 0, from = 0, to = 1', "segment[2].curve.z: missing"),
    ('x = "t", y = 0, z = 0, from = 0, to = "t"', "segment[2].curve.to: \"t\": t is not defined here"),
    ('x = "t", y = 0, z = 0, from = 1, to = 1', "t runs from 1 to 1"),
    ('x = "t", y = 0, z = 0, w = 0, from = 0, to = 1', "segment[2].curve.w: unknown key"),
    ('x = [1], y = 0, z = 0, from = 0, to = 1', "segment[2].curve.x: [1] is no formula"),
    ('x = true, y = 0, z = 0, from = 0, to = 1', "segment[2].curve.x: true is no formula"),
    ('x = "t", y = 0, z = 0, from = 0, to = 1, constants = { sin = 1 }', "sin is predefined"),
    ('x = "t", y = 0, z = 0, from = 0, to = 1, constants = { a = "1" }', "segment[2].curve.constants.a"),
    ('x = "9**9**9**9", y = 0, z = 0, from = 0, to = 1', "is not a finite number"),
])  # fmt: skip
def test_faults_of_files(text, words, tmp_path):
    path = tmp_path / "c.toml"
    path.write_text(TOML.format(text))
    with pytest.raises(FileError) as refused:
        load_program(path)
    assert words in str(refused.value)


def test_units_have_to_be_declared(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text(
        'schema = 1\n[[segment]]\ncurve = { x = "t", y = 0, z = 0, from = 0, to = 1 }\n'
    )
    with pytest.raises(FileError, match='add the line length = "mm" at the top'):
        load_program(path)
