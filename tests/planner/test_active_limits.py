"""What a plan does when: the segments as a table, against their known lengths and times; and its stops at joins."""

from dataclasses import replace

import numpy as np
import pytest

from planner import Blend, Dwell, Line, Program, Stop, plan
from planner.active_limits import describe_stops, tabulate_segments
from planner.path.arc_length import measure_travel
from planner.program.modifiers import Fit, Trigger


def columns_of(table):
    return {column.name: column.raw for column in table.columns}


def test_each_segment_has_its_length_time_line_and_what_holds_it_back():
    """A slow line runs at its cap all but its ramps; a rest takes its time and no way; repetitions add up."""
    slow = Line(np.array([0.02, 0.0, 0.0]), speed=1e-3, line_number=7)
    back = Line(np.array([0.0, 0.0, 0.0]), line_number=9)
    made = plan(Program((slow, Dwell(0.25, line_number=8), back), repeat=2), "traverser")
    told = columns_of(tabulate_segments(made))
    assert told["segment"] == [1, 2, 3]
    assert told["file line"] == [7, 8, 9]
    assert told["kind"] == ["line", "dwell", "line"]
    assert told["length"] == pytest.approx([0.04, 0.0, 0.04])
    assert told["time"][0] > 40.0
    assert told["time"][1] == pytest.approx(0.5)
    assert sum(told["time"]) == pytest.approx(made.trajectory.duration)
    assert told["mean speed"][0] == pytest.approx(0.04 / told["time"][0])
    assert told["held back by"][0] == "tool speed"
    assert told["for"][0] > 95
    assert told["held back by"][1] is None
    assert "file line" not in columns_of(tabulate_segments(plan(Program((replace(back, to=slow.to, line_number=None),)),
                                                           "traverser")))  # fmt: skip


@pytest.mark.parametrize("join", [Blend(1e-3), Fit(2e-4)], ids=["blend", "fit"])
def test_the_mean_speed_of_a_segment_stays_below_its_cap(join):
    """Its length is that of the shorter curve that is run in its time: the sum is that of the whole."""
    corners = [Line(np.array([4e-3 * k, 4e-3 * (k % 2), 0.0]), join=join, speed=5e-4) for k in range(1, 9)]
    made = plan(Program(tuple(corners)), "traverser", order=2)
    told = columns_of(tabulate_segments(made))
    assert max(told["mean speed"]) <= 5e-4 * (1 + 1e-9)
    assert max(told["mean speed"]) > 0.97 * 5e-4
    assert sum(told["length"]) == pytest.approx(measure_travel(made.path.pieces), rel=1e-9)
    assert sum(told["length"]) < 0.999 * made.path.breaks[-1]


def zigzag(join, count=30, **said):
    return [Line(np.array([1e-3 * k, 1e-3 * (k % 2), 0.0]), join=join, **said) for k in range(1, count + 1)]


def test_many_stops_at_joins_are_told_but_not_those_that_are_meant():
    said = describe_stops(plan(Program(tuple(zigzag(Stop()))), "traverser", order=2))
    assert said == 'at 29 of 29 joins; --fit "0.02 mm" can pass them'
    exact = plan(Program(tuple(zigzag(Stop())), join_word="G61.1"), "traverser", order=2)
    assert describe_stops(exact) == "at 29 of 29 joins, as G61.1 asks; G64 P0.02 (mm) in its place can pass them"
    assert describe_stops(plan(Program(tuple(zigzag(Stop(), 10))), "traverser", order=2)) == ""
    assert describe_stops(plan(Program(tuple(zigzag(Blend(1e-5)))), "traverser", order=2)) == ""
    rests = [part for line in zigzag(Stop()) for part in (line, Dwell(0.01))]
    assert describe_stops(plan(Program(tuple(rests)), "traverser", order=2)) == ""
    marked = zigzag(Stop(), trigger=Trigger("camera"))
    assert describe_stops(plan(Program(tuple(marked)), "traverser", order=2)) == ""
