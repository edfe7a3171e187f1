"""Modes, origins and subprograms of G-code: against `rs274 -g` of LinuxCNC 2.9, and points computed
by hand.
"""

from math import degrees, pi, radians

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from kinematics import FileError, MotionError
from planner import Arc, Dwell, Line, Stop, Turn, import_program, plan
from planner.sources.rs274.arcs import Way, arc_by_centre, arc_by_radius


def places(done):
    """Ends of the lines in mm."""
    return [
        np.round(part.to * 1e3, 9).tolist()
        for part in done.program.segments
        if isinstance(part, Line)
    ]


def speeds(done):
    """Caps in mm/min."""
    return [
        part.speed and part.speed * 6e4
        for part in done.program.segments
        if isinstance(part, Line | Arc)
    ]


# F is a speed


def test_a_feed_stays_a_speed_when_the_unit_changes(read):
    done = read("G21 F600\nG1 X1\nG20\nG1 X2\nG2 X3 I0.5\nG1 G21\nX90\nF300 X95\nG20 X4\n")
    assert speeds(done) == pytest.approx([600] * 4 + [300, 300])
    back = read("G20 F10\nG1 X1\nG21\nX2\nM70\nG20 F1\nM72\nX4\n")
    assert speeds(back) == pytest.approx([254, 254, 254])


def test_a_feed_of_turns_and_of_inverse_time_has_no_unit_of_length(read):
    done = read("G21 F600\nG1 A10\nG20\nA20\nG93\nX1 F2\nG21 X50.8 F2\nG94 F100\nX60\n")
    turns = [part.angular_speed for part in done.program.segments if isinstance(part, Turn)]
    assert turns == pytest.approx([radians(10), radians(10)])
    assert speeds(done) == pytest.approx([2 * 25.4, 2 * 25.4, 100])


def test_home_and_dwells_have_no_unit_of_their_own(read):
    done = read(
        "G21 F600\nG1 X5 Y5\nG20\nG4 P2\nG28 Z1\nG1 X1\nG21\nG28\n", origin="0 mm, 0 mm, 3 mm"
    )
    assert places(done) == [[5, 5, -3], [5, 5, 25.4], [5, 5, -3], [25.4, 5, -3], [0, 0, -3]]
    assert [part.duration for part in done.program.segments if isinstance(part, Dwell)] == [2]
    assert speeds(done) == [pytest.approx(600), None, None, pytest.approx(600), None]


def test_a_feed_beside_a_change_of_the_unit_is_warned_of(read):
    """Grbl reads it in the new unit, `rs274` in the old."""
    done = read("G21 F600\nG1 X1\nG20 G1 X1 F60\n")
    assert speeds(done) == pytest.approx([600, 1524])
    assert any("F in one block with a change of G20 or G21" in warning for warning in done.warnings)
    assert not any("G20" in warning for warning in read("G20 F60\nG1 X1\n").warnings)
    before = read("F60\nG20 G1 X1\n")
    assert speeds(before) == pytest.approx([60])
    assert any(
        "F before the first G20 or G21 counts in mm" in warning for warning in before.warnings
    )


# M70 to M73


def test_saved_modes_come_back(read):
    """The places are those of `rs274`; without M72 the last would be 12."""
    assert places(read("G21 F600\nG1 X5\nM70\nG91\nG1 X5\nM72\nG1 X2\n")) == [
        [5, 0, 0],
        [10, 0, 0],
        [2, 0, 0],
    ]
    done = read("G21 F600 G99\nG10 L2 P1 X0\nG10 L2 P2 X10\nM70\nG20 G91\nF1 G18 G90.1 G61.1 G98 G55\nG1 X0.1\nM72\n"
                "G1 X3\nG2 X5 I1\nG81 Z-1 R1 X7\n")  # fmt: skip
    # home is X-10 in G55, and the step of 0.1 in counts from there
    assert places(done)[:2] == [[2.54, 0, 0], [3, 0, 0]]
    assert speeds(done)[1] == pytest.approx(600)
    assert done.program.segments[1].join == done.program.segments[2].join
    assert done.program.segments[2].normal.tolist() == [0, 0, 1]
    assert places(done)[-1] == [7, 0, 1]


