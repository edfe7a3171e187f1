"""What the checker holds every rule to: each of 200 or more seeded corruptions of a schedule is
caught under each.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from kinematics import Axis
from kinematics.foundation.options import options
from kinematics.machine.axis import StepTiming
from planner import Infeasible
from planner.pulses import RULES, AxisPulses, check, generate
from planner.pulses.checking import standards
from planner.pulses.generation.firing_rule import COUNT_ROUNDING
from tests.planner.motions import PULSE, example, in_pulses
from tests.planner.pulses.checking.test_check import CLOCK, CORRUPTIONS, shift_one

RULES_HELD = [
    "nearest:hysteresis=0.2",
    "floor",
    "timer",
    "sampled",
    "dda:spacing=1ms,pulses_per_count=4,rate=1MHz",
]
SEEDS = 10  # 22 corruptions x 10 seeds = 220 schedules of each rule


def shift_two(a, rng):
    """Two whole grains of the rule, early or late: rounding excuses half of one."""
    a.ticks[rng.integers(len(a.ticks))] += int(rng.choice([-2, 2])) * a.grain


def a_little(a, rng):
    """By a tick, away from where the rule has it: a level 0.2 beyond half a pulse, a whole count, a
    timer's, a look.
    """
    i = rng.integers(len(a.ticks))
    a.ticks[i] += 1 if a.grain > 1 else 2


def shift_far(a, rng):
    """By half the way to the next pulse: it stays within the bound of the counts."""
    i = rng.integers(len(a.ticks) - 1)
    a.ticks[i] += (a.ticks[i + 1] - a.ticks[i]) // 2 or 2


EVERY = [*(kind for kind in CORRUPTIONS if kind is not shift_one), shift_two, a_little, shift_far]


@pytest.mark.parametrize("rule", RULES_HELD)
def test_every_corrupted_schedule_is_caught_under_every_rule(rule):
    missed = []
    for seed in range(SEEDS):
        motion = example(seed, size=0.25)
        home = motion.at(np.zeros(1)).q[0]
        axes = [Axis(f"leg{i}", pulse=PULSE) for i in range(3)]
        schedule = generate(motion, axes, home, CLOCK, rule)
        assert check(schedule, motion, axes, home).holds
        for kind, corrupt in enumerate(EVERY):
            rng = np.random.default_rng([seed, kind])
            k = int(rng.integers(3))
            axis, other = schedule.axes[k], schedule.axes[(k + 1) % 3]
            a = SimpleNamespace(start=axis.start, home=axis.home, motion=motion, k=k, other=other)
            a.ticks, a.direction = axis.ticks.copy(), axis.direction.copy()
            a.grain = 5 if rule == "timer" else 1
            corrupt(a, rng)
            false = AxisPulses(
                axis.name, a.ticks, a.direction, int(a.start), axis.pulse, axis.home, axis.bound
            )
            found = check(
                replace(
                    schedule,
                    axes=tuple(false if i == k else one for i, one in enumerate(schedule.axes)),
                ),
                motion,
            )
            if found.holds:
                missed.append((corrupt.__name__, seed))
    assert SEEDS * len(EVERY) >= 200
    assert not missed


@pytest.mark.parametrize("rule", ["mine", *RULES_HELD])
def test_a_pulse_the_wrong_way_is_caught_whatever_is_known_of_the_rule(rule):
    """Inside a bound of three pulses, a pulse back against a steady motion and two forwards."""
    motion, home = in_pulses([400.0, 0.0])
    made = generate(
        motion, [Axis("x", pulse=PULSE)], home, CLOCK, rule if rule != "mine" else "nearest"
    )
    (axis,) = made.axes
    assert len(axis) > 300
    ticks = np.insert(axis.ticks, 101, axis.ticks[100] + np.array([300, 600]))
    direction = np.insert(axis.direction, 101, [-1, 1])
    wrong = replace(axis, ticks=ticks, direction=direction, bound=max(3.0, axis.bound))
    assert not check(
        replace(made, rule="mine" if rule == "mine" else made.rule, axes=(wrong,)), motion
    ).holds


def test_what_the_checker_writes_down_again_is_what_the_rules_say():
    """The defaults of the rules' options, and the way that `floor` leaves to a whole count."""
    told = {
        name: {key: field.default for key, field in options(rule).items()}
        for name, rule in RULES.items()
    }
    assert told["sampled"]["period"] == standards.SAMPLED_PERIOD
    assert told["timer"]["clock"] == standards.TIMER_RATE
    assert list(told["dda"].values()) == [
        standards.DDA_SPACING,
        standards.DDA_COUNT,
        None,
    ]  # schedules state their rate
    assert standards.REACHED_SHARE == COUNT_ROUNDING


@pytest.fixture(scope="module")
def moved():
    """A motion that reverses once, on a drive whose set-up moves the two pulses there."""
    motion, home = in_pulses([-6.0, 12.0, 0.0], [-6.0, 0.0, 6.0])
    (plain,) = generate(motion, [Axis("x", pulse=PULSE)], home).axes
    turn = int(np.flatnonzero(np.diff(plain.direction))[0])
    between = (plain.ticks[turn + 1] - plain.ticks[turn]) / CLOCK
    axis = Axis("x", pulse=PULSE, timing=StepTiming(1e-6, 1e-6, 0.0, between * 1.2))
    return motion, generate(motion, [axis], home), turn


def test_pulses_moved_for_their_drive_are_allowed_and_the_others_stay_exact(moved):
    """Each other pulse shifted by two ticks is caught, and so is a moved one that is farther off
    than stated.
    """
    motion, schedule, turn = moved
    (axis,), (cost,) = schedule.axes, schedule.moves
    assert cost.pulses == 2
    honest = check(schedule, motion)
    assert honest.holds, honest.faults
    assert honest.time_error <= 0.501

    def holds(i, by):
        ticks = axis.ticks.copy()
        ticks[i] += by
        return check(replace(schedule, axes=(replace(axis, ticks=ticks),)), motion).holds

    for i in range(len(axis)):
        if i not in (turn, turn + 1):
            assert not holds(i, 2)
            assert not holds(i, -2)
    assert not holds(turn, -2)
    assert not holds(turn + 1, 2)


def test_moves_must_be_as_many_as_stated(moved):
    motion, schedule, _ = moved
    for pulses in (1, 3):
        told = replace(schedule, moves=(replace(schedule.moves[0], pulses=pulses),))
        assert not check(told, motion).holds


@pytest.mark.parametrize("rule", ["nearest", *RULES_HELD, "sampled:period=7us"])
def test_honest_schedules_with_moved_pulses_hold_under_every_rule(rule):
    """First pulses before their set-up, and reversals: moved within a look, by whole looks, past a
    turn.
    """
    moved = 0
    for seed in range(25):
        motion = example(seed)
        home = motion.at(np.zeros(1)).q[0]
        timing = StepTiming(4e-7, 4e-7, 2e-4 * (1 + seed % 5), 1e-4 * (seed % 2))
        axes = [Axis(f"leg{i}", pulse=PULSE, timing=timing) for i in range(3)]
        try:
            schedule = generate(motion, axes, home, CLOCK, rule)
        except Infeasible:
            continue
        moved += sum(one.pulses for one in schedule.moves)
        found = check(schedule, motion, axes, home)
        assert found.holds, (seed, found.faults)
    # listed points are farther apart than these drives ask for: its bursts have no need to move
    assert moved > 0 or rule.startswith("dda")
