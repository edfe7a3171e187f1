"""Pulses of an axis are as far apart as it takes them, across reversals too, under every rule; and
this is proved.
"""

from dataclasses import replace
from math import ceil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Axis, Traverser, load_machine
from kinematics.machine.axis import StepTiming, find_drive, rate_ticks
from planner import Infeasible, Line, Program, PulseSchedule
from planner import plan as planned
from planner.export.formats import pulse_csv
from planner.pulses import AxisPulses, check, generate, pace_axes
from pulsepath.store.read import StoredSource
from tests.planner.motions import PULSE, in_pulses, one_axis

CLOCK = 10_000_000
RATE = 2400.0
BURSTS = "dda:spacing=5ms,pulses_per_count=1"


def turning(beyond=2e-5):
    """Up by ten pulses and a half and `beyond`, and back, at up to 2000 pulses/s and 1e6 pulses/s²
    at the turn.
    """
    top = 10.5 + beyond
    return one_axis(
        np.array([[0.0, 2000.0, 0.0], [-1e6, 2000.0, top - 1.0], [0.0, -2000.0, top - 1.0]])
        * PULSE,
        np.cumsum([0.0, (top - 1.0) / 2000.0, 2e-3, (top - 1.0) / 2000.0]),
    )


def gaps_of(schedule):
    """Of every axis: ticks between pulses one way, and between those the other way."""
    for axis in schedule.axes:
        turned = np.diff(axis.direction) != 0
        yield np.diff(axis.ticks)[~turned], np.diff(axis.ticks)[turned]


def test_without_a_limit_the_two_pulses_of_a_turn_come_microseconds_apart():
    """The premise: that is the crossing's own time, √(8·excursion/acceleration) with the excursion
    2e-5 pulse.
    """
    schedule = generate(turning(), [Axis("x", pulse=PULSE)], [0.0])
    ((_, back),) = gaps_of(schedule)
    assert back.min() == pytest.approx(CLOCK * np.sqrt(8 * 2e-5 / 2e6), abs=2)


@pytest.mark.parametrize("rule", ["nearest", "floor", "timer", "sampled", BURSTS])
def test_a_pulse_rate_holds_across_a_reversal_under_every_rule(rule):
    """It used to hold from pulse to pulse one way alone: two at a turn came 9 µs apart, of 417 that
    the axis takes.
    """
    motion = turning(2e-5 if rule != "floor" else 0.5 - 2e-3 + 2e-5)
    axis = Axis("x", pulse=PULSE, max_pulse_rate=RATE)
    schedule = generate(motion, [axis], [0.0], CLOCK, rule)
    ((one, other),) = gaps_of(schedule)
    assert min(one.min(), other.min()) >= CLOCK / RATE * (1 - 1e-3)
    found = check(schedule, motion, [axis], [0.0])
    assert found.holds, found.faults
    free = generate(motion, [Axis("x", pulse=PULSE)], [0.0], CLOCK, schedule.rule)
    widened = sum(one.error for one in schedule.moves)
    assert schedule.axes[0].bound == pytest.approx(free.axes[0].bound + widened)
    assert widened < 0.06  # pulses: a T²/8 with the turn's own acceleration


@pytest.mark.parametrize("rule", ["timer", "sampled"])
def test_pulses_that_are_moved_stay_on_the_instants_at_which_a_rule_can_fire(rule):
    axis = Axis("x", pulse=PULSE, max_pulse_rate=RATE)
    motion = turning()
    schedule = generate(motion, [axis], [0.0], CLOCK, rule)
    grain = {"timer": 5, "sampled": 200}[rule]
    offset = round(motion.duration * CLOCK) % grain if rule == "sampled" else 0
    assert (schedule.axes[0].ticks % grain == offset).all()


@pytest.mark.parametrize(
    ("stated", "high"),
    [
        ({"max_pulse_rate": RATE}, 20),
        ({"max_speed": 0.1}, 20),  # 2 µs and as long a low, where a speed alone is stated
        ({"max_speed": 1.0}, 4),  # where pulses at that speed come every 0.75 µs, half of it
        ({}, 3),  # nothing stated: as the crossings are, √(8·1e-7/2e6) = 0.63 µs apart
    ],
)
def test_the_step_width_of_a_file_does_not_shrink_with_a_reversal(stated, high):
    schedule = generate(turning(1e-7), [Axis("x", pulse=PULSE, **stated)], [0.0])
    assert pulse_csv.high_ticks(pulse_csv.measure_spacing([schedule]), None, [None]) == high


