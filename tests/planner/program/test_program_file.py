"""Program files: the bundled ones, units, frames and rotations, and faults."""

from importlib.resources import files
from math import cos, radians, sin

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kinematics import FileError, MotionError
from planner import (
    Arc,
    Blend,
    Dwell,
    Line,
    Stop,
    Through,
    Trigger,
    Turn,
    load_program,
    program_names,
)

CIRCLE = (files("planner") / "presets" / "circle.toml").read_text(encoding="utf-8")
TOP = 'schema = 1\nlength = "mm"\nangle = "deg"\n'


@pytest.fixture
def load(tmp_path):
    def loaded(text):
        path = tmp_path / "part.toml"
        path.write_text(text, encoding="utf-8")
        return load_program(path)

    return loaded


def moving_axes(x, y, z):
    """Rx(θx) · Ry(θy) · Rz(θz), degrees, written out."""
    (cx, cy, cz), (sx, sy, sz) = ([f(radians(a)) for a in (x, y, z)] for f in (cos, sin))
    rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return rx @ ry @ rz


def test_the_circle_is_the_program_of_the_design():
    program = load_program("circle")
    assert (program.name, program.machine, program.frame, program.start) == (
        "circle",
        "hexapod",
        "home",
        None,
    )
    kinds = [type(segment) for segment in program.segments]
    assert kinds == [Line, Line, Arc, Arc, Line, Dwell, Turn, Turn, Line]
    assert all(
        segment.join == Stop() for segment in program.segments if not isinstance(segment, Dwell)
    )
    up, out, flat, tilted, back, rest, turned, straight, down = program.segments
    for line, to in (
        (up, (0, 0, 0.025)),
        (out, (0.015, 0, 0.025)),
        (back, (0, 0, 0.025)),
        (down, (0, 0, 0)),
    ):
        np.testing.assert_array_equal(line.to, to)
    assert (flat.speed, tilted.speed, rest.duration) == (0.03, None, 0.2)
    for arc in (flat, tilted):
        assert arc.angle == 2 * np.pi
        np.testing.assert_array_equal(arc.centre, [0, 0, 0.025])
    # ten digits in the file
    np.testing.assert_allclose(tilted.normal, [0, -sin(radians(20)), cos(radians(20))], atol=1e-10)
    np.testing.assert_allclose(turned.to.as_matrix(), moving_axes(6, -7, 0), atol=1e-15)
    np.testing.assert_allclose(straight.to.as_matrix(), np.eye(3), atol=1e-15)


def test_the_bare_circle_is_one_arc_from_its_start():
    program = load_program("bare-circle")
    (arc,) = program.segments
    np.testing.assert_array_equal(program.start.translation, [0.015, 0, 0.025])
    np.testing.assert_allclose(program.start.rotation.as_matrix(), np.eye(3))
    np.testing.assert_array_equal(arc.centre, [0, 0, 0.025])
    np.testing.assert_array_equal(arc.normal, [0, 0, 1])
    assert (arc.angle, arc.speed, arc.rotate) == (2 * np.pi, None, None)


def test_segments_know_the_lines_of_their_file():
    lines = CIRCLE.splitlines()
    numbers = [segment.line_number for segment in load_program("circle").segments]
    assert [n + 1 for n, line in enumerate(lines) if line == "[[segment]]"] == numbers


def test_plain_numbers_and_unit_strings_mean_the_same(load):
    plain = load(
        TOP
        + "start = [1, 2, 3, 10, 20, 30]\n[[segment]]\nline = { to = [25.4, 0, -1], rotate = [30, 0, 90] }\n"
    )
    units = load(
        'schema = 1\nstart = ["1 mm", "0.2 cm", "3000 um", "10 deg", "1200 arcmin", "30°"]\n'
        '[[segment]]\nline = { to = ["1 in", "0 m", "-1 mm"], rotate = ["30 deg", "0 rad", "0.25 rev"] }\n'
    )
    for program in (plain, units):
        (line,) = program.segments
        np.testing.assert_allclose(line.to, [0.0254, 0, -0.001], rtol=1e-15)
        np.testing.assert_allclose(line.rotate.as_matrix(), moving_axes(30, 0, 90), atol=1e-15)
        np.testing.assert_allclose(program.start.translation, [0.001, 0.002, 0.003], rtol=1e-15)
        np.testing.assert_allclose(
            program.start.rotation.as_matrix(), moving_axes(10, 20, 30), atol=1e-15
        )


