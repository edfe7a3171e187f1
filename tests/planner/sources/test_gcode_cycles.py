"""Canned cycles: against the points that LinuxCNC's interpreter prints for the same blocks, `rs274
-g`.

The blocks are those of LinuxCNC's tests/interp/g81 and g84, and variations of them. Version 2.9.
"""

import numpy as np
import pytest

from kinematics import FileError
from planner import Dwell, Line, Stop, Through, plan


def steps(done):
    """Each segment as (kind, x, y, z) in mm, or the s of a rest."""
    rows = []
    for part in done.program.segments:
        if isinstance(part, Dwell):
            rows.append(("P", part.duration))
        else:
            kind = "G0" if part.speed is None else "G1"
            rows.append((kind, *np.round(part.to * 1e3, 9).tolist()))
    return rows


def parse(text):
    """The same of lines like G0 1 2 3."""
    rows = [line.split() for line in text.strip().split("\n")]
    return [(row[0], *map(float, row[1:])) for row in rows]


CASES = {
    "G81 G98, R below the level": (
        "G98 G0 X0 Y0 Z2\nG81 X1 Y1 Z-1 R1",
        "G0 0 0 2\nG0 1 1 2\nG0 1 1 1\nG1 1 1 -1\nG0 1 1 2",
    ),
    "G81 G99, R above the level, and the next hole": (
        "G99 G0 Z2\nG81 X1 Y2 Z0.5 R3\nX4",
        "G0 0 0 2\nG0 0 0 3\nG0 1 2 3\nG1 1 2 0.5\nG0 1 2 3\nG0 4 2 3\nG1 4 2 0.5\nG0 4 2 3",
    ),
    "G82 repeated in increments": (
        "G0 Z5\nG91 G99 G82 X1 Y2 Z-1 R-1 P0.3 L2",
        "G0 0 0 5\nG0 1 2 5\nG0 1 2 4\nG1 1 2 3\nP 0.3\nG0 1 2 4\nG0 2 4 4\nG1 2 4 3\nP 0.3\nG0 2 4 4",
    ),
    "G83": (
        "G0 Z5\nG98 G83 X1 Z-1 R1 Q0.7",
        "G0 0 0 5\nG0 1 0 5\nG0 1 0 1\nG1 1 0 0.3\nG0 1 0 1\nG0 1 0 0.554\nG1 1 0 -0.4\nG0 1 0 1\n"
        "G0 1 0 -0.146\nG1 1 0 -1\nG0 1 0 5",
    ),
    "G83 whose step divides the depth": (
        "G0 Z2\nG99 G83 Z-3 X1 R2 Q2.5",
        "G0 0 0 2\nG0 1 0 2\nG1 1 0 -0.5\nG0 1 0 2\nG0 1 0 -0.246\nG1 1 0 -3\nG0 1 0 2",
    ),
    "G73": (
        "G0 Z5\nG99 G73 X1 Z-1 R1 Q0.7",
        "G0 0 0 5\nG0 1 0 5\nG0 1 0 1\nG1 1 0 0.3\nG0 1 0 0.554\nG1 1 0 -0.4\nG0 1 0 -0.146\nG1 1 0 -1\nG0 1 0 1",
    ),
    "G84": ("G99 G84 X1 Z-1 R1", "G0 0 0 1\nG0 1 0 1\nG1 1 0 -1\nG1 1 0 1"),
    "G74 with a dwell": (
        "G99 G74 X1 Z-1 R1 P0.5",
        "G0 0 0 1\nG0 1 0 1\nG1 1 0 -1\nP 0.5\nG1 1 0 1",
    ),
    "G85": ("G0 Z5\nG99 G85 X1 Z-1 R1", "G0 0 0 5\nG0 1 0 5\nG0 1 0 1\nG1 1 0 -1\nG1 1 0 1"),
    "G86": ("G99 G86 X1 Z-1 R1 P0.5", "G0 0 0 1\nG0 1 0 1\nG1 1 0 -1\nP 0.5\nG0 1 0 1"),
    "G87": (
        "G0 Z5\nG99 G87 X1 Z-1 R1 I0.2 J0.3 K0.5",
        "G0 0 0 5\nG0 1 0 5\nG0 1 0 1\nG0 1.2 0.3 1\nG0 1.2 0.3 -1\nG0 1 0 -1\nG1 1 0 0.5\nG1 1 0 -1\n"
        "G0 1.2 0.3 -1\nG0 1.2 0.3 1\nG0 1 0 1",
    ),
    "G89": ("G99 G89 X1 Z-1 R1 P0.5", "G0 0 0 1\nG0 1 0 1\nG1 1 0 -1\nP 0.5\nG1 1 0 1"),
    "G18, along y": (
        "G98 G18 G0 X0 Y2 Z0\nG81 X1 Z1 Y-1 R1\nG80 G0 Y9",
        "G0 0 2 0\nG0 1 2 1\nG0 1 1 1\nG1 1 -1 1\nG0 1 2 1\nG0 1 9 1",
    ),
    "G19, along x": (
        "G99 G19\nG83 X-1 Y2 Z3 R1 Q1.5",
        "G0 1 0 0\nG0 1 2 3\nG1 -0.5 2 3\nG0 1 2 3\nG0 -0.246 2 3\nG1 -1 2 3\nG0 1 2 3",
    ),
    "a hole after another motion begins a new series": (
        "G98 G81 X1 Z-1 R2\nG0 Z7\nG81 X2 R2 Z-1",
        "G0 0 0 2\nG0 1 0 2\nG1 1 0 -1\nG0 1 0 2\nG0 1 0 7\nG0 2 0 7\nG0 2 0 2\nG1 2 0 -1\nG0 2 0 7",
    ),
}