def violate(axis, kind, rng):
    """Two neighbours brought closer than 417 µs, one way or the other."""
    turned = np.diff(axis.direction) != 0
    i = int(rng.choice(np.flatnonzero(turned if kind == "reversal" else ~turned)))
    ticks = axis.ticks.copy()
    ticks[i + 1 :] -= max(0, ticks[i + 1] - ticks[i] - int(rng.integers(1, 4150)))
    return replace(axis, ticks=ticks, bound=50.0)


@pytest.mark.parametrize("kind", ["run", "reversal"])
def test_the_check_catches_every_spacing_that_is_broken(kind):
    motion, axis = turning(), Axis("x", pulse=PULSE, max_pulse_rate=RATE)
    schedule = generate(motion, [axis], [0.0])
    for seed in range(40):
        wrong = replace(
            schedule,
            axes=(violate(schedule.axes[0], kind, np.random.default_rng(seed)),),
            rule="mine",
        )
        found = check(wrong, motion, [axis], [0.0])
        told = "spacing at a reversal:" if kind == "reversal" else "spacing:"
        assert any(fault.what.startswith(told) for fault in found.faults), seed
        assert not any(
            fault.what.startswith("spacing") for fault in check(wrong, motion).faults
        )  # no axis, no limit


def test_the_check_knows_set_up_and_hold_of_a_drive():
    drive = StepTiming(1e-6, 1e-6, 30e-6, 20e-6)
    motion, home = in_pulses([0.0, 4.0, 0.0], [0.0, -4.0, 4.0])
    for ticks, signs, told in (
        ([200, 400], [1, 1], "direction set-up:"),
        ([400, 850], [1, -1], "spacing at a reversal:"),
        ([400, 410], [1, 1], "spacing:"),
    ):
        schedule = PulseSchedule(
            CLOCK, (AxisPulses("x", np.array(ticks), np.array(signs), 0, PULSE, 0.0, 9.0),), 2.0
        )
        found = check(schedule, motion, [Axis("x", pulse=PULSE, timing=drive)], home)
        assert [
            fault.what.startswith(told) for fault in found.faults if "us, and" in fault.what
        ] == [True]


@given(st.floats(1.0, 9e6), st.integers(1, 12_000_000))
def test_the_ticks_of_a_rate(rate, clock):
    """Never shorter than a thousandth less than its interval; never a tick longer than has to
    be.
    """
    ticks = rate_ticks(rate, clock)
    assert ticks >= clock / rate * (1 - 1e-3) - 1e-6
    assert ticks <= max(1, ceil(clock / rate))


@given(
    st.floats(1e3, 1e6),
    st.sampled_from([200_000, 1_000_000, 10_000_000]),
    st.floats(0.1, 1.0),
    st.integers(0, 99),
)
@settings(max_examples=30, deadline=None)
def test_a_motion_at_the_rate_that_ticks_hold_needs_no_pulse_moved(rate, clock, share, seed):
    """Any motion that keeps what `pace_axes` says comes out as far apart as the axis takes, without
    a pulse moved.
    """
    (axis,) = pace_axes([Axis("x", pulse=PULSE, max_pulse_rate=rate)], clock)
    start = np.random.default_rng(seed).uniform(-0.4, 0.4)
    motion = one_axis(np.array([[axis.pulse_rate * share, start]]) * PULSE, [0.0, 200 / rate])
    schedule = generate(motion, [Axis("x", pulse=PULSE, max_pulse_rate=rate)], [0.0], clock)
    assert schedule.moves == ()
    assert check(schedule, motion, [Axis("x", pulse=PULSE, max_pulse_rate=rate)], [0.0]).holds