def test_declared_units_may_be_any_of_their_dimension(load):
    turn, line = load("""\
schema = 1
length = "in"
angle = "rad"
[[segment]]
turn = { to = [1, 0, 0] }
[[segment]]
line = { to = [1, 0, 0] }
""").segments
    assert line.to[0] == 0.0254
    np.testing.assert_allclose(turn.to.as_rotvec(), [1, 0, 0], atol=1e-15)


def test_joins_speeds_frames_and_dwells(load):
    text = f"""{TOP}frame = "base"
[[segment]]
line = {{ to = [1, 2, 3] }}
speed = "0.5 in/s"
join = {{ blend = 0.05 }}
[[segment]]
arc = {{ centre = [0, 2, 3], normal = [0, 0, 2], angle = "-2 rev", rotate = [0, 0, 5] }}
join = {{ blend = "1 um" }}
[[segment]]
turn = {{ to = [0, 0, 0] }}
join = "stop"
[[segment]]
dwell = "20 ms"
"""
    program = load(text)
    line, arc, turn, dwell = program.segments
    assert (program.frame, program.machine, program.name) == ("base", None, "part")
    assert (line.speed, line.join) == (0.0127, Blend(0.05e-3))
    assert (arc.angle, arc.join) == (-4 * np.pi, Blend(1e-6))
    np.testing.assert_array_equal(arc.normal, [0, 0, 1])
    np.testing.assert_allclose(arc.rotate.as_rotvec(degrees=True), [0, 0, 5], atol=1e-14)
    assert (turn.join, dwell.duration) == (Stop(), 0.02)


def test_splines_helices_and_what_joins_may_be(load):
    text = f"""{TOP}
[[segment]]
spline = {{ through = [[1, 2, 3], ["1 in", 0, 0]], rotate = [[0, 0, 5], [0, "0.1 rad", 0]] }}
speed = "3 mm/s"
join = {{ blend = 0.05, angle = 0.5 }}
[[segment]]
spline = {{ through = [[0, 0, 0]] }}
join = "through"
[[segment]]
arc = {{ centre = [0, 2, 3], normal = [0, 0, 2], angle = 720, rise = -4 }}
"""
    spline, point, arc = load(text).segments
    np.testing.assert_allclose(spline.through, [[1e-3, 2e-3, 3e-3], [0.0254, 0, 0]], rtol=1e-15)
    np.testing.assert_allclose(
        spline.rotate.as_rotvec(), [[0, 0, np.deg2rad(5)], [0, 0.1, 0]], atol=1e-15
    )
    assert (spline.speed, spline.join) == (0.003, Blend(0.05e-3, np.deg2rad(0.5)))
    assert (point.rotate, point.join, point.through.shape) == (None, Through(), (1, 3))
    assert (arc.angle, arc.rise, arc.join) == (4 * np.pi, -0.004, Stop())


def test_faults_of_splines_stand_with_their_lines(load):
    text = f"""{TOP}
[[segment]]
spline = {{ through = [
  [1, 2, 3], [4, 5, 6], [4, 5, 6],
] }}
[[segment]]
spline = {{ through = [[1, 2, 3]], rotate = [[0, 0, 5], [0, 0, 0]] }}
join = {{ blend = 0.05, angle = 0 }}
[[segment]]
spline = {{ through = [] }}
join = "thru"
[[segment]]
arc = {{ centre = [0, 2, 3], normal = [0, 0, 2], angle = 720, rise = "3 deg" }}
"""
    with pytest.raises(FileError) as refusal:
        load(text)
    found = [(fault.key, fault.message) for fault in refusal.value.faults]
    expected = [
        ("segment[1].spline.through", "points 2 and 3 are the same; omit one of them"),
        (
            "segment[2].spline",
            "2 orientations in rotate for 1 point in through: give one for each, or none",
        ),
        ("segment[2].join.angle", "must be"),
        ("segment[3].spline.through", "at least one point"),
        ("segment[3].join", 'write "stop", "through", { blend'),
        ("segment[4].arc.rise", "deg"),
    ]
    assert [key for key, _ in found] == [key for key, _ in expected]
    for (_, message), (_, phrase) in zip(found, expected, strict=True):
        assert phrase in message
    first = text.split("\n").index("spline = { through = [") + 1
    assert refusal.value.faults[0].line == first