def test_a_shift_that_did_not_apply_does_not_after_m72(read):
    """`rs274` prints SET_G92_OFFSET(0, …) at the M72, and the shift itself at G92.3."""
    done = read("G21 F600\nM70\nG92 X-3\nM72\nG1 X5\nG92.3\nX5\nM70\nG92.1\nM72\nX6\n")
    assert places(done) == [[5, 0, 0], [8, 0, 0], [6, 0, 0]]


def test_a_sub_restores_what_it_saved_for_itself(read):
    text = "G21 F600\nO1 sub\nM73\nG20 G91\nF5\nG1 X1\nO1 endsub\nO1 call\nG1 X3\nO1 call\nO1 call\nX5\n"
    done = read(text)
    assert places(done) == [[25.4, 0, 0], [3, 0, 0], [28.4, 0, 0], [53.8, 0, 0], [5, 0, 0]]
    assert speeds(done) == pytest.approx([127, 600, 127, 127, 600])
    # M71 forgets it, and M70 only saves
    kept = places(read(text.replace("M73", "M73\nM71").replace("O1 call\nO1 call\n", "")))
    assert kept == [[25.4, 0, 0], [25.4 * 4, 0, 0], [25.4 * 9, 0, 0]]
    assert places(read("G21 F600\nO1 sub\nM70\nG91\nO1 endsub\nG1 X3\nO1 call\nX3\n")) == [
        [3, 0, 0],
        [6, 0, 0],
    ]


def test_the_spindle_and_coolant_come_back(read):
    """As `rs274` prints them: only what differs."""
    done = read("G21 F600\nM3 S100 M8\nG1 X1\nM70\nM5 M9\nX2\nM72\nX3\n")
    names = [part.trigger.name if part.trigger else "" for part in done.program.segments]
    assert names == ["M3 S100 M8", "M5 M9", "M3 S100 M8"]
    same = read("G21 F600\nG1 X1\nM3 S100 M8\nM70\nX2\nM72\nX3\n")
    assert [part.trigger is None for part in same.program.segments] == [False, True, True]


@pytest.mark.parametrize("text", ["M72", "M70\nM71\nM72", "M70\nO1 sub\nM72\nO1 endsub\nO1 call"])
def test_nothing_is_restored_that_was_not_saved(read, text):
    with pytest.raises(FileError, match="M72 restores what M70 or M73 saved"):
        read(f"G21 F600\nG1 X1\n{text}\nG1 X5\n")


def test_a_printer_reports_its_progress_by_m73(read):
    done = read("G21 F600\nM73 P10 R5\nG1 X1\n")
    assert places(done) == [[1, 0, 0]]
    assert "skipped: M73 (1x: line 2)" in done.warnings


# origins


def test_shifts_of_all_axes(read):
    """G52 and G92 state one shift, as in LinuxCNC: the points are those of `rs274`."""
    text = "G21 F600\nG0 X5\nG52 X1\nX2\nG92 X0\nX1\nG52 X3\nX0\nG92.2\nX0\nG92.3\nX0\nG92.1\nX0\nG92.1 X3\n"
    x = [place[0] for place in places(read(text))]
    assert x == [5, 3, 4, 3, 0, 3, 0, 3]
    turned = read("G21 G10 L2 P1 R90\nG54\nG52 X1\nG0 X2\n")
    assert places(turned) == [[0, 3, 0]]


def test_shifts_of_the_angles(read):
    """G92 A: the tool has the angle, and later numbers count from there; G92.1 ends that."""
    done = read("G21 F600\nG1 X1 A10\nG92 A0 C5\nX2 A20\nG92.1\nX3 A0 C0\nG52 B7\nX4 B3\n")
    angles = [part.rotate.as_euler("XYZ", degrees=True) for part in done.program.segments]
    np.testing.assert_allclose(angles, [[10, 0, 0], [30, 0, 0], [0, 0, 0], [0, 10, 0]], atol=1e-9)
    system = read("G21 F600\nG10 L2 P2 A15\nG10 L2 P1 A0\nG55\nG1 X1 A0\nG10 L20 P2 A5\nX2 A0\n")
    angles = [part.rotate.as_euler("XYZ", degrees=True)[0] for part in system.program.segments]
    assert angles == pytest.approx([15, 10])
    home = read("G21 F600\nG92 A30\nG1 X1 A40\nG28\n").program.segments
    assert home[0].rotate.as_euler("XYZ", degrees=True)[0] == pytest.approx(10)
    assert home[1].rotate.magnitude() == pytest.approx(0, abs=1e-12)


