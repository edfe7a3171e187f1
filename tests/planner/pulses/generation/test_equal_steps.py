"""The source's own ramps as a firing rule: the timer's count changes by a constant after each
pulse.
"""

import logging

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Axis, MotionError, load_machine
from planner import Dwell, Line, Program, plan
from planner.pulses import check, find_rule, generate
from planner.pulses.generation.equal_steps import share_counts
from planner.pulses.generation.firing_rule import describe_rule
from planner.pulses.generation.motion_parts import MotionPart

CLOCK, TIMER = 10_000_000, 2_000_000


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.integers(1, 400), st.integers(1, 500), st.integers(1, 60), st.floats(1.0, 6.0))
def test_counts_of_a_run_change_by_the_step_alone(pulses, least, step, slack):
    total = int(pulses * least * slack)
    counts = share_counts(pulses, total, least, step)
    assert len(counts) == pulses
    assert counts.min() >= least
    assert counts.sum() <= total
    np.testing.assert_array_equal(counts, counts[::-1])
    assert set(np.diff(counts).tolist()) <= {-step, 0, step}
    # N m + d R (R + 1) for the largest R that fits; two halves where the run is too short for that
    ramp = 0
    while pulses * least + step * (ramp + 1) * (ramp + 2) <= total:
        ramp += 1
    if 2 * ramp <= pulses:
        assert counts.sum() == pulses * least + step * ramp * (ramp + 1)
    else:
        half = pulses // 2
        assert 0 <= total - counts.sum() < pulses
        assert counts[0] - counts.min() == step * (half if pulses % 2 else half - 1)


def test_more_pulses_than_counts_do_not_fit():
    assert share_counts(10, 9, 1, 1) is None


@pytest.fixture(scope="module")
def traverser():
    """There, a rest, on in one axis and back in another: two runs of each of two axes, one of the
    third.
    """
    machine = load_machine("traverser")
    program = Program((Line([0.01, 0.02, 0.01]), Dwell(0.2), Line([0.02, 0.005, 0.01])))
    return machine, plan(program, machine, order=2).trajectory


@pytest.mark.parametrize("step", [1, 7, 100])
def test_ramps_of_a_plan_end_with_it_and_are_proved(traverser, step):
    machine, motion = traverser
    rule = f"timer:step={step}"
    assert describe_rule(find_rule(rule)) == rule
    schedule = generate(motion, machine.axes, machine.home_q, CLOCK, rule)
    verdict = check(schedule, motion, machine.axes, machine.home_q)
    assert verdict.holds, verdict.faults
    final = np.rint(
        (motion.at([motion.duration]).q[0] - machine.home_q) / [axis.pulse for axis in machine.axes]
    )
    assert [axis.final for axis in schedule.axes] == final.tolist()

    crossings = generate(motion, machine.axes, machine.home_q, CLOCK)
    for axis, plain in zip(schedule.axes, crossings.axes, strict=True):
        np.testing.assert_array_equal(axis.direction, plain.direction)
        assert not (axis.ticks % (CLOCK // TIMER)).any()
        counts = np.diff(axis.ticks) * TIMER // CLOCK
        # the rest of 0.2 s parts the runs; within them the count changes by the step or not at all
        for run in np.split(counts, np.flatnonzero(counts > 0.2 * TIMER)):
            own = run[run < 0.2 * TIMER]
            assert set(np.diff(own).tolist()) <= {-step, 0, step}
        assert schedule.duration == pytest.approx(motion.duration)


def test_the_bound_is_the_largest_difference(traverser):
    """By the counts themselves, at every pulse and just before it."""
    machine, motion = traverser
    schedule = generate(motion, machine.axes, machine.home_q, CLOCK, "timer:step=7")
    for k, axis in enumerate(schedule.axes[:3]):
        x = (
            motion.at(np.minimum(axis.ticks / CLOCK, motion.duration)).q[:, k] - axis.home
        ) / axis.pulse
        after = axis.start + np.cumsum(axis.direction)
        largest = max(np.abs(x - after).max(), np.abs(x - after + axis.direction).max())
        assert axis.bound == pytest.approx(max(largest, 0.5), abs=0.01)


def test_a_steep_ramp_is_warned_of(traverser, caplog):
    """d/f·(f/c)³ pulses/s² at the least count: of X, in m/s², from the schedule's own counts."""
    machine, motion = traverser
    with caplog.at_level(logging.WARNING, "pulsepath"):
        schedule = generate(motion, machine.axes, machine.home_q, CLOCK, "timer:step=100")
    (told,) = [one.getMessage() for one in caplog.records if "axis X:" in one.getMessage()]
    axis = schedule.axes[0]
    counts = np.diff(axis.ticks) * TIMER // CLOCK
    steepest = axis.pulse * 100 / TIMER * (TIMER / counts.min()) ** 3
    assert f"accelerate by up to {steepest:.4g} m/s²" in told
    assert steepest > machine.axes[0].max_acceleration


def test_it_needs_the_whole_motion_and_a_step_that_is_one(traverser):
    machine, motion = traverser
    part = MotionPart(motion, machine.axes, machine.home_q, CLOCK, last=False)
    with pytest.raises(
        MotionError, match="makes no pulses of a motion part by part: its ramps reach from one rest"
    ):
        find_rule("timer:step=5").fire(part)
    assert find_rule("timer").whole_reason == ""
    for wrong in ("-1", "1.5"):
        with pytest.raises(MotionError, match="whole number"):
            find_rule(f"timer:step={wrong}")


def test_a_timer_too_slow_for_the_pulses_is_refused(traverser):
    machine, motion = traverser
    axes = [Axis(axis.name, axis.kind, pulse=axis.pulse / 500) for axis in machine.axes]
    with pytest.raises(MotionError, match=r"pulse rate|more than a timer of 1000 Hz can count"):
        generate(motion, axes, machine.home_q, CLOCK, "timer:clock=1kHz,step=1")
