"""Avoidable stops at joins: which count, what they cost compared with plans that pass them, what
avoids them.
"""

import json
from math import sqrt

import numpy as np
import pytest

from planner import (
    Blend,
    Dwell,
    Fit,
    Line,
    Program,
    Stop,
    Through,
    Trigger,
    Turn,
    check,
    import_program,
    load_program,
    plan,
    plan_parts,
)
from planner.avoidable_stops import find_stops_of_import, propose_tolerance
from planner.program.joins import fit_joins
from planner.program.modifiers import STOP
from planner.program.program_writer import program_toml


def polyline(join, count=40):
    angle = np.linspace(0, np.pi / 2, count + 1)[1:]
    return [
        Line(np.array([0.02 * np.sin(a), 0.02 - 0.02 * np.cos(a), 0.0]), join=join) for a in angle
    ]


def zigzag(join, count=30, **said):
    return [
        Line(np.array([1e-3 * k, 1e-3 * (k % 2), 0.0]), join=join, **said)
        for k in range(1, count + 1)
    ]


def count_stops(segments, machine="cartesian", order=2, **said):
    return plan(Program(tuple(segments), **said), machine, order=order).avoidable_stops.count


@pytest.mark.parametrize(("end", "count"), [(STOP, 2), (Stop(), 1)])
def test_a_stop_inside_a_fitted_chain_counts_in_windows_and_in_the_whole(end, count):
    """A fit within 10 nm cannot round its corner, which is a stop that a larger tolerance
    avoids.
    """
    corners = [(0.4, -2.0, 0.0), (0.8, -2.1, 0.0), (0.9, -1.5, 0.0), (0.1, -1.5, 0.0)]
    joins = [Blend(1e-4), Fit(1e-8), end, STOP]
    lines = [
        Line(1e-3 * np.array(corner), join=join)
        for corner, join in zip(corners, joins, strict=True)
    ]
    program = Program(tuple(lines))
    whole = plan(program, "arm", order=3)
    rests = whole.path.breaks[whole.path.stops(3)][1:-1]
    assert len(rests) == 2
    assert whole.avoidable_stops.count == count
    at_rests = np.interp(rests, whole.trajectory.s, np.arange(len(whole.trajectory.s)))
    speeds = whole.trajectory.v[np.round(at_rests).astype(int)]
    np.testing.assert_allclose(speeds, 0.0, atol=1e-9)
    *_, last = plan_parts(program, "arm", order=3, pieces=2)
    assert last.standing.avoidable_stops.count == count


@pytest.mark.parametrize(
    ("join", "said", "count"),
    [
        (STOP, {}, 29),  # no join is stated
        (Through(), {}, 29),  # corners
        (Through(), {"trigger": Trigger("camera")}, 29),  # which does not ask for a rest
        (Stop(), {}, 0),
        (STOP, {"trigger": Trigger("camera")}, 0),
        (STOP, {"trigger": Trigger("camera", at=0.0)}, 0),
        (Blend(1e-5), {}, 0),
        (Fit(1e-5), {}, 0),
        (Fit(1e-5, stop=True), {}, 0),
    ],
)
def test_only_stops_without_a_reason_count(join, said, count):
    assert count_stops(zigzag(join, **said)) == count


def test_a_dwell_and_a_reversal_ask_for_their_stops():
    rests = [part for line in zigzag(Through(), 6) for part in (line, Dwell(0.01))]
    assert count_stops(rests) == 0
    there_and_back = [
        Line(np.array([5e-3 * (k % 2), 0.0, 0.0]), join=Through()) for k in range(1, 7)
    ]
    assert count_stops(there_and_back) == 0
    lift = Line(np.array([0.0, 0.0, 0.02]), join=Stop())
    turned = [
        Turn(None, Through(), about=np.array([0, 0, 1.0]), angle=angle) for angle in (0.05, -0.05)
    ]
    assert count_stops([lift, *turned], "hexapod") == 0


