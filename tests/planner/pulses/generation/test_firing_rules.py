"""The firing rules: each within the bound it states on any motion, and each as its source has
it.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Axis, MotionError
from planner import Infeasible, PulseSchedule
from planner.pulses import RULES, AxisPulses, check, find_rule, generate
from planner.pulses.compensation.compensate import compensate_motion
from planner.pulses.generation.dda import spread_counts
from planner.pulses.generation.firing_rule import describe_rule
from planner.pulses.generation.levels import MAX_COUNT_BLUR
from tests.planner.motions import PULSE, Polynomials, smooth_motions, through

CLOCK = 10_000_000
ROUNDING = (
    1e-8  # pulses: double precision of positions of some 0.1 mm, with room for a few operations
)
DDA = "dda:spacing=1ms,pulses_per_count=4,rate=1MHz"
EVERY = [
    "nearest",
    "nearest:hysteresis=0.3",
    "floor",
    "sampled",
    "sampled:period=10us",
    DDA,
    "timer",
    "timer:clock=1MHz",
]


def line(speed, duration, start=0.0):
    return Polynomials(np.array([[[speed]], [[start]]]), [0, duration])


def there_and_back():
    """120 pulses up and back, 0.2 s, with rests at both ends: its duration is whole periods of
    every rule.
    """
    return through(
        PULSE * np.array([[0.0], [120.0], [120.0], [0.0]]), np.zeros((4, 1)), [0, 0.08, 0.12, 0.2]
    )


def fire(motion, rule, pulse=PULSE, clock=CLOCK, home=0.0):
    axes = [Axis(f"leg{i + 1}", pulse=pulse) for i in range(motion.at(0.0).q.shape[1])]
    return generate(motion, axes, [home] * len(axes), clock, rule)


def excess(schedule, motion, k, t):
    """By how much (pulses) |count - x| passes the axis' bound + one tick's travel at the instants t
    (N,).
    """
    axis, tick = schedule.axes[k], 1 / schedule.clock_hz

    def x(at):
        return (motion.at(np.clip(at, 0, motion.duration)).q[:, k] - axis.home) / axis.pulse

    travel = np.maximum(abs(x(t + tick) - x(t)), abs(x(t - tick) - x(t)))
    return abs(schedule.counts(t)[:, k] - x(t)) - axis.bound - travel


def assert_sound(schedule, motion):
    """Rising ticks in the motion, and the bound at thousands of instants: even ones, and around
    every pulse.
    """
    even = np.linspace(0, motion.duration, 3000)
    for k, axis in enumerate(schedule.axes):
        assert (np.diff(axis.ticks) > 0).all()
        assert (axis.ticks >= 0).all()
        assert (axis.ticks <= motion.duration * CLOCK + 0.5).all()
        assert (abs(axis.direction) == 1).all()
        around = np.concatenate((axis.ticks - 0.5, axis.ticks)) / schedule.clock_hz
        t = np.concatenate((even, np.clip(around, 0, motion.duration)))
        assert excess(schedule, motion, k, t).max() <= ROUNDING


# What every rule owes


@pytest.mark.parametrize("rule", EVERY)
@settings(deadline=None, max_examples=15)
@given(motion=smooth_motions((0.01, 0.013, 0.05), 4))
def test_any_motion_is_followed_within_the_bound_that_the_schedule_states(rule, motion):
    schedule = fire(motion, rule)
    assert schedule.rule == describe_rule(find_rule(rule))
    assert_sound(schedule, motion)
    found = check(schedule, motion)
    assert found.holds, found.faults


@pytest.mark.parametrize("rule", EVERY)
def test_a_schedule_run_backwards_keeps_its_bound_and_passes_where_time_has_no_sense(rule):
    motion = there_and_back()
    schedule = fire(motion, rule)
    (axis,) = schedule.axes
    assert len(axis) > 100
    back = through(motion.at(motion.knots).q[::-1], np.zeros((4, 1)), 0.2 - motion.knots[::-1])
    assert np.allclose(back.at([0.03]).q, motion.at([0.17]).q, rtol=0, atol=1e-16)
    end = round(motion.duration * CLOCK)
    mirrored = replace(
        axis, ticks=end - axis.ticks[::-1], direction=-axis.direction[::-1], start=axis.final
    )
    found = check(replace(schedule, axes=(mirrored,)), back)
    # what waits for something, a way back, a look or a listed point, waits on the other side when
    # time runs back
    assert found.holds == (rule in ("nearest", "floor") or rule.startswith("timer")), found.faults
    assert check(replace(schedule, axes=(mirrored,), rule="mine"), back).holds


@pytest.mark.parametrize("rule", [*EVERY[:-3], "dda:pulses_per_count=40", *EVERY[-2:]])
def test_round_lengths_give_round_counts(rule):
    """0.04 units at 32 000 steps per unit: 1280 pulses, there and back."""
    motion = through([[0.0], [0.04], [0.0]], np.zeros((3, 1)), [0, 1, 2])
    (axis,) = fire(motion, rule, pulse=1 / 32_000).axes
    assert axis.start == axis.final == 0
    assert len(axis) == 2 * 1280
    assert axis.counts(CLOCK) == 1280


def test_counts_of_50_pulses_cannot_give_1280():
    """25.6 counts become 26: 20 pulses more than asked for, which the stated bound covers."""
    motion = through([[0.0], [0.04]], np.zeros((2, 1)), [0, 1])
    schedule = fire(motion, "dda", pulse=1 / 32_000)
    assert schedule.axes[0].final == 1300
    assert check(schedule, motion).holds


@pytest.mark.parametrize(
    ("rule", "grain"),
    [("nearest", 1), ("floor", 1), ("timer", 5), ("sampled", 200), ("sampled:period=7us", 70)],
)
def test_constant_speed_gives_intervals_that_differ_by_at_most_one_grain(rule, grain):
    """A tick, a timer count, a period."""
    (axis,) = fire(line(0.0173, 0.05), rule).axes
    intervals = np.diff(axis.ticks[1:])  # floor's first level is 0.998 from the start
    assert np.ptp(intervals) <= grain
    assert len(axis) == int(0.0173 * 0.05 / PULSE + (0.002 if rule == "floor" else 0.5))


@pytest.mark.parametrize("rule", EVERY)
def test_an_axis_that_never_moves_never_fires(rule):
    (axis,) = fire(line(0.0, 0.1, 3.0 * PULSE), rule).axes
    assert (len(axis), axis.start) == (0, 3)


@pytest.mark.parametrize("rule", EVERY)
def test_what_breaks_the_bound_is_caught(rule):
    motion = there_and_back()
    schedule = fire(motion, rule)
    (axis,) = schedule.axes
    many = int(2 * axis.bound) + 1

    def holds(**changes):
        return check(replace(schedule, axes=(replace(axis, **changes),)), motion).holds

    assert holds()
    assert not holds(
        ticks=np.delete(axis.ticks, np.s_[40 : 40 + many]),
        direction=np.delete(axis.direction, np.s_[40 : 40 + many]),
    )
    assert not holds(direction=-axis.direction)
    assert not holds(start=axis.start + many)
    assert not holds(bound=0.4 * axis.bound)
    late = axis.ticks.copy()
    late[40:60] += CLOCK // 50
    assert not holds(ticks=np.unique(late), direction=axis.direction[: len(np.unique(late))])


@pytest.mark.parametrize(
    "rule", [rule for rule in EVERY if not rule.startswith(("dda", "nearest"))]
)
def test_the_stated_bound_is_no_wider_than_what_is_needed(rule):
    """At full speed throughout, the worst error comes within 2 % of the bound: a smaller one would
    be broken.
    """
    motion = line(0.0173, 0.5)
    schedule = fire(motion, rule)
    (axis,) = schedule.axes
    tick = 0.0173 / PULSE / CLOCK  # pulses of travel
    before = motion.at((axis.ticks - 0.5) / CLOCK).q[:, 0] / PULSE - axis.counts(axis.ticks - 1)
    # The timer states a whole timer count's travel for its last pulse; the others are late by half
    # of one at most.
    spare = (axis.bound - 0.5) / 2 if rule.startswith("timer") else 0.02
    assert abs(before).max() >= axis.bound - spare - tick


@pytest.mark.parametrize("rule", EVERY)
def test_compensated_axes_keep_the_bound_too(rule):
    """A screw whose error bends at two places, where the motor's speed jumps by 4 %; and play."""
    screw = ((0.0, 0.0), (30 * PULSE, 1.2 * PULSE), (70 * PULSE, 0.0))
    axis = Axis(
        "X", pulse=PULSE, lead_error=screw, backlash=3 * PULSE, compensate=("lead", "backlash")
    )
    motion = there_and_back()
    schedule = generate(motion, [axis], [0.0], rule=rule)
    behind = compensate_motion(motion, [axis], np.zeros(1))
    found = check(schedule, behind, [axis], [0.0])
    assert found.holds, found.faults
    assert not check(schedule, motion, [axis], [0.0]).holds or rule == DDA


