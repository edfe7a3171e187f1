"""Triggers in exported files: at their instants where the format holds them, else named in a
warning.
"""

import csv
import re
from dataclasses import replace

import numpy as np
import pytest

from kinematics import MotionError
from planner import (
    Dwell,
    Line,
    Program,
    PulseSchedule,
    Trigger,
    Triggered,
    import_program,
    load_program,
    plan,
)
from planner.export.format import FORMATS, find_format, holds_triggers
from planner.export.formats.g93 import is_machine_code, split_codes
from planner.export.trigger_lines import ALL, describe_lost, join_lines, list_lines

HOLDING = {"pulses", "vcd", "csp", "g93"}
OFFSETS = np.array([[10.0, 0, 20], [4, 3, 20], [0, 0, 25]]) * 1e-3


@pytest.fixture(scope="module")
def marked(hexapod):
    """Triggers at the start, in motion, on arrival, within a dwell, and at the end; two of them
    share a name.
    """
    first, second, third = (Line(place) for place in OFFSETS)
    segments = (
        replace(first, trigger=Trigger("M3 S1200", 0.0)),
        replace(second, trigger=Trigger("photo", 0.4)),
        Dwell(0.03, trigger=Trigger("photo", 0.5)),
        replace(third, trigger=Trigger('M5 "off"')),
    )
    made = plan(Program(segments, "home", name="marked"), hexapod, order=2)
    assert [event.name for event in made.triggers] == ["M3 S1200", "photo", "photo", 'M5 "off"']
    return made


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_holds_the_triggers_or_names_them(name, marked, tmp_path):
    try:
        done = marked.export(name, tmp_path / "file")
    except MotionError as refused:
        pytest.skip(f"for another machine: {refused}")
    told = [note for note in done.notes if note.startswith("WARNING")]
    assert holds_triggers(find_format(name)) == (name in HOLDING)
    if name in HOLDING:
        assert not told
        assert any(note.startswith("triggers: 4") for note in done.notes)
    else:
        assert len(told) == 1
        assert all(
            words in told[0] for words in ('"M3 S1200" at 0.0', '"photo"', "and 1 more time", "M5")
        )


@pytest.mark.parametrize("name", FORMATS)
def test_without_triggers_nothing_is_said_of_them(name, planned, tmp_path):
    try:
        done = planned("bare-circle", 2).export(name, tmp_path / "file")
    except MotionError:
        return
    assert not any("trigger" in note for note in done.notes)


def test_edges_of_the_pulse_csv_come_with_the_counts_of_their_triggers(marked, tmp_path):
    """Counted by the standard library: STEP edges up to the row in which a trigger's column
    rises.
    """
    marked.export("pulses", tmp_path / "p.csv")
    with (tmp_path / "p.csv").open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file, skipinitialspace=True)
    axes = marked.machine.axes
    assert head[13:] == ["trigger M3 S1200", "trigger photo", 'trigger M5 "off"']
    levels = np.array([row[1:] for row in rows], int)
    before = np.vstack([np.zeros(levels.shape[1], int), levels[:-1]])
    rises = (levels == 1) & (before == 0)
    signs = np.where(levels[:, 1:12:2] == 1, 1, -1) * [axis.direction for axis in axes]
    counts = np.cumsum(rises[:, 0:12:2] * signs, axis=0)
    seen = []
    for k, name in enumerate(("M3 S1200", "photo", 'M5 "off"')):
        for row in np.flatnonzero(rises[:, 12 + k]):
            seen.append((float(rows[row][0]), name, counts[row]))
    for (t, name, own), event in zip(
        sorted(seen, key=lambda one: one[0]), marked.triggers, strict=True
    ):
        assert name == event.name
        assert t == pytest.approx(event.time, abs=1.01 / marked.pulses.clock_hz)
        assert own.tolist() == event.counts.tolist()


def test_a_dump_has_a_wire_for_each_name(marked, tmp_path):
    marked.export("vcd", tmp_path / "p.vcd")
    text = (tmp_path / "p.vcd").read_text()
    wires = dict(re.findall(r"\$var wire 1 (\S) trigger_(\S+) \$end", text))
    assert list(wires.values()) == ["M3%20S1200", "photo", "M5%20%22off%22"]
    now, rises = 0, []
    for line in text.partition("$enddefinitions")[2].split("\n"):
        if line.startswith("#"):
            now = int(line[1:])
        elif line[:1] == "1" and line[1:] in wires:
            rises.append(now)
    assert rises == pytest.approx([event.time * 1e9 for event in marked.triggers], abs=101)


def test_codes_of_inverse_time_stand_at_their_instants(marked, tmp_path):
    """Times added up line by line: F is 1/min of a piece, P seconds of a rest."""
    marked.export("g93", tmp_path / "p.ngc")
    text = (tmp_path / "p.ngc").read_text()
    assert '(output 0 = trigger photo)\n(output 1 = trigger M5 "off")\n' in text
    t, rises, falls = 0.0, [], []
    for line in text.split("\n"):
        if line.startswith("G1"):
            t += 60 / float(line.rpartition("F")[2])
        elif line.startswith("G4"):
            t += float(line[4:])
        elif re.match(r"M3|M6[24]", line):
            rises.append((line, t))
        elif re.match(r"M6[35]", line):
            falls.append(line)
    assert [line for line, _ in rises] == ["M3 S1200", "M62 P0", "M64 P0", "M64 P1"]
    assert [at for _, at in rises] == pytest.approx(
        [event.time for event in marked.triggers], abs=2e-6
    )
    assert falls == ["M63 P0", "M65 P0", "M65 P1"]
    assert text.rstrip().endswith("M64 P1\nM65 P1\nG94\nM2")


