"""Pulses of a stop behind those that were sent: joined, they are checked as those of one motion."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.evidence.cases.holds import PERIOD, find_faults, rest_after
from kinematics import load_machine
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import DRIVES
from planner import Blend, Dwell, Line, Program, plan
from planner.interruption.instant import find_running
from planner.pulses import AxisPulses, PulseSchedule, generate
from planner.pulses.generation.sent import find_sent, go_on
from planner.pulses.generation.spacing import GivenPulse, HeldPulses, LeastGaps

GAPS = LeastGaps(straight=20, back=50, setup=500, grain=1)
AXIS = AxisPulses("leg", np.array([0, 90]), np.array([1, 1]), 7, 1e-6, 0.0)


CORNERS = [(0.045, 0.03, 0), (0.02, 0.045, 0), (0.01, 0.01, 0), (0.03, 0, 0), (0, 0, 0)]
SCREW = ((0.0, 0.0), (0.02, 1e-5), (0.04, -1e-5), (0.09, 2e-5))
WORN = {"backlash": 2e-5, "lead_error": SCREW, "compensate": ("lead", "backlash")}


@pytest.fixture(scope="module")
def cases():
    """Plans of blended lines, and of lines with rests on a machine that makes up for play and screws.

    Their drives take DIR 50 µs ahead.
    """
    blends = Program((*(Line(to=corner, join=Blend(5e-4)) for corner in CORNERS[:-1]), Line(to=CORNERS[-1])))
    rests = Program(tuple(part for corner in CORNERS for part in (Line(to=corner), Dwell(0.05))))
    timing = DRIVES["Pacific-6410"]
    plans = []
    for program, properties in ((blends, {}), (rests, WORN)):
        machine = load_machine("corexy")
        machine.axes = tuple(replace(axis, timing=timing, **properties) for axis in machine.axes)
        plans.append(plan(program, machine, order=2))
    return plans


@pytest.mark.parametrize("rule", ["nearest", "nearest:hysteresis=0.3", "floor", "timer", "sampled:period=10us"])
def test_sections_go_on_with_what_was_sent(cases, rule):
    """No instant is refused for the set-up of DIR, which has its level, nor for play that was taken up before.

    The rule `sampled` needs the whole of a motion, so that a section begins anew: its spacing alone is compared.
    """
    for number, made in enumerate(cases):
        pulses = generate(made.counted, made.machine.axes, made.machine.home_q, made.pulses.clock_hz, rule)
        made = replace(made, pulses=pulses)
        drawn = np.random.default_rng(number).uniform(0, made.duration, 3)
        faults = []
        for at in np.round(drawn / PERIOD) * PERIOD:
            stop = made.hold(at)
            sent = made.counted, made.pulses, at
            faults += find_faults(stop, sent)
            if stop.until < made.path.breaks[-1]:
                faults += find_faults(made.resume(stop), sent, rest_after(stop))
        if rule.startswith("sampled"):
            faults = [fault for fault in faults if "spacing" in fault or "set-up" in fault]
        assert faults == []


def test_the_check_of_joined_pulses_sees_what_is_wrong(cases):
    """A pulse that is sent twice, left out, or too soon behind DIR."""
    made = cases[0]
    at = round(0.37 * made.duration / PERIOD) * PERIOD
    held, before = made.hold(at), (made.counted, made.pulses, at)
    assert not find_faults(held, before)
    axis = next(axis for axis in held.pulses.axes if len(axis) > 2)

    def change(**own):
        axes = tuple(replace(each, **own) if each is axis else each for each in held.pulses.axes)
        return replace(held, pulses=replace(held.pulses, axes=axes))

    left_out = change(ticks=axis.ticks[1:], direction=axis.direction[1:])
    twice = change(
        ticks=np.insert(axis.ticks, 1, axis.ticks[0] + 1), direction=np.insert(axis.direction, 1, axis.direction[0])
    )
    other = change(start=axis.start + 1)
    turned = change(direction=np.concatenate([-axis.direction[:1], axis.direction[1:]]))
    for wrong in (left_out, twice, other, turned):
        assert find_faults(wrong, before)


def test_what_was_sent_is_the_count_and_the_last_pulse():
    axis = AxisPulses("leg", np.array([10, 90, 170]), np.array([1, 1, -1]), 7, 1e-6, 0.0)
    schedule = PulseSchedule(10_000_000, (axis,), 1e-3)
    (none,), (one,), (two,), (all_,) = (find_sent(schedule, tick) for tick in (10, 90, 100, 171))
    assert (none.count, none.last) == (7, None)
    assert (one.count, one.last) == (8, GivenPulse(-80, -80, -80, 1))
    # the next pulse goes the other way: DIR may have been turned for it
    assert (two.count, two.last) == (9, GivenPulse(-10, -10, -10, 1, stands=False))
    assert (all_.count, all_.last) == (8, GivenPulse(-1, -1, -1, -1))
    # of a section without a pulse it is what came before it
    (later,) = find_sent(schedule, 10, (two,))
    assert later.last == GivenPulse(-20, -20, -20, 1, stands=False)


def test_a_pulse_on_the_last_tick_of_a_stop_was_sent(cases):
    """A stop ends within a tick, on either side of which its last pulse may be rounded."""
    made = cases[0]
    running = find_running(made.whole(), made.hold(round(0.37 * made.duration / PERIOD) * PERIOD))
    running = replace(running, duration=1000.7 / running.pulses.clock_hz)
    axes = [replace(axis, ticks=[1001], direction=[1], start=7) for axis in running.pulses.axes]
    sent = replace(running, pulses=replace(running.pulses, axes=axes)).find_sent().pulses
    assert [(one.count, one.last.tick) for one in sent] == 3 * [(8, -1)]


@pytest.mark.parametrize(
    ("given", "direction", "least"),
    [
        (None, 1, 500),
        (GivenPulse(-5, -5, -5, 1), 1, 15),
        (GivenPulse(-5, -5, -5, 1), -1, 500),  # DIR is turned at the start, not before
        (GivenPulse(-5, -5, -5, 1, stands=False), 1, 500),
        (GivenPulse(-900, -900, -900, -1), -1, 0),
    ],
)
def test_the_first_pulse_waits_for_dir_only_where_it_does_not_stand(given, direction, least):
    held = HeldPulses(np.array([0]), np.array([direction], np.int8), given)
    assert GAPS.space(held, 0, None)[0].tolist() == [least]


def still(_, ticks):
    return np.full(len(ticks), 7.4), np.zeros(len(ticks))


def test_a_pulse_moved_across_the_first_tick_is_sent_once():
    assert go_on(0, AXIS, 7, GAPS, still) is AXIS
    early = go_on(0, AXIS, 8, GAPS, still)  # one more was sent: it came before it was due
    assert (early.start, early.ticks.tolist(), early.final) == (8, [90], AXIS.final)
    assert early.bound == pytest.approx(0.6)
    late = go_on(0, replace(AXIS, ticks=[90, 180], start=8), 7, GAPS, still)  # it is due at once
    assert (late.ticks.tolist(), late.direction.tolist(), late.final) == ([0, 90, 180], [1, 1, 1], 10)
    away = go_on(0, replace(AXIS, ticks=[90, 180]), 8, GAPS, still)  # it is not due soon: taken back
    assert (away.ticks.tolist(), away.direction.tolist(), away.final) == ([0, 90, 180], [-1, 1, 1], 9)
    with pytest.raises(MotionError, match="another instant"):
        go_on(0, AXIS, 9, GAPS, still)