# floor


def test_floor_fires_at_whole_counts_both_ways():
    motion = there_and_back()
    (axis,) = fire(motion, "floor").axes
    x = motion.at(axis.ticks / CLOCK).q[:, 0] / PULSE
    level = axis.start + np.cumsum(axis.direction) + (axis.direction < 0)
    assert (
        abs(x + 2 * MAX_COUNT_BLUR - level).max() <= 120 * 1.5 / 0.08 / CLOCK
    )  # half a tick at the top speed, and room
    assert (axis.direction == np.repeat([1, -1], 120)).all()


def test_below_home_the_floor_is_the_lower_count():
    schedule = fire(through([[0.0], [-2.5 * PULSE]], np.zeros((2, 1)), [0, 0.1]), "floor")
    assert schedule.axes[0].final == -3


# sampled


def test_sampled_is_the_rule_of_the_source_instant_by_instant():
    """N(i) = N(i-1) ± 1 where |N desired - N(i-1)| > 0.5, else N(i-1): run as printed."""
    motion = through(
        PULSE * np.array([[0.3], [90.0], [20.5], [20.5]]), np.zeros((4, 1)), [0, 0.03, 0.05, 0.06]
    )
    schedule = fire(motion, "sampled:period=50us")
    (axis,) = schedule.axes
    count, fired = 0, []
    for tick in range(0, 600_001, 500):
        desired = motion.at(np.array([tick / CLOCK])).q[0, 0] / PULSE
        if abs(desired - count) > 0.5:
            sign = int(np.sign(desired - count))
            count += sign
            fired.append((tick, sign))
    assert fired == list(zip(axis.ticks.tolist(), axis.direction.tolist(), strict=True))
    assert np.diff(axis.ticks).min() >= 500


