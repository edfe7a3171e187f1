"""G-code, read: against programs whose places are known before they are written down, and what is
refused.
"""

import random
import time
import tracemalloc
from math import cos, hypot, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import FileError, MotionError, load_machine
from planner import (
    Arc,
    Blend,
    Dwell,
    Fit,
    Line,
    Stop,
    Through,
    Trigger,
    Turn,
    import_program,
    load_program,
    plan,
    plan_parts,
)
from planner.path.actuation import actuate
from planner.path.chain import chain_pieces
from planner.program.joins import fit_joins
from planner.program.program_writer import program_lines, program_toml
from planner.sources.gcode import Gcode
from planner.sources.outline import outline
from tests.pace import cpu_limit, slowness

PLANES = {"G17": (0, 1, 2), "G18": (2, 0, 1), "G19": (1, 2, 0)}
ROUNDED = 2e-12
"""m: coordinates are written to 1e-12 of their unit, and added up a few dozen times."""


def walked(program):
    """The place (3,) in the middle and at the end of every segment that moves the tool; SciPy turns
    the arcs.
    """
    here, found = np.zeros(3), []
    for part in program.segments:
        if isinstance(part, Line):
            places = [(here + part.to) / 2, part.to]
        elif isinstance(part, Arc):
            u = here - part.centre
            places = [
                part.centre + Rotation.from_rotvec(share * part.angle * part.normal).apply(u)
                + share * part.rise * part.normal
                for share in (0.5, 1.0)
            ]  # fmt: skip
        else:
            continue
        found.append(places)
        here = places[1]
    return np.array(found).reshape(-1, 2, 3)


class Writer:
    """Random moves, known as places first and then written down in one of the many ways that G-code
    has.
    """

    def __init__(self, rng):
        self.rng, self.lines, self.places = rng, [], []
        self.at, self.unit, self.absolute, self.plane, self.code = (
            np.zeros(3),
            1e-3,
            True,
            "G17",
            "",
        )

    def number(self, value):
        text = f"{value:.12f}"
        return self.rng.choice([text, text.rstrip("0"), "+" + text if value >= 0 else text])

    def words(self, end, axes="XYZ"):
        """Those axes that change, and sometimes more."""
        said = []
        for k, axis in enumerate(axes):
            if end[k] != self.at[k] or self.rng.random() < 0.3:
                value = end[k] if self.absolute else end[k] - self.at[k]
                said.append(axis + self.number(value / self.unit))
        self.rng.shuffle(said)
        return said

    def put(self, *words):
        rng = self.rng
        words = [word for word in words if word]
        text = rng.choice(["", " "]).join(words)
        text = rng.choice(
            [
                text,
                text.lower(),
                f"N{len(self.lines) * 10} {text}",
                f"{text} (G1 X99)",
                f"{text};G2 X9",
            ]
        )
        self.lines.append(text)

    def modes(self):
        rng = self.rng
        if rng.random() < 0.2:
            self.unit, word = rng.choice([(1e-3, "G21"), (0.0254, "g20")])
            self.put(word)
        if rng.random() < 0.2:
            self.absolute = not self.absolute
            self.put("G90" if self.absolute else "G91")
        if rng.random() < 0.2:
            self.plane = rng.choice(list(PLANES))
            self.put(self.plane)

    def motion(self, code):
        """The word of a motion, or none where it holds already."""
        repeated = code == self.code and self.rng.random() < 0.7
        self.code = code
        return "" if repeated else self.rng.choice([code, code[0] + "0" + code[1:]])

    def line(self):
        end = self.at + np.array(
            [self.rng.uniform(-0.02, 0.02) * (self.rng.random() < 0.8) for _ in range(3)]
        )
        if np.linalg.norm(end - self.at) < 1e-6:
            return
        self.put(self.motion(self.rng.choice(["G0", "G1"])), *self.words(end))
        self.places.append([(self.at + end) / 2, end])
        self.at = end

    def arc(self):
        rng, (first, second, normal) = self.rng, PLANES[self.plane]
        radius, begin = rng.uniform(1e-3, 0.02), rng.uniform(0, 2 * pi)
        sweep = rng.choice([-1, 1]) * rng.uniform(0.1, 2 * pi - 0.1)
        full = rng.random() < 0.15
        sweep = 2 * pi * (1 if sweep > 0 else -1) if full else sweep
        rise = rng.uniform(-0.01, 0.01) if rng.random() < 0.3 else 0.0
        centre = self.at.copy()
        centre[[first, second]] -= radius * np.array([cos(begin), sin(begin)])

        def at(share):
            place = centre.copy()
            place[[first, second]] += radius * np.array(
                [cos(begin + share * sweep), sin(begin + share * sweep)]
            )
            place[normal] += share * rise
            return place

        end = at(1.0)
        if full:
            end[[first, second]] = self.at[[first, second]]
        word = self.motion("G2" if sweep < 0 else "G3")
        # R loses half the digits where an arc is nearly half or no turn
        if (
            not full
            and min(abs(abs(sweep) - turn) for turn in (0, pi, 2 * pi)) > 0.3
            and rng.random() < 0.5
        ):
            said = ["R" + self.number((radius if abs(sweep) < pi else -radius) / self.unit)]
        else:
            offset = centre - self.at
            said = ["IJK"[k] + self.number(offset[k] / self.unit) for k in (first, second)]
        self.put(word, *self.words(end), *said)
        self.places.append([at(0.5), end])
        self.at = end


