"""Pulses in parts: the same verdict as of the whole wherever they are cut, read in memory that does
not grow.
"""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Axis
from planner import PulseSchedule
from planner.export.formats import pulse_csv
from planner.pulses import AxisPulses, check, check_file, generate
from planner.pulses.checking import check_parts, edge_reader
from planner.pulses.schedule import holds_same_pulses, join_schedules
from tests import read_lines
from tests.planner.motions import PULSE


def cut(schedule, ticks):
    """A schedule in parts that end at these ticks."""
    starts = [axis.start for axis in schedule.axes]
    for lo, hi in zip([0, *ticks], [*ticks, 1 << 62], strict=True):
        axes = []
        for axis, start in zip(schedule.axes, starts, strict=True):
            inside = (axis.ticks >= lo) & (axis.ticks < hi)
            axes.append(
                replace(
                    axis, ticks=axis.ticks[inside], direction=axis.direction[inside], start=start
                )
            )
        starts = [axis.final for axis in axes]
        yield replace(schedule, axes=tuple(axes))


CUTS = st.lists(st.integers(0, 2_500_000), max_size=6).map(
    sorted
)  # past the end of the motion as well


@settings(max_examples=30, derandomize=True, deadline=None)
@given(
    cuts=CUTS, late=st.sampled_from([0, 0, 3, 40_000]), rule=st.sampled_from(["nearest", "floor"])
)
def test_the_verdict_does_not_depend_on_where_a_schedule_is_cut(three_legs, cuts, late, rule):
    """late: ticks by which a pulse of the second axis is off, so that there are faults to find."""
    motion, home = three_legs.counted, three_legs.machine.home_q
    schedule = generate(motion, three_legs.machine.axes, home, rule=rule)
    ticks = schedule.axes[1].ticks.copy()
    ticks[len(ticks) // 2] += late
    axes = list(schedule.axes)
    axes[1] = replace(axes[1], ticks=ticks)
    schedule = replace(schedule, axes=tuple(axes))
    whole = check(schedule, motion, three_legs.machine.axes, home)
    parts = check_parts(schedule, cut(schedule, cuts), motion, three_legs.machine.axes, home)
    assert whole.holds == parts.holds == (late == 0)
    if late < 40_000:  # one out of order ends the measuring, in parts where it comes
        assert whole == parts
    assert holds_same_pulses(schedule, cut(schedule, cuts))
    assert holds_same_pulses(schedule, [join_schedules(cut(schedule, cuts))])


@pytest.mark.parametrize(
    "change", [{"ticks": np.array([10, 21])}, {"direction": np.array([1, 1], np.int8)}, "short"]
)
def test_another_schedule_is_not_the_same(change):
    axis = AxisPulses("x", np.array([10, 20]), np.array([1, -1], np.int8), 0, PULSE, 0.0)
    other = (
        replace(axis, ticks=axis.ticks[:1], direction=axis.direction[:1])
        if change == "short"
        else None
    )
    other = other or replace(axis, **change)
    one, two = (PulseSchedule(10_000_000, (each,), 1.0) for each in (axis, other))
    assert holds_same_pulses(one, [one])
    assert not holds_same_pulses(one, [two])
    assert not holds_same_pulses(two, [one])


@pytest.mark.parametrize("size", [1, 1000, 1 << 20])
def test_a_file_reads_the_same_in_pieces_of_any_size(
    three_legs, three_short_legs, tmp_path, monkeypatch, size
):
    """Cut inside rows, and so that a piece holds no whole row."""
    made = three_short_legs if size == 1 else three_legs
    axes = made.machine.axes
    pulse_csv.write(made.pulses, tmp_path / "p.csv", [axis.direction for axis in axes])
    expected = read_lines.read(tmp_path / "p.csv", 10_000_000, axes, made.machine.home_q)
    monkeypatch.setattr(edge_reader, "PART_BYTES", size)
    parts = list(edge_reader.parts(tmp_path / "p.csv", 10_000_000, axes, made.machine.home_q))
    assert len(parts) > 1 or size > 1000
    assert holds_same_pulses(made.pulses, (part.schedule for part in parts))
    assert parts[-1].times == expected.times
    told = []
    assert check_file(tmp_path / "p.csv", made, lambda done, of: told.append((done, of))).holds
    assert told == sorted(set(told))
    assert told[-1] == (told[0][1],) * 2 == ((tmp_path / "p.csv").stat().st_size,) * 2


def test_reading_takes_no_memory_for_the_pulses_that_are_read(tmp_path, monkeypatch):
    """Twice the pulses take the same: the growth allowed is a tenth of what their ticks alone would
    take.
    """
    monkeypatch.setattr(edge_reader, "PART_BYTES", 1 << 15)
    axes, peaks = [Axis("x", pulse=PULSE)], []
    for pulses in (30_000, 60_000):
        made = AxisPulses(
            "x", 100 * np.arange(1, pulses + 1), np.ones(pulses, np.int8), 0, PULSE, 0.0
        )
        pulse_csv.write(PulseSchedule(10_000_000, (made,), 1.0), tmp_path / "p.csv", [1])
        tracemalloc.start()
        assert sum(
            len(part.schedule.axes[0])
            for part in edge_reader.parts(tmp_path / "p.csv", 10_000_000, axes, [0.0])
        )
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < 0.1 * 8 * 30_000
