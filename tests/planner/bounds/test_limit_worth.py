"""What limits are worth: closed forms, kinks, and planning again with a limit one per cent
higher.
"""

import numpy as np
import pytest
from scipy.interpolate import PPoly

from kinematics import MotionError, load_machine
from planner import load_program, plan, time_optimal
from planner.bounds import ALL, find_worth


@pytest.fixture(scope="module")
def circle(plan_bundled):
    return {order: plan_bundled("bare-circle", "hexapod", order).worth for order in (2, 3)}


def straight(*lengths):
    return PPoly(np.array([[lengths], [[0.0 for _ in lengths]]]), np.array([0.0, 1.0]))


def worth_of(path, **limits):
    found = time_optimal(path, **limits)
    return find_worth(found.trajectory, found.limits, found.order, found.certificate, found.bound)


def test_a_trapezoid_in_closed_form():
    length, speed, acceleration = 3.0, 1.2, 2.0
    worth = worth_of(straight(length), max_speed=speed, max_acceleration=acceleration)
    assert worth.of("speed") == pytest.approx(
        0.01 * (length / speed - speed / acceleration), rel=5e-3
    )
    assert worth.of("acceleration") == pytest.approx(0.01 * speed / acceleration, rel=5e-3)
    # without a stretch of full speed: T = 2 √(L/A)
    worth = worth_of(straight(length), max_speed=10.0, max_acceleration=acceleration)
    assert worth.of("acceleration") == pytest.approx(
        0.01 * np.sqrt(length / acceleration), rel=5e-3
    )
    assert worth.of("speed") == pytest.approx(0.0, abs=1e-6)
    assert worth.best == ("acceleration", "axis1")


def test_an_s_curve_in_closed_form():
    """T = L/V + V/A + A/J where each of V and A is reached."""
    length, speed, acceleration, jerk = 3.0, 1.2, 2.0, 10.0
    worth = worth_of(
        straight(length), max_speed=speed, max_acceleration=acceleration, max_jerk=jerk
    )
    assert worth.of("speed") == pytest.approx(
        0.01 * (length / speed - speed / acceleration), rel=1e-2
    )
    assert worth.of("acceleration") == pytest.approx(
        0.01 * (speed / acceleration - acceleration / jerk), rel=1e-2
    )
    assert worth.of("jerk") == pytest.approx(0.01 * acceleration / jerk, rel=1e-2)


def test_of_two_axes_that_move_alike_one_alone_saves_nothing():
    worth = worth_of(straight(3.0, 3.0), max_speed=1.2, max_acceleration=2.0)
    for limit, least in (("speed", 0.019), ("acceleration", 0.006)):
        assert worth.of(limit, "axis1") == pytest.approx(0.0, abs=1e-5)
        assert worth.of(limit, ALL) == pytest.approx(least, rel=1e-2)
        assert worth.replan(limit, "axis1", 0.01).saved == pytest.approx(0.0, abs=1e-7)
    # of axes that differ by half a per cent, the slower one gains half a per cent
    worth = worth_of(straight(3.0, 2.985), max_speed=1.2, max_acceleration=2.0)
    assert worth.of("speed", "axis1") == pytest.approx(0.019 / 2, rel=1e-2)
    assert worth.of("speed", "axis1") == pytest.approx(
        worth.replan("speed", "axis1", 0.01).saved, rel=2e-2
    )
    assert worth.of("speed", "axis2") == 0.0


@pytest.mark.parametrize("order", [2, 3])
def test_planned_again_with_one_per_cent_more_it_saves_as_much(circle, order):
    worth = circle[order]
    every = [
        *((limit, ALL) for limit in dict.fromkeys(worth.limits)),
        ("speed", "leg1"),
        ("speed", "leg4"),
    ]
    for limit, axis in every:
        if worth.of(limit, axis) > 3e-4 * worth.trajectory.duration:
            again = worth.replan(limit, axis, 0.01)
            assert again.saved == pytest.approx(worth.of(limit, axis), rel=0.1)
            assert again.predicted == pytest.approx(worth.of(limit, axis))
            assert again.solution.certificate.holds
    assert worth.explained == pytest.approx(1.0, abs=2e-3)


def test_rows_add_up_along_the_path_and_over_the_axes(circle):
    worth = circle[3]
    assert worth.along.sum(1) == pytest.approx(worth.together)
    of = np.array(worth.limits)
    for limit in ("speed", "acceleration", "jerk"):
        own = [k for k in np.flatnonzero(of == limit) if worth.axes[k] != ALL]
        assert worth.together[own].sum() == pytest.approx(worth.of(limit), rel=1e-6)
        assert (worth.saved[own] <= worth.together[own] * (1 + 1e-12)).all()
    assert worth.of("force", "leg1") == 0.0
    assert "force" in worth.tables()[0].notes[0]


def test_a_change_of_twenty_per_cent_is_planned_and_not_predicted(circle):
    change = circle[3].replan("speed", "leg1", 0.2)
    assert 0 < change.saved < change.predicted
    assert change.solution.trajectory.duration + change.saved == circle[3].trajectory.duration
    assert "planned again" in change.describe()
    lower = circle[3].replan("speed", "leg1", -0.2)
    assert lower.saved < 0
    assert "costs" in lower.describe()


def test_what_cannot_be_changed_is_refused(circle):
    worth = circle[3]
    for limit, axis, by, words in (
        ("sped", ALL, 0.1, 'nearest is "speed"'),
        ("tilt", ALL, 0.1, "no limit 'tilt'"),
        ("speed", "leg9", 0.1, "nearest is"),
        ("speed", ALL, -1.0, "above -1"),
        ("speed", ALL, np.nan, "above -1"),
    ):
        with pytest.raises(MotionError, match=words):
            worth.replan(limit, axis, by)
    with pytest.raises(MotionError, match="timing"):
        next(each for each in worth.constraints if each.geometric).scale(1.1)


def test_a_stated_duration_is_worth_nothing():
    found = plan(load_program("bare-circle"), load_machine("hexapod"), order=2, duration=2.0)
    assert found.worth is None