@settings(max_examples=150)
@given(seed=st.integers(0, 2**32))
def test_places_are_those_that_were_written(seed, tmp_path_factory):
    rng = random.Random(seed)
    writer = Writer(rng)
    writer.put("F100")
    for _ in range(rng.randint(2, 20)):
        writer.modes()
        rng.choice([writer.line, writer.arc])()
    path = tmp_path_factory.mktemp("gcode") / "part.ngc"
    path.write_text("\n".join(writer.lines), newline=rng.choice(["\n", "\r\n", "\r"]))
    if not writer.places:
        return
    found = walked(import_program(path).program)
    assert found.shape == np.shape(writer.places)
    # R: the centre of an arc 0.3 rad from half a turn moves by 1/sin(0.15) of the error of its
    # radius, and so on
    np.testing.assert_allclose(found, writer.places, atol=1e3 * ROUNDED)


def test_what_is_read_is_saved_and_drawn(read, hexapod, tmp_path):
    """The circle of the bundled program as G-code: the same path, from TOML too."""
    done = read("G21 G61.1 F1800\nG0 Z25\nG0 X15\nG3 I-15\nG0 X0\nM30\n")
    path = tmp_path / "saved.toml"
    path.write_text(program_toml(done.program), encoding="utf-8")
    pieces, again = (
        chain_pieces(program, hexapod).pieces for program in (done.program, load_program(path))
    )
    assert [piece.length for piece in pieces] == pytest.approx(
        [0.025, 0.015, 2 * pi * 0.015, 0.015]
    )
    for one, other in zip(pieces, again, strict=True):
        np.testing.assert_allclose(one.parameters, other.parameters, atol=1e-15)
    assert pieces[2].tool_speed == pytest.approx(0.03)
    assert done.entities == {"G0": 3, "G3": 1}
    assert done.outline.length == pytest.approx(0.055 + 2 * pi * 0.015)
    np.testing.assert_allclose(done.outline.low, [-0.015, -0.015, 0], atol=1e-12)
    np.testing.assert_allclose(done.outline.high, [0.015, 0.015, 0.025], atol=1e-12)


def test_feeds_are_caps(read):
    """Per minute in the unit that holds; of rapids none, or the one that is given; inverse time by
    the way.
    """
    text = "F600\nG1 X10\nG20 G1 X1 F60\nG21\nG0 X0\nG93 G1 X30 F2\nG94 F90 G1 A90\n"
    speeds = [getattr(part, "speed", None) for part in read(text).program.segments]
    assert speeds == pytest.approx([0.01, 0.0254, None, 0.001, None])
    assert read(text).program.segments[-1].angular_speed == pytest.approx(radians(1.5))
    assert read("G0 X1", rapid=0.2).program.segments[0].speed == 0.2
    assert read("G1 X1", feed=0.1).program.segments[0].speed == 0.1


def test_dwells_rest(read):
    segments = read("F60\nG64 P0.1\nG1 X10\nG4 P0.5\nX20\nG4 P0\nX30").program.segments
    assert [type(part) for part in segments] == [Line, Dwell, Line, Line]
    assert segments[1].duration == 0.5
    assert [part.join for part in segments if isinstance(part, Line)] == [
        Stop(),
        Stop(),
        Fit(0.1 * 1e-3),
    ]
    assert read("G0 X1\nG4 P500", dwell="ms").program.segments[1].duration == 0.5


def test_joins_are_what_the_modes_say(read):
    text = "G0 X1\nG61.1 X2\nG61 X3\nG64 P0.02 X4\nG20 G64 P0.001 X5"
    joins = [part.join for part in read(text).program.segments]
    assert joins == [Through(), Stop(), Through(), Fit(0.02 * 1e-3), Fit(0.001 * 0.0254)]
    words = [
        read(f"G0 {word}X1").program.join_word for word in ("", "G61 ", "G61.1 ", "G64 P0.02 ")
    ]
    assert words == ["", "G61", "G61.1", ""]
    assert read(text, join="stop").program.segments[0].join == Stop()
    assert read(text, blend=3e-4).program.segments[0].join == Blend(3e-4)
    assert read(text, fit=2e-5).program.segments[0].join == Fit(2e-5)


