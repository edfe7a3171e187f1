"""The segments of a plan as a table, against their known lengths and times."""

from dataclasses import replace

import numpy as np
import pytest

from planner import Blend, Dwell, Fit, Line, Program, plan
from planner.active_limits import tabulate_segments
from planner.path.arc_length import measure_travel


def columns_of(table):
    return {column.name: column.raw for column in table.columns}


def test_each_segment_has_its_length_time_line_and_what_holds_it_back():
    """A slow line runs at its cap all but its ramps; a rest takes its time and no way; repetitions
    add up.
    """
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
    """Its length is that of the shorter curve that is run in its time: the sum is that of the
    whole.
    """
    corners = [
        Line(np.array([4e-3 * k, 4e-3 * (k % 2), 0.0]), join=join, speed=5e-4) for k in range(1, 9)
    ]
    made = plan(Program(tuple(corners)), "traverser", order=2)
    told = columns_of(tabulate_segments(made))
    assert max(told["mean speed"]) <= 5e-4 * (1 + 1e-9)
    assert max(told["mean speed"]) > 0.97 * 5e-4
    assert sum(told["length"]) == pytest.approx(measure_travel(made.path.pieces), rel=1e-9)
    assert sum(told["length"]) < 0.999 * made.path.breaks[-1]
