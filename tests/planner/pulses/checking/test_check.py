"""The pulse checker: honest schedules hold, every corruption of one is caught, and its figures are
the true ones.
"""

import ast
import inspect
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from kinematics import Axis, MotionError
from planner import PulseSchedule
from planner.pulses import AxisPulses, check, generate
from tests.planner.motions import PULSE, example, in_pulses, one_axis, through

CLOCK = 10_000_000


def fire(motion, home=None, clock=CLOCK):
    start = motion.at(np.zeros(1)).q[0]
    return generate(
        motion,
        [Axis(f"leg{i + 1}", pulse=PULSE) for i in range(len(start))],
        start if home is None else home,
        clock,
    )


HALF = 0.5 * PULSE
HONEST = {
    "three axes with a dwell": (example(), None),
    "never moves": in_pulses([0.0, 0.3]),
    "never moves, on a level": in_pulses([0.0, 0.5]),
    "touches a level": in_pulses([-6.0, 6.0, 0.0]),
    "touches a level from above": in_pulses([6.0, -6.0, 0.0]),
    "passes a level by 1e-9 pulse": in_pulses([-6.0 - 4e-9, 6.0 + 4e-9, 0.0]),
    "starts and ends on levels": in_pulses([2.0, 0.5]),
    "starts and ends on levels, downwards": in_pulses([-2.0, 0.5]),
    "stands still for an instant on a level": in_pulses([8.0, -12.0, 6.0, -0.5]),
    "rests on a level, leaves, returns, rests": (
        through([[HALF], [HALF], [8 * HALF], [HALF], [HALF]], np.zeros((5, 1)), np.arange(5.0)),
        [0.0],
    ),
    "stops between two ticks at full speed": (one_axis([[0.02, 0.0]], [0, 0.012345678]), None),
    "a minute": (one_axis([[0.02, 0.0], [0.0, 2e-4], [-0.02, 2e-4]], [0, 0.01, 60.0, 60.01]), None),
    "nearly half the clock's rate": (one_axis([[PULSE * CLOCK / 2.1, 0.0]], [0, 1e-3]), None),
}


@pytest.mark.parametrize("name", HONEST)
def test_an_honest_schedule_holds(name):
    motion, home = HONEST[name]
    found = check(fire(motion, home), motion)
    assert found.holds, found.faults
    assert (found.faults, found.fault_count, found.final_error) == ((), 0, 0)
    assert found.position_error <= 1e-6
    assert found.time_error <= 0.501


@pytest.mark.parametrize("seed", range(40))
def test_honest_schedules_of_random_motions_hold(seed):
    """Random speeds and places, many of them levels and rests, with pieces from 0.1 ms to 0.1 s."""
    rng = np.random.default_rng(seed)
    count = rng.integers(2, 9)
    places = np.where(
        rng.random((count, 2)) < 0.5,
        rng.integers(-40, 40, (count, 2)) / 2,
        rng.uniform(-20, 20, (count, 2)),
    )
    stay = rng.random(count - 1) < 0.3
    speeds = rng.choice([0.0, 0.0, 1e-3, -2e-3, 0.02], (count, 2))
    for k in np.flatnonzero(stay):
        places[k + 1], speeds[k], speeds[k + 1] = places[k], 0.0, 0.0
    motion = through(
        0.2 + places * PULSE,
        speeds,
        np.concatenate(([0], np.cumsum(10 ** rng.uniform(-4, -1, count - 1)))),
    )
    found = check(fire(motion, [0.2, 0.2]), motion)
    assert found.holds, found.faults


# Corruptions: each spoils the ticks, the directions or the start `a` of one axis.


def shift_one(a, rng):
    """One tick early or late: away from the crossing, since rounding excuses half a tick."""
    i = rng.integers(len(a.ticks))
    state = a.motion.at(np.array([a.ticks[i] / CLOCK]))
    level = a.home + (a.start + a.direction[: i + 1].sum() - a.direction[i] / 2) * PULSE
    late = (state.q[0, a.k] - level) / state.qd[0, a.k] > 0
    a.ticks[i] += 1 if late else -1


