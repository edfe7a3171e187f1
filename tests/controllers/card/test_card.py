"""The card against the closed form: positions, pulses, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.card import PCI_8132, PCI_8164, Refused, TAMove, at_rest, send
from controllers.card.state import round_to_ticks
from planner.pulses.schedule import COUNTER

EXACT = 1e-6
"""Pulses: rounding of positions of up to 1e6 pulses and of times of up to 1e3 s."""

speeds = st.floats(50.0, 1e5)
times = st.floats(0.0, 0.5)


def started(target, v0, v1, tacc, tdec, *, at=0, card=PCI_8132):
    state = send(card, at_rest([at]), TAMove([target], [v0], [v1], tacc, tdec), 0.0)
    return state, state.moves[-1]


def integrated(distance, v0, v1, tacc, tdec, steps=20_001):
    """Distance over time by integrating the speed as the command's semantics say it, in small
    steps: (t, s).

    The speed follows the ramp from the start until the braking ramp, seen backwards from the
    target, is met.
    """
    s = np.linspace(0.0, distance, steps)

    def speed(way, ramp):
        if ramp < 1 / PCI_8132.clock_hz or v0 == v1:
            return np.full_like(way, v1)
        rate = (v1 - v0) / ramp
        square = np.maximum(v0**2 + 2 * rate * way, 0.0)
        return np.where(rate > 0, np.minimum(np.sqrt(square), v1), np.maximum(np.sqrt(square), v1))

    inner = np.minimum if v1 > v0 else np.maximum
    v = inner(speed(s, tacc), speed(distance - s, tdec))
    # dt = ds/v with the trapezoid rule on 1/v; exact enough as v > 0 everywhere
    t = np.concatenate([[0.0], np.cumsum(2 * np.diff(s) / (v[1:] + v[:-1]))])
    return t, s


def test_long_move_is_the_textbook_trapezoid():
    state, move = started(10_000, 0.0, 4000.0, 0.5, 0.25)
    v0 = PCI_8132.least_speed
    ramp_up, ramp_down = (v0 + 4000) / 2 * 0.5, (v0 + 4000) / 2 * 0.25
    cruise = (10_000 - ramp_up - ramp_down) / 4000
    assert move.end[0] == pytest.approx(0.75 + cruise, abs=1e-12)
    t = np.array([0.2, 0.5, 0.5 + cruise, 0.75 + cruise, 99.0])
    expected = [v0 * 0.2 + (4000 - v0) / 0.5 * 0.02, ramp_up, 10_000 - ramp_down, 10_000, 10_000]
    np.testing.assert_allclose(state.position(t)[:, 0], expected, atol=EXACT)


@given(target=st.integers(-1000, 1000).filter(bool), v0=speeds, v1=speeds, tacc=times, tdec=times)
def test_any_move_is_the_integral_of_its_speed(target, v0, v1, tacc, tdec):
    """Long moves and moves too short to reach the speed, ramps up and down, either direction."""
    _, move = started(target, v0, v1, tacc, tdec)
    t, s = integrated(abs(target), v0, v1, tacc, tdec)
    # each of the two bends of the speed falls inside some step, whose time is known to itself
    tolerance = 3 * (s[1] - s[0]) / min(v0, v1)
    assert abs(move.end[0] - t[-1]) <= tolerance
    halves = np.arange(abs(target)) + 0.5
    assert np.abs(move.edges(0).t - np.interp(halves, s, t)).max() <= tolerance


@given(
    target=st.integers(-3000, 3000),
    at=st.integers(-50, 50),
    v0=speeds,
    v1=speeds,
    tacc=times,
    tdec=times,
)
def test_pulses_are_the_crossings_of_half_counts(target, at, v0, v1, tacc, tdec):
    """Every pulse fires where the command position is half way between two counts, to half a tick;
    all of them do.
    """
    state, move = started(target, v0, v1, tacc, tdec, at=at)
    times_of = move.edges(0).t
    ticks = round_to_ticks(PCI_8132, times_of)
    direction = np.sign(target - at)
    assert len(ticks) == abs(target - at)
    if len(ticks):
        assert np.all(np.diff([0.0, *times_of, move.end[0]]) > 0)
    halves = at + direction * (np.arange(len(ticks)) + 0.5)
    np.testing.assert_allclose(state.position(times_of)[:, 0], halves, atol=EXACT)
    assert np.all(
        np.abs(ticks / PCI_8132.clock_hz - times_of) <= 0.5 / PCI_8132.clock_hz * (1 + 1e-6)
    )
    assert state.counter([move.end[0]])[0, 0] == target
    assert state.pulses(move.end[0])[0] == abs(target - at)
    # counted from the pulses, or read from the counter: the same at instants between pulses
    t = (times_of[1:] + times_of[:-1]) / 2
    np.testing.assert_array_equal(
        state.counter(t)[:, 0], at + direction * np.arange(1, len(ticks))[: len(t)]
    )


@given(target=st.integers(-3000, 3000), v0=speeds, v1=speeds, tacc=times, tdec=times)
def test_counter_stays_within_half_a_pulse(target, v0, v1, tacc, tdec):
    state, move = started(target, v0, v1, tacc, tdec)
    t = np.linspace(0.0, move.end[0] * 1.1, 300)
    assert np.abs(state.counter(t) - state.position(t)).max() <= 0.5 + EXACT


def test_short_move_keeps_the_rate_and_lowers_the_top_speed():
    """From near rest at 8000 pulses/s² up and 16000 down, the top is √(2 D/(1/r₁ + 1/r₂)), not the
    4000 asked for.
    """
    _, move = started(1000, 0.0, 4000.0, 0.5, 0.25)
    v0 = PCI_8132.least_speed
    r1, r2 = (4000 - v0) / 0.5, (4000 - v0) / 0.25
    top = np.sqrt(v0**2 + 2 * 1000 / (1 / r1 + 1 / r2))
    assert top < 4000
    assert move.speeds[1, 0] == pytest.approx(top, rel=1e-12)
    assert move.rates[0, 0] == pytest.approx(r1)
    assert move.rates[2, 0] == pytest.approx(-r2)


def test_start_speed_above_max_ramps_downwards():
    state, move = started(2000, 3000.0, 1000.0, 0.1, 0.0)
    # 200 pulses in the ramp, then 1800 at 1000 pulses/s
    assert state.position([0.1])[0, 0] == pytest.approx(200.0, abs=EXACT)
    assert state.position([0.05])[0, 0] == pytest.approx(125.0, abs=EXACT)
    assert move.end[0] == pytest.approx(1.9, abs=1e-12)


def test_without_deceleration_the_channel_stops_dead_on_the_target_and_waits():
    state, move = started(-500, 1000.0, 1000.0, 0.01, 0.0)
    assert move.end[0] == pytest.approx(0.5, abs=1e-12)
    np.testing.assert_array_equal(state.position([0.5, 0.6, 100.0]), [[-500.0]] * 3)
    assert state.position([0.499])[0, 0] == pytest.approx(-499.0, abs=EXACT)


def test_speeds_count_as_magnitudes():
    forward, _ = started(900, 100.0, 2000.0, 0.1, 0.1)
    backward, _ = started(900, -100.0, -2000.0, 0.1, 0.1)
    t = np.linspace(0, 1, 50)
    np.testing.assert_array_equal(forward.position(t), backward.position(t))


def test_speed_zero_runs_at_one_step_of_the_register():
    state, move = started(10, 0.0, 0.0, 0.1, 0.0)
    assert move.end[0] == pytest.approx(10 * 65535 / 2.4e6, rel=1e-12)
    assert state.counter([move.end[0]])[0, 0] == 10


def test_nothing_to_move_emits_nothing():
    state, move = started(7, 500.0, 1000.0, 0.1, 0.1, at=7)
    assert move.end[0] == 0
    assert not len(move.edges(0).t)
    assert state.pulses(1.0)[0] == 0


@given(
    first=st.integers(-2000, 2000),
    second=st.integers(-2000, 2000),
    v=st.tuples(speeds, speeds, speeds, speeds),
    share=st.floats(0.0, 1.2),
    tacc=times,
)
def test_replacing_goes_on_from_the_command_position(first, second, v, share, tacc):
    state, move = started(first, v[0], v[1], tacc, 0.0)
    t = share * move.end[0]
    before = state.position([t])[0, 0]
    again = send(PCI_8132, state, TAMove([second], [v[2]], [v[3]], tacc, 0.0), t)
    assert again.position([t])[0, 0] == pytest.approx(before, abs=EXACT)
    assert len(again.moves) == 1
    end = again.moves[0].end[0]
    assert again.counter([end])[0, 0] == second
    # pulses of both legs of the way: as many as the counter moved on each, counted one by one
    turn = int(state.counter([t])[0, 0])
    assert again.pulses(end)[0] == abs(turn) + abs(second - turn)


def test_replacing_keeps_the_share_of_a_pulse():
    """A motion cut into replaced moves of a fraction of a pulse each loses none: 1000 times 0.37
    pulses are 370.
    """
    state, dt = at_rest([0]), 1e-3
    for k in range(1000):
        state = send(PCI_8132, state, TAMove([1_000_000], [370.0], [370.0], dt, 0.0), k * dt)
    assert state.position([1.0])[0, 0] == pytest.approx(370.0, abs=EXACT)
    assert state.counter([1.0])[0, 0] == 370


def test_queue_waits_for_each_channel():
    card = replace(PCI_8132, while_moving="queue")
    state = send(
        card, at_rest([0, 0]), TAMove([100, 1000], [1000.0] * 2, [1000.0] * 2, 0.0, 0.0), 0.0
    )
    state = send(card, state, TAMove([0, 2000], [1000.0] * 2, [1000.0] * 2, 0.0, 0.0), 0.05)
    t = [0.05, 0.1, 0.15, 0.2, 1.0, 1.5, 2.0, 3.0]
    expected = [
        [50, 50],
        [100, 100],
        [50, 150],
        [0, 200],
        [0, 1000],
        [0, 1500],
        [0, 2000],
        [0, 2000],
    ]
    np.testing.assert_allclose(state.position(t), expected, atol=EXACT)
    np.testing.assert_array_equal(state.pulses(3.0), [200, 2000])
    # a third one, sent when the first is over: nothing fired is forgotten
    state = send(card, state, TAMove([0, 0], [1000.0] * 2, [1000.0] * 2, 0.0, 0.0), 1.2)
    assert len(state.moves) == 2
    np.testing.assert_array_equal(state.pulses(4.0), [200, 4000])
    np.testing.assert_array_equal(state.counter([1.5, 2.5, 4.0]), [[0, 1500], [0, 1500], [0, 0]])


@pytest.mark.parametrize("target", [COUNTER[0], COUNTER[1]])
def test_whole_range_of_the_counter(target):
    state, move = started(target, 2e6, 2.4e6, 1.0, 1.0)
    assert state.counter([move.end[0]])[0, 0] == target


@pytest.mark.parametrize(
    ("card", "move", "reason"),
    [
        (
            PCI_8132,
            TAMove([0, COUNTER[1] + 1], [0, 0], [1, 1], 0.1, 0.1),
            "channel 2.*134217728.*28-bit",
        ),
        (
            PCI_8132,
            TAMove([COUNTER[0] - 1, 0], [0, 0], [1, 1], 0.1, 0.1),
            "channel 1.*-134217729.*28-bit",
        ),
        (
            PCI_8132,
            TAMove([0, 0], [0, 0], [1, 2.5e6], 0.1, 0.1),
            "channel 2.*max speed 2500000.*2400000",
        ),
        (
            PCI_8164,
            TAMove([0, 0], [-6.6e6, 0], [1, 1], 0.1, 0.1),
            "channel 1.*start speed -6600000.*6550000",
        ),
        (PCI_8132, TAMove([np.nan, 0], [0, 0], [1, 1], 0.1, 0.1), "nan"),
        (PCI_8132, TAMove([0, 0], [0, 0], [1, 1], -0.1, 0.1), "acceleration time -0.1"),
        (PCI_8132, TAMove([0, 0], [0, 0], [1, 1], 0.1, np.inf), "deceleration time inf"),
        (PCI_8132, TAMove([0], [0], [1], 0.1, 0.1), "1 channels cannot start 2"),
    ],
)
def test_refusals_name_the_reason(card, move, reason):
    with pytest.raises(Refused, match=reason):
        send(card, at_rest([0, 0]), move, 0.0)


def test_the_8164_takes_what_the_8132_refuses():
    fast = TAMove([1000], [0.0], [5e6], 0.1, 0.1)
    assert send(PCI_8164, at_rest([0]), fast, 0.0).moves[-1].target[0] == 1000
    with pytest.raises(Refused):
        send(PCI_8132, at_rest([0]), fast, 0.0)
