"""The step queue: every pulse within its tolerance, by an independent decoder; nearly as long as
commands can be.
"""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from kinematics import MotionError
from planner.pulses import AxisPulses, compress, decompress
from tests.planner.pulses.longest_commands import find_longest_commands


def axis_of(gaps, signs=None, first=50_000):
    ticks = first + np.concatenate([[0], np.cumsum(gaps, dtype=np.int64)])
    signs = np.ones(len(ticks)) if signs is None else np.asarray(signs)
    return AxisPulses("leg", ticks, signs.astype(np.int8), 0, 1e-6, 0.0)


def decode(queue):
    """Pulse k (from 0) of a command falls at first + k·interval + add·k(k+1)/2, first = last +
    interval.
    """
    ticks, signs, last = [], [], 0
    for interval, count, add, sign, reset in zip(
        *(
            getattr(queue, name).tolist()
            for name in ("interval", "count", "add", "direction", "reset")
        ),
        strict=True,
    ):
        assert 0 <= interval < 2**31  # further ahead is past to firmware
        assert 1 <= count <= 65535
        assert -(2**15) <= add < 2**15
        last = last if reset < 0 else reset
        first = last + interval
        ticks += [first + k * interval + add * k * (k + 1) // 2 for k in range(count)]
        signs += [sign] * count
        last = ticks[-1]
    return np.array(ticks, np.int64), np.array(signs)


def assert_kept(axis, queue, tolerance, least=1):
    ticks, signs = decode(queue)
    assert len(ticks) == len(axis)
    assert (signs == axis.direction).all()
    assert abs(ticks - axis.ticks).max(initial=0) <= tolerance
    assert np.diff(ticks).min(initial=least) >= least
    held = decompress(queue)
    assert (held[0] == ticks).all()
    assert (held[1] == signs).all()


@st.composite
def axes(draw):
    """Gaps that are smooth, ragged, of one tick, or longer than an interval can be; runs of either
    direction.
    """
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    parts = [[draw(st.integers(1, 50_000))]]
    for kind in draw(
        st.lists(
            st.sampled_from(["smooth", "ragged", "close", "far", "even"]), min_size=1, max_size=4
        )
    ):
        n = int(random.integers(1, 200))
        base = 10 ** random.uniform(0.5, 5)
        smooth = base * (
            1 + np.sin(np.linspace(0, random.uniform(0, 9), n)) * random.uniform(0, 0.95)
        )
        ways = {
            "smooth": smooth,
            "ragged": random.integers(1, 10**4, n),
            "close": random.integers(1, 3, n),
            "far": random.integers(2**31, 2**34, min(n, 3)),
            "even": np.full(n, base),
        }
        parts.append(np.maximum(1, np.rint(ways[kind])).astype(np.int64))
    gaps = np.concatenate(parts)
    turns = np.cumsum(random.random(len(gaps) + 1) < random.choice([0.0, 0.02, 0.5])) % 2
    return axis_of(gaps, 1 - 2 * turns, first=draw(st.sampled_from([0, 1, 70_000, 2**33])))


@settings(deadline=None, max_examples=15)
@given(
    st.lists(axes(), min_size=1, max_size=3),
    st.sampled_from([0, 1, 3, 10, 100, 2500, 10**5]),
    st.booleans(),
)
@example(
    [axis_of([3] * 9000)], 2500, True
)  # blocks end among pulses that tolerance would let pass each other
def test_any_pulses_are_kept_within_the_tolerance_in_order_and_apart(axes, tolerance, apart):
    least = min(int(np.diff(axis.ticks).min()) for axis in axes) if apart else 1
    for axis, queue in zip(axes, compress(axes, tolerance, least), strict=True):
        assert_kept(axis, queue, tolerance, least)


@settings(deadline=None, max_examples=15)
@given(axes(), st.sampled_from([1, 10, 100]))
def test_few_commands_more_than_an_exhaustive_search_needs(axis, tolerance):
    (queue,) = compress([axis], tolerance)
    assert_kept(axis, queue, tolerance)
    near = len(axis) if np.diff(axis.ticks).max() < 2**31 else 0
    if near and axis.ticks[0] < 2**31:  # the exhaustive search knows no resets
        commands = len(find_longest_commands(axis, tolerance))
        blocks = 1 + len(axis) // 128
        # one for the first pulse, less than one for each block, and a tenth
        assert len(queue) <= 1.1 * commands + 1 + blocks


@pytest.mark.parametrize(("micro", "pulses"), [(1, 10_000), (10, 10_000), (25, 10_000)])
def test_nine_tenths_of_an_exhaustive_search_on_the_hexapod(planned, micro, pulses):
    """The program `circle` at 10 MHz, from the middle of two legs."""
    legs = []
    for leg in planned("circle", None).pulses.axes[1:5:3]:
        middle = slice(len(leg) // 2 - pulses // 2, len(leg) // 2 + pulses // 2)
        start = leg.ticks[middle][0] - 1000
        legs.append(replace(leg, ticks=leg.ticks[middle] - start, direction=leg.direction[middle]))
    queues = compress(legs, 10 * micro)
    found = sum(len(queue) for queue in queues)
    least = sum(len(find_longest_commands(leg, 10 * micro)) for leg in legs)
    assert least >= 0.9 * found
    for leg, queue in zip(legs, queues, strict=True):
        assert_kept(leg, queue, 10 * micro)


def test_the_exhaustive_search_keeps_its_own_promise():
    """What the ratio is measured against is sound: within the tolerance, and no command can be
    longer.
    """
    random = np.random.default_rng(3)
    axis = axis_of(np.rint(400 + 200 * np.sin(np.linspace(0, 6, 300)) + random.normal(0, 2, 300)))
    last, at = 0, 0
    for interval, count, add in find_longest_commands(axis, 6):
        k = np.arange(count)
        ticks = last + (k + 1) * interval + add * (k * (k + 1) // 2)
        assert abs(ticks - axis.ticks[at : at + count]).max() <= 6
        if at + count < len(axis) and count > 3:
            # every interval and add near: none serves one pulse more
            j = np.arange(1, count + 2)
            wanted = axis.ticks[at : at + count + 1] - last
            tried = wanted[0] + np.arange(-6, 7)[:, None, None], np.arange(-40, 41)[:, None]
            off = abs(tried[0] * j + tried[1] * (j * (j - 1) // 2) - wanted).max(axis=2)
            assert off.min() > 6
        last, at = int(ticks[-1]), at + count


def test_pieces_of_bounded_memory_make_the_same_queue(monkeypatch):
    random = np.random.default_rng(1)
    legs = [
        axis_of(400 + random.integers(0, 9, 5000), random.choice([-1, 1], 5001)) for _ in range(3)
    ]
    whole = compress(legs, 5)
    monkeypatch.setattr(import_module("planner.pulses.compression"), "PIECE_PULSES", 300)
    for leg, queue, one in zip(legs, compress(legs, 5), whole, strict=True):
        assert_kept(leg, queue, 5)
        assert (queue.count == one.count).all()


def test_even_pulses_need_as_few_commands_as_their_counts_allow():
    axis = axis_of(np.full(200_000, 250))
    (queue,) = compress([axis], 0)
    assert_kept(axis, queue, 0)
    assert len(queue) <= 1 + 2 * np.ceil(200_000 / 65535)


def test_even_growth_is_one_command_without_any_tolerance():
    """Gaps 1000, 997, 994, …: interval and add say it all."""
    axis = axis_of(1000 - 3 * np.arange(120))
    (queue,) = compress([axis], 0)
    assert [queue.interval[1:].tolist(), queue.count.tolist(), queue.add[1:].tolist()] == [
        [1000],
        [1, 120],
        [-3],
    ]


def test_waits_longer_than_an_interval_reset_the_clock():
    axis = axis_of([100, 2**31 - 5, 100, 2**40, 90], first=2**35)
    (queue,) = compress([axis], 10)
    assert_kept(axis, queue, 10)
    assert queue.reset[queue.reset >= 0].tolist() == axis.ticks[[0, 2, 4]].tolist()


def test_axes_without_pulses_and_with_one():
    silent = replace(axis_of([]), ticks=np.empty(0, np.int64), direction=np.empty(0, np.int8))
    none, one = compress([silent, axis_of([], first=0)], 10)
    assert len(none) == 0
    assert len(decompress(none)[0]) == 0
    assert_kept(axis_of([], first=0), one, 0)
    assert compress([], 10) == ()


@pytest.mark.parametrize(
    ("axis", "tolerance", "least", "told"),
    [
        (
            axis_of([5, 4, 5]),
            1,
            5,
            "axis leg: the pulses at ticks 50005 and 50009 are 4 ticks apart, limit 5",
        ),
        (axis_of([0]), 1, 1, "0 ticks apart"),
        (axis_of([9], first=-1), 1, 1, "first pulse is at tick -1"),
        (axis_of([9]), -1, 1, "tolerance -1"),
        (axis_of([9]), 1, 0, "least interval 0"),
    ],
)
def test_what_cannot_be_kept_is_refused(axis, tolerance, least, told):
    with pytest.raises(MotionError, match=told):
        compress([axis], tolerance, least)
