"""Velocity moves and the change of speed on the fly: against the integral of the speed that was
asked for.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.card import (
    PCI_8132,
    Card,
    DStop,
    Refused,
    SVMove,
    TAMove,
    TVMove,
    VChange,
    at_rest,
    send,
)

EXACT = 1e-6
"""Pulses: rounding of positions of up to 1e5 pulses."""

signed = st.floats(50.0, 1e4).flatmap(lambda v: st.sampled_from([v, -v]))
times = st.floats(0.01, 0.3)


@given(speeds=st.lists(signed, min_size=2, max_size=8), dt=times)
def test_a_train_of_changes_is_the_integral_of_straight_speeds(speeds, dt):
    """Laws 1 and 2: p(k dt) is the trapezoid rule over the speeds, exactly, whatever signs they
    have.
    """
    state = send(PCI_8132, at_rest([0]), TVMove([speeds[0]], [speeds[1]], dt), 0.0)
    for k, speed in enumerate(speeds[2:], 1):
        state = send(PCI_8132, state, VChange([speed], dt), k * dt)
    v = np.array(speeds)
    end = (len(v) - 1) * dt
    way = dt * (v[1:] + v[:-1]).sum() / 2
    assert state.position([end])[0, 0] == pytest.approx(way, abs=EXACT)
    assert state.position([end + 1.0])[0, 0] == pytest.approx(way + v[-1], abs=EXACT)


@given(v0=signed, v1=signed, tacc=times)
def test_pulses_of_a_change_through_zero(v0, v1, tacc):
    """Pulses fire at the half counts of v0 t + (v1 − v0) t²/(2 tacc), out and back."""
    state = send(PCI_8132, at_rest([0]), TVMove([v0], [v1], tacc), 0.0)
    (move,) = state.moves
    until = 1.5 * tacc
    found = move.edges(0, until=until).t
    t = np.minimum(found, tacc)
    p = v0 * t + (v1 - v0) * t * t / (2 * tacc) + v1 * (found - t)
    np.testing.assert_allclose(p - np.floor(p), 0.5, atol=EXACT)
    assert np.all(np.diff(found) > 0)
    # as many out and back as an independent walk over a fine grid counts
    t = np.linspace(0.0, until, 20_001)
    inside = np.minimum(t, tacc)
    walk = np.rint(v0 * inside + (v1 - v0) * inside**2 / (2 * tacc) + v1 * (t - inside))
    assert (
        abs(len(found) - np.abs(np.diff(walk)).sum()) <= 2
    )  # the walk may miss the two at the very turn
    assert state.pulses(until)[0] == len(found)
    assert state.counter([until])[0, 0] == pytest.approx(walk[-1], abs=1)


@given(v0=signed, v1=signed, tacc=times, curve=st.floats(0.0, 6e3))
def test_an_s_curve_velocity_move_takes_the_way_of_the_straight_one_and_bends_its_speed(
    v0, v1, tacc, curve
):
    """Through zero too: way (v0 + v1)/2 · tacc, antisymmetric in speed, no step of the rate at its
    ends.
    """
    state = send(PCI_8132, at_rest([0]), SVMove([v0], [v1], tacc, curve), 0.0)
    (move,) = state.moves
    assert state.position([tacc])[0, 0] == pytest.approx((v0 + v1) / 2 * tacc, abs=EXACT)
    assert state.position([tacc + 1.0])[0, 0] == pytest.approx((v0 + v1) / 2 * tacc + v1, abs=EXACT)
    t = np.linspace(0.0, tacc, 41)
    v = np.array([move.speed(float(at))[0] for at in t])
    np.testing.assert_allclose(v + v[::-1], v0 + v1, atol=1e-6 * (abs(v0) + abs(v1)) + 1e-6)
    assert np.all(np.diff(v) * np.sign(v1 - v0) >= -1e-6)
    # bent by `curve` at either end, or half of the change: the rate there is 2 curve/τ within τ = 2
    # curve/rate
    change = abs(v1 - v0)
    bend = min(curve, change / 2) if curve else change / 2
    most = (change + 2 * bend) / tacc
    if change > 1.0:
        assert np.abs(np.diff(v)).max() <= most * (t[1] - t[0]) * (1 + 1e-6)
        tau = min(0.3 * 2 * bend / most, tacc)
        jerk = most / (2 * bend / most) if bend > 1e-3 else np.inf
        if np.isfinite(jerk):
            assert abs(move.speed(tau)[0] - v0) == pytest.approx(
                jerk * tau * tau / 2, rel=1e-4, abs=1e-4
            )
    # within a piece the position runs one way: the pulses are those of a walk over it
    until = 1.5 * tacc
    fine = np.rint(state.position(np.linspace(0.0, until, 4001))[:, 0])
    assert abs(state.pulses(until)[0] - np.abs(np.diff(fine)).sum()) <= 2
    assert state.pulses(until)[0] == len(move.edges(0, until=until).t)


def test_an_s_curve_velocity_move_takes_a_change_and_a_stop():
    state = send(PCI_8132, at_rest([0]), SVMove([1000.0], [3000.0], 0.2), 0.0)
    state = send(PCI_8132, state, VChange([1000.0], 0.1), 1.0)
    assert state.position([1.1])[0, 0] == pytest.approx(400.0 + 0.8 * 3000.0 + 200.0, abs=EXACT)
    state = send(PCI_8132, state, DStop(0.1), 1.1)
    assert state.position([9.0])[0, 0] == pytest.approx(3000.0 + 50.0, abs=EXACT)
    with pytest.raises(Refused, match=r"velocity interval -1\.0"):
        send(PCI_8132, at_rest([0]), SVMove([1000.0], [3000.0], 0.2, -1.0), 0.0)


def test_speed_zero_stops_and_keeps_the_share_of_a_pulse():
    state = send(PCI_8132, at_rest([0]), TVMove([1000.0], [1000.0], 0.0), 0.0)
    state = send(PCI_8132, state, VChange([0.0], 0.1), 0.0123)
    assert state.moves[-1].end[0] == pytest.approx(0.1123)
    assert state.position([9.0])[0, 0] == pytest.approx(12.3 + 50.0, abs=EXACT)
    state = send(PCI_8132, state, VChange([-100.0], 0.0), 9.0)
    assert state.position([9.5])[0, 0] == pytest.approx(12.3, abs=EXACT)


def test_lanes_of_a_batch_turn_each_on_its_own():
    state = send(
        PCI_8132,
        at_rest(np.zeros((2, 3))),
        TVMove([[100.0, -100, 0], [0, 50, 80]], [[100.0, 100, 0]] * 2, 1),
        0,
    )
    expected = [[200.0, 100.0, 0.0], [150.0, 175.0, 40.0]]
    np.testing.assert_allclose(state.position([2.0])[0], expected, atol=EXACT)
    due = np.array([[True], [False]])
    state = send(PCI_8132, state, VChange(np.full((2, 3), -100.0), 0.0), 2.0, due)
    np.testing.assert_allclose(
        state.position([3.0])[0], [[100, 0, -100], [250, 275, 40]], atol=EXACT
    )


def test_refusals_name_the_register():
    with pytest.raises(
        Refused,
        match=r"channel 2: speed -2500000 is outside ±2400000 pulses/s of the speed register",
    ):
        send(PCI_8132, at_rest([0, 0]), TVMove([0, 0], [0, -2.5e6], 0.1), 0.0)
    rig = Card("PCI-8132", 2.4e6, 9_830_400, speed_range=1e5)
    with pytest.raises(Refused, match=r"speed 100001 is outside ±100000 pulses/s"):
        send(rig, at_rest([0]), VChange([100_001.0], 0.1), 0.0)


@given(v=st.floats(1.0, 1e5))
def test_a_speed_range_rounds_to_its_steps(v):
    """The rig: steps of 100 000/65535 = 1.526 pulses/s, all of them whole."""
    rig = Card("PCI-8132", 2.4e6, 9_830_400, speed_range=1e5)
    state = send(rig, at_rest([0]), TVMove([v], [v], 0.0), 0.0)
    way = state.position([1.0])[0, 0]
    assert way * 65535 / 1e5 == pytest.approx(max(round(v * 65535 / 1e5), 1), abs=1e-6)
    # the same of a position move
    state = send(rig, at_rest([0]), TAMove([10**6], [v], [v], 0.0, 0.0), 0.0)
    assert state.position([1.0])[0, 0] == pytest.approx(way, abs=EXACT)