@settings(max_examples=60)
@given(
    turn=st.floats(-180, 180), offset=st.tuples(*[st.floats(-9, 9)] * 3), shift=st.floats(-5, 5),
    numbers=st.dictionaries(st.sampled_from("XYZ"), st.floats(-9, 9), min_size=1), active=st.booleans(),
)  # fmt: skip
def test_a_turned_system_is_put_where_the_tool_has_these_numbers(
    tmp_path_factory, turn, offset, shift, numbers, active
):
    """After G10 L20 the tool's own numbers lead nowhere; letters that are missing keep theirs."""
    path = tmp_path_factory.getbasetemp() / "l20.ngc"
    said = " ".join(f"{letter}{value:.6f}" for letter, value in numbers.items())
    path.write_text(
        f"G21 G90 F600\nG10 L2 P1 X0 R0\nG10 L2 P2 X{offset[0]:.6f} Y{offset[1]:.6f} Z{offset[2]:.6f} R{turn:.6f}\n"
        f"G55\nG52 X{shift:.6f}\nG0 X1 Y2 Z3\n{'G55' if active else 'G54'}\nG10 L20 P2 {said}\nG55\nG0 X0 Y0 Z0\n"
    )
    segments = import_program(path).program.segments
    tool, origin = segments[0].to * 1e3, segments[-1].to * 1e3
    known = {"X": 1.0, "Y": 2.0, "Z": 3.0} | numbers
    there = Rotation.from_euler("z", round(turn, 6), degrees=True).apply(
        [known[letter] for letter in "XYZ"]
    )
    np.testing.assert_allclose(tool - origin, there, atol=2e-5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("G92", "G92 without axes has no meaning (a printer zeroes all axes): state them, as G92 X0 Y0 Z0"),
        ("G52", "G52 without axes has no meaning"), ("G92 I1", "I beside G92"),
        ("G10 L20 P1 X0 R5", "G10 L20 takes no R"),
        ("G11 X1", "G11 with arguments is not supported"), ("G10 P1 X1", "G10 states systems only"),
        ("G41 D1", "G41 is not supported; take it out\n"),
        ("G92.4", "G92.4 is not supported; take it out\n"), ("G28.1", "G28.1 is not supported; take it out\n"),
    ],
)  # fmt: skip
def test_origins_that_cannot_be_known_are_refused(read, text, words):
    with pytest.raises(FileError) as refused:
        read(f"G21 F600\nG1 X1\n{text}\nG1 X2\n")
    assert words.rstrip() in str(refused.value)
    if words.endswith("\n"):
        assert "ignore" not in str(refused.value)


def test_retraction_of_a_printer_is_skipped(read):
    done = read("G21 F600\nG1 X1\nG10\nG1 X2\nG11\n")
    assert places(done) == [[1, 0, 0], [2, 0, 0]]
    assert "skipped: G10 (1x: line 3), G11 (1x: line 5)" in done.warnings
    assert places(read("G21 F600\nG92 E0\nG1 X1 E2\n", ignore="E")) == [[1, 0, 0]]


# subprograms


def test_subprograms_run_where_m98_calls_them(read):
    """LinuxCNC's tests/interp/m98m99: basics, nested calls, and the main program's own number."""
    text = "%\nO1000 (MAIN)\nG21 F600\nM98 P0002\nG0 X5 Y5\nM30\nO0002\nG0 X9\nM98 P3 L2\nM99\nO3\nG91 G1 X1\nG90\nM99\n%"
    done = read(text)
    assert places(done) == [[9, 0, 0], [10, 0, 0], [11, 0, 0], [5, 5, 0]]
    assert not any("not read" in warning for warning in done.warnings)
    shared = read(
        "G21\n#1 = 0\nM98 P[1 + 1] L3\nG0 X#1\nM98 P2 L0\nG0 X[#1 + 1]\nM2\nO2\n#1 = [#1 + 1]\nM99\n"
    )
    assert places(shared) == [[3, 0, 0], [4, 0, 0]]