def test_angles_turn_about_the_axes_in_turn(read):
    """A B C as Rx Ry Rz; on the spot one letter turns all the way that it says, also more than half
    a turn.
    """
    done = read("F600\nG1 X10 A10\nG1 B20\nC30\nC-330\nG1 X0 A0 B0 C-360")
    line, b, c, back, last = done.program.segments
    assert line.rotate.as_euler("XYZ", degrees=True) == pytest.approx([10, 0, 0])
    here = Rotation.from_euler("X", 10, degrees=True)
    for turn, angle in ((b, 20), (c, 30), (back, -360)):
        assert isinstance(turn, Turn)
        assert turn.angle == pytest.approx(radians(angle))
        here = Rotation.from_rotvec(turn.angle * turn.about) * here
    whole = Rotation.from_euler("XYZ", [10, 20, 30], degrees=True)
    assert (whole.inv() * here).magnitude() == pytest.approx(0, abs=1e-12)
    assert last.rotate.magnitude() == pytest.approx(0, abs=1e-12)
    assert [warning for warning in done.warnings if "several axes" in warning]


def test_the_origin_lies_where_it_is_put(read, hexapod):
    """The tool starts at home, which the file knows by its distance from its zero."""
    program = read(
        "G91 G0 X1\nG90 X0 Y0 Z0", origin="10 mm, 0 mm, 25 mm, 0 deg, 0 deg, 90 deg"
    ).program
    np.testing.assert_allclose(program.segments[0].to, [0.001, 0.01, -0.025], atol=1e-15)
    pieces = chain_pieces(program, hexapod).pieces
    start, end = (
        piece.poses(np.array([s]))[0, :3]
        for piece, s in zip(pieces, (0.0, pieces[1].length), strict=True)
    )
    home = hexapod.home.translation
    np.testing.assert_allclose(start, home, atol=1e-12)
    np.testing.assert_allclose(end, home + np.array([0.01, 0, 0.025]), atol=1e-12)


def test_relative_centres_and_absolute_ones_are_the_same_arc(read):
    one = read("G0 X10 Y5\nF60 G3 X0 Y15 I-10 J0").program.segments[1]
    other = read("G0 X10 Y5\nG90.1 F60 G3 X0 Y15 I0 J5").program.segments[1]
    np.testing.assert_allclose(one.centre, other.centre, atol=1e-15)
    assert one.angle == pytest.approx(other.angle) == pytest.approx(pi / 2)


def test_rounded_arcs_stay_where_the_file_has_them(read):
    """A circle of a hundred arcs with coordinates of whole micrometres: none of them is more than
    1.5 um off.
    """
    lines, places = ["F60", "G0 X20 Y0"], []
    here = (20.0, 0.0)
    for k in range(1, 101):
        x, y = round(20 * cos(k * pi / 50), 3), round(20 * sin(k * pi / 50), 3)
        lines.append(f"G3 X{x} Y{y} I{-here[0]:.3f} J{-here[1]:.3f}")
        here = (x, y)
        places.append([x * 1e-3, y * 1e-3, 0])
    done = read("\n".join(lines))
    assert np.abs(walked(done.program)[1:, 1] - places).max() < 1.5e-6
    assert [warning for warning in done.warnings if "radii differ" in warning]


