"""Hosts: a counter is exact, sleep is late, and lateness adds up."""

import numpy as np
import pytest

from controllers.rig import Host, instants
from kinematics import MotionError


def test_a_counter_is_exact():
    np.testing.assert_array_equal(
        instants([Host()], "counter", 0.125, 40)[:, 0], np.arange(41) * 0.125
    )


def test_sleep_wakes_on_ticks_and_drifts_by_what_is_left_to_them():
    """100 ms on ticks of 15 ms are 7 ticks: 5 ms late every step, from the second on."""
    t = instants([Host("sleep", granularity=15e-3, seed=3)], "counter", 0.1, 50)[:, 0]
    steps = np.diff(t)
    assert 0.1 - 1e-12 <= steps[0] <= 0.115
    np.testing.assert_allclose(steps[1:], 0.105, rtol=1e-12)


def test_a_law_may_ask_for_sleep():
    host = Host(granularity=15e-3, seed=3)
    slept = instants([host], "sleep", 0.1, 50)
    np.testing.assert_array_equal(
        slept, instants([Host("sleep", 15e-3, seed=3)], "counter", 0.1, 50)
    )
    assert slept[-1, 0] > instants([host], "counter", 0.1, 50)[-1, 0] + 0.2


def test_jitter_alone_adds_half_of_itself_to_a_step():
    t = instants([Host("sleep", jitter=2e-3)], "counter", 0.1, 4000)[:, 0]
    late = np.diff(t) - 0.1
    assert late.min() >= -1e-9
    assert late.max() < 2e-3
    # the mean of 4000 even draws: 1 ms ± 4 standard errors
    assert late.mean() == pytest.approx(1e-3, abs=4 * 2e-3 / np.sqrt(12 * 4000))


def test_what_a_host_draws_is_its_own():
    hosts = [Host("sleep", 10e-3, 1e-3, seed) for seed in range(5)]
    every = instants(hosts, "counter", 0.1, 20)
    for b, host in enumerate(hosts):
        np.testing.assert_array_equal(every[:, b], instants([host], "counter", 0.1, 20)[:, 0])
    assert len({row[5] for row in every.T}) == 5


@pytest.mark.parametrize(
    ("host", "words"),
    [
        ({"timer": "clock"}, 'timer is "clock"; expected "counter" or "sleep"'),
        ({"granularity": -1.0}, "granularity"),
        ({"jitter": np.nan}, "jitter"),
        ({"seed": -1}, "seed"),
        ({"speed_from": "drive"}, 'speed_from is "drive"; expected "encoder" or "card"'),
        ({"closing_stop": -1e-3}, "closing stop"),
        ({"closing_stop": np.nan}, "closing stop"),
    ],
)
def test_impossible_hosts_are_refused(host, words):
    with pytest.raises(MotionError, match=words):
        Host(**host)
