"""Plans in parts of machines that may cross bands of resonance: no stay in a band spans a seam."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics import load_machine
from planner import Blend, Line, Program, plan, plan_parts
from planner.certificate import CROSSING

BAND = (0.02, 0.03)
TIME = 0.03


@pytest.fixture(scope="module")
def machine():
    cartesian = load_machine("cartesian")
    resonant = {"resonance": (BAND,), "resonance_time": TIME}
    return cartesian.driven_by([replace(axis, **resonant) for axis in cartesian.axes])


@pytest.fixture(scope="module")
def program():
    """A zigzag of round corners, on which X changes its speed all the time."""
    t = np.linspace(0, 2.5 * np.pi, 50)[1:]
    points = np.stack([0.004 * np.sin(t) + 0.0015 * t, 0.004 * np.sin(0.7 * t), 0 * t], 1)
    return Program([Line(point, join=Blend(2e-5)) for point in points], name="zigzag")


@pytest.mark.parametrize("order", [2, 3])
def test_no_axis_stays_in_a_band_for_longer_than_it_may(program, machine, order):
    whole = plan(program, machine, order=order)
    parts = [*plan_parts(program, machine, order=order, pieces=16)]
    assert len(parts) > 2
    standing = parts[-1].standing
    assert standing.certificate.holds
    assert standing.certificate.worst[CROSSING] <= 1
    assert whole.certificate.worst[CROSSING] > 0.3
    assert standing.duration == pytest.approx(whole.duration, rel=2e-3)

    # by samples of the joined motion, over all seams
    step = 2e-5
    speeds = [np.abs(part.motion.at(np.arange(0, part.motion.duration, step)).qd) for part in parts]
    inside = (np.concatenate(speeds) >= BAND[0]) & (np.concatenate(speeds) <= BAND[1])
    for axis in inside.T:
        edges = np.diff(np.concatenate([[0], axis, [0]]).astype(int))
        stays = np.flatnonzero(edges < 0) - np.flatnonzero(edges > 0)
        assert stays.max(initial=0) * step <= TIME + 2 * step
    for part in parts[:-1]:
        seam = np.abs(part.motion.at(part.motion.duration).qd[0])
        assert not ((seam >= BAND[0]) & (seam <= BAND[1])).any()
