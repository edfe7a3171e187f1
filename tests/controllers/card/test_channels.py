"""Any list of commands: pulses add up, ticks rise, lanes do not know of each other."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from controllers.card import (
    PCI_8164,
    DStop,
    DwellMove,
    EStop,
    HomeReturn,
    LinearMove,
    Refused,
    SAMove,
    SRMove,
    SVMove,
    TAMove,
    TRMove,
    TVMove,
    VChange,
    at_rest,
    play,
    send,
)

N = 3
STOP = {"soft_limits": ((-600, 600),) * N, "at_soft_limit": "stop"}
FOUND = (Phase.explicit, Phase.generate)
"""Not made smaller: that takes minutes."""
speed = st.floats(100.0, 5000.0)
place = st.integers(-800, 800)
ramp = st.sampled_from([0.0, 0.03, 0.1])


def three(values):
    return st.tuples(values, values, values)


def ramped(command):
    return st.builds(command, three(place), three(speed), three(speed), ramp, ramp)


signed = three(st.floats(-5000.0, 5000.0))
commands = st.one_of(
    ramped(TAMove),
    ramped(TRMove),
    ramped(SAMove),
    ramped(SRMove),
    st.builds(TVMove, signed, signed, ramp),
    st.builds(SVMove, signed, signed, ramp, st.floats(0.0, 3000.0)),
    st.builds(VChange, signed, ramp),
    st.builds(DStop, ramp),
    st.just(EStop()),
    st.builds(DwellMove, ramp),
    st.builds(LinearMove, st.just((0, 2)), st.tuples(place, place), speed, speed, ramp, ramp),
    st.builds(
        HomeReturn,
        three(place),
        three(st.sampled_from([1, -1])),
        three(speed),
        three(speed),
        three(speed),
        ramp,
    ),
)
programs = st.lists(st.tuples(st.floats(0.001, 0.2), commands), min_size=1, max_size=6)
cards = st.sampled_from(
    [
        PCI_8164,
        replace(PCI_8164, while_moving="queue"),
        replace(PCI_8164, backlash=(7, 0, 30)),
        replace(PCI_8164, start_from="current", short_moves="keep time", **STOP),
        replace(PCI_8164, speed_range=1e4, **STOP),
        replace(
            PCI_8164,
            while_moving="queue",
            backlash=(0, 5, 5),
            soft_limits=((-900, 700),) * 3,
            at_soft_limit="stop",
        ),
    ]
)


def timed(program):
    t, found = 0.0, []
    for wait, command in program:
        t += wait
        found.append((t, command))
    return found


@given(card=cards, program=programs)
@settings(max_examples=60, phases=FOUND)
def test_pulses_add_up(card, program):
    """At the end and in between: the counted pulses are what the counter changed by, all of them
    what was fired.
    """
    sent = timed(program)
    for cut in range(len(sent), 0, -1):
        try:
            record = play(card, at_rest([0] * N), sent[:cut], sent[cut - 1][0] + 0.37)
            break
        except Refused:  # a change of speed that finds an interpolation
            continue
    else:
        return
    state, until = record.states[-1], record.until
    running = state.current_move(until)
    for k in range(N):
        train = record.train(k)
        assert np.all(np.diff(train.ticks) > 0)
        # the next pulse may be due at the very end
        assert state.pulses(until)[k] == len(train.ticks)
        zero = 0 if running.zero is None else running.zero[k]
        assert train.direction[train.counted].sum() == state.counter([until])[0, k] + zero
        assert np.all(np.abs(train.ticks / card.clock_hz) <= until + 1e-6)
        net = train.direction[~train.counted]
        assert abs(net.sum()) <= (0 if card.backlash is None else card.backlash[k])


def test_a_row_stands_where_it_was_stopped_until_a_move_that_waits_for_backlash():
    """One row has moves behind one another, the other was stopped: its channels stay there, not
    where they were to.
    """
    card = replace(PCI_8164, while_moving="queue", backlash=(0, 50, 50))
    move, back = (TAMove((way,) * N, (1000.0,) * N, (1000.0,) * N, 0.0, 0.0) for way in (100, 0))
    both, single = at_rest(np.zeros((2, N))), at_rest([0] * N)
    for t, row, command in ((0.0, 0, move), (0.05, 1, move), (0.1, 1, DStop(0.0)), (0.2, 1, back)):
        due = np.zeros((2, N), bool)
        due[row] = True
        both = send(card, both, command, t, due)
        single = send(card, single, command, t) if row else single
    t = np.linspace(0.2, 1.0, 81)
    np.testing.assert_allclose(both.position(t)[:, 1], single.position(t), atol=1e-9)
    np.testing.assert_allclose(single.position(t)[0], 50.0)


@given(card=cards, programs=st.tuples(programs, programs))
@settings(max_examples=40, phases=FOUND)
def test_runs_of_a_batch_are_runs_of_their_own(card, programs):
    """Two programs in the two rows of a batch, each command sent to its row alone: as if each had a
    card to itself.
    """
    sent = sorted(
        [
            (t, row, command)
            for row, program in enumerate(programs)
            for t, command in timed(program)
        ],
        key=lambda s: s[0],
    )
    both, single = at_rest(np.zeros((2, N))), [at_rest([0] * N), at_rest([0] * N)]
    now = 0.0
    for t, row, command in sent:
        due = np.zeros((2, N), bool)
        due[row] = True
        try:
            single[row] = send(card, single[row], command, t)
        except Refused:
            with pytest.raises(Refused):
                send(card, both, command, t, due)
            continue
        both, now = send(card, both, command, t, due), t
        grid = now + np.array([0.0, 0.01, 0.5, 20.0])
        expected = np.stack([state.position(grid) for state in single], 1)
        np.testing.assert_allclose(both.position(grid), expected, rtol=1e-12, atol=1e-9)
    for row in (0, 1):
        np.testing.assert_array_equal(both.pulses(now + 0.3)[row], single[row].pulses(now + 0.3))