@pytest.mark.parametrize(("text", "words"), [
    ("G1 X1", "column 1: no F is active"),
    ("X1", "column 1: no G0, G1, G2 or G3 is active"),
    ("F60 G5 X1", "column 5: G5 is not supported"),
    ("G0 X1 M48", "column 7: M48 is not supported; take it out, or skip it by the option ignore=\"M48\""),
    ("G0 X1 E2", "column 7: E2 is not supported"),
    ("G0 X1 X2", "column 7: X appears twice"),
    ("G0 G1 X2", "column 4: G1 and G0 exclude each other"),
    ("G90 G91 X2", "column 5: G91 and G90 exclude each other"),
    ("G0 X1.5.2", "column 4"),
    ("G0 X", "column 4"),
    ("G0 X#3", "column 5: #3 has no value here: set it before, as #3 = 0"),
    ("G0 X[1+]", "column 8: \"]\" is no value"),
    ("G0 X[1+2", "column 9: \"]\" is missing here, to close the bracket"),
    ("#3=2\nX[#3/0]", "column 3: #3/0 has no value"),
    ("#5221=2", "column 2: #5221 is not a parameter of a program"),
    ("G0 X1 @2 ^30", "column 7: \"@2 ^30\": polar coordinates are not supported"),
    ("G0 X1 (a (nested) one)", "column 7: the comment has no end, or contains another"),
    ("G0 X1 (open", "column 7: the comment has no end"),
    ("G0 X1 (not) 5", "column 7: a comment is within a number: move it"),
    ("G0 X1 (a)( b ) .5", "column 7: a comment is within a number: move it"),
    ("G0 X1 )", "column 7: unmatched parenthesis"),
    ("/G0 X1", "column 1: block delete (/): give the option block_delete"),
    ("G0 X1 % and more", "column 7: % must be alone"),
    ("G0 X1 \x00 Y2", "column 7"),
    ("G0 X\uff11", "column 4"),  # a digit, but not of ASCII
    (b"G0 X1 \xff Y2", "column 7"),
    ("G0 X" + "9" * 400, "column 4: X9999"),
    ("G0 X1e5", "column 6: e5 is not supported"),
    ("G0 X" + "1" * 2000, "2004 characters; a line has at most"),
    ("F0 G1 X1", "column 1: F0 must be above 0"),
    ("F60 G1 X1 I3", "column 11: I belongs to G2 or G3"),
    ("F60 G2 X1", "needs either its centre I J K or its radius R"),
    ("F60 G2 X1 R2 I3", "column 11: G2 needs either its centre I J K or its radius R"),
    ("F60 G2 X10 I5 K1", "column 15: K is outside the plane of G17"),
    ("F60 G18 G2 X10 J5", "column 16: J is outside the plane of G18"),
    ("F60 G2 R5", "R does not define a full circle"),
    ("F60 G2 X10 R4", "R 4 mm is too small: its ends are 10 mm apart, so give at least 5 mm"),
    ("F60 G2 X10 I5.1", "its start is 5.1 mm from the centre [5.1, 0] mm and its end 4.9 mm"),
    ("F60 G2 X10 I0", "its centre [0, 0] mm"),
    ("F60 G2 I0 J0", "is its start or end point"),
    ("F60 G90.1 G2 X10 I5", "G90.1 asks for both I and J"),
    ("G4", "G4 needs P"),
    ("G4 P-1", "column 4: G4 needs P"),
    ("G4 P1 X3", "column 7: X has no meaning beside G4"),
    ("G0 X1 P2", "column 7: P belongs to G4 or G64"),
    ("G64 X1", "column 1: G64 needs P"),
    ("G93 G1 X1", "G93 needs F, 1/minutes of the block, on every block"),
    ("G93 G1 X1 F3\nX2", "G93 needs F, 1/minutes of the block, on every block"),
    ("F60 G1 X1 A180", "column 11: A turns by 180° along a path"),
    ("", "nothing moves"),
    ("(only this)\n%\n%", "nothing moves"),
    ("M2\nG0 X1", "nothing moves"),
])  # fmt: skip
def test_faults_name_their_place(text, words, read):
    with pytest.raises(FileError) as refused:
        read(text)
    assert words in str(refused.value)


def test_all_faults_come_in_one_pass_and_no_more_than_make_sense(read):
    with pytest.raises(FileError) as refused:
        read("G0 X1\nG5\nX2\nM48\nQ1 Y2\nX3")
    assert [fault.line for fault in refused.value.faults] == [2, 4, 5]
    with pytest.raises(FileError) as refused:
        read("Q1\n" * 100_000)
    assert len(refused.value.faults) == 101
    assert len(str(refused.value)) < 20_000


def test_a_fault_of_an_arc_makes_none_of_what_follows(read):
    """The blocks after it go on from where it was to lead."""
    with pytest.raises(FileError) as refused:
        read("F60 G0 X10\nG2 X20 I4\nG2 X30 I5\nG1 X0")
    assert [fault.line for fault in refused.value.faults] == [2]


def test_what_a_printer_extrudes_is_left_out_when_asked(read):
    text = "G21\nM104 S200\nG92 E0\nG1 X10 E0.5 F1500\nG1 E-2 F2400\nG1 X20 E1.0\n"
    with pytest.raises(MotionError, match='skip it by the option ignore="E"'):
        read(text)
    done = read(text, ignore="E M104")
    assert [line.to[0] for line in done.program.segments] == [0.01, 0.02]
    assert "skipped: E (4x: lines 3, 4, 5, 6), M104 (1x: line 2)" in done.warnings


def test_words_are_left_out_on_demand_and_counted(read):
    text = "G54 G0 X1 S100 M03\nT1 M6\nG43 H1 Z5\nM5 M9"
    done = read(text, ignore="S T M3 M6, H g43 M5 M09 G54")
    assert done.program.segments[0].to == pytest.approx([0.001, 0, 0])
    assert done.program.segments[1].to == pytest.approx([0.001, 0, 0.005])
    (skipped,) = [warning for warning in done.warnings if "skipped: " in warning]
    assert "M3 (1x: line 1)" in skipped
    assert not any(segment.trigger for segment in done.program.segments)
    with pytest.raises(FileError, match="G43 is not supported"):
        read(text, ignore="S T M H")
    for word in (
        "G92",
        "G28",
        "X",
        "M98",
        "M30",
        "G1",
        "G",
        "F",
        "?",
    ):  # their words would be taken for a path
        with pytest.raises(MotionError, match="cannot be ignored"):
            read(text, ignore=word)


