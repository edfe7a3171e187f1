"""Pulses of a stop behind those that were sent: joined, they are checked as those of one motion."""

from dataclasses import replace
from math import ceil

import numpy as np
import pytest

from kinematics import load_machine
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import DRIVES
from planner import Blend, Dwell, Line, Program, PulseSchedule, plan
from planner.interruption.running import find_running
from planner.pulses import AxisPulses, generate
from planner.pulses.checking import check
from planner.pulses.generation.motion_parts import JoinedMotion, MotionSpan
from planner.pulses.generation.sent import find_sent, go_on
from planner.pulses.generation.spacing import GivenPulse, HeldPulses, LeastGaps

GAPS = LeastGaps(straight=20, back=50, setup=500, grain=1)
AXIS = AxisPulses("leg", np.array([0, 90]), np.array([1, 1]), 7, 1e-6, 0.0)


# s of which instants are whole multiples, so that the timer's own clock continues
PERIOD = 1e-6
CORNERS = ((0.045, 0.03), (0.02, 0.045), (0.01, 0.01), (0.03, 0.0), (0.0, 0.0))


def list_programs():
    """Blended lines on a CoreXY, and lines with rests on one that compensates its play and its
    screws.
    """
    corners = [np.array([*corner, 0.0]) for corner in CORNERS]
    lines = [Line(to=corner, join=Blend(5e-4)) for corner in corners[:-1]]
    yield Program((*lines, Line(to=corners[-1]))), load_machine("corexy")
    worn = load_machine("corexy")
    screw = ((0.0, 0.0), (0.02, 1e-5), (0.04, -1e-5), (0.09, 2e-5))
    worn.axes = tuple(
        replace(axis, backlash=2e-5, lead_error=screw, compensate=("lead", "backlash"))
        for axis in worn.axes
    )
    yield (
        Program(tuple(part for corner in corners for part in (Line(to=corner), Dwell(0.05)))),
        worn,
    )


@pytest.fixture(scope="module")
def cases():
    """Plans of both, with drives that want DIR 50 µs ahead."""
    made = []
    for program, machine in list_programs():
        machine.axes = tuple(replace(axis, timing=DRIVES["Pacific-6410"]) for axis in machine.axes)
        made.append(plan(program, machine, order=2))
    return made


def join(*runs):
    """Join runs (counted motion, its pulses, s until which it runs): the pulses sent, and the
    motion, as one.
    """
    clock = runs[0][1].clock_hz
    axes = []
    for k, first in enumerate(runs[0][1].axes):
        ticks, directions, begin = [], [], 0
        for _, pulses, until in runs:
            end = np.iinfo(np.int64).max if pulses is runs[-1][1] else round(until * clock)
            sent = pulses.axes[k].ticks < end
            ticks.append(pulses.axes[k].ticks[sent] + begin)
            directions.append(pulses.axes[k].direction[sent])
            begin += end if end < np.iinfo(np.int64).max else 0
        moves = [
            [move.error for move in pulses.moves if move.axis == first.name]
            for _, pulses, _ in runs
        ]
        least = min(
            pulses.axes[k].bound - max(errors, default=0.0)
            for (_, pulses, _), errors in zip(runs, moves, strict=True)
        )
        bound = least + max((error for errors in moves for error in errors), default=0.0)
        axes.append(
            replace(
                first,
                ticks=np.concatenate(ticks),
                direction=np.concatenate(directions),
                bound=bound,
            )
        )
    motion = JoinedMotion.of(*(MotionSpan(motion, 0.0, until) for motion, _, until in runs))
    every = [move for _, pulses, _ in runs for move in pulses.moves]
    merged = []
    for name in {move.axis: None for move in every}:
        own = [move for move in every if move.axis == name]
        worst = max(own, key=lambda move: move.error)
        longest = max(move.time for move in own)
        merged.append(replace(worst, pulses=sum(move.pulses for move in own), time=longest))
    return PulseSchedule(
        clock, tuple(axes), motion.duration, runs[0][1].rule, tuple(merged)
    ), motion