def test_the_last_look_is_at_the_end_of_the_motion():
    (axis,) = fire(line(0.01, 0.0123457), "sampled").axes
    assert ((123_457 - axis.ticks) % 200 == 0).all()


def test_an_axis_faster_than_a_pulse_a_period_is_refused():
    motion = line(0.0173, 0.01)
    rate = 0.0173 / PULSE
    assert len(fire(motion, "sampled:period=43us").axes[0])
    with pytest.raises(Infeasible, match=r"leg1.*a period of 43\.3 us or less") as refused:
        fire(motion, "sampled:period=44us")
    assert refused.value.value == pytest.approx(rate)
    assert refused.value.limit == pytest.approx(1 / 44e-6)


def test_a_rate_that_is_beyond_by_rounding_reads_so():
    """5000 pulses/s at a period of 200 us: the bound of the rate is above by less than six digits
    tell.
    """
    motion = line(5000 * (1 + 1e-9) * PULSE, 0.01)
    with pytest.raises(
        Infeasible, match=r"5000\.00001 1/s is beyond 5000 1/s .* a period of 199\.9 us or less"
    ):
        fire(motion, "sampled:period=200us")
    fire(motion, "sampled:period=199.9us")


def test_a_period_of_no_whole_ticks_is_refused():
    with pytest.raises(MotionError, match=r"0\.5 ticks of 10000000 Hz"):
        fire(line(0.01, 0.01), "sampled:period=50ns")


# dda