def test_spindle_coolant_and_tool_words_are_skipped_with_their_lines_or_refused(read):
    """The path is as without them; with `strict`, each is refused at its place."""
    text = "G21 G0 X1 S100 M03\nT1 M6 M8\nG97 S200 M4\nG1 X2 F600 M9\nM5 M7 M19"
    done = read(text)
    assert [line.to[0] for line in done.program.segments] == [1e-3, 2e-3]
    assert (
        "skipped: G97 (1x: line 3), M19 (1x: line 5), S (2x: lines 1, 3), T (1x: line 2)"
        in done.warnings
    )
    with pytest.raises(FileError) as refused:
        read(text, strict=True)
    assert [fault.line for fault in refused.value.faults] == [1, 2, 3, 4, 5]
    assert "column 11: S100 is not supported" in str(refused.value)
    words = "S T M3 M4 M5 M6 M7 M8 M9 M19 G97"
    assert read(text, strict=True, ignore=words).warnings == read(text, ignore=words).warnings


def test_warnings_name_the_first_lines_and_count_the_rest(read):
    done = read("G21 G0 X1\n" + "S1 G0 X2\nS2 G0 X1\n" * 5)
    assert done.warnings == ("skipped: S (10x: lines 2, 3, 4, 5, 6 and 5 more)",)


def test_the_motion_stops_at_a_change_of_the_tool_whatever_joins_say(read):
    text = "G21 G1 X1 F600\nX2\nT2 M6\nS800 M3\nX3\nX4\n"
    for option in ({}, {"fit": 1e-5}, {"blend": 1e-5}):
        before, at, *_ = read(text, **option).program.segments[:3]
        assert not isinstance(before.join, Stop)
        assert isinstance(at.join, Stop)
        assert at.trigger == Trigger("M6 T2 M3 S800")
    # a fit of the whole program keeps that stop, and no other
    fitted = fit_joins(read(text, join="stop").program, 1e-5)
    assert [type(segment.join) for segment in fitted.segments] == [Fit, Stop, Fit, Fit]
    path = actuate(fitted, load_machine("traverser"))
    assert sum(path.stops(2)) == 3  # start, end, and the tool change


def test_events_mark_the_place_where_the_path_has_come_to(read):
    """A block's events come before its motion, as in LinuxCNC; before the first segment they mark
    its start.
    """
    done = read("G21 M3 S5\nG1 X1 F600 M8\nX2\nX3 M9\nM5")
    assert [segment.trigger for segment in done.program.segments] == [
        Trigger("M3 S5 M8", 0.0), Trigger("M9"), Trigger("M5"),
    ]  # fmt: skip
    assert (
        done.warnings[0]
        == "marked by triggers: M3 (1x: line 1), M5 (1x: line 5), M8 (1x: line 2), M9 (1x: line 4)"
    )
    # a segment has one trigger, so that what comes at the end of the first marks the start of the
    # second
    done = read("G21 M3\nG1 X1 F600\nM6\nX2")
    assert [segment.trigger for segment in done.program.segments] == [
        Trigger("M3", 0.0),
        Trigger("M6", 0.0),
    ]
    assert isinstance(done.program.segments[0].join, Stop)
    assert isinstance(fit_joins(done.program, 1e-5).segments[0].join, Stop)
    done = read("G21 M3\nG1 X1 F600\nM5")
    assert done.warnings == (
        "marked by triggers: M3 (1x: line 1)",
        "M5 (line 3): NO TRIGGER, as the last segment has one at its start already",
    )
    done = read("G21 G1 X1 F600\nM8\nG4 P1\nM9\nX2")
    assert [segment.trigger for segment in done.program.segments] == [
        Trigger("M8"),
        Trigger("M9"),
        None,
    ]  # of the dwell
    assert "marked by triggers: M8 (1x: line 2), M9 (1x: line 4)" in done.warnings
    done = read("G21 M3\nG4 P1\nM8\nG1 X1 F600\nG4 P1\nM5")
    triggers = [segment.trigger for segment in done.program.segments]
    assert triggers == [Trigger("M3", 0.0), Trigger("M8", 0.0, after_rest=True), Trigger("M5")]
    assert "NO TRIGGER" not in "\n".join(done.warnings)