def driven(**stated):
    """The traverser's X with another drive, fast enough for it to be what limits it."""
    machine = load_machine("traverser")
    own = {"max_speed": 8.0, "max_acceleration": 40.0, "max_pulse_rate": None}
    return Traverser(
        axes=[replace(axis, **own, **stated) for axis in machine.axes], home=machine.home
    )


@pytest.mark.parametrize(
    ("clock", "rate"), [(1_000_000, 250_000), (10_000_000, 1 / 3.8e-6), (3_000_000, 250_000)]
)
def test_a_plan_at_a_drives_own_rate_keeps_the_rate_that_the_clock_can_hold(clock, rate):
    """Levels of a DRV8825: a pulse every 3.8 µs; on a clock of 1 MHz every 4.

    Its own pulses refused that once.
    """
    machine = driven(timing=replace(find_drive("DRV8825"), max_rate=None))
    made = planned(Program([Line([0.5, 0, 0])]), machine, clock_hz=clock)
    limit = next(limit for limit in made.limits if limit.name == "pulse rate")
    assert limit.bounds[0] == pytest.approx(rate)
    assert made.certificate.holds
    assert made.certificate.worst["pulse rate"] == pytest.approx(1.0, abs=1e-5)
    assert check(made.pulses, made.trajectory, machine.axes, machine.home_q).holds
    assert made.pulses.smallest_interval >= 3.8e-6 * clock
    # a plan that is taken up again is held to the limits that it was made to keep
    source = StoredSource(made.program, machine, made.order, Path("motion.bin"), made.pulses)
    again = source.find_limits(made.trajectory)
    assert [limit.bounds.tolist() for limit in again] == [
        limit.bounds.tolist() for limit in made.limits
    ]


@pytest.mark.parametrize("rule", ["timer", "sampled:period=3us"])
def test_a_plan_keeps_the_rate_that_its_rule_can_hold(rule):
    """Every 3 counts of 2 MHz, every second look of 3 µs: 263 158 pulses/s of a drive are fewer of
    a rule.
    """
    machine = driven(timing=find_drive("DRV8825"))
    made = planned(Program([Line([0.5, 0, 0])]), machine, rule=rule)
    grain = {"timer": 0.5e-6}.get(rule, 3e-6)
    limit = next(limit for limit in made.limits if limit.name == "pulse rate")
    assert limit.bounds[0] == pytest.approx(1 / (ceil(3.8e-6 / grain) * grain))
    assert check(made.pulses, made.trajectory, machine.axes, machine.home_q).holds


def test_bursts_at_their_default_suit_the_machine_for_which_they_were_made():
    """It was refused: 375 000 pulses/s of its arms are beyond the 100 000 that bursts used to
    have.
    """
    machine = load_machine("tripod")
    made = planned(Program([Line([0, 0, 0.003])]), machine, rule="dda")
    assert made.pulses.rule == "dda:rate=500000.0 1/s"
    found = check(made.pulses, made.trajectory, machine.axes, machine.home_q)
    assert found.holds, found.faults
    assert made.pulses.smallest_interval == 20


def test_bursts_keep_an_axis_that_its_own_rate_limits_within_it():
    machine = load_machine("traverser")
    made = planned(
        Program([Line([0.3, 0, 0])]), machine, rule="dda:spacing=100ms,pulses_per_count=5"
    )
    assert check(made.pulses, made.trajectory, machine.axes, machine.home_q).holds
    assert made.pulses.smallest_interval >= CLOCK / RATE * (1 - 1e-3)


def test_bursts_that_no_move_has_time_for_are_refused_before_planning():
    with pytest.raises(
        Exception, match=r'dda a spacing above 41.67 ms, as in "dda:spacing=166.7 ms"'
    ):
        planned(Program([Line([0.3, 0, 0])]), load_machine("traverser"), rule="dda")


def test_a_reversal_that_nothing_helps_is_refused_with_what_would():
    """A hold so long that the axis runs on by more than half a pulse meanwhile."""
    axis = Axis("x", pulse=PULSE, timing=StepTiming(1e-6, 1e-6, 0.0, 5e-3))
    with pytest.raises(Infeasible, match=r"at a reversal.*rest there for.*nearest:hysteresis=0.2"):
        generate(turning(), [axis], [0.0])