def printed_dda(vector):
    """The loop of the source as it is printed, for whole counts: `going` in Module2."""
    k = max(map(abs, vector))
    sums, steps = [0] * len(vector), []
    for _ in range(k):
        step = []
        for axis, counts in enumerate(vector):
            sums[axis] += abs(counts)
            fires = sums[axis] >= k - 1 and counts != 0
            sums[axis] -= k if fires else 0
            step.append((counts > 0) - (counts < 0) if fires else 0)
        steps.append(step)
    return steps


@settings(deadline=None, max_examples=200)
@given(st.lists(st.lists(st.integers(-300, 300), min_size=3, max_size=3), max_size=6))
def test_the_dda_is_the_loop_of_the_source(vectors):
    steps = spread_counts(np.reshape(vectors, (-1, 3)))
    assert steps.tolist() == [step for vector in vectors for step in printed_dda(vector)]
    assert steps.sum(axis=0).tolist() == np.reshape(vectors, (-1, 3)).sum(axis=0).tolist()


def test_the_axis_with_the_most_counts_fires_at_every_step():
    assert spread_counts([[4, -2, 1], [0, 0, 0], [0, 1, 0]]).tolist() == [
        [1, 0, 0],
        [1, -1, 0],
        [1, 0, 1],
        [1, -1, 0],
        [0, 1, 0],
    ]