@pytest.mark.parametrize(
    ("text", "rests"),
    [
        ("M3 S1\nG4 P1\nM8\nG1 X10", {"M3 S1": (0, 0.0), "M8": (0, 1.0)}),
        ("G4 P1\nM3\nG4 P1\nG1 X10", {"M3": (0, 1.0)}),
        ("G1 X10\nM9\nG4 P0.5\nM5\nG1 X20", {"M9": (1, 0.0), "M5": (1, 0.5)}),
        ("G1 X10\nG4 P1\nM5\nM30", {"M5": (1, 1.0)}),
        ("G1 X10\nG4 P1\nM3\nG4 P2\nG1 X20", {"M3": (1, 1.0)}),
        (
            "G1 X10\nM5\nG4 P1\nM6\nG4 P1\nM3\nG4 P2\nG1 X20",
            {"M5": (1, 0.0), "M6": (1, 1.0), "M3": (1, 2.0)},
        ),
    ],
)
def test_events_among_dwells_come_when_the_file_has_them(read, text, rests):
    """So many moves of 10 mm behind the start, and so many s of rest: in a plan, in its parts and
    on the way on.
    """
    program = read("G21 G90 F1200\n" + text).program
    made = plan(program, "cartesian", order=2)
    move = plan(read("G21 G90 F1200\nG1 X10").program, "cartesian", order=2).duration
    due = {name: moves * move + rest for name, (moves, rest) in rests.items()}
    assert {event.name: event.time for event in made.triggers} == pytest.approx(due, abs=1e-6)
    parts = [event for part in plan_parts(program, "cartesian", order=2) for event in part.triggers]
    assert {event.name: event.time for event in parts} == pytest.approx(due, abs=1e-6)
    held = made.hold(0.6 * move) if "G4" not in text.partition("G1")[0] else None
    if held is not None:  # each once, as long behind its rest as planned
        late = made.resume(held).triggers
        assert [event.name for event in (*held.triggers, *late)] == [
            event.name for event in made.triggers
        ]
        waits = np.diff([event.time for event in late])
        assert waits == pytest.approx(np.diff([due[event.name] for event in late]), abs=1e-6)


def test_events_of_a_file_that_is_not_held_are_found(read, tmp_path):
    (tmp_path / "part.nc").write_text("G21 G1 X1 F600\nM6\nX2\n")
    program = Gcode().stream(tmp_path / "part.nc").program
    assert program.segments.marked
    (event,) = plan(program, "traverser", order=2).triggers
    assert (event.name, event.where.segment) == ("M6", 1)
    assert event.pose.translation[0] == pytest.approx(
        load_machine("traverser").home.translation[0] + 1e-3
    )


def test_a_line_that_cannot_be_read_hides_nothing_that_the_next_would_miss(read):
    """Its F or its G1 may stand there."""
    for text in ("G1 X10 F600 (open\nG1 X20", "G1 F600 X1 (open\nX2"):
        with pytest.raises(FileError) as refused:
            read(text)
        assert [fault.line for fault in refused.value.faults] == [1]


def test_what_follows_the_end_is_told(read):
    done = read("%\nG0 X1\nM30\n%\nG0 X2\n")
    assert len(done.program.segments) == 1
    assert "not read: 1 line after the end of the program" in done.warnings
    assert [w for w in done.warnings if w.startswith("no G20 or G21")]
    done = read("%\nG21 G0 X1\n%\nG0 X2\n")
    assert len(done.program.segments) == 1
    assert done.warnings == ("not read: 1 line after the end of the program",)


def test_blanks_mean_nothing_even_in_numbers(read):
    """The places are those of `rs274`; a comment ends a word, so that it is none of its digits."""
    done = read(
        "G 2 1 G0 X1 0.5 Y- 2\n x + 1 2 . 5\tz 0 0 7\nN 1 0 g\t0 1 f 6 00 X[ 7 MODFIX[2.5] ] Y [1 OR0]\n"
    )
    places = [(line.to * 1e3).round(9).tolist() for line in done.program.segments]
    assert places == [[10.5, -2, 0], [12.5, -2, 7], [1, 1, 7]]
    assert done.program.segments[2].speed == pytest.approx(0.01)
    apart = read("G21 G0 X1 (5) Y2 (X5) ; 5 (6) 7\n(X9) X3\n").program.segments
    assert [line.to.tolist() for line in apart] == [[1e-3, 2e-3, 0], [3e-3, 2e-3, 0]]


def test_comments_may_hold_anything(read):
    done = read(b"(\xe4\xf6\xfc \x00 % # G1)G21G0X1;\xff(((\n( )Y1")
    np.testing.assert_allclose(done.program.segments[-1].to, [1e-3, 1e-3, 0])


