"""Laws side by side: what each does alone, and refused where one batch cannot hold them."""

import numpy as np
import pytest

from controllers import evaluate, find_law, track
from controllers.metrics.evaluate import evaluate_each
from controllers.tracking import SideBySide, track_each
from kinematics import MotionError, load_machine
from planner import Line, Program, plan

SAME = 1e-12
"""Of a value, as in a batch of other runs (test_simulate_batches)."""


@pytest.fixture(scope="module")
def planned():
    return plan(
        Program((Line((0.0, 0.0, 0.002)), Line((0.001, 0.0, 0.002)))), load_machine("hexapod")
    )


@pytest.mark.parametrize("names", [("3", "6"), ("6", "6r", "3"), ("1",)])
def test_each_is_as_it_is_alone(planned, names):
    machine, laws = planned.machine, [find_law(name) for name in names]
    together = track_each(planned, machine, laws, period=1e-3)
    for own, found, errors in zip(
        laws, together, evaluate_each(together, planned, machine), strict=True
    ):
        alone = track(planned, machine, own, period=1e-3)
        assert found.law == alone.law
        for name in ("t", "reference", "command", "pulses"):
            np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))
        np.testing.assert_allclose(found.actual, alone.actual, rtol=SAME)
        expected = evaluate(alone, planned, machine)
        for mine, theirs in zip(errors.series, expected.series, strict=True):
            np.testing.assert_allclose(mine.value, theirs.value, rtol=0, atol=SAME)
            assert mine.rms == pytest.approx(theirs.rms, rel=1e-9)


def test_laws_that_send_different_commands_are_refused(planned):
    with pytest.raises(MotionError, match="different commands"):
        track_each(planned, planned.machine, [find_law("1"), find_law("3")])


def test_laws_of_hosts_that_wait_differently_are_refused():
    with pytest.raises(MotionError, match="different timing"):
        SideBySide((find_law("1"), find_law("2")))
