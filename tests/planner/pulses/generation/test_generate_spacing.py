"""Room for the drives: pulses keep the times that their inputs need, moved by the least that
does.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from kinematics import Axis, MotionError
from kinematics.machine.axis import DRIVES, StepTiming, find_drive
from planner import Infeasible, PulseSchedule
from planner.export.formats import pulse_csv
from planner.pulses import AxisPulses, check_file, generate
from planner.pulses.generation.spacing import HeldPulses, LeastGaps, space_pulses
from tests.planner.motions import in_pulses, one_axis

CLOCK = 1_000_000


class Slow:
    """So slow a motion that no shift of these tests runs an axis half a pulse."""

    knots = np.array([0.0, 1.0])
    duration = 1.0

    def at(self, t):
        q = np.asarray(t)[:, None] * 1e-3
        nothing = np.zeros_like(q)
        return SimpleNamespace(s=np.asarray(t), q=q, qd=nothing + 1e-3, qdd=nothing, qddd=nothing)


def fired(ticks, direction, timing, clock=CLOCK):
    axes = [Axis("x", pulse=1.0, timing=timing)]
    held = HeldPulses(np.array(ticks), np.array(direction))

    def travel(axis, at):
        return Slow().at(at / clock).q[:, axis], at / clock

    done = space_pulses(
        held, 0, axes[0], LeastGaps.from_axis(axes[0], clock, 1), clock, travel, end=clock
    )
    widened = 0.0 if done.moved is None else done.moved.error
    pulses = AxisPulses("x", done.ticks, done.direction, 0, 1.0, 0.0, 0.5 + widened)
    return PulseSchedule(clock, (pulses,), 1.0, moves=() if done.moved is None else (done.moved,))


def gaps(direction, timing):
    """Ticks that each pulse has to be behind the one before, written down from the data sheet's
    meaning.
    """
    levels = timing.high + timing.low
    other = max(timing.high, timing.hold) + timing.setup
    rate = 0 if timing.max_rate is None else int(CLOCK // timing.max_rate)
    same = max(int(np.ceil(levels * CLOCK - 1e-6)), rate)
    return np.where(np.diff(direction) != 0, max(same, int(np.ceil(other * CLOCK - 1e-6))), same)


@given(
    st.lists(st.tuples(st.integers(1, 40), st.sampled_from([-1, 1])), min_size=1, max_size=12),
    st.sampled_from(
        [StepTiming(4e-6, 3e-6, 9e-6, 2e-6), StepTiming(1e-6, 1e-6, 0, 0, 1e5), find_drive("A4988")]
    ),
)
def test_no_two_pulses_are_closer_than_needed_and_none_is_moved_farther_than_the_least(
    fires, timing
):
    """The least largest shift by a linear programme: min z over t' with t'[i+1] - t'[i] >= gap, |t'
    - t| <= z.
    """
    ticks, direction = 100 + np.cumsum([gap for gap, _ in fires]), [sign for _, sign in fires]
    moved = fired(ticks, direction, timing).axes[0].ticks
    needed = gaps(direction, timing)
    assert (np.diff(moved) >= needed).all()
    n = len(ticks)
    rows = [[*-row, 0.0] for row in np.diff(np.eye(n), axis=0)]
    rows += [[*row, -1.0] for row in np.eye(n)] + [[*-row, -1.0] for row in np.eye(n)]
    least = linprog(
        [0] * n + [1], rows, [*-needed, *ticks, *-ticks], bounds=[(None, None)] * (n + 1)
    ).fun
    assert abs(moved - ticks).max() <= np.ceil(least - 1e-6) + 1e-9


def test_a_reversal_is_moved_by_the_least_and_the_schedule_says_so():
    """Up to 6 pulses and back, half a pulse beyond the last level, with a hold longer than the
    motion stays there.
    """
    motion, home = in_pulses([-6.0, 12.0, 0.0], [-6.0, 0.0, 6.0])
    pulse = 0.75e-6
    axis = Axis("x", pulse=pulse)
    plain = generate(motion, [axis], home).axes[0]
    turn = int(np.flatnonzero(np.diff(plain.direction))[0])
    between = (plain.ticks[turn + 1] - plain.ticks[turn]) / 1e7
    timing = StepTiming(1e-6, 1e-6, 0.0, between * 1.2)
    reversal = max(1 / timing.rate, max(timing.high, timing.hold) + timing.setup)
    schedule = generate(motion, [replace(axis, timing=timing)], home)
    (moved,), (after,) = schedule.moves, schedule.axes
    gap = (after.ticks[turn + 1] - after.ticks[turn]) / 1e7
    assert reversal <= gap <= reversal + 2e-7
    assert moved.pulses == 2
    assert moved.time == pytest.approx((reversal - between) / 2, abs=1.5e-7)
    shifts = np.abs(motion.at(after.ticks / 1e7).q - motion.at(plain.ticks / 1e7).q).max() / pulse
    assert moved.error == pytest.approx(shifts, rel=1e-6)
    assert moved.length == moved.error * pulse
    assert after.bound == 0.5 + moved.error
    assert after.final == plain.final


def test_what_no_shift_helps_is_refused_with_axis_time_and_rate():
    motion, home = in_pulses([1e4, 0.3])  # 10 000 pulses/s for a second
    axis = Axis("x", pulse=0.75e-6, timing=StepTiming(60e-6, 60e-6, 0, 0))
    with pytest.raises(
        Infeasible, match=r"drive timing 10000 1/s is beyond 8333.33 1/s at x, s = .*, t = "
    ) as no:
        generate(motion, [axis], home)
    assert no.value.place.t is not None


def test_at_exactly_the_highest_rate_rounding_costs_a_tick_at_most():
    motion, home = in_pulses([7000.0, 0.0])
    axis = Axis("x", pulse=0.75e-6, timing=StepTiming(1e-6, 1e-6, 0, 0, 7000.0))
    schedule = generate(motion, [axis], home)
    assert schedule.smallest_interval >= 1e7 // 7000
    assert schedule.moves == ()
    assert axis.pulse_rate == 7000.0


def test_the_first_pulse_leaves_the_direction_its_set_up():
    assert fired([3, 100], [1, 1], StepTiming(1e-6, 1e-6, 20e-6, 0)).axes[0].ticks[0] >= 20


def test_a_first_pulse_before_the_set_up_is_told_as_that_and_a_dwell_cures_it():
    """It used to be told as a reversal, which there is none of."""
    rate, setup = 5e4, 1e-3
    axis = Axis("x", pulse=0.75e-6, timing=StepTiming(1e-6, 1e-6, setup, 0))
    motion, home = in_pulses([rate, 0.0])
    told = (
        r"direction set-up before the first pulse 100000 1/s is beyond 1000 1/s at x, .* a dwell of"
    )
    with pytest.raises(Infeasible, match=told) as no:
        generate(motion, [axis], home)
    dwell = float(no.value.remedy.partition("a dwell of ")[2].split()[0])
    assert dwell == pytest.approx(setup - 0.5 / rate, abs=2e-7)
    waits = one_axis([[0.0, 0.0], [rate * axis.pulse, 0.0]], [0, dwell, dwell + 0.1])
    assert generate(waits, [axis], home).moves == ()


def test_a_refused_reversal_is_told_as_one():
    motion, home = in_pulses([-6.0, 12.0, 0.0], [-6.0, 0.0, 6.0])
    axis = Axis("x", pulse=0.75e-6, timing=StepTiming(1e-6, 1e-6, 0.0, 1.5))
    with pytest.raises(
        Infeasible,
        match=r"drive timing at a reversal .* is beyond 0\.6666\d* 1/s at x, .* rest there",
    ):
        generate(motion, [axis], home)


def test_pulses_that_keep_the_timing_stay_as_they_are():
    before = [50, 100, 200]
    schedule = fired(before, [1, 1, -1], find_drive("TMC2209"))
    assert (schedule.axes[0].ticks == before).all()
    assert schedule.moves == ()
    assert schedule.axes[0].bound == 0.5


@pytest.mark.parametrize("name", DRIVES)
def test_named_drives_are_consistent(name):
    timing = find_drive(name)
    assert timing.max_rate is None or timing.rate == pytest.approx(timing.max_rate, rel=0.05)
    interval, reversal = timing.ticks(10_000_000)
    assert interval / 1e7 >= timing.high + timing.low - 1e-12
    assert reversal / 1e7 >= timing.hold + timing.setup - 1e-12


@pytest.mark.parametrize(
    "wrong", [{"high": 0}, {"low": -1e-6}, {"setup": np.nan}, {"hold": "1 us"}, {"max_rate": 0}]
)
def test_wrong_timing_is_refused_by_name(wrong):
    with pytest.raises(MotionError, match=next(iter(wrong))):
        StepTiming(**({"high": 1e-6, "low": 1e-6, "setup": 0, "hold": 0} | wrong))


def test_an_unknown_drive_is_told_the_nearest():
    with pytest.raises(MotionError, match='nearest is "A4988"'):
        find_drive("a4988")


def test_the_file_of_moved_reversals_keeps_their_set_up(tmp_path):
    """STEP may stay high only so long that DIR, which changes when it falls, is early enough."""
    motion, home = in_pulses(
        [0.0, 0.0, 0.0], [-6.0, 12.0, 0.0], [-6.0, 0.0, 6.0]
    )  # after a rest, for the first set-up
    timing = StepTiming(
        0.25e-6, 0.25e-6, 0.6, 0.0
    )  # and the motion stays beyond its last level for 0.577 s
    axis = Axis("x", pulse=0.75e-6, timing=timing)
    schedule = generate(motion, [axis], home)
    assert len(schedule.moves) == 1
    machine = SimpleNamespace(axes=[axis], home_q=np.array(home))
    plan = SimpleNamespace(machine=machine, counted=motion, pulses=schedule)
    pulse_csv.write(schedule, tmp_path / "p.csv", [1], timing=[timing])
    found = check_file(tmp_path / "p.csv", plan)
    assert found.holds, found.faults
    with pytest.raises(MotionError, match="pulse width"):
        pulse_csv.write(schedule, tmp_path / "q.csv", [1], timing=[timing], width=2e-6)