def find_faults(made, section, *before):
    """Faults of the pulses sent before a section and its own, checked as those of one motion."""
    pulses, machine = section.pulses, made.machine
    tick = round(before[-1][2] * pulses.clock_hz)
    if [axis.start for axis in pulses.axes] != [
        int(axis.counts([tick - 1])[0]) for axis in before[-1][1].axes
    ]:
        return ["it does not start at the counts that were sent"]
    joined, motion = join(*before, (section.counted, pulses, section.duration))
    faults = [
        fault
        for axis in check(joined, motion, machine.axes, machine.home_q).axes
        for fault in axis.faults
    ]
    if pulses.rule.startswith(
        "sampled"
    ):  # its sections begin anew, so that spacing alone can be compared
        faults = [fault for fault in faults if "spacing" in fault.what or "set-up" in fault.what]
    return [f"{fault.axis} at tick {fault.tick}: {fault.what}" for fault in faults]


def hold_soon(made, at, on):
    """A stop of the way on; some milliseconds later where a motor is in the midst of crossing its
    play.
    """
    for later in range(5):
        try:
            return made.hold(at + later * 5e-3, on)
        except MotionError as error:
            if "crossing the play" not in str(error):
                raise
    raise AssertionError("every instant was refused")


@pytest.mark.parametrize(
    "rule", ["nearest", "nearest:hysteresis=0.3", "floor", "timer", "sampled:period=20us"]
)
def test_sections_go_on_with_what_was_sent(cases, rule):
    """No instant is refused for the set-up of DIR, which stands right, nor for play that was taken
    up before.
    """
    for number, case in enumerate(cases):
        pulses = generate(
            case.counted, case.machine.axes, case.machine.home_q, case.pulses.clock_hz, rule
        )
        made = replace(case, source=replace(case.source, schedule=pulses))
        rng = np.random.default_rng(number)
        for t in np.round(rng.uniform(0, made.duration, 2) / PERIOD) * PERIOD:
            first = (made.counted, made.pulses, float(t))
            stop = made.hold(float(t))
            assert not find_faults(made, stop, first)
            if stop.until > 0.99 * float(made.path.breaks[-1]):
                continue
            end = ceil(stop.duration / PERIOD + 1) * PERIOD  # it rests until then
            second = (stop.counted, stop.pulses, end)
            on = made.resume(stop, 0.7)
            assert not find_faults(made, on, first, second)
            if rule.startswith(
                "sampled"
            ):  # its counts at the instant are no beginning for another section
                continue
            later = round(0.4 * on.duration / PERIOD) * PERIOD
            again = hold_soon(made, later, on)
            assert not find_faults(made, again, first, second, (on.counted, on.pulses, again.at))


def test_the_check_of_joined_pulses_sees_what_is_wrong(cases):
    """A pulse that is sent twice, left out, or too soon behind DIR."""
    made = cases[0]
    at = round(0.37 * made.duration / PERIOD) * PERIOD
    held, before = made.hold(at), (made.counted, made.pulses, at)
    assert not find_faults(made, held, before)
    axis = next(axis for axis in held.pulses.axes if len(axis) > 2)

    def change(**own):
        axes = tuple(replace(each, **own) if each is axis else each for each in held.pulses.axes)
        return replace(held, pulses=replace(held.pulses, axes=axes))

    left_out = change(ticks=axis.ticks[1:], direction=axis.direction[1:])
    twice = change(
        ticks=np.insert(axis.ticks, 1, axis.ticks[0] + 1),
        direction=np.insert(axis.direction, 1, axis.direction[0]),
    )
    other = change(start=axis.start + 1)
    turned = change(direction=np.concatenate([-axis.direction[:1], axis.direction[1:]]))
    for wrong in (left_out, twice, other, turned):
        assert find_faults(made, wrong, before)


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
    assert (late.ticks.tolist(), late.direction.tolist(), late.final) == (
        [0, 90, 180],
        [1, 1, 1],
        10,
    )
    away = go_on(
        0, replace(AXIS, ticks=[90, 180]), 8, GAPS, still
    )  # it is not due soon: taken back
    assert (away.ticks.tolist(), away.direction.tolist(), away.final) == (
        [0, 90, 180],
        [-1, 1, 1],
        9,
    )
    with pytest.raises(MotionError, match="another instant"):
        go_on(0, AXIS, 9, GAPS, still)
