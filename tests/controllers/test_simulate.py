"""The whole loop: times, units, and what is refused."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from controllers.card import Refused
from controllers.drives.servo import leg_servo
from controllers.laws.closed_loop import ClosedPosition
from controllers.laws.open_loop import OpenPosition
from controllers.simulate import sample
from kinematics import MotionError
from tests.controllers.servos import track

PULSE = 0.75e-6


def test_steady_following_error_is_speed_over_gain(rig, axis_motion):
    """v/Kv at the constant speed of the quarter-sine, to the steps of command (1 pulse) and encoder
    (1/8 pulse).
    """
    motion = axis_motion("quarter-sine", (40_000, -25_000, 10_000), duration=2.0)
    tracking = track(motion, rig, OpenPosition())
    middle = (tracking.t > 1.2) & (tracking.t < 1.5)
    error = (tracking.reference - tracking.actual)[middle]
    speed = motion.at(np.array([1.0])).qd[0]
    assert np.abs(error - speed / 30).max() <= 1.2 * PULSE


def test_instants_are_those_of_the_drives_and_reach_past_the_settling(rig, axis_motion):
    tracking = track(axis_motion("smooth", duration=0.333), rig, OpenPosition(), settle=0.2)
    np.testing.assert_allclose(np.diff(tracking.t), 0.25e-3, rtol=1e-9)
    assert 0.333 + 0.2 <= tracking.t[-1] + 0.25e-3 <= 0.333 + 0.2 + 2 * tracking.dt
    assert (
        tracking.reference.shape
        == tracking.command.shape
        == tracking.actual.shape
        == (len(tracking.t), 3)
    )
    np.testing.assert_array_equal(
        tracking.reference[-1], axis_motion("smooth", duration=0.333).at(1.0).q
    )


def test_results_are_values(rig, axis_motion):
    tracking = track(axis_motion("smooth"), rig, OpenPosition(), settle=0.1)
    for name in ("t", "reference", "command", "actual", "pulses"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(tracking, name)[0] = 0


def test_command_is_whole_pulses_from_home(rig, axis_motion):
    counts = (track(axis_motion("smooth"), rig, ClosedPosition()).command - rig.home_q) / PULSE
    # a coordinate of 0.3 m is rounded to 5e-17 m
    assert np.abs(counts - np.rint(counts)).max() < 1e-9


def test_a_plan_is_tracked_by_its_trajectory(rig, axis_motion):
    motion = axis_motion("smooth")
    a, b = (
        track(what, rig, OpenPosition(), settle=0.1)
        for what in (motion, SimpleNamespace(trajectory=motion))
    )
    np.testing.assert_array_equal(a.actual, b.actual)


def test_a_plan_may_start_away_from_home(rig, axis_motion):
    """The axes and the counters stand at the start when the motion begins: no jump, whatever the
    start.
    """
    motion = axis_motion("smooth")
    shifted = replace(motion, home=motion.home + np.array([0.01, -0.02, 0.03]))
    a, b = track(motion, rig, OpenPosition()), track(shifted, rig, OpenPosition())
    # 0.01 m and the others are no whole pulses: the grid of the counters lies elsewhere
    assert np.abs((b.actual - b.reference) - (a.actual - a.reference)).max() < 3 * PULSE


def test_servos_may_differ_by_axis(rig, axis_motion):
    motion = axis_motion("smooth", (10_000, 10_000, 10_000))
    plain = leg_servo(rig.axes[0])
    gains = (15.0, 30.0, 60.0)
    tracking = track(
        motion, rig, OpenPosition(), servo=[replace(plain, position_gain=gain) for gain in gains]
    )
    rms = np.sqrt(np.mean((tracking.reference - tracking.actual) ** 2, 0))
    assert rms[0] > 1.5 * rms[1] > 2.25 * rms[2]


def test_reference_speed_is_the_derivative_of_its_position(rig, axis_motion):
    """What a law sees: the trapezoid rule over the speeds gives the positions, to dt² q̈/12; `ang`
    in whole pulses.
    """
    motion, dt = axis_motion("smooth"), 1e-3
    reference = sample(motion, rig, dt)
    assert reference.steps == 1000
    summed = np.cumsum((reference.speed[1:] + reference.speed[:-1]) / 2 * dt, 0)
    np.testing.assert_allclose(summed, reference.position[1:], atol=20_000 * 7.6 * dt**2 / 12)
    np.testing.assert_array_equal(reference.ang(500), np.rint(reference.position[500]))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"dt": 0.6e-3}, "0.5 ms"),
        ({"dt": 1e-5}, "0.25 ms"),
        ({"dt": np.nan}, "dt nan s"),
        ({"dt": 0.0}, "dt 0 s"),
        ({"settle": -0.1}, "settle -0.1 s"),
        ({"servo": []}, "0 drives for the 3 axes"),
    ],
)
def test_misfits_are_refused(rig, axis_motion, change, reason):
    with pytest.raises(MotionError, match=reason):
        track(axis_motion("smooth"), rig, OpenPosition(), **change)


def test_a_motion_beyond_the_card_is_refused(rig, axis_motion):
    """4e6 pulses in a second need 8.75e6 pulses/s at the middle; then a way of 2e6 that ends beyond
    the counter.
    """
    with pytest.raises(Refused, match=r"channel 2: max speed .*2400000"):
        track(axis_motion("smooth", (1000, -4_000_000, 0)), rig, OpenPosition())
    motion = axis_motion("smooth", (0, 0, 2e6), duration=2.0)
    far = replace(motion, home=motion.home + np.array([0, 0, (2**27 - 1e6) * PULSE]))
    with pytest.raises(Refused, match=r"channel 3: position .* 28-bit"):
        track(far, rig, OpenPosition())
