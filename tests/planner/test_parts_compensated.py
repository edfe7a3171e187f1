"""Plans in parts of machines that make up for play: the pulses are those of the whole motion."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics import load_machine
from planner import Line, Program, plan, plan_parts
from planner.plan_parts import come_to_rest
from planner.pulses import check

WALK = np.random.default_rng(1).uniform(-0.03, 0.03, (60, 3))


@pytest.fixture(scope="module")
def machine():
    cartesian = load_machine("cartesian")
    play = {"backlash": 2e-5, "take_up_acceleration": 20.0, "compensate": ("backlash",)}
    return cartesian.driven_by([replace(axis, **play) for axis in cartesian.axes])


@pytest.fixture(scope="module")
def program():
    return Program([Line(point) for point in WALK], name="walk")


@pytest.fixture(scope="module")
def whole(program, machine):
    return plan(program, machine, order=2)


@pytest.fixture(scope="module")
def parts(program, machine):
    return [*plan_parts(program, machine, order=2, pieces=12)]


def test_pulses_of_parts_are_those_of_the_whole(whole, parts):
    assert len(parts) > 3
    for k, axis in enumerate(whole.pulses.axes):
        ticks = np.concatenate([part.pulses.axes[k].ticks for part in parts])
        directions = np.concatenate([part.pulses.axes[k].direction for part in parts])
        assert len(ticks) == len(axis)
        # the durations of whole and parts differ by rounding
        assert np.abs(ticks - axis.ticks).max() <= 1
        np.testing.assert_array_equal(directions, axis.direction)


def test_every_crossing_of_the_play_is_stated(whole, parts):
    stated = come_to_rest(parts[-1]).pulses.compensations
    for one, other in zip(stated, whole.pulses.compensations, strict=True):
        assert one.crossings == other.crossings == len(one.windows) > 20
        np.testing.assert_allclose(one.windows, other.windows, rtol=0, atol=1e-6)


def test_an_axis_that_comes_back_after_its_motor_has_crossed_is_within_its_bound(machine):
    """Acceleration before and after a turn differ, so that the step ends before the axis is back.

    The seed gives a turn at which the axis was 0.60 pulses off, and 0.5 were stated.
    """
    points = np.random.default_rng(32).uniform([-0.03, -0.03, -0.009], [0.03, 0.03, 0.009], (60, 3))
    program = Program([Line(point) for point in points], name="walk")
    whole = plan(program, machine, order=2)
    assert check(whole.pulses, whole.counted, machine.axes, machine.home_q).holds