@pytest.mark.parametrize(("text", "expected"), CASES.values(), ids=CASES)
def test_holes_are_those_of_linuxcnc(read, text, expected):
    assert steps(read(f"G21 G90 F600 M3 S100\n{text}\nM2\n")) == parse(expected)


def test_inches_are_inches_and_turned_systems_are_turned(read):
    """The clearance of a step stays 0.254 mm, which LinuxCNC has as 0.010 in."""
    done = read("G20 G90 F60\nG99 G83 X1 Z-0.5 R0.5 Q0.6\nM2\n")
    assert [row[3] for row in steps(done)] == pytest.approx(
        [12.7, 12.7, -2.54, 12.7, -2.286, -12.7, 12.7]
    )
    turned = read("G21 G90 F600\nG10 L2 P1 X3 Y2 R90\nG54\nG99 G81 X1 Z-1 R1\nM2\n")
    hole = next(row for row in steps(turned) if row[0] == "G1")
    # home is (-2, 3) in the turned system, so that the hole at (1, 3) lies at (0, 3) from home
    assert hole == ("G1", 0.0, 3.0, -1.0)


def test_the_spindle_turns_as_the_cycle_says(read):
    """Triggers come where `rs274` prints STOP_SPINDLE_TURNING and START_SPINDLE."""
    tapped = read("G21 G90 F600 M3 S100\nG0 Z5\nG99 G84 X1 Z-1 R1\nM2\n").program.segments
    names = [part.trigger.name if part.trigger else "" for part in tapped]
    assert names == ["M3 S100", "", "", "M5 M4 S100", "M5 M3 S100"]
    bored = read("G21 G90 F600 M4\nG0 Z5\nG99 G86 X1 Z-1 R1 P0.2\nM2\n").program.segments
    names = [part.trigger.name if part.trigger else "" for part in bored]
    assert names == ["M4", "", "", "", "M5", "M4"]
    still = read("G21 G90 F600\nG0 Z5\nG99 G86 X1 Z-1 R1 P0.2\nM2\n").program.segments
    assert not any(part.trigger for part in still)


def test_an_operator_retracts_where_g88_stops(read):
    """LinuxCNC takes the tool to be at the retract level after the stop; here it goes there by
    itself.
    """
    done = read("G21 G90 F600 M3\nG0 Z5\nG98 G88 X1 Z-1 R1 P0.2\nG0 X0\nM2\n")
    segments = done.program.segments
    assert steps(done)[3:] == parse("G1 1 0 -1\nP 0.2\nG0 1 0 5\nG0 0 0 5")
    assert segments[4].trigger.name == "M5 M0"
    assert any("G88 retracts by a rapid" in warning for warning in done.warnings)