def test_whether_a_tangent_join_stops_depends_on_the_order():
    line, (arc,) = Line(np.array([0.02, 0.0, 0.0]), join=Through()), [tangent_arc()]
    assert count_stops([line, arc], order=2) == 0
    assert count_stops([line, arc], order=3) == 1  # the curvature jumps


def tangent_arc():
    from planner import Arc

    return Arc(np.array([0.02, 0.01, 0.0]), np.array([0.0, 0.0, 1.0]), np.pi / 2, join=Through())


def test_each_repetition_counts():
    assert count_stops(zigzag(Through(), 4), repeat=3) == 3 * 4 - 1


def test_the_cost_of_a_tangent_stop_on_a_long_line_is_that_of_its_ramps():
    """Two lines in one, which nobody joins: two ramps from and to v of v/a + a/j each, half of
    either is lost.
    """
    v, a, j = 0.1, 3.0, 100.0
    halves = [Line(np.array([x, 0.0, 0.0]), speed=v) for x in (0.04, 0.08)]
    made = plan(Program(tuple(halves)), "cartesian", order=3)
    ramp = v / a + a / j if v >= a**2 / j else 2 * sqrt(v / j)
    assert made.avoidable_stops.cost == pytest.approx(ramp, rel=1e-6)
    passed = plan(Program((halves[1],)), "cartesian", order=3)
    assert made.duration - passed.duration == pytest.approx(ramp, rel=1e-4)


CASES = {
    "chain, order 2": (polyline(Through()), "cartesian", 2),
    "chain, order 3": (polyline(Through()), "cartesian", 3),
    "tangent, order 3": (
        [
            Line(np.array([0.02, 0.0, 0.0]), join=Through()),
            tangent_arc(),
            Line(np.array([0.03, 0.03, 0.0])),
        ],
        "cartesian",
        3,
    ),
    "square, order 2": (
        [Line(np.array([x, y, 0.0])) for x, y in ((0.04, 0), (0.04, 0.04), (0, 0.04), (0, 0))],
        "cartesian",
        2,
    ),
    "hexapod, order 3": (
        [
            Line(np.array(to))
            for to in ((0.01, 0, 0.005), (0.02, 0.003, 0.005), (0.025, 0.005, 0.008), (0, 0, 0.005))
        ],
        "hexapod",
        3,
    ),
}


def test_where_an_axis_turns_back_next_to_nothing_is_to_be_had():
    """Y comes to rest at each corner of a zigzag, whether the path does or not."""
    stops = plan(Program(tuple(zigzag(Through()))), "cartesian", order=2).avoidable_stops
    assert stops.count == 29
    assert stops.cost < 1e-3
    assert "saves little time" in stops.describe()


@pytest.mark.parametrize("case", CASES)
def test_the_cost_is_about_what_a_fit_of_the_same_tolerance_saves(case):
    segments, machine, order = CASES[case]
    program = Program(tuple(segments), speed=0.1)
    stopping = plan(program, machine, order=order)
    stops = stopping.avoidable_stops
    saved = (
        stopping.duration - plan(fit_joins(program, stops.tolerance), machine, order=order).duration
    )
    assert stops.count == len(segments) - 1
    assert 0.5 * saved < stops.cost < 1.5 * saved


@pytest.mark.parametrize("machine", ["hexapod", "cartesian"])
def test_the_cost_of_right_angles_is_at_most_what_a_fit_saves(machine):
    """The message says "at least about": the savings of overlapping ramps are not all counted."""
    corners = ((0.0, 0.0), (0.02, 0.0), (0.02, 0.01), (-0.02, 0.01), (-0.02, -0.01), (0.02, -0.01))
    program = Program(tuple(Line(np.array([x, y, 0.025])) for x, y in corners))
    stopping = plan(program, machine, order=3)
    stops = stopping.avoidable_stops
    saved = stopping.duration - plan(fit_joins(program, stops.tolerance), machine, order=3).duration
    assert stops.count == len(corners) - 1
    assert 0.1 * saved < stops.cost < saved
    assert f"saves at least about {stops.cost:.2g} s; to pass them" in stops.describe()


