"""Interpolation: the path is a line or a circle, the way along it a ramped move, the pulses within
half of both.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.card import PCI_8132, PCI_8164, ArcMove, LinearMove, Refused, at_rest, play, send

EXACT = 1e-6
"""Pulses: rounding of positions of thousands of pulses."""
some = settings(max_examples=25)
speeds, ramps = st.floats(100.0, 5000.0), st.floats(0.01, 0.3)


def way(t, distance, v0, v1, tacc, tdec):
    """The textbook's trapezoid: distance after t, by the peak that fits, and backwards from the
    end.
    """
    up, down = (v1 - v0) / tacc, (v1 - v0) / tdec
    # the peak from energy: (vp² − v0²)/(2 up) + (vp² − v0²)/(2 down) = distance
    top = min(v1, np.sqrt(v0**2 + 2 * distance / (1 / up + 1 / down)))
    t1, t3 = (top - v0) / up, (top - v0) / down
    t2 = (distance - (v0 + top) / 2 * (t1 + t3)) / top
    end = t1 + t2 + t3
    back = np.maximum(end - t, 0.0)
    falling = distance - v0 * back - down * back**2 / 2
    return np.where(
        t < t1,
        v0 * t + up * t**2 / 2,
        np.where(t < t1 + t2, (v0 + top) / 2 * t1 + top * (t - t1), falling),
    ), end


@given(
    gap=st.lists(st.integers(-2000, 2000), min_size=2, max_size=4).filter(any),
    v=st.tuples(speeds, speeds).filter(lambda v: abs(v[0] - v[1]) > 1),
    tacc=ramps,
    tdec=ramps,
)
@some
def test_line(gap, v, tacc, tdec):
    """Each channel is at its share of the way: in position exactly, in pulses to half of one, long
    or short.
    """
    v0, v1 = sorted(v)
    axes, here = tuple(range(len(gap))), np.arange(5, 5 + len(gap))
    move = LinearMove(axes, gap, v0, v1, tacc, tdec, relative=True)
    record = play(PCI_8164, at_rest(here), [(0.0, move)], 100.0)
    length = np.hypot.reduce(np.array(gap, float))
    end = record.states[-1].moves[0].end[0]
    t = np.linspace(0.0, end, 101)
    s, expected = way(t, length, v0, v1, tacc, tdec)
    assert end == pytest.approx(expected, rel=1e-9)
    ideal = here + np.outer(s / length, gap)
    np.testing.assert_allclose(record.position(t), ideal, atol=EXACT)
    assert np.abs(record.states[-1].counter(t) - ideal).max() <= 0.5 + EXACT
    for k in axes:
        train = record.train(k)
        assert len(train.ticks) == abs(gap[k])
        at = way(train.ticks / PCI_8164.clock_hz, length, v0, v1, tacc, tdec)[0] * gap[k] / length
        # a tick is as far as the fastest goes within half of one
        assert (
            np.abs(at - (train.count - here[k] - train.direction / 2)).max(initial=0)
            <= v1 / PCI_8164.clock_hz + EXACT
        )


@given(
    radius=st.integers(20, 3000),
    at=st.floats(0, 2 * np.pi),
    turn=st.sampled_from([1, -1]),
    angle=st.floats(0.2, 2 * np.pi),
    v=st.tuples(speeds, speeds).filter(lambda v: abs(v[0] - v[1]) > 1),
    tacc=ramps,
    tdec=ramps,
)
@some
def test_circle(radius, at, turn, angle, v, tacc, tdec):
    """Round by any angle, on channels 2 and 1 of a card of two; the ideal is where the arc and the
    trapezoid say.
    """
    v0, v1 = sorted(v)
    centre = np.array([100, -50])
    start = np.rint(centre + radius * np.array([np.cos(at), np.sin(at)]))
    radius = np.hypot(*(start - centre))
    first = np.arctan2(*(start - centre)[::-1])
    last = first + turn * angle
    end = np.rint(centre + radius * np.array([np.cos(last), np.sin(last)]))
    record = play(
        PCI_8132,
        at_rest(start[::-1]),
        [(0.0, ArcMove((1, 0), centre, end, v0, v1, tacc, tdec, turn))],
        100.0,
    )
    span = np.mod(turn * (np.arctan2(*(end - centre)[::-1]) - first), 2 * np.pi)
    if np.all(end == start):
        span = 2 * np.pi
    stop = record.states[-1].moves[0].end
    t = np.linspace(0.0, stop[1], 401)
    s, expected = way(t, radius * span, v0, v1, tacc, tdec)
    np.testing.assert_allclose(stop, expected, rtol=1e-9)
    theta = first + turn * s / radius
    ideal = centre + radius * np.stack([np.cos(theta), np.sin(theta)], -1)
    np.testing.assert_allclose(record.position(t)[:, ::-1], ideal, atol=EXACT)
    state = record.states[-1]
    assert np.abs(state.counter(t)[:, ::-1] - ideal).max() <= 0.5 + EXACT
    assert np.abs(record.position([99.0])[0, ::-1] - end).max() <= 1.0
    for k in (0, 1):
        train = record.train(1 - k)
        theta = (
            first
            + turn
            * way(train.ticks / PCI_8132.clock_hz, radius * span, v0, v1, tacc, tdec)[0]
            / radius
        )
        at = centre[k] + radius * (np.cos, np.sin)[k](theta)
        tick = v1 / PCI_8132.clock_hz + EXACT
        assert np.abs(at - (train.count - train.direction / 2)).max(initial=0) <= tick
        assert np.all(np.diff(train.ticks) > 0)
        assert state.pulses(99.0)[1 - k] == len(train.ticks)


def test_whole_circle_comes_back_and_counts_four_radii_on_each_channel():
    record = play(
        PCI_8132,
        at_rest([1000, 0]),
        [(0.0, ArcMove((0, 1), [0, 0], [1000, 0], 100.0, 4000.0, 0.1, 0.1))],
        9.0,
    )
    np.testing.assert_allclose(record.position([9.0]), [[1000, 0]], atol=EXACT)
    np.testing.assert_array_equal(record.states[-1].pulses(9.0), [4000, 4000])


@pytest.mark.parametrize("curve", [(0.0, 0.0), (300.0, 100.0)])
def test_s_curve_along_the_path(curve):
    """Smooth along the path: the same ends and times as with straight ramps, between them on the
    path as well.
    """
    lanes, t = at_rest([0, 0]), np.linspace(0.0, 1.0, 201)
    for straight in (
        LinearMove((0, 1), [600, 800], 100.0, 2000.0, 0.2, 0.2),
        ArcMove((0, 1), [500, 0], [1000, 0], 100.0, 2000.0, 0.2, 0.2),
    ):
        bent = replace(straight, curve=curve)
        one, other = (send(PCI_8132, lanes, move, 0.0) for move in (straight, bent))
        np.testing.assert_allclose(other.moves[0].end, one.moves[0].end, rtol=1e-12)
        p, q = one.position(t), other.position(t)
        np.testing.assert_allclose(q[[0, -1]], p[[0, -1]], atol=EXACT)
        assert 1.0 < np.abs(p - q).max() < 60.0
        off = q @ [0.8, -0.6] if isinstance(bent, LinearMove) else np.hypot(*(q - [500, 0]).T) - 500
        assert np.abs(off).max() <= EXACT


def test_queued_interpolations_run_on_without_a_stop():
    """A line into an arc into a line, at one speed along all of them: continuous interpolation."""
    card = replace(PCI_8164, while_moving="queue")
    moves = (
        LinearMove((0, 1), [1000, 0], 1000.0, 1000.0, 0.0, 0.0),
        ArcMove((0, 1), [1000, 500], [1500, 500], 1000.0, 1000.0, 0.0, 0.0),
        LinearMove((0, 1), [1500, 900], 1000.0, 1000.0, 0.0, 0.0),
    )
    record = play(card, at_rest([0, 0, 0]), [(0.0, move) for move in moves], 9.0)
    quarter = np.pi / 2 * 500 / 1000
    t = np.array([0.5, 1 + quarter / 2, 1 + quarter + 0.2, 9.0])
    middle = 500 * np.sqrt(0.5)
    expected = [[500, 0, 0], [1000 + middle, 500 - middle, 0], [1500, 700, 0], [1500, 900, 0]]
    np.testing.assert_allclose(record.position(t), expected, atol=EXACT)
    way = np.linalg.norm(
        np.diff(record.position(np.linspace(0, 1.4 + quarter, 5001)), axis=0), axis=1
    )
    # the chord of an arc is shorter than the arc by (step/radius)²/24
    np.testing.assert_allclose(way, 1000 * (1.4 + quarter) / 5000, rtol=1e-6)


def test_a_batch_of_runs_each_with_its_own_line():
    state = send(
        PCI_8132,
        at_rest(np.zeros((2, 2))),
        LinearMove((0, 1), [[300, 400], [-30, 0]], [500, 100], [500, 100], 0, 0),
        0.0,
    )
    np.testing.assert_allclose(state.position([0.1]), [[[30, 40], [-10, 0]]], atol=EXACT)


@pytest.mark.parametrize(
    ("card", "move", "reason"),
    [
        (
            PCI_8132,
            LinearMove((0, 1, 2), [1, 2, 3], 1, 1, 0, 0),
            r"channels 1, 2, 3 of 4.*2 to 2 different.*card of 2",
        ),
        (
            PCI_8132,
            LinearMove((1, 2), [1, 2], 1, 1, 0, 0),
            r"channels 2, 3 of 4.*all of one card of 2",
        ),
        (PCI_8164, LinearMove((0, 0), [1, 2], 1, 1, 0, 0), r"channels 1, 1 of 4.*2 to 4 different"),
        (PCI_8164, LinearMove((2, 4), [1, 2], 1, 1, 0, 0), r"channels 3, 5 of 4"),
        (
            PCI_8164,
            LinearMove((0, 1), [1, 2**27], 1, 1, 0, 0),
            r"channel 2: position 134217728 .* 28-bit",
        ),
        (PCI_8164, LinearMove((0, 1), [1, 2], 1, 7e6, 0, 0), r"max speed 7000000.*speed register"),
        (PCI_8164, ArcMove((0, 1), [100, 0], [0, 5], 1, 1, 0, 0, turn=2), r"turn is ±1"),
        (
            PCI_8164,
            ArcMove((0, 1), [100, 0], [202, 0], 1, 1, 0, 0),
            r"100 pulses to 102.*within 1 pulse of the circle",
        ),
        (PCI_8164, ArcMove((0, 1), [0, 0], [0, 0], 1, 1, 0, 0), r"radius above 1"),
    ],
)
def test_refusals_name_the_reason(card, move, reason):
    with pytest.raises(Refused, match=reason):
        send(card, at_rest([0] * 4), move, 0.0)