def test_joins_in_a_cycle_stay_on_the_path(read):
    """As `rs274` prints SET_MOTION_CONTROL_MODE(CANON_EXACT_PATH) before each hole and the mode
    after it.
    """
    text = "G21 G90 F600\nG0 Z5\nG99 G81 X1 Z-1 R1\nX2\nG80\nG0 X3\n"
    joins = [type(part.join) for part in read(text, fit=1e-5).program.segments]
    assert joins[1:-1] == [Through] * (len(joins) - 2)
    assert type(read(text, fit=1e-5).program.segments[-1].join).__name__ == "Fit"
    assert all(isinstance(part.join, Stop) for part in read(text, join="stop").program.segments)


def test_a_file_of_holes_is_planned(read):
    done = read("G21 G90 F600 M3\nG0 Z5\nG98 G83 X2 Y2 Z-2 R1 Q1.2\nX4\nG80\nM2\n")
    made = plan(done.program, "cartesian", order=2)
    assert made.certificate.holds
    end = made.trajectory.at(made.duration).pose.translation - made.machine.home.translation
    np.testing.assert_allclose(end.ravel(), [4e-3, 2e-3, 5e-3], atol=1e-9)
    deepest = made.trajectory.at(np.linspace(0, made.duration, 5000)).pose.translation[:, 2]
    assert deepest.min() - made.machine.home.translation[2] == pytest.approx(-2e-3, abs=1e-6)


def test_a_level_that_nobody_stated_is_said(read):
    """LinuxCNC starts with G99; others with G98."""
    text = "G21 G90 F600\nG0 Z5\n{}G81 X1 Z-1 R1\n"
    assert any("without G98 or G99" in warning for warning in read(text.format("")).warnings)
    assert not any("G98" in warning for warning in read(text.format("G99 ")).warnings)
    assert not any(
        "G98" in warning for warning in read(text.format("").replace("R1", "R5")).warnings
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("G81 X1 Z-1", "G81 needs R: its first block states Z, R"),
        ("G81 X1 R1", "G81 needs Z"), ("G83 X1 Z-1 R1", "G83 needs Q"), ("G82 X1 Z-1 R1", "G82 needs P"),
        ("G87 X1 Z-1 R1 I1", "G87 needs J, K"), ("G81 X1 Z-1 R1\nG82 X2", "G82 needs Z, R, P"),
        ("G81 X1 Z-1 R1\nG80\nX2", "no G0, G1, G2 or G3 is active"),
        ("G81 X1 Z3 R1", "R leads 2 mm below Z"), ("G83 X1 Z-1 R1 Q0", "Q0 must be above 0"),
        ("G83 X1 Z-1 R1 Q0.00001", "Q makes 200000 steps in this block; at most 10000"),
        ("G83 X1 Z-1 R1 Q0.01 L1000", "steps in this block"),
        ("G81 X1 Z-1 R1 L0", "L0 must be a whole number"), ("G81 X1 Z-1 R1 L1e", "is not a word"),
        ("G81 X1 Z-1 R1 L2000", "L2000 must be a whole number from 1 to 1000"),
        ("G81 X1 Z-1 R1 A3", "A has no place in a canned cycle"),
        ("G93 G81 X1 Z-1 R1 F2", "G81 needs G94"), ("G81 R1", "needs X, Y or Z in each"),
        ("G81 X1 Z-1 R1\nR2", "needs X, Y or Z in each"), ("G82 X1 Z-1 R1 P-1", "P-1 must not be negative"),
        ("G81 X1 Z-1 R1\nG20\nX2", "the unit changed after Z, R of G81: state them again"),
        ("G76 X1", "G76 is not supported"), ("G0 X1 L2", "L2 is not supported"), ("G0 X1 Q2", "Q2 is not supported"),
    ],
)  # fmt: skip
def test_blocks_that_state_too_little_or_nonsense_are_refused(read, text, words):
    with pytest.raises(FileError) as refused:
        read(f"G21 G90 F600\n{text}\n")
    assert words in str(refused.value)


def test_segments_of_a_cycle_are_lines_of_its_block(read):
    segments = read("G21 G90 F600\nG99 G81 X1 Z-1 R1\nX2\n").program.segments
    assert all(isinstance(part, Line) for part in segments)
    assert [part.line_number for part in segments] == [2, 2, 2, 2, 3, 3, 3]