def test_the_main_program_ends_where_it_would_start_again(read):
    done = read("G21\nG0 X5\nM99\nG0 X9\n")
    assert places(done) == [[5, 0, 0]]
    assert (
        "M99 in line 3 ends the program, where a controller would start it again" in done.warnings
    )
    assert "not read: 1 line after the end of the program" in done.warnings


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("M98 P7\nM30", "2: column 1: o7 is not a subprogram of this file: add it there"),
        ("M98\nM30", "2: column 1: M98 takes P"), ("G0 X1 M98 P1\nM30\nO1\nM99", "shares its line with no other word"),
        ("M98 P1 L1.5\nM30\nO1\nM99", "L1.5 must be a whole number"), ("M98 P1\nM30\nO1\nG0 X1", "o1 has no M99"),
        ("M98 P1\nM30\nO1\nG0 X1\nO2\nM99", "the subprogram before o2 has no M99"),
        ("G0 X1\nM98 P1\nO1\nM99", "the program does not end before it: write M30 or M2"),
        ("M98 P1\nM30\nO1\nM98 P1\nM99", "more than 20 deep"), ("M98 P1\nM30\nO1\nM99\nO1\nM99", "defined twice"),
        ("M98 P1\nM30\nO1 sub\nO1 endsub", "o1 sub is called by o1 call"),
        ("O1 call\nM30\nO1\nM99", "subprogram o1 is called by M98"),
        ("O1 sub\nM99\nO1 endsub", "M99 is inside an O-word sub"),
        ("M98 P1\nM30\nO1\nM99 P10", "M99 shares its line"), ("O[1] sub\nO[1] endsub", "the label of sub is computed"),
        ("O[1.5] call", "O1.5 is no label"), ("O[#9] call", "#9 has no value"),
        ("%\nM98 P1\n%\nO1\nM99", "o1 is not a subprogram of this file"),
    ],
)  # fmt: skip
def test_calls_that_lead_nowhere_are_refused(read, text, words):
    with pytest.raises(FileError) as refused:
        read(f"G21 F600\n{text}\n" if not text.startswith("%") else text)
    assert words in str(refused.value)


def test_labels_are_numbers_however_they_are_written(read):
    calls = "G21\n#2 = 1\nO[#2 * 10 + 1] call\nO#2 call\nO 01 call\nM2\n"
    subs = "O011 sub\nG0 X7\nO11 endsub\nO1 sub\nG0 X#<_value> Y9\nO1 endsub\n"
    assert places(read(calls + subs)) == [[7, 0, 0], [0, 9, 0]]


def test_what_a_call_returns_is_zero_where_it_returns_nothing(read):
    """LinuxCNC's tests/interp/return-value, and #<_value_returned> of its manual."""
    text = "G21 G91\nG0 X[1 + #<_value>] Y#<_value_returned>\n"
    text += "O1 sub\nO2 if [#1 GT 0]\nO1 return [#1]\nO2 endif\nO1 endsub\n"
    calls = "".join(f"O1 call [{k}]\nX[1 + #<_value>] Y#<_value_returned>\n" for k in (5, 0, 7, -1))
    end = "O3 sub\nO3 endsub [4]\nO3 call\nX[1 + #<_value>] Y#<_value_returned>\nM98 P9\nX[1 + #<_value>]\nM2\nO9\nM99\n"
    steps = np.diff(places(read(text + calls + end)), axis=0, prepend=np.zeros((1, 3)))[:, :2]
    assert np.round(steps).tolist() == [[1, 0], [6, 1], [1, 0], [8, 1], [1, 0], [5, 1], [1, 0]]
    with pytest.raises(FileError, match="#<_value> is set by calls only"):
        read("G21\n#<_value> = 5\nG0 X1\n")


# stops and outputs


def test_the_motion_stops_where_the_program_waits(read):
    """`rs274` prints PROGRAM_STOP after the motion of its block; M6 comes before it."""
    done = read("G21 F600\nG1 X1 M0\nX2\nX3 M1\nM60\nX4\n", fit=1e-5)
    segments = done.program.segments
    assert [part.trigger.name if part.trigger else "" for part in segments] == [
        "M0",
        "",
        "M1 M60",
        "",
    ]
    assert [isinstance(part.join, Stop) for part in segments] == [True, False, True, False]
    assert (
        "the motion stops, and a trigger marks it: M0 (1x: line 2), M1 (1x: line 4), M60 (1x: line 5)"
        in done.warnings
    )
    made = plan(done.program, "cartesian", order=2)
    assert [event.name for event in made.triggers] == ["M0", "M1 M60"]
    for event in made.triggers:
        assert np.abs(made.trajectory.at(event.time).qd).max() < 1e-9
    first = read("G21 F600\nM0\nG1 X1\n").program.segments[0].trigger
    assert (first.name, first.at) == ("M0", 0.0)
    skipped = read("G21 F600\nG1 X1 M0\nX2\n", fit=1e-5, ignore="M0").program.segments
    assert not any(part.trigger for part in skipped)
    assert not isinstance(skipped[0].join, Stop)