def shift_all(a, rng):
    a.ticks += rng.choice([-1, 1])


def drop(a, rng):
    i = rng.integers(len(a.ticks))
    a.ticks, a.direction = np.delete(a.ticks, i), np.delete(a.direction, i)


def drop_last(a, rng):
    a.ticks, a.direction = a.ticks[:-1], a.direction[:-1]


def drop_first(a, rng):
    a.ticks, a.direction = a.ticks[1:], a.direction[1:]


def drop_turn(a, rng):
    """Leave out the pair at a turning point: counts close, only the excursion between shows it."""
    i = rng.choice(np.flatnonzero(np.diff(a.direction)))
    a.ticks, a.direction = np.delete(a.ticks, [i, i + 1]), np.delete(a.direction, [i, i + 1])


def double(a, rng):
    i = rng.integers(len(a.ticks))
    a.ticks, a.direction = (
        np.insert(a.ticks, i, a.ticks[i]),
        np.insert(a.direction, i, a.direction[i]),
    )


def double_next_tick(a, rng):
    i = rng.integers(len(a.ticks))
    a.ticks, a.direction = (
        np.insert(a.ticks, i + 1, a.ticks[i] + 1),
        np.insert(a.direction, i, a.direction[i]),
    )


def turn_round(a, rng):
    a.direction[rng.integers(len(a.ticks))] *= -1


def turn_all_round(a, rng):
    a.direction *= -1


def no_direction(a, rng):
    a.direction[rng.integers(len(a.ticks))] = 0


def swap(a, rng):
    i = rng.integers(len(a.ticks) - 1)
    a.ticks[[i, i + 1]] = a.ticks[[i + 1, i]]


def swap_directions(a, rng):
    i = rng.choice(np.flatnonzero(np.diff(a.direction)))
    a.direction[[i, i + 1]] = a.direction[[i + 1, i]]


def false_start(a, rng):
    a.start += rng.choice([-1, 1])


def put_pair(a, rng, tick):
    i = np.searchsorted(a.ticks, tick)
    way = rng.choice([-1, 1])
    a.ticks = np.insert(a.ticks, i, [tick, tick + 50])
    a.direction = np.insert(a.direction, i, [way, -way])


def pair_at_rest(a, rng):
    put_pair(a, rng, rng.integers(int(0.1101 * CLOCK), int(0.1299 * CLOCK)))


def pair_between(a, rng):
    gaps = np.flatnonzero(np.diff(a.ticks) > 200)
    i = rng.choice(gaps)
    put_pair(a, rng, rng.integers(a.ticks[i] + 1, a.ticks[i + 1] - 51))


def pair_at_a_crossing(a, rng):
    """Back and forth right after a true pulse, within a few ticks of the level."""
    i = rng.integers(len(a.ticks))
    a.ticks = np.insert(a.ticks, i + 1, a.ticks[i] + np.array([1, 2]))
    a.direction = np.insert(a.direction, i + 1, [-a.direction[i], a.direction[i]])


def extra_at_end(a, rng):
    a.ticks, a.direction = (
        np.append(a.ticks, round(a.motion.duration * CLOCK)),
        np.append(a.direction, rng.choice([-1, 1])),
    )


def after_the_end(a, rng):
    end = round(a.motion.duration * CLOCK)
    a.ticks, a.direction = np.append(a.ticks, [end + 2, end + 9]), np.append(a.direction, [1, -1])


def other_axis(a, rng):
    a.ticks, a.direction = a.other.ticks.copy(), a.other.direction.copy()