def test_each_count_is_a_burst_at_the_stated_rate():
    """At 10 000 pulses/s, 200 counts of 50 in a second: a burst every 5 ms, its pulses 10 µs
    apart.
    """
    (axis,) = fire(line(1e4 * PULSE, 1.0), "dda").axes
    bursts = axis.ticks.reshape(-1, 50)
    assert (np.diff(bursts, axis=1) == 100).all()
    assert len(bursts) == 200
    assert (bursts[:, 0] == np.arange(200) * CLOCK // 200).all()


def test_bursts_that_do_not_fit_are_refused():
    told = r"leg1.*send a count's pulses at 25000 1/s or more \(rule \"dda:rate=25000.0 1/s\"\)"
    with pytest.raises(Infeasible, match=told) as refused:
        fire(line(0.0173, 0.5), "dda:rate=20kHz")
    assert refused.value.limit == 20_000
    assert fire(line(0.0173, 0.5), "dda:rate=25kHz").total


def test_bursts_faster_than_an_axis_takes_are_refused():
    motion = line(0.001, 0.5)
    slow = Axis("X", pulse=PULSE, max_pulse_rate=2400.0)
    with pytest.raises(
        Infeasible, match=r"X.*send the pulses of a count at 2400 1/s or less .*dda:rate=2400.0 1/s"
    ):
        generate(motion, [slow], [0.0], rule="dda:rate=100kHz")
    assert generate(motion, [slow], [0.0], rule="dda:rate=2400 1/s,spacing=0.1s").total


# timer


def test_remainders_are_carried():
    """Each pulse within half a timer count of its crossing, however many came before."""
    speed = 0.0173
    (axis,) = fire(line(speed, 5.0), "timer").axes
    crossing = (np.arange(len(axis)) + 0.5) * PULSE / speed * 2e6
    assert abs(axis.ticks / 5 - crossing).max() <= 0.5 + 1e-4  # TICK_ERROR


def test_no_pulse_comes_after_the_end():
    """The last crossing is half a timer count before the end, and would round up beyond it."""
    duration = 0.0100004
    motion = line(100.5 * PULSE / (duration - 1e-7), duration)
    schedule = fire(motion, "timer:clock=1MHz")
    assert schedule.axes[0].ticks[-1] == 100_000
    assert check(schedule, motion).holds


def test_a_timer_clock_must_divide_that_of_the_pulses():
    with pytest.raises(MotionError, match="3000000 Hz does not divide the 10000000 Hz"):
        fire(line(0.01, 0.01), "timer:clock=3MHz")


# Hysteresis


def hover(amplitude, places, level=0.5):
    """A leg that wanders at random within `amplitude` (pulses) of a level, 1 ms from place to
    place.
    """
    q = (level + amplitude * np.array(places)) * PULSE
    return through(q[:, None], np.zeros((len(q), 1)), np.arange(len(q)) * 1e-3)


@settings(deadline=None, max_examples=60)
@given(
    st.floats(0.01, 0.49),
    st.lists(st.floats(-1, 1), min_size=3, max_size=40),
    st.sampled_from([-1.5, 0.5, 7.5]),
)
def test_a_leg_that_hovers_on_a_crossing_does_not_chatter(hysteresis, places, level):
    motion = hover(0.999 * hysteresis, places, level)
    assert fire(motion, f"nearest:hysteresis={hysteresis}").total == 0


def test_without_hysteresis_it_chatters():
    assert fire(hover(0.1, [-1, 1] * 10), "nearest").total == 19


def test_hysteresis_delays_only_the_first_pulse_of_each_way():
    motion = there_and_back()
    (plain,), (late,) = fire(motion, "nearest").axes, fire(motion, "nearest:hysteresis=0.3").axes
    assert (plain.direction == late.direction).all()
    same = plain.ticks == late.ticks
    assert np.flatnonzero(~same).tolist() == [0, 120]
    x = motion.at(late.ticks / CLOCK).q[:, 0] / PULSE
    assert x[[0, 120]] == pytest.approx([0.5 + 0.3, 119.5 - 0.3], abs=1e-4)  # half a tick's travel
    assert (late.bound, plain.bound) == (0.8, 0.5)


def test_a_hysteresis_that_would_spoil_whole_ends_is_refused():
    with pytest.raises(MotionError, match=r"hysteresis 0\.5 pulses: must be from 0 to below 0\.5"):
        find_rule("nearest:hysteresis=0.5")


# Names and options


@pytest.mark.parametrize(
    "rule", [*RULES, *EVERY, "dda:spacing=3ms,pulses_per_count=7,rate=3e5 1/s"]
)
def test_a_rule_is_told_as_it_is_read(rule):
    assert find_rule(describe_rule(find_rule(rule))) == find_rule(rule)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "sampeld",
            'no firing rule is called "sampeld", nearest is "sampled"; firing rules: nearest, floor, sampled',
        ),
        (
            "sampled:perod=1us",
            'firing rule sampled has no option "perod", nearest is "period"; its options: period',
        ),
        ("floor:period=1us", 'floor has no option "period"; its options: none'),
        ("sampled:period=1", "without a unit"),
        ("sampled:period=1 mm", "mm"),
        ("sampled:period", "write sampled:OPTION=VALUE"),
        ("dda:rate=1kHz,rate=2kHz", "each once"),
        ("dda:pulses_per_count=2.5", '"2.5" is not a whole number'),
        ("dda:pulses_per_count=0", "must be positive"),
        ("nearest:hysteresis=much", '"much" is not a number'),
        ("sampled:period=-1us", "must be positive"),
        ("timer:clock=0 Hz", "must be a positive whole number"),
    ],
)
def test_mistaken_rules_are_refused_with_what_there_is(text, message):
    with pytest.raises(MotionError) as refused:
        find_rule(text)
    assert message in str(refused.value)


def test_the_time_error_is_told_only_where_pulses_have_their_one_tick():
    motion = there_and_back()
    for rule in EVERY:
        grain = {"timer": 5, "timer:clock=1MHz": 10}.get(rule, 1)  # ticks of a timer count
        assert check(fire(motion, rule), motion).time_error <= 0.501 * grain
    wide = fire(motion, "nearest")
    late = AxisPulses(
        "leg1", wide.axes[0].ticks + 2000, wide.axes[0].direction, 0, PULSE, 0.0, bound=1.5
    )
    found = check(PulseSchedule(CLOCK, (late,), motion.duration), motion)
    assert found.holds
    assert found.time_error is None


@pytest.mark.parametrize("rule", EVERY)
def test_progress_rises_to_the_whole(rule):
    told = []
    motion = there_and_back()
    generate(
        motion,
        [Axis("x", pulse=PULSE)],
        [0.0],
        CLOCK,
        rule,
        lambda done, of: told.append(done / of),
    )
    assert told == sorted(set(told))
    assert told[-1] == 1
