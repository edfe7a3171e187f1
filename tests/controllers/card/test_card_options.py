"""Home return, backlash, soft limits, counters, latch and compare: what the card's options do."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.card import (
    PCI_8164,
    ArcMove,
    Card,
    HomeReturn,
    LinearMove,
    Refused,
    SAMove,
    TAMove,
    TRMove,
    TVMove,
    VChange,
    at_rest,
    play,
    read_counters,
    send,
)
from kinematics import MotionError
from planner.pulses.schedule import COUNTER

EXACT = 1e-6
some = settings(max_examples=25)


def to(*targets, v=1000.0):
    return TAMove(targets, [v] * len(targets), [v] * len(targets), 0.0, 0.0)


@given(
    switch=st.integers(-2000, 2000),
    sign=st.sampled_from([1, -1]),
    index=st.integers(0, 199),
    v=st.floats(300.0, 4000.0),
    tacc=st.floats(0.01, 0.3),
)
@some
def test_home_return(switch, sign, index, v, tacc):
    """Zero comes to the last index before the switch, wherever the channel begins; the pulses add
    up to it.
    """
    home = HomeReturn(
        [switch], [sign], [200.0], [v], [150.0], tacc, index=[index], index_spacing=200
    )
    record = play(PCI_8164, at_rest([0]), [(0.0, home), (100.0, to(25))], 101.0)
    grid = index + 200 * np.arange(-30, 30)
    before = grid[(switch - grid) * sign >= 0]
    zero = before[np.argmin(np.abs(switch - before))]
    train = record.train(0)
    assert train.direction.sum() == zero + 25
    assert record.states[-1].moves[-1].zero[0] == zero
    assert record.position([99.0])[0, 0] == 0
    assert record.states[-1].counter([101.0])[0, 0] == 25
    assert record.states[-1].pulses(101.0)[0] == len(train.ticks)
    # the way out beyond the switch: the ramp from the speed there, which no more than v comes to
    if switch * sign > 0:
        v1 = min(max(v, 200.0), np.sqrt(200.0**2 + 2 * abs(switch) * (v - 200.0) / tacc))
        beyond = (v1**2 - 200.0**2) / (2 * (v - 200.0) / tacc)
        far = (np.cumsum(train.direction[: len(train.ticks) - 25]) * sign).max()
        assert far == pytest.approx(abs(switch) + beyond, abs=0.5 + 1e-6)


def test_home_return_without_index_and_from_the_switch():
    """From 300 beyond the edge straight back to it; a second return finds the same place from the
    new zero.
    """
    home = HomeReturn([-500], [-1], [1000.0], [2000.0], [1000.0], 0.1)
    record = play(PCI_8164, at_rest([-800]), [(0.0, home), (9.0, to(700)), (19.0, home)], 99.0)
    np.testing.assert_allclose(record.position([0.1, 8.0, 18.0])[:, 0], [-700, 0, 700], atol=EXACT)
    assert record.states[-1].moves[-1].zero[0] == -500
    assert record.train(0).direction.sum() == 300


def test_home_return_refuses():
    with pytest.raises(Refused, match="index needs a spacing"):
        send(PCI_8164, at_rest([0]), HomeReturn([1], [1], [1.0], [1.0], [1.0], 0.1, index=[3]), 0.0)
    with pytest.raises(Refused, match="channel 2: home return: direction"):
        send(
            PCI_8164,
            at_rest([0, 0]),
            HomeReturn([1, 1], [1, 0], [1.0] * 2, [1.0] * 2, [1.0] * 2, 0.1),
            0.0,
        )


PLAY = replace(PCI_8164, backlash=(20, 0), backlash_speed=500.0)


def test_backlash_is_taken_up_when_a_channel_turns_and_not_counted():
    """Up, up, down, down, up: compensated before the third and the fifth, each delayed by 20/500
    s.
    """
    targets = (100, 200, 100, 50, 100)
    record = play(
        PLAY, at_rest([0, 0]), [(k, to(goal, goal)) for k, goal in enumerate(targets)], 9.0
    )
    train = record.train(0)
    np.testing.assert_array_equal(record.states[-1].counter([9.0]), [[100, 100]])
    extra = train.ticks[~train.counted] / PLAY.clock_hz
    expected = np.concatenate([2 + (np.arange(20) + 0.5) / 500, 4 + (np.arange(20) + 0.5) / 500])
    np.testing.assert_allclose(extra, expected, atol=1 / PLAY.clock_hz)
    assert np.all(train.direction[~train.counted] == np.repeat([-1, 1], 20))
    assert len(train.ticks) == record.states[-1].pulses(9.0)[0] == 400 + 40
    assert record.train(1).counted.all()
    # the load behind the play follows the counter: it loses nothing to it
    held, load = np.cumsum(train.direction), 0
    for motor in held:
        load = min(
            max(load, motor), motor + 20
        )  # the motor pushes upwards at once, downwards 20 later
    assert load == 100
    np.testing.assert_allclose(record.position([2.03, 2.09])[:, 0], [200.0, 150.0], atol=EXACT)


def test_backlash_of_a_change_through_zero_and_of_a_replaced_compensation():
    sent = [(0.0, TVMove([1000.0] * 2, [1000.0] * 2, 0.0)), (1.0, VChange([-1000.0] * 2, 0.2))]
    record = play(PLAY, at_rest([0, 0]), sent, 3.0)
    # 50 pulses up to the turn at 1.1 s, then 40 ms of compensation
    p = record.position([1.1, 1.14, 1.24])
    np.testing.assert_allclose(p, [[1050, 1050], [1050, 1042], [1000, 960]], atol=EXACT)
    assert (~record.train(0).counted).sum() == 20
    # turned round after 5 of the 20: 5 back, and none is left over
    record = play(PLAY, at_rest([0, 0]), [(0.0, to(-10, -10)), (0.0101, to(10, 10))], 3.0)
    train = record.train(0)
    assert train.direction[~train.counted].tolist() == [-1] * 5 + [1] * 5
    assert train.count[-1] == 10


def test_backlash_of_an_interpolation_delays_all_its_channels():
    line = LinearMove((0, 1), [-300, -400], 1000.0, 1000.0, 0.0, 0.0)
    record = play(PLAY, at_rest([0, 0]), [(0.0, line)], 3.0)
    np.testing.assert_allclose(
        record.position([0.04, 0.14, 2.0]), [[0, 0], [-60, -80], [-300, -400]], atol=EXACT
    )


LIMITED = replace(PCI_8164, soft_limits=((-100, 100), (-1000, 1000)))
STOPPING = replace(LIMITED, at_soft_limit="stop")


@pytest.mark.parametrize(
    ("move", "channel"),
    [
        (to(101, 0), 1),
        (to(0, -1001), 2),
        (SAMove([0, 1001], [100.0] * 2, [500.0] * 2, 0.1, 0.1), 2),
        (LinearMove((0, 1), [200, 200], 100.0, 100.0, 0.0, 0.0), 1),
        (ArcMove((0, 1), [0, 95], [0, 190], 500.0, 500.0, 0.0, 0.0), None),
        (ArcMove((0, 1), [0, 105], [0, 210], 500.0, 500.0, 0.0, 0.0), 1),
    ],
)
def test_soft_limits_refuse(move, channel):
    if channel is None:
        send(LIMITED, at_rest([0, 0]), move, 0.0)
        return
    with pytest.raises(Refused, match=f"channel {channel}: the move to .* passes the soft limits"):
        send(LIMITED, at_rest([0, 0]), move, 0.0)


def test_soft_limits_stop_dead():
    state = send(STOPPING, at_rest([0, 0]), to(300, 300), 0.0)
    np.testing.assert_allclose(
        state.position([0.05, 0.2, 9.0]), [[50, 50], [100, 200], [100, 300]], atol=EXACT
    )
    np.testing.assert_array_equal(state.pulses(9.0), [100, 300])
    # an interpolation stops as one, on its path
    state = send(
        STOPPING, at_rest([0, 0]), LinearMove((0, 1), [300, 150], 1000.0, 1000.0, 0.1, 0.1), 0.0
    )
    np.testing.assert_allclose(state.position([9.0]), [[100, 50]], atol=EXACT)
    # the channel may come back, and go out to the limit again
    state = send(STOPPING, state, to(-500, 50), 10.0)
    np.testing.assert_allclose(state.position([10.1, 19.0]), [[0, 50], [-100, 50]], atol=EXACT)
    # arcs, in the middle of a quarter
    state = send(
        STOPPING, at_rest([0, 0]), ArcMove((0, 1), [0, 200], [0, 400], 500.0, 500.0, 0.0, 0.0), 0.0
    )
    np.testing.assert_allclose(
        state.position([9.0]), [[100, 200 - np.sqrt(200**2 - 100**2)]], atol=EXACT
    )


@pytest.mark.parametrize("card", [LIMITED, STOPPING])
def test_velocity_moves_stop_at_soft_limits(card):
    state = send(card, at_rest([0, 0]), TVMove([100.0] * 2, [-1000.0, 1000.0], 0.1), 0.0)
    np.testing.assert_array_equal(state.counter([9.0]), [[-100, 1000]])


def test_counters_beyond_28_bits():
    """A velocity move leaves the range after 28 pulses: reading it is refused, or wraps round,
    which loses no count.
    """
    state = send(PCI_8164, at_rest([COUNTER[1] - 28]), TVMove([1000.0], [1000.0], 0.0), 0.0)
    assert read_counters(PCI_8164, state, [0.02])[0, 0] == COUNTER[1] - 8
    with pytest.raises(
        Refused, match=r"channel 1: position 134217800 is outside -134217728 … 134217727.*28-bit"
    ):
        read_counters(PCI_8164, state, [0.0, 0.101])
    wrapping = replace(PCI_8164, beyond_counter="wrap")
    assert read_counters(wrapping, state, [0.101])[0, 0] == 134217800 - 2**28
    goal = TRMove([100], [1000.0], [1000.0], 0.0, 0.0)
    with pytest.raises(Refused, match="28-bit position counter"):
        send(PCI_8164, at_rest([COUNTER[1]]), goal, 0.0)
    state = send(wrapping, at_rest([COUNTER[1]]), goal, 0.0)
    assert read_counters(wrapping, state, [1.0])[0, 0] == COUNTER[0] + 99


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"speed_range": 3e6}, "speed range 3000000.0"),
        ({"backlash_speed": 0.0}, "backlash speed 0.0"),
        ({"soft_limits": ((5, 4),)}, "soft limits 5 … 4"),
        ({"backlash": (-1,)}, "backlash"),
    ],
)
def test_options_out_of_range(options, reason):
    with pytest.raises(MotionError, match=reason):
        Card("PCI-8132", 2.4e6, 9_830_400, **options)


@pytest.mark.parametrize("options", [{"soft_limits": ((0, 1),)}, {"backlash": (1,)}])
def test_options_for_other_channels(options):
    with pytest.raises(Refused, match="for 2 channels"):
        send(replace(PCI_8164, **options), at_rest([0, 0]), to(1, 1), 0.0)


@pytest.mark.parametrize(
    "again", [TAMove([5000], [200.0], [2000.0], 0.1, 0.1), TRMove([4000], [200], [2000], 0.1, 0.1)]
)
def test_a_command_begins_at_the_speed_of_the_instant_where_the_card_says_so(again):
    """At 1000 pulses/s, for 4000 pulses more at 2000: 0.1 s up, 0.1 s down to 200, the rest at
    2000.
    """
    first = TAMove([9000], [1000.0], [1000.0], 0.0, 0.0)
    for start_from, begins, ramp in (("commanded", 200.0, 110.0), ("current", 1000.0, 150.0)):
        card = replace(PCI_8164, start_from=start_from)
        state = send(card, send(card, at_rest([0]), first, 0.0), again, 1.0)
        move = state.current_move(1.0)
        assert move.speed(1.0)[0] == pytest.approx(begins)
        assert move.speed(1.1)[0] == pytest.approx(2000.0)
        end = 1.2 + (4000 - ramp - 110) / 2000
        assert move.end[0] == pytest.approx(end)
        assert move.speed(end - 1e-9)[0] == pytest.approx(200.0, abs=1e-3)
        assert state.position([end - 1e-9])[0, 0] == pytest.approx(5000, abs=EXACT)


def test_a_command_the_other_way_or_from_rest_begins_as_it_says():
    card = replace(PCI_8164, start_from="current")
    forth, back = to(9000), TAMove([-500], [200.0], [2000.0], 0.1, 0.1)
    for sent in ([(0.0, back)], [(0.0, forth), (1.0, back)], [(0.0, forth), (10.0, back)]):
        state = play(card, at_rest([0]), sent, 20.0).states[-1]
        expected = play(PCI_8164, at_rest([0]), sent, 20.0).states[-1]
        t = np.linspace(sent[-1][0], 20.0, 50)
        np.testing.assert_array_equal(state.position(t), expected.position(t))


def test_a_velocity_move_goes_on_from_the_speed_of_the_instant():
    card = replace(PCI_8164, start_from="current")
    state = send(card, at_rest([0, 0]), TVMove([1000, 1000], [1000, 1000], 0.0), 0.0)
    state = send(card, state, TVMove([100, -100], [500, -500], 0.1), 1.0)
    np.testing.assert_allclose(state.current_move(1.0).speed(1.0), [1000, -100])
    np.testing.assert_allclose(state.position([1.1])[0], [1075, 970], atol=EXACT)
    state = send(card, state, TVMove([100, -100], [0, 0], 0.1), 2.0)
    np.testing.assert_allclose(state.current_move(2.0).speed(2.0), [500, -500])


def test_too_late_to_ramp_down_is_a_dead_stop_on_the_target():
    card = replace(PCI_8164, start_from="current")
    state = send(card, at_rest([0]), to(9000), 0.0)
    state = send(card, state, TAMove([1010], [10.0], [20.0], 1.0, 1.0), 1.0)
    assert state.position([30.0])[0, 0] == 1010
    t = np.linspace(1.0, 3.0, 2001)
    assert np.diff(state.position(t)[:, 0]).min() >= 0
    assert state.position(t).max() == 1010


@given(
    way=st.integers(1, 400),
    sign=st.sampled_from([1, -1]),
    v0=st.floats(100.0, 1000.0),
    v1=st.floats(100.0, 5000.0),
    tacc=st.floats(0.02, 0.2),
    tdec=st.sampled_from([0.0, 0.05, 0.2]),
)
def test_a_short_move_keeps_the_time_where_the_card_says_so(way, sign, v0, v1, tacc, tdec):
    command = TAMove([sign * way], [v0], [v1], tacc, tdec)
    rate, time = (
        send(replace(PCI_8164, short_moves=kept), at_rest([0]), command, 0.0).current_move(0.0)
        for kept in ("keep rate", "keep time")
    )
    if v1 <= v0 or way >= (v0 + v1) / 2 * (tacc + tdec):
        np.testing.assert_array_equal(time.lengths, rate.lengths)
        np.testing.assert_array_equal(time.rates, rate.rates)
        return
    mean = way / (tacc + tdec)
    speeds = np.abs([time.speed(t)[0] for t in np.linspace(0, 0.999999, 40) * time.end[0]])
    assert speeds.min() >= v0 * (1 - 1e-5)
    assert speeds.max() <= max(2 * mean - v0, v0) * (1 + 1e-9)
    # at the mean speed it takes the ramps' time; it cannot run below its start speed
    assert time.end[0] == pytest.approx(tacc + tdec if mean >= v0 else way / v0, rel=1e-9)
    assert time.end[0] >= rate.end[0] * (1 - 1e-9)
    ends = time.end[0] * (1 - 1e-9)
    assert time.position(np.array([ends]))[0, 0] == pytest.approx(sign * way, abs=1e-4)