CORRUPTIONS = [
    shift_one,
    shift_all,
    drop,
    drop_first,
    drop_last,
    drop_turn,
    double,
    double_next_tick,
    turn_round,
    turn_all_round,
    no_direction,
    swap,
    swap_directions,
    false_start,
    pair_at_rest,
    pair_between,
    pair_at_a_crossing,
    extra_at_end,
    after_the_end,
    other_axis,
]
SEEDS = 15  # 20 corruptions x 15 seeds = 300 schedules


@pytest.mark.parametrize("corrupt", CORRUPTIONS, ids=lambda f: f.__name__)
def test_every_corrupted_schedule_is_caught(corrupt):
    for seed in range(SEEDS):
        rng = np.random.default_rng([seed, CORRUPTIONS.index(corrupt)])
        motion = example(seed)
        schedule = fire(motion)
        k = int(rng.integers(3))
        axis, other = schedule.axes[k], schedule.axes[(k + 1) % 3]
        a = SimpleNamespace(start=axis.start, home=axis.home, motion=motion, k=k, other=other)
        a.ticks, a.direction = axis.ticks.copy(), axis.direction.copy()
        corrupt(a, rng)
        false = AxisPulses(axis.name, a.ticks, a.direction, int(a.start), axis.pulse, axis.home)
        axes = tuple(false if i == k else one for i, one in enumerate(schedule.axes))
        found = check(replace(schedule, axes=axes), motion)
        assert not found.holds, seed
        assert {fault.axis for fault in found.faults} == {axis.name}, seed
        assert found.fault_count >= len(found.faults) > 0


def test_exchanged_axes_are_caught():
    motion = example()
    schedule = fire(motion)
    found = check(
        replace(schedule, axes=(schedule.axes[1], schedule.axes[0], schedule.axes[2])), motion
    )
    assert {fault.axis for fault in found.faults} == {"leg1", "leg2"}


def test_chatter_in_a_rest_on_a_level_is_caught():
    """On the level itself a pair breaks no bound; it is still a pulse of an axis that stands
    still.
    """
    motion = through([[0.5 * PULSE], [0.5 * PULSE], [4 * PULSE]], np.zeros((3, 1)), np.arange(3.0))
    (axis,) = fire(motion, [0.0]).axes
    ticks, direction = (
        np.concatenate(([100, 200], axis.ticks)),
        np.concatenate(([1, -1], axis.direction)),
    )
    found = check(
        PulseSchedule(CLOCK, (AxisPulses("x", ticks, direction, 0, PULSE, 0.0),), 2.0), motion
    )
    assert [(fault.tick, fault.what.split(":")[0]) for fault in found.faults] == [
        (100, "at rest"),
        (200, "at rest"),
    ]


def test_a_missing_pair_is_caught_however_short_its_excursion():
    """Turning points 1e-13 … 1e-7 m beyond a level, fired as if they had not reached it."""
    for beyond in 10.0 ** np.arange(-13, -6):
        top = 0.5 * PULSE + beyond
        motion = one_axis([[-top / 0.25, top / 0.25, 0.0]], [0, 1.0])
        assert len(fire(motion, [0.0]).axes[0]) == 2
        silent = PulseSchedule(
            CLOCK,
            (AxisPulses("x", np.empty(0, np.int64), np.empty(0, np.int8), 0, PULSE, 0.0),),
            1.0,
        )
        assert not check(silent, motion).holds, beyond


# Figures


def test_a_late_pulse_is_reported_where_and_by_how_much():
    speed = 0.0173
    motion = one_axis([[speed, 0.0]], [0, 0.01])
    (axis,) = fire(motion).axes
    ticks = axis.ticks.copy()
    ticks[100] += 7
    found = check(PulseSchedule(CLOCK, (replace(axis, ticks=ticks),), 0.01), motion)
    exact = 7 + axis.ticks[100] - 100.5 * PULSE / speed * CLOCK
    assert found.time_error == pytest.approx(
        exact, abs=1e-5
    )  # 0.2 m rounds to 2e-8 tick; float64 derivatives to less
    assert [fault.tick for fault in found.faults] == [ticks[100]]
    assert found.faults[0].what.startswith("off its crossing: +")
    assert found.position_error == pytest.approx((exact - 1) * speed / CLOCK / PULSE, rel=1e-3)


