"""Errors of schedules along an axis, and the bounds on speeds that they rest on."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from planner.pulses import generate
from planner.pulses.generation.pieces import bound_rate, fit


@pytest.mark.parametrize(("rule", "least"), [("nearest", 0.499), ("floor", 0.99), ("dda", 50)])
def test_errors_of_an_axis_reach_what_the_rule_states(planned, hexapod, rule, least):
    """They are largest right before and at a pulse."""
    motion = planned("bare-circle", 2).trajectory
    schedule = generate(motion, hexapod.axes, hexapod.home_q, rule=rule)
    for k, axis in enumerate(schedule.axes):
        x = (motion.at(axis.ticks / schedule.clock_hz).q[:, k] - axis.home) / axis.pulse
        error = max(np.abs(axis.counts(ticks) - x).max() for ticks in (axis.ticks - 1, axis.ticks))
        assert least < error <= axis.bound + 27e3 / schedule.clock_hz  # the travel of a tick


@pytest.mark.parametrize("times", [1, 2])
def test_no_rate_is_above_its_bound_and_one_comes_near(times):
    rng = np.random.default_rng(times)
    for _ in range(20):
        knots = np.concatenate(([0.0], np.cumsum(rng.uniform(0.01, 1, 4))))
        curve = PPoly(rng.normal(size=(6, 1, 1)), [0.0, knots[-1]])

        def at(t, curve=curve):
            return SimpleNamespace(
                s=t,
                **{"q" + n * "d": curve.derivative(n)(np.atleast_1d(t)) for n in range(3)},
                qddd=0,
            )

        pieces = fit(SimpleNamespace(knots=knots, duration=knots[-1], at=at), np.array([1e-9]))
        bound, where = bound_rate(pieces, 0, times)
        true = abs(curve.derivative(times)(np.linspace(0, knots[-1], 20_001)))[:, 0]
        # Above by 1/64 of what the control points of a piece have: those of a quintic are within
        # its own size.
        assert true.max() <= bound * (1 + 1e-9) <= 1.05 * true.max()
        assert abs(curve.derivative(times)(where))[0] >= 0.9 * bound