def test_outputs_are_triggers_with_their_arguments(read):
    done = read(
        "G21 F600\nG1 X1\nM62 P1\nM65 P2 X2\nM68 E1 Q2.5\nM66 P1 L3 Q5\nX3\nM66 P1 L0\nX4\n"
    )
    segments = done.program.segments
    names = [part.trigger.name if part.trigger else "" for part in segments]
    assert names == ["M62 P1 M65 P2", "M68 E1 Q2.5 M66 P1 L3 Q5", "M66 P1 L0", ""]
    assert [isinstance(part.join, Stop) for part in segments] == [False, True, False, False]


# arcs


def test_a_short_arc_after_a_rounded_one_stays_short(read):
    """The second arc is -0.0057°, whatever is left of the first one's mismatch of 4 um."""
    done = read("G21 G90 G17 F600\nG2 X50.004 Y-50 I0 J-50\nG2 X50.001 Y-50 I-0.0015 J30\n")
    assert degrees(done.program.segments[1].angle) == pytest.approx(
        -2 * degrees(np.arctan(0.0015 / 30)), rel=1e-3
    )


@settings(max_examples=200)
@given(
    radius=st.floats(1e-3, 0.2), begin=st.floats(0, 2 * pi), chord=st.floats(2e-7, 2e-5), clockwise=st.booleans(),
    along=st.floats(-5e-6, 5e-6), across=st.floats(-4e-6, 4e-6), by_radius=st.booleans(),
)  # fmt: skip
def test_arcs_shorter_than_the_mismatch_run_the_way_that_the_file_states(
    radius, begin, chord, clockwise, along, across, by_radius
):
    """The tool is some um from the start, in any direction: never a turn, and never against the
    sense of travel.
    """
    sense = -1 if clockwise else 1
    sweep = sense * chord / radius
    start = np.array([np.cos(begin), np.sin(begin)]) * radius
    end = np.array([np.cos(begin + sweep), np.sin(begin + sweep)]) * radius
    tangent = sense * np.array([-np.sin(begin), np.cos(begin)])
    tool = start + along * tangent + across * start / radius
    way = Way(tool.tolist(), start.tolist(), end.tolist())
    by_centre = arc_by_centre(way, (0.0, 0.0), clockwise)
    arc = arc_by_radius(way, radius, clockwise) if by_radius else by_centre
    length = abs(arc.angle) * radius
    assert arc.angle * sense > 0
    assert length <= chord + 6e-6
    assert length >= min(chord, abs(chord - along)) * 0.98 or length >= chord * 0.98 or along > 0


def test_long_arcs_and_full_circles_end_where_they_should(read):
    """Nearly a circle, exactly one, and one that nobody can tell from nothing."""
    done = read("G21 F600\nG0 X10\nG2 X9.9998 Y0.0632 I-10\nG0 X10 Y0\nG3 I-10\nG3 X-10 I-10\n")
    angles = [degrees(part.angle) for part in done.program.segments if isinstance(part, Arc)]
    assert angles == pytest.approx([-360 + degrees(0.00632), 360, 180], abs=1e-3)
    with pytest.raises(FileError, match="it may be a full circle or nothing"):
        read("G21 F600\nG0 X10\nG2 X10.002 Y0 I-10\n")


def test_an_offset_across_the_plane_may_be_nothing(read):
    flat = read("G21 F600\nG0 Z5\nG2 X2 I1 K0\n").program.segments[-1]
    assert flat.angle == pytest.approx(-pi)
    assert flat.centre == pytest.approx([1e-3, 0, 5e-3])
    assert read("G21 F600\nG0 Z5\nG90.1 G2 X2 I1 J0 K5\n").program.segments[
        -1
    ].angle == pytest.approx(-pi)
    assert read("G21 F600\nG18 G2 X2 R1 J0\n").program.segments[-1].angle == pytest.approx(-pi)
    for text in ("G2 X2 I1 K1", "G90.1 G2 X2 I1 J0 K3", "G2 X2 K0"):
        with pytest.raises((FileError, MotionError)):
            read(f"G21 F600\nG0 Z5\n{text}\n")