def test_intervals_rates_and_final_error():
    motion = one_axis([[PULSE * 1000.0, 0.0]], [0, 1.0])
    (axis,) = fire(motion).axes
    found = check(PulseSchedule(CLOCK, (axis,), 1.0), motion)
    assert found.smallest_interval == pytest.approx(1e-3, rel=1e-12)
    assert found.highest_rate == pytest.approx(1000.0, rel=1e-12)
    short = replace(axis, ticks=axis.ticks[:-3], direction=axis.direction[:-3])
    assert check(PulseSchedule(CLOCK, (short,), 1.0), motion).final_error == pytest.approx(-3.0)


def test_a_motion_that_is_not_a_number_never_holds():
    motion = one_axis([[0.01, 0.0]], [0, 0.01])
    schedule = fire(motion)
    motion.curves[0].c[0] = np.nan
    assert not check(schedule, motion).holds


def test_faults_are_counted_but_not_all_listed():
    motion = one_axis([[0.02, 0.0]], [0, 0.1])
    (axis,) = fire(motion).axes
    found = check(PulseSchedule(CLOCK, (replace(axis, ticks=axis.ticks + 3),), 0.1), motion)
    assert found.fault_count >= len(axis)
    assert len(found.faults) < 100


def test_the_motion_is_asked_at_most_twice_per_pulse_in_blocks():
    rng = np.random.default_rng(0)
    motion = through(
        0.2 + rng.uniform(-5e-3, 5e-3, (40, 2)),
        rng.uniform(-0.02, 0.02, (40, 2)),
        np.arange(40) * 0.5,
    )
    schedule = fire(motion)
    largest = 0
    at = motion.at

    def watched(t):
        nonlocal largest
        largest = max(largest, np.size(t))
        return at(t)

    motion.at, motion.asked = watched, 0
    assert check(schedule, motion).holds
    assert schedule.total > 200_000
    assert motion.asked <= 1.1 * schedule.total
    assert largest < 1 << 16


@pytest.mark.parametrize(
    ("kind", "changes"),
    [
        ("pulse", {"pulse": 2e-6}),
        ("home", {"home": 1e-3}),
        ("name", {"name": "other"}),
        ("duration", {"duration": 99.0}),
    ],
)
def test_a_schedule_of_another_machine_or_motion_is_caught(kind, changes):
    """It closes in itself; only the machine and the motion tell that it is not theirs."""
    motion = one_axis([[0.02, 0.0]], [0, 0.1])
    schedule = fire(motion)
    (axis,) = schedule.axes
    driven = [Axis(axis.name, pulse=axis.pulse)]
    assert check(schedule, motion, driven, [axis.home]).holds
    duration = changes.pop("duration", schedule.duration)
    found = check(
        PulseSchedule(CLOCK, (replace(axis, **changes),), duration), motion, driven, [axis.home]
    )
    assert not found.holds
    assert any(kind in str(fault) for fault in found.faults)


def test_axes_must_match():
    with pytest.raises(MotionError, match="3 axes, the motion 1"):
        check(fire(example()), one_axis([[0.01, 0.0]], [0, 1]))


def test_the_checker_shares_no_code_with_the_generator():
    """Of the planner it may know what a schedule, a motion and a verdict are, and what play and
    screws do.
    """
    known = {
        "planner.parallel",
        "planner.pulses.schedule",
        "planner.pulses.motion",
        "planner.pulses.checking",
    }
    texts = {file: file.read_text() for file in Path(inspect.getfile(check)).parent.glob("*.py")}
    assert len(texts) > 5
    for text in texts.values():
        imports = [
            node.module for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom)
        ]
        own = {
            name
            for name in imports
            if name.startswith("planner") and not name.startswith("planner.pulses.checking.")
        }
        assert own <= known