def test_codes_come_back_as_triggers(marked, tmp_path):
    marked.export("g93", tmp_path / "p.ngc")
    found = import_program(tmp_path / "p.ngc", machine="hexapod").program
    events = [
        segment.trigger
        for segment in found.segments
        if getattr(segment, "trigger", None) is not None
    ]
    assert [(event.name, event.at) for event in events] == [
        ("M3 S1200", 0), ("photo", 1), ("photo", 1), ('M5 "off"', 1),
    ]  # fmt: skip


def test_with_a_fixed_spacing_codes_stand_at_the_nearest_point(marked, tmp_path):
    done = marked.export("g93", tmp_path / "p.ngc", spacing=0.01)
    (told,) = [note for note in done.notes if note.startswith("triggers")]
    off = float(re.search(r"off by up to (\S+) ms", told)[1])
    assert 0 < off <= 5


@pytest.mark.parametrize("cycle", [1e-3, 4e-3])
def test_columns_of_cyclic_positions_are_set_in_the_first_row_after(marked, cycle, tmp_path):
    marked.export("csp", tmp_path / "p.csv", cycle=cycle)
    lines = (tmp_path / "p.csv").read_text().split("\n")
    assert [line for line in lines if line.startswith("# trigger")] == [
        '# trigger 0 = "M3 S1200"', '# trigger 1 = "photo"', '# trigger 2 = "M5 \\"off\\""',
    ]  # fmt: skip
    head = next(line for line in lines if line.startswith("cycle")).split(",")
    assert head[-3:] == ["trigger:0", "trigger:1", "trigger:2"]
    rows = [line.split(",") for line in lines if line[:1].isdigit()]
    fired = [
        (int(row[0]) * cycle, k) for row in rows for k in range(3) for _ in range(int(row[k - 3]))
    ]
    assert [k for _, k in fired] == [0, 1, 1, 2]
    for (t, _), event in zip(fired, marked.triggers, strict=True):
        assert -1e-9 <= t - event.time <= cycle


def test_sections_have_the_triggers_that_are_left(marked, tmp_path):
    at = (marked.triggers[1].time + marked.triggers[2].time) / 2
    stop = marked.hold(at)
    done = marked.resume(stop).export("ros", tmp_path / "on.yaml")
    (told,) = [note for note in done.notes if note.startswith("WARNING")]
    assert "photo" in told
    assert "M3" not in told


def _events(names, times):
    place = load_program("bare-circle")  # any object: only names and times are looked at
    return tuple(
        Triggered(name, type("Where", (), {"t": t})(), place, np.zeros(1, int))
        for name, t in zip(names, times, strict=True)
    )


def test_many_names_share_one_line_and_triggers_of_one_tick_an_edge():
    schedule = PulseSchedule(10**6, (), 1.0)
    many = list_lines(_events([f"p{k}" for k in range(17)], np.arange(17) / 100), schedule)
    assert [(line.name, line.ticks.tolist()) for line in many] == [
        (ALL, list(range(0, 170_000, 10_000)))
    ]
    twice = list_lines(_events("aab", [0.5, 0.5, 0.25]), schedule)
    assert [(line.name, line.ticks.tolist()) for line in twice] == [
        ("b", [250_000]),
        ("a", [500_000]),
    ]


def test_edges_of_one_name_stay_apart():
    """Rising edges 5 ticks apart with a width of 20: each falls half-way to the next, the last
    after the width.
    """
    schedule = PulseSchedule(10**6, (), 1.0)
    (line,) = list_lines(_events("aaa", [1e-5, 1.5e-5, 2e-5]), schedule)
    assert line.edges(20).tolist() == [10, 12, 15, 17, 20, 40]
    rows = [
        (np.array([0, 12]), np.array([[0], [1]], np.uint8)),
        (np.array([30]), np.array([[0]], np.uint8)),
    ]
    joined = list(join_lines(iter(rows), [line], 20))
    assert np.concatenate([ticks for ticks, _ in joined]).tolist() == [
        0,
        10,
        12,
        15,
        17,
        20,
        30,
        40,
    ]
    assert np.concatenate([levels for _, levels in joined]).tolist() == [
        [0, 0], [0, 1], [1, 0], [1, 1], [1, 0], [1, 1], [0, 1], [0, 0],
    ]  # fmt: skip


def test_a_long_list_of_lost_triggers_is_cut_short():
    (told,) = describe_lost(_events([f"p{k}" for k in range(12)], np.arange(12.0)))
    assert "p7" in told
    assert "p8" not in told
    assert told.endswith("and 4 more names")


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("M3", ["M3"]), ("M03 S500", ["M03 S500"]), ("M6 T2 M3 S500", ["M6 T2", "M3 S500"]), ("M8 M9", ["M8", "M9"]),
        ("M100", ["M100"]), ("M2", None), ("M30", None), ("M02", None), ("M98", None), ("photo", None), ("S3", None),
        ("M3 photo", None), ("M62 P1", None), ("m3", None),
    ],
)  # fmt: skip
def test_names_that_are_codes_are_written_as_they_are(name, lines):
    """M2, M30 and calls would end the program or leave it."""
    assert is_machine_code(name) == (lines is not None)
    if lines is not None:
        assert split_codes(name) == lines
