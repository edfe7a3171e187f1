"""The numbered modes of home return: where zero comes to be, how far beyond a channel goes, how
fast it is there.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.card import PCI_8132, PCI_8164, HomeMode, Refused, TAMove, at_rest, play, send
from controllers.card.home import MODES

CARD = replace(PCI_8164, speed_range=1e5)
START, TOP, CREEP, TACC = 200.0, 3000.0, 150.0, 0.2
RAMP = (TOP**2 - START**2) / (2 * (TOP - START) / TACC)
"""Pulses that a ramp from top to start speed takes: (v1² − v0²)/(2 a)."""
SPACING = 400


def mode_of(mode, origin, limit, sign, index, count=1):
    speeds = [START], [TOP], [CREEP]
    return HomeMode(
        mode, [sign], *speeds, TACC, origin=[origin], limit=[limit], index=[index], index_spacing=SPACING,
        index_count=count,
    )  # fmt: skip


def walked(mode, origin, limit, index, count):
    """(zero, furthest place, whether it goes back) of a walk pulse by pulse from 0 in direction +1.

    Sensors are looked at after every pulse, as by a person who reads counts off; a ramp down takes
    RAMP pulses. It knows nothing of `MODES`.
    """
    is_index = lambda p: (p - index) % SPACING == 0  # noqa: E731
    p = 0

    def until(step, stop):
        nonlocal p
        while True:
            p += step
            if stop():
                return

    def indices(step):
        left = count

        def met():
            nonlocal left
            left -= is_index(p)
            return left == 0

        until(step, met)

    if mode in (6, 7, 8, 12):
        until(1, lambda: p >= limit)
        far = p
        if mode == 6:
            until(-1, lambda: p < limit)
        else:
            indices(-1)
        return p, far
    until(1, lambda: p >= origin)
    if mode in (0, 1, 9):
        return origin, origin + RAMP
    if mode in (2, 3, 10):
        indices(1)
        return p, p + (RAMP if mode != 2 else 0)
    far = origin + RAMP
    p = round(far)
    indices(-1)
    return p, far


@given(
    mode=st.integers(0, 12),
    origin=st.integers(1500, 4000),
    sign=st.sampled_from([1, -1]),
    index=st.integers(0, SPACING - 1),
    count=st.integers(1, 3),
)
@settings(max_examples=80, deadline=None)
def test_zero_and_the_furthest_place_are_those_of_a_walk_pulse_by_pulse(
    mode, origin, sign, index, count
):
    limit = origin + 3000
    command = mode_of(mode, sign * origin, sign * limit, sign, sign * index, count)
    record = play(CARD, at_rest([0]), [(0.0, command)], 60.0)
    zero, far = walked(mode, origin, limit, index, count)
    # half-way between two counts the stop at the turn may be on either
    assert record.states[-1].moves[-1].zero[0] * sign == pytest.approx(
        zero, abs=SPACING if edge_case(far, index) else 0
    )
    if edge_case(far, index):
        return
    train = record.train(0)
    places = np.cumsum(train.direction) * sign
    assert places.max() == pytest.approx(far, abs=1)
    stands = record.states[-1].counter([60.0])[0, 0]
    assert stands == places[-1] * sign - zero * sign
    if MODES[mode].returns or MODES[mode].then.startswith("creep") or mode == 1:
        assert stands == 0
    elif mode in (0, 3):
        assert stands * sign == pytest.approx(RAMP, abs=1)
    else:  # 5 and 8 run back over it
        assert stands * sign < -1


def edge_case(far, index):
    """Whether the place of the turn is beside an index, or half a pulse from the next."""
    return (
        abs(far % 1 - 0.5) < 1e-3 or abs((far - index + SPACING / 2) % SPACING - SPACING / 2) < 1.5
    )


@pytest.mark.parametrize("mode", [1, 2, 4, 6, 7])
def test_modes_that_stop_dead_are_slow_there(mode):
    """The last pulses before zero come at the creep speed, or mode 2's start speed: nothing is
    thrown at the edge.

    Of mode 2 where the index lies beyond the ramp down, here the second one.
    """
    record = play(CARD, at_rest([0]), [(0.0, mode_of(mode, 2000, 5000, 1, 37, count=2))], 60.0)
    t = record.train(0).ticks / CARD.clock_hz
    slow = START if mode == 2 else CREEP
    assert 1 / (t[-1] - t[-2]) <= slow * 1.01 or mode == 6  # its one pulse back comes after a turn


@pytest.mark.parametrize("mode", range(13))
def test_each_mode_is_as_good_from_its_switch_and_a_move_behind_it_counts_from_zero(mode):
    begins = 5000 if MODES[mode].sensor == "limit" else 2100
    sent = [
        (0.0, mode_of(mode, 2000, 5000, 1, 37)),
        (60.0, TAMove([25], [START], [START], 0.0, 0.0)),
    ]
    record = play(CARD, at_rest([begins]), sent, 90.0)
    zero = record.states[-1].current_move(90.0).zero[0]
    assert begins + record.train(0).direction.sum() == zero + 25
    assert record.states[-1].counter([90.0])[0, 0] == 25


def test_channels_home_each_by_their_own_switch():
    command = HomeMode(0, [1, -1], [START] * 2, [TOP] * 2, [CREEP] * 2, TACC, origin=[2000, -300])
    state = send(CARD, at_rest([0, 0]), command, 0.0)
    np.testing.assert_array_equal(state.moves[-1].zero, [2000, -300])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mode": 13}, "no mode 13; modes are 0 … 12"),
        ({"origin": None}, "mode 4 needs origin; state it"),
        ({"index": None, "index_spacing": None}, "mode 4 needs index and index_spacing"),
        ({"index_count": 0}, "index count 0"),
        ({"index_spacing": 0}, "spacing 0"),
        ({"direction": np.array([2.0])}, "direction must be"),
        ({"limit": np.array([2100.0])}, "runs into the limit; search slower"),
    ],
)
def test_what_a_mode_cannot_do_is_refused(changes, words):
    with pytest.raises(Refused, match=words):
        send(CARD, at_rest([0]), replace(mode_of(4, 2000, 5000, 1, 37), **changes), 0.0)


def test_a_card_without_numbered_modes_says_so():
    with pytest.raises(Refused, match=r"PCI-8132: .* use Home, or a PCI-8164"):
        send(PCI_8132, at_rest([0]), mode_of(0, 2000, 5000, 1, 37), 0.0)