def test_the_proposed_tolerance_is_small_beside_the_path():
    assert propose_tolerance(1.0) == 2e-5
    assert propose_tolerance(5e-3) == pytest.approx(5e-6)
    assert propose_tolerance(3.4e-5) == pytest.approx(2e-8)


GCODE = (
    "G21 G90 F6000\n{word}"
    + "".join(f"G1 X{(k + 1) // 2} Y{k // 2}\n" for k in range(1, 31))
    + "M2\n"
)


@pytest.mark.parametrize(
    ("word", "count", "remedy"),
    [
        ("", 29, '--fit "0.02 mm" or --blend "0.02 mm"'),
        ("G61\n", 29, "G64 P0.02 (mm) in place of G61"),
        ("G61.1\n", 0, None),
        ("G64 P0.02\n", 0, None),
    ],
)
def test_files_of_other_formats_are_told_the_option_or_word_that_avoids_stops(
    tmp_path, word, count, remedy
):
    file = tmp_path / "part.nc"
    file.write_text(GCODE.format(word=word))
    program = import_program(file).program
    told = find_stops_of_import(program).record()
    assert (told["count"], told["remedy"]) == (count, remedy)
    stops = check(program, "cartesian").avoidable
    assert stops.record()["remedy"] == remedy
    # an import knows no machine, and says which it takes
    assert told["assumed"] == "on the bundled machine cartesian"
    assert told["cost_s"] == pytest.approx(stops.cost)
    # and its file still tells what was asked for
    (tmp_path / "part.toml").write_text(program_toml(program))
    again = check(load_program(tmp_path / "part.toml"), "cartesian").avoidable
    assert (again.count, again.cost) == (count, pytest.approx(stops.cost))


def test_a_program_file_is_told_its_key_and_the_option_only_where_that_keeps_its_stops(tmp_path):
    lines = [f"[[segment]]\nline = {{ to = [{k}, {k % 2}, 0] }}\n" for k in range(1, 5)]
    head = 'schema = 1\nlength = "mm"\n'
    file = tmp_path / "part.toml"
    file.write_text(head + "".join(lines))
    plain = check(load_program(file), "cartesian").avoidable
    assert plain.count == 3
    key = 'join = { blend = "0.005 mm" } under each [[segment]] that ends there'
    assert plain.remedy == f'--fit "0.005 mm" or {key}'  # a thousandth of the short path
    file.write_text(head + "".join([lines[0] + 'join = "stop"\n', *lines[1:]]))
    stated = check(load_program(file), "cartesian").avoidable
    assert stated.count == 2
    assert stated.remedy == key


def test_a_plan_in_parts_counts_the_same_stops_at_about_the_same_cost():
    program = Program(tuple(zigzag(Through(), 90)), speed=0.1)
    whole = plan(program, "cartesian", order=3).avoidable_stops
    *_, last = plan_parts(program, "cartesian", order=3, pieces=20)
    assert last.standing.windows > 1
    assert last.standing.avoidable_stops.count == whole.count == 89
    assert last.standing.avoidable_stops.cost == pytest.approx(whole.cost, rel=0.1)


def test_a_path_that_no_bundled_machine_follows_is_counted_without_a_cost():
    turned = [Line(np.array([1e-2 * k, 1e-2 * (k % 2), 0.0]), join=Through()) for k in range(1, 4)]
    turned.append(Turn(None, Through(), about=np.array([1.0, 0, 0]), angle=0.1))
    stops = find_stops_of_import(Program(tuple(turned)))
    assert stops.count == 3
    assert "cost" not in stops.describe()
    assert json.dumps(stops.record()["cost_s"]) == "null"
