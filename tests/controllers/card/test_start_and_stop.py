"""Changes on the fly, stops, dwell and starting together: against a walk in small steps, and by
hand.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.card import (
    PCI_8132,
    PCI_8164,
    ArcMove,
    DStop,
    DwellMove,
    EStop,
    LinearMove,
    PChange,
    Refused,
    SAMove,
    TAMove,
    Together,
    TRMove,
    TVMove,
    VChange,
    at_rest,
    play,
    send,
)

EXACT = 1e-6
STEP = 2e-5
"""s of the walk."""
QUEUE = replace(PCI_8164, while_moving="queue")

some = settings(max_examples=25)
lows, tops = st.floats(100.0, 400.0), st.floats(500.0, 4000.0)
ramps = st.floats(0.02, 0.3)


def walked(p, v, target, low, top, up, down, instants):
    """Positions at instants of a channel that drives to a target by looking at where it is, as a
    person would.

    Beyond the target, or too close to stop: slow down, and at the start speed turn. Otherwise speed
    up to the top.
    """
    found = []
    for n in range(round(instants[-1] / STEP) + 1):
        while len(found) < len(instants) and instants[len(found)] <= (n + 0.5) * STEP:
            found.append(p)
        sign = 1.0 if target >= p else -1.0
        left, heading = abs(target - p), v * sign
        if left <= low * STEP and abs(v) <= low + max(up, down) * STEP * 2:
            p, v = target, 0.0
        elif heading < 0 or max(v * v - low * low, 0.0) / (2 * down) > left:
            slower = abs(v) - down * STEP
            v = math.copysign(slower, v) if slower >= low else sign * low
        else:
            v = sign * min(heading + up * STEP, top)
        p += v * STEP
    return found


@given(
    first=st.integers(300, 1500),
    second=st.integers(-500, 1500),
    low=lows,
    top=tops,
    tacc=ramps,
    tdec=ramps,
    share=st.floats(0.05, 0.9),
)
@settings(max_examples=40)
def test_change_of_position(first, second, low, top, tacc, tdec, share):
    """Further on, nearer, behind, and too near to stop at: the channel ends there, by way of the
    walk.
    """
    state = send(PCI_8164, at_rest([0]), TAMove([first], [low], [top], tacc, tdec), 0.0)
    t = share * state.moves[0].end[0]
    p, v = state.position([t])[0, 0], state.moves[0].speed(t)[0]
    state = send(PCI_8164, state, PChange([second]), t)
    (move,) = state.moves
    up, down = (top - low) / tacc, (top - low) / tdec
    later = np.linspace(0.1, 1.0, 5) * (move.end[0] - t)
    expected = walked(float(p), float(v), second, low, top, up, down, later.tolist())
    # the walk decides a step late at each of its four bends, and sums speeds that are a step old
    tolerance = 8 * top * STEP + 8 * max(up, down) * STEP * later[-1]
    np.testing.assert_allclose(state.position(t + later)[:, 0], expected, rtol=0, atol=tolerance)
    assert state.counter([move.end[0]])[0, 0] == second
    turn = move.start + move.lengths[0] * (move.speeds[0] + move.rates[0] * move.lengths[0] / 2)
    assert (
        state.pulses(move.end[0])[0]
        == np.rint(p) + np.abs(np.diff(np.rint([p, turn[0], second]))).sum()
    )


@given(
    top=tops,
    new=st.floats(100.0, 5000.0),
    low=lows,
    tacc=ramps,
    tdec=ramps,
    ramp=st.floats(0.0, 0.2),
    share=st.floats(0.1, 0.6),
)
@settings(max_examples=15)
def test_change_of_speed_keeps_the_target(top, new, low, tacc, tdec, ramp, share):
    """Whatever the new speed, the move ends on its target; where there is room, at the textbook's
    time.
    """
    state = send(PCI_8132, at_rest([0]), TAMove([3000], [low], [top], tacc, tdec), 0.0)
    t = share * state.moves[0].end[0]
    p, v = state.position([t])[0, 0], state.moves[0].speed(t)[0]
    state = send(PCI_8132, state, VChange([new], ramp), t)
    (move,) = state.moves
    assert state.position([t])[0, 0] == pytest.approx(p, abs=EXACT)
    assert state.counter([move.end[0]])[0, 0] == 3000
    down = (top - low) / tdec
    ramps_way = (v + new) / 2 * ramp + abs(new * new - low * low) / (2 * down)
    if ramps_way < 3000 - p and ramp > 1e-6:
        expected = ramp + (3000 - p - ramps_way) / new + abs(new - low) / down
        assert move.end[0] - t == pytest.approx(expected, rel=1e-9)
    # no jump anywhere: the way is the integral of the speed
    grid = np.linspace(t, move.end[0], 801)
    speed = np.array([move.speed(x)[0] for x in (grid[1:] + grid[:-1]) / 2])
    # a bend, or a dead end at the target, falls inside a step
    assert (speed * np.diff(grid)).sum() == pytest.approx(
        3000 - p, abs=3 * max(v, new) * (grid[1] - grid[0])
    )
    assert np.all(speed >= 0)


def test_the_8132_changes_no_position():
    state = send(PCI_8132, at_rest([0]), TAMove([1000], [100.0], [100.0], 0.0, 0.0), 0.0)
    with pytest.raises(Refused, match=r"PCI-8132 cannot change a position on the fly.*8164"):
        send(PCI_8132, state, PChange([5]), 0.1)


@pytest.mark.parametrize(
    "moving",
    [
        SAMove([1000], [100.0], [500.0], 0.1, 0.1),
        TVMove([100.0], [100.0], 0.1),
        TAMove([1], [100.0], [100.0], 0, 0),
        None,
    ],
)
def test_no_position_to_change(moving):
    state = at_rest([0]) if moving is None else send(PCI_8164, at_rest([0]), moving, 0.0)
    with pytest.raises(Refused, match=r"channel 1: no trapezoidal move is under way"):
        send(PCI_8164, state, PChange([5]), 0.5)


def test_an_s_curve_takes_no_change_of_speed():
    state = send(PCI_8164, at_rest([0]), SAMove([1000], [100.0], [500.0], 0.1, 0.1), 0.0)
    with pytest.raises(Refused, match=r"channel 1: only a velocity move or a trapezoidal move"):
        send(PCI_8164, state, VChange([200.0], 0.1), 0.05)


@given(
    low=lows,
    top=tops,
    tacc=ramps,
    tdec=ramps,
    share=st.floats(0.05, 0.95),
    stop=st.floats(0.0, 0.4),
)
@some
def test_decelerated_stop(low, top, tacc, tdec, share, stop):
    """v·tdec/2 further on, or on the target where that comes first."""
    state = send(PCI_8132, at_rest([0]), TAMove([-2000], [low], [top], tacc, tdec), 0.0)
    t = share * state.moves[0].end[0]
    p, v = state.position([t])[0, 0], state.moves[0].speed(t)[0]
    state = send(PCI_8132, state, DStop(stop), t)
    rest = max(p + v * (stop if stop * PCI_8132.clock_hz >= 1 else 0) / 2, -2000)
    assert state.position([t + stop + 1e-9])[0, 0] == pytest.approx(rest, abs=EXACT)
    assert state.position([t + 9])[0, 0] == pytest.approx(rest, abs=EXACT)
    assert state.pulses(t + 9)[0] == abs(round(state.position([t + 9])[0, 0]))


def test_simultaneous_stop_keeps_an_interpolation_on_its_path():
    line = LinearMove((0, 1), [3000, -1000], 100.0, 2000.0, 0.2, 0.2)
    arc = ArcMove((2, 3), [1000, 0], [1000, 1000], 100.0, 2000.0, 0.1, 0.1, turn=-1)
    start = send(PCI_8164, at_rest([0] * 4), Together((((0, 1), line), ((2, 3), arc))), 0.0)
    state = send(PCI_8164, start, DStop(0.3), 0.3)
    p = state.position(np.linspace(0.3, 1.0, 40))
    np.testing.assert_allclose(p[:, 1], -p[:, 0] / 3, atol=EXACT)
    np.testing.assert_allclose(np.hypot(p[:, 2] - 1000, p[:, 3]), 1000, atol=EXACT)
    # at 2000 pulses/s along the path half of 0.3 s more
    before = start.position([0.3])[0]
    assert np.hypot(*(p[-1, :2] - before[:2])) == pytest.approx(300.0, abs=EXACT)
    turned = np.diff([np.arctan2(y, x - 1000) for x, y in (before[2:], p[-1, 2:])])
    assert abs(turned[0]) * 1000 == pytest.approx(300.0, abs=EXACT)


def test_emergency_stop_drops_what_is_queued():
    state = send(QUEUE, at_rest([0]), TAMove([100], [1000.0], [1000.0], 0.0, 0.0), 0.0)
    state = send(QUEUE, state, TAMove([0], [1000.0], [1000.0], 0.0, 0.0), 0.01)
    state = send(QUEUE, state, EStop(), 0.0503)
    assert state.position([9.0])[0, 0] == pytest.approx(50.3, abs=EXACT)
    assert state.pulses(9.0)[0] == 50


def test_dwell_waits_between_queued_moves():
    there = TRMove([100], [1000.0], [1000.0], 0.0, 0.0)
    record = play(QUEUE, at_rest([0]), [(0.0, there), (0.0, DwellMove(0.5)), (0.0, there)], 9.0)
    np.testing.assert_allclose(
        record.position([0.1, 0.6, 0.65, 0.7])[:, 0], [100, 100, 150, 200], atol=EXACT
    )


def test_started_together():
    """Each channel its own kind of move; a queueing card waits for the last of them; the others go
    on.
    """
    sent = Together(
        (
            ((0,), TAMove([100, 0, 0], [1000.0] * 3, [1000.0] * 3, 0.0, 0.0)),
            ((2,), TVMove([0] * 3, [200.0] * 3, 0.0)),
        )
    )
    state = send(PCI_8164, at_rest([0, 7, 0]), sent, 1.0)
    np.testing.assert_allclose(
        state.position([1.05, 2.0]), [[50, 7, 10], [100, 7, 200]], atol=EXACT
    )
    state = send(
        QUEUE, at_rest([0, 7, 0]), TAMove([0, 0, 60], [200.0] * 3, [200.0] * 3, 0.0, 0.0), 0.0
    )
    state = send(QUEUE, state, sent, 0.1)
    np.testing.assert_allclose(
        state.position([0.3, 0.35, 1.3]), [[0, 0, 60], [50, 0, 70], [100, 0, 260]], atol=EXACT
    )
    for members in ((((0,), sent), ((0,), sent)), (((3,), sent),), ()):
        with pytest.raises(Refused, match="cannot be started together"):
            send(PCI_8164, at_rest([0, 7, 0]), Together(members), 1.0)