@settings(max_examples=300)
@given(
    st.binary(max_size=200) | st.text("GXYMFIJR0123456789.-+ \n()%;", max_size=200).map(str.encode)
)
def test_any_bytes_are_a_program_or_a_refusal(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "any.nc"
    path.write_bytes(data)
    try:
        program = import_program(path).program
    except MotionError:
        return
    assert len(program.segments) > 0


def test_many_words_are_read_in_time(read):
    """Ten thousand lines, and many words of other kinds: 2 s for 100 000 lines is 0.2 s for 10 000.

    By the processor's time, the least of three, and half as much again, since others work on the
    same machine.
    """
    rng = random.Random(2)
    lines = ["G21 F600 G1"] + [
        f"N{n} X{rng.uniform(-9, 9):.4f} Y{rng.uniform(-9, 9):.4f} Z{rng.random():.4f}"
        for n in range(10_000)
    ]
    text = "\n".join(lines)
    took = []
    for _ in range(3):
        begin = time.process_time()
        assert len(read(text).program.segments) == 10_000
        took.append(time.process_time() - begin)
        if took[-1] < 0.3:
            break
    assert min(took) < 0.3 or min(took) < 0.3 * slowness()
    for words in ("X1" * 500_000, "\n".join(["X1 " * 300] * 1650), "(" * 500_000):
        with cpu_limit(0.5), pytest.raises(FileError):
            read(words)


def test_too_large_a_file_is_refused(read, monkeypatch):
    monkeypatch.setattr("planner.sources.source.MAX_BYTES", 1 << 20)
    with pytest.raises(FileError, match="larger than 1 MB"):
        read("(" + "x" * (1 << 20) + ")")


def test_a_quantity_is_a_number_or_a_text_with_its_unit(read):
    lines = "G1 X1 F100\nX1.1 Y1\nX1.2 Y2"
    texts, numbers = (read(lines, blend=value).program for value in ("50 um", 5e-5))
    assert program_toml(texts) == program_toml(numbers)
    for value in ("5 kg", "x", [1], True):
        with pytest.raises(MotionError, match="blend"):
            read(lines, blend=value)


def test_the_format_is_found_by_suffix_or_by_name(read):
    assert read("G0 X1", ".TAP").program.name == "part"
    assert read("G0 X1", ".txt", format="gcode").program.name == "part"
    with pytest.raises(MotionError, match="is not a known format"):
        read("G0 X1", ".xyz")
    with pytest.raises(MotionError, match='nearest is "gcode"'):
        read("G0 X1", format="gcod")
    with pytest.raises(MotionError, match='format gcode has no option "speed"'):
        read("G0 X1", speed=3)
    for option in (
        {"rapid": -1.0},
        {"blend": 0.0},
        {"origin": "1, 2"},
        {"origin": "1 mm, 2 mm, 3 s"},
    ):
        with pytest.raises(MotionError):
            read("G0 X1", **option)
    assert read("G0 X1 Y1", origin="0 mm, 0 mm, 0 mm").program.work is not None
    assert isinstance(read("G0 X1", origin="0 mm, 0 mm, 0 mm").program.work, RigidTransform)
    assert hypot(*read("G0 X3 Y4", length="in").program.segments[0].to) == pytest.approx(5 * 0.0254)


@pytest.mark.parametrize(
    ("text", "ignore", "words"),
    [
        ("G54 G1 X1 F100\nG55 X2", "G54 G55", "moved under G54 and moves under G55"),
        ("G43 H1 G1 Z1 F100\nG43 H2 Z2", "G43 H", "moved under G43 H1 and moves under G43 H2"),
        (
            "T1 M6 G43 G1 Z1 F100\nT2 M6\nG43 Z2",
            "G43 T M6",
            "moved under G43 T1 and moves under G43 T2",
        ),
        ("G43 H1 G1 Z1 F100\nG49\nZ2", "G43 H G49", "moved under G43 H1 and moves under G49"),
        ("G1 X1 F100\nG80\nX2", "G80", "no G0, G1, G2 or G3 is active"),
    ],
)
def test_offsets_that_change_are_not_left_out(read, text, ignore, words):
    with pytest.raises(FileError, match=words):
        read(f"G21\n{text}\n", ignore=ignore)


@pytest.mark.parametrize(
    ("text", "ignore"),
    [
        ("G54 G1 X1 F100\nG54 X2", "G54"), ("G55\nG54 G1 X1 F100\nX2", "G54 G55"),
        ("G1 X1 F100\nG43 H1 X2\nG49\nM5", "G43 H G49 M5"), ("G1 X1 F100\nG80\nG1 X2", "G80"),
        ("G1 X1 F100\nG80 G1 X2", "G80"),
    ],
)  # fmt: skip
def test_offsets_that_stay_are_left_out(read, text, ignore):
    assert [line.to[0] for line in read(f"G21\n{text}\n", ignore=ignore).program.segments] == [
        1e-3,
        2e-3,
    ]


def test_what_rounding_leaves_of_a_zero_is_zero(read):
    """-0, and 0.3 - 0.1 - 0.2 in mm, which is not 0 in floating point; what is larger stays as it
    is.
    """
    found = read("G21 G1 F100 X1 Y-0\nG91 X-0.9 Y0.3\nY-0.1\nY-0.2").program
    places = np.array([line.to for line in found.segments])
    assert not np.signbit(places).any()
    assert (places[3, 1], places[0, 1]) == (0, 0)
    assert places[2, 1] == pytest.approx(2e-4, abs=1e-18)
    assert "-0.0" not in program_toml(found)
    assert "e-" not in program_toml(found)


def test_a_file_is_read_as_a_stream(tmp_path):
    """The same segments as of the whole, again and again; and none of them is held."""
    file = tmp_path / "long.nc"
    text = "G21 G64 P0.01 F600\nG2 X1 I0.5 Z0.00000000000001\n"
    moves = (
        f"G1 X{k % 7} Y{k % 11}\n" + ("G4 P0.1\n" if k % 50 == 9 else "") for k in range(2_000)
    )
    file.write_text(text + "".join(moves))
    whole, stream = Gcode().read(file), Gcode().stream(file)
    assert stream.entities == whole.entities
    assert len(stream.program.segments) == len(whole.program.segments)
    for one, other in zip(stream.program.segments, whole.program.segments, strict=True):
        assert type(one) is type(other)
        assert getattr(one, "join", None) == getattr(other, "join", None)
        if isinstance(one, Line):
            np.testing.assert_array_equal(one.to, other.to)
    assert stream.program.segments[-1].to.tolist() == whole.program.segments[-1].to.tolist()
    assert [part.line_number for part in stream.program.segments[3:5]] == [5, 6]
    segments = iter(stream.program.segments)
    next(segments)  # its text has been read
    tracemalloc.start()
    assert sum(1 for _ in segments) > 2_000
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 1e5
    file.write_text(text)
    with pytest.raises(MotionError, match="was changed while it was read"):
        list(stream.program.segments)


def test_more_segments_than_a_program_holds_are_refused_where_they_are(read, monkeypatch):
    """Counted first where the lines are as many, so that they are not all held; also where blocks
    run again.
    """
    monkeypatch.setattr("planner.sources.gcode.MOST_SEGMENTS", 100)
    moves = "".join(f"G1 X{k}\n" for k in range(1, 102))
    with pytest.raises(
        FileError,
        match=r"part.nc:102: more than 100 segments, which a program does not hold: plan the",
    ):
        read("G21 F600\n" + moves + "G1 X0\n" * 9)
    with pytest.raises(FileError, match=r"part.nc:3: more than 100 segments"):
        read("G21 G91 F600\nO1 repeat [200]\nG1 X1\nO1 endrepeat\n")
    assert (
        len(read("G21 F600\n" + "".join(moves.splitlines(keepends=True)[:100])).program.segments)
        == 100
    )


def test_a_stream_has_the_outline_of_the_whole(tmp_path, monkeypatch):
    """Of many segments several share a stroke: its points, its extents and its length stay."""
    file = tmp_path / "long.nc"
    file.write_text(
        "G21 F600\n"
        + "".join(f"G1 X{k % 7} Y{k % 5}\nG3 X{k % 7 + 1} R3\nG4 P1\n" for k in range(1, 60))
    )
    whole, stream = Gcode().read(file).program, Gcode().stream(file).program
    one = outline(whole)
    for most in (20_000, 50, 7):
        monkeypatch.setattr("planner.sources.outline.MOST_STROKES", most)
        other = outline(stream)
        assert len(other.strokes) <= most
        np.testing.assert_array_equal(other.low, one.low)
        np.testing.assert_array_equal(other.high, one.high)
        assert other.length == pytest.approx(one.length, rel=1e-12)
        rows = [
            np.concatenate([found.strokes[0][:1], *(part[1:] for part in found.strokes)])
            for found in (one, other)
        ]
        np.testing.assert_array_equal(*rows)
    text = (
        "\n".join(program_lines(stream, "told", source="long.nc", segments=iter(stream.segments)))
        + "\n"
    )
    assert text == program_toml(whole, "told", source="long.nc")


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\r\r\n"])
def test_lines_are_counted_whatever_ends_them(read, end):
    with pytest.raises(FileError) as refused:
        read(end.join(["G21 G90 F600", "G1 X1", "G5 X2", "X3", "G5 X4", ""]))
    assert [fault.line for fault in refused.value.faults] == [3, 5]


def test_what_is_skipped_and_what_is_long_names_its_line(read):
    done = read("G21 G90\nG1 X1 F600\nG1 X1\nG4 P1500\nG1 X2\nG4 P99\n")
    assert "blocks that end where they start were skipped (1x: line 3)" in done.warnings
    assert (
        "dwells above 100 s, of which P may be meant in ms (option dwell) (1x: line 4)"
        in done.warnings
    )
    assert not any(
        "dwells" in told
        for told in read("G21 G90\nG1 X1 F600\nG4 P1500\nG1 X2\n", dwell="ms").warnings
    )
