"""Errors of schedules along an axis and in space, against forward kinematics; the bounds on speeds behind them."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from benchmarks.evidence.trials.firing_rules import axis_error, draw_close_up, space_error
from planner.pulses import generate
from planner.pulses.generation.dda import DEFAULT_RATE
from planner.pulses.generation.pieces import bound_rate, fit
from planner.pulses.motion import axis_errors, space_errors


@pytest.fixture(scope="module")
def schedules(planned, hexapod):
    motion = planned("bare-circle", 2).trajectory
    return [generate(motion, hexapod.axes, hexapod.home_q, rule=rule) for rule in ("nearest", "floor", "dda")]


def test_errors_in_space_are_those_of_the_pose_that_the_counts_stand_for(planned, hexapod, schedules):
    """First order against the forward kinematics: it leaves out |δ|²/2r of rotations of some δ/100 mm."""
    motion = planned("bare-circle", 2).trajectory
    for schedule in schedules:
        t, error = space_errors(schedule, motion, hexapod)
        some = np.arange(0, len(t), 997)
        pulse = np.array([axis.pulse for axis in schedule.axes])
        state = motion.at(t[some])
        for i, count, pose in zip(some, schedule.counts(t[some]), state.pose, strict=True):
            true = hexapod.forward(hexapod.home_q + count * pulse, near=pose).pose
            off = np.linalg.norm(true.translation - pose.translation)
            assert error[i] == pytest.approx(off, abs=1e-10 + 50 * off**2)


def test_errors_of_an_axis_reach_what_the_rule_states(planned, schedules):
    motion = planned("bare-circle", 2).trajectory
    for schedule, least in zip(schedules, (0.499, 0.99, 50), strict=True):
        for k, axis in enumerate(schedule.axes):
            t, error = axis_errors(schedule, motion, k)
            assert (np.diff(t) >= 0).all()
            assert least < abs(error).max() <= axis.bound + 27e3 / schedule.clock_hz  # the travel of a tick


def test_figures_have_a_line_for_each_rule(planned, hexapod, schedules):
    motion = planned("bare-circle", 2).trajectory
    drawn = (
        axis_error(schedules, motion),
        draw_close_up(schedules, motion, 0.5, 0.501),
        space_error(schedules, motion, hexapod),
    )
    for ax in drawn:
        # dda tells the rate of its bursts: no axis states one
        assert [line.get_label() for line in ax.lines] == ["nearest", "floor", f"dda:rate={DEFAULT_RATE} 1/s"]
    levels = [line.get_ydata().max() for line in drawn[0].lines]
    assert levels == sorted(levels)
    assert levels[0] == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("times", [1, 2])
def test_no_rate_is_above_its_bound_and_one_comes_near(times):
    rng = np.random.default_rng(times)
    for _ in range(20):
        knots = np.concatenate(([0.0], np.cumsum(rng.uniform(0.01, 1, 4))))
        curve = PPoly(rng.normal(size=(6, 1, 1)), [0.0, knots[-1]])

        def at(t, curve=curve):
            return SimpleNamespace(
                s=t, **{"q" + n * "d": curve.derivative(n)(np.atleast_1d(t)) for n in range(3)}, qddd=0
            )

        pieces = fit(SimpleNamespace(knots=knots, duration=knots[-1], at=at), np.array([1e-9]))
        bound, where = bound_rate(pieces, 0, times)
        true = abs(curve.derivative(times)(np.linspace(0, knots[-1], 20_001)))[:, 0]
        # Above by 1/64 of what the control points of a piece have: those of a quintic are within its own size.
        assert true.max() <= bound * (1 + 1e-9) <= 1.05 * true.max()
        assert abs(curve.derivative(times)(where))[0] >= 0.9 * bound