def test_tool_work_repeat_triggers_and_speeds(load):
    program = load(f"""{TOP}tool = {{ to = [0, 0, -50], rotate = [10, 20, 30] }}
work = {{ to = ["1 in", 0, 2] }}
repeat = 3
start_speed = "5 mm/s"
end_speed = "0 mm/s"
[[segment]]
line = {{ to = [1, 2, 3] }}
speed = "10 mm/s"
speed_constant = true
trigger = "laser"
[[segment]]
arc = {{ centre = [0, 2, 3], normal = [0, 0, 2], angle = 5 }}
trigger = {{ name = "half", at = 0.5 }}
[[segment]]
turn = {{ to = [0, 0, 0] }}
trigger = {{ name = "turned" }}
""")
    np.testing.assert_allclose(program.tool.translation, [0, 0, -0.05])
    np.testing.assert_allclose(
        program.tool.rotation.as_matrix(), moving_axes(10, 20, 30), atol=1e-15
    )
    np.testing.assert_allclose(program.work.as_matrix()[:3, 3], [0.0254, 0, 0.002])
    assert (program.repeat, program.start_speed, program.end_speed) == (3, 0.005, 0.0)
    line, arc, turn = program.segments
    assert (line.speed, line.speed_constant, line.trigger) == (0.01, True, Trigger("laser", 1.0))
    assert (arc.speed, arc.speed_constant, arc.trigger) == (None, False, Trigger("half", 0.5))
    assert turn.trigger == Trigger("turned", 1.0)
    plain = load(TOP + "[[segment]]\nline = { to = [1, 2, 3] }\n")
    assert (plain.tool, plain.work, plain.repeat, plain.start_speed, plain.end_speed) == (
        None,
        None,
        1,
        0.0,
        0.0,
    )
    assert (plain.segments[0].speed_constant, plain.segments[0].trigger) == (False, None)


@pytest.mark.parametrize(
    ("text", "line", "key", "phrase"),
    [
        (TOP, 1, "segment", "missing: a program needs at least one [[segment]]"),
        (TOP + "segment = []\n", 4, "segment", "empty: a program needs at least one [[segment]]"),
        (CIRCLE.replace("schema = 1", ""), 1, "schema", "missing: write schema = 1"),
        (CIRCLE.replace('length = "mm"', 'length = "MM"'), 4, "length", 'nearest is "mm"'),
        (CIRCLE.replace('angle = "deg"', 'angle = "mm"'), 5, "angle", "not convertible to deg"),
    ],
)
def test_a_single_fault_is_the_only_one_reported(load, text, line, key, phrase):
    with pytest.raises(FileError) as refusal:
        load(text)
    (fault,) = refusal.value.faults
    assert (fault.line, fault.key) == (line, key)
    assert phrase in fault.message


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ('join = "through"\n[[segment]]\nline = { to = [1, 0, 0] }\n', "join"),
        ('[[segment]]\nline = { to = [1, 0, 0], join = "through" }\n', "segment[1].line.join"),
        ('[[segment]]\nline = { to = [1, 0, 0], speed = "1 mm/s" }\n', "segment[1].line.speed"),
    ],
)
def test_a_key_of_a_segment_in_a_wrong_place_is_shown_its_place(load, text, key):
    with pytest.raises(FileError) as refused:
        load(TOP + text)
    (fault,) = refused.value.faults
    assert fault.key == key
    assert fault.message == "unknown key here: it belongs in a line of its own under [[segment]]"
    with pytest.raises(FileError, match="valid keys: dwell, trigger"):
        load(TOP + '[[segment]]\ndwell = "1 s"\njoin = "through"\n')  # it is under one already


def test_an_undeclared_angle_names_the_line_to_add(load):
    with pytest.raises(FileError) as refusal:
        load(CIRCLE.replace('angle = "deg"', ""))
    # two arcs and two turns of three angles
    assert len(refusal.value.faults) == 2 + 2 * 3
    assert all(
        'add the line angle = "deg" at the top' in fault.message for fault in refusal.value.faults
    )


def test_names_are_the_bundled_files():
    assert {"circle", "bare-circle"} <= set(program_names())
    for name in program_names():
        assert load_program(name).name == name
    with pytest.raises(MotionError, match='no program is called "circel", nearest is "circle"'):
        load_program("circel")


@settings(
    deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.integers(0, len(CIRCLE)),
    st.integers(0, 12),
    st.one_of(
        st.text(max_size=6),
        st.sampled_from(
            [
                "nan",
                "-inf",
                "[",
                "]]",
                "{",
                '"',
                "'''",
                "1e999",
                "9" * 400,
                "0xffff",
                "[[segment]]\n",
                "\n",
                "true",
            ]
        ),
    ),
)
def test_any_damage_to_a_file_is_a_program_or_a_motion_error(load, at, cut, patch):
    damaged = CIRCLE[:at] + patch + CIRCLE[at + cut :]
    try:
        program = load(damaged.encode("utf-8", "replace").decode())
    except MotionError as refusal:
        outcome = str(refusal)
    else:
        outcome = program.name
    assert outcome  # every other exception would have ended the test
