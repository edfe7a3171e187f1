"""The card's closed forms against a pulse generator in integers: every pulse within one tick of the
clock.

The generator knows nothing of positions over time: once a tick it adds three integers to one
another, as a card's accumulators do, and fires where the sum passes half a pulse more than it has
fired.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.card import (
    Card,
    DStop,
    EStop,
    LinearMove,
    SAMove,
    SRMove,
    SVMove,
    TAMove,
    TRMove,
    TVMove,
    VChange,
    at_rest,
    play,
)  # fmt: skip

CLOCK = 20_000
CARD = Card("slow clock", 1e4, CLOCK)
"""A clock slow enough to be walked through tick by tick; a tick is then up to half a pulse."""


@dataclass
class Generator:
    """Third differences of the position, in units of 1/(6 f³) pulse: all integers, exact."""

    sum: int = 0
    fired: int = 0
    tick: int = 0

    def run(self, ticks, v, a=0, j=0):
        """Speed v pulses/s, rate a pulses/s² and jerk j pulses/s³ at the start; yields (tick,
        count) of each pulse.
        """
        f, unit = CLOCK, 6 * CLOCK**3
        # P(n) = 6 f² v n + 3 f a n² + j n³
        first, second, third = 6 * f * f * v + 3 * f * a + j, 6 * f * a + 6 * j, 6 * j
        pulses = []
        for _ in range(ticks):
            self.sum += first
            first += second
            second += third
            self.tick += 1
            while 2 * self.sum > unit * (2 * self.fired + 1):
                self.fired += 1
                pulses.append((self.tick, self.fired))
            while 2 * self.sum < unit * (2 * self.fired - 1):
                self.fired -= 1
                pulses.append((self.tick, self.fired))
        return pulses


def held(train, pulses, late=0):
    """Every pulse of the card beside the generator's, which fires at the tick that ends the one of
    the crossing.
    """
    assert train.count.tolist() == [count for _, count in pulses]
    ticks = np.array([tick for tick, _ in pulses], int) + late
    assert np.all(np.abs(train.ticks - ticks) <= 1)
    assert np.all(np.diff(train.ticks) > 0)


counts = st.sampled_from([200, 400, 800, 1000, 2000])
steps = st.integers(1, 20)
small = settings(max_examples=40)


@given(
    i=steps,
    k=steps,
    up=counts,
    hold=counts,
    down=counts,
    sign=st.sampled_from([1, -1]),
    at=st.integers(-9, 9),
)
@small
def test_trapezoidal_moves(i, k, up, hold, down, sign, at):
    """Absolute and relative; ramps upwards and downwards."""
    v0, v1 = 200 * i, 200 * k
    r_up, r_down = ((v1 - v0) * CLOCK // ramp for ramp in (up, down))
    generator = Generator()
    pulses = [
        *generator.run(up, sign * v0, sign * r_up),
        *generator.run(hold, sign * v1),
        *generator.run(down, sign * v1, -sign * r_down),
    ]
    distance = generator.sum // (6 * CLOCK**3)
    assert distance * 6 * CLOCK**3 == generator.sum  # whole by the choice of numbers
    speeds = [v0], [v1], up / CLOCK, down / CLOCK
    for command in (TAMove([at + distance], *speeds), TRMove([distance], *speeds)):
        record = play(CARD, at_rest([at]), [(0.0, command)], 10.0)
        held(record.train(0), [(tick, at + count) for tick, count in pulses])
        assert record.states[-1].pulses(10.0)[0] == len(pulses)


@given(i=steps, k=steps, up=counts, hold=counts, down=counts, sign=st.sampled_from([1, -1]))
@small
def test_s_curve_moves(i, k, up, hold, down, sign):
    """Ramps all bent: jerk 4 Δ/T² upwards in the first half, downwards in the second."""
    v0, v1 = 200 * i, 200 * k
    middle = (v0 + v1) // 2
    generator, pulses = Generator(), []
    for ticks, u, w in ((up, v0, v1), (hold, v1, v1), (down, v1, v0)):
        rate, half = 2 * (w - u) * CLOCK // ticks, ticks // 2
        pulses += generator.run(half, sign * u, 0, sign * rate * CLOCK // half)
        pulses += generator.run(
            half, sign * middle if u != w else sign * u, sign * rate, -sign * rate * CLOCK // half
        )
    distance = generator.sum // (6 * CLOCK**3)
    assert distance * 6 * CLOCK**3 == generator.sum
    ramps = [v0], [v1], up / CLOCK, down / CLOCK
    for command in (SAMove([distance], *ramps), SRMove([distance], *ramps, 1e9, 1e9)):
        held(play(CARD, at_rest([0]), [(0.0, command)], 10.0).train(0), pulses)


@given(i=steps, k=steps, up=counts, hold=counts, sign=st.sampled_from([1, -1]))
@small
def test_s_curve_velocity_moves(i, k, up, hold, sign):
    """The ramp of an S-curve move, and then speed without end."""
    v0, v1 = 200 * i, 200 * k
    rate, half = 2 * (v1 - v0) * CLOCK // up, up // 2
    generator = Generator()
    pulses = [
        *generator.run(half, sign * v0, 0, sign * rate * CLOCK // half),
        *generator.run(half, sign * (v0 + v1) // 2, sign * rate, -sign * rate * CLOCK // half),
        *generator.run(hold, sign * v1),
    ]
    command = SVMove([sign * v0], [sign * v1], up / CLOCK)
    train = play(CARD, at_rest([0]), [(0.0, command)], (up + hold + 0.5) / CLOCK).train(0)
    held(train, pulses)


@given(speeds=st.lists(st.integers(-40, 40), min_size=2, max_size=5), ticks=counts, stop=counts)
@small
def test_velocity_moves_changes_and_stops(speeds, ticks, stop):
    """A train of changes through all speeds and signs, a stop on a ramp, and nothing after it."""
    v = [200 * of for of in speeds]
    dt, generator, pulses = ticks / CLOCK, Generator(), []
    for u, w in pairwise(v):
        pulses += generator.run(ticks, u, (w - u) * CLOCK // ticks)
    pulses += generator.run(stop, v[-1], -v[-1] * CLOCK // stop)
    sent = [
        (0.0, TVMove([v[0]], [v[1]], dt)),
        *((k * dt, VChange([w], dt)) for k, w in enumerate(v[2:], 1)),
    ]
    sent.append(((len(v) - 1) * dt, DStop(stop / CLOCK)))
    record = play(CARD, at_rest([0]), sent, 100.0)
    train = record.train(0)
    # at the very turn the two may differ by a pulse out and back within a tick
    if len(train.ticks) == len(pulses):
        held(train, pulses)
    else:
        extra = abs(len(train.ticks) - len(pulses))
        assert extra % 2 == 0
        assert extra <= 2 * len(v)
        assert train.count[-1] == generator.fired


@given(i=steps, ticks=counts, cut=st.integers(1, 150))
@small
def test_emergency_stop_fires_no_further_pulse(i, ticks, cut):
    generator = Generator()
    pulses = generator.run(cut, 200 * i)
    sent = [(0.0, TVMove([200 * i], [200 * i], ticks / CLOCK)), (cut / CLOCK, EStop())]
    train = play(CARD, at_rest([0]), sent, 10.0).train(0)
    # one that is due at the very tick of the stop may go either way
    assert abs(len(train.ticks) - len(pulses)) <= 1
    held_ = min(len(train.ticks), len(pulses))
    assert np.all(
        np.abs(train.ticks[:held_] - np.array([tick for tick, _ in pulses[:held_]], int)) <= 1
    )


@given(
    gap=st.sampled_from(
        [(300, -400), (-900, 0), (600, 0, 800), (20, -40, -40), (200, 400, 400, 800)]
    ),
    i=st.integers(1, 3),
)
@settings(max_examples=10)
def test_linear_interpolation_is_a_move_of_each_channel(gap, i):
    """Of vector speed V and whole length L, channel k runs at V·gap/L."""
    length = round(sum(of * of for of in gap) ** 0.5)
    v = 20 * i * length // int(np.gcd.reduce([length, *gap]))
    move = LinearMove(tuple(range(len(gap))), gap, v, v, 0.0, 0.0)
    record = play(CARD, at_rest(np.zeros(len(gap))), [(0.0, move)], 99.0)
    for k, of in enumerate(gap):
        held(
            record.train(k),
            Generator().run(round(length / v * CLOCK) + 1, v * of // length)[: abs(of)],
        )
