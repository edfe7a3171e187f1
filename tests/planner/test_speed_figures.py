"""The speed along the path that figures show is the tool's, whatever parameter the path has."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.interpolate import PPoly

from kinematics import load_machine
from planner import Blend, Fit, Line, Program, Spline, plan, time_optimal
from planner.figures import path_speed
from planner.overview import TOOL_SPEED, Overview

CAP = 60e-3


def zigzag(join):
    """Lines of 4 mm that turn by 90° each; the corners are rounded, which is shorter than the
    corner.
    """
    points = [(4 * ((n + 1) // 2), 4 * (n // 2), 0) for n in range(1, 9)]
    lines = [Line(1e-3 * np.array(point), join=join) for point in points[:-1]]
    return Program((*lines, Line(1e-3 * np.array(points[-1]))), speed=CAP)


def curve():
    """A spline whose parameter is the length of its chords."""
    angle = np.linspace(0, np.pi, 7)[1:]
    points = 10e-3 * np.column_stack([np.sin(angle), 1 - np.cos(angle), 0 * angle])
    return Program((Spline(points),), speed=CAP)


PROGRAMS = {"blends": zigzag(Blend(0.5e-3)), "fit": zigzag(Fit(0.5e-3)), "spline": curve()}


@pytest.fixture(scope="module", params=PROGRAMS)
def trajectory(request):
    return plan(PROGRAMS[request.param], load_machine("cartesian"), order=2).trajectory


def drawn_speed(trajectory):
    ax = Figure().add_subplot()
    path_speed(trajectory, ax)
    (line,) = ax.lines
    assert ax.get_ylabel().startswith("speed along the path")
    return line.get_data()


def test_the_speed_that_is_drawn_stays_below_the_cap(trajectory):
    t, speed = drawn_speed(trajectory)
    assert speed.max() <= 1e3 * CAP * (1 + 1e-6)
    assert speed.max() > 1e3 * CAP * 0.9
    # and is that of the positions, by central differences
    step = 1e-6
    inside = np.linspace(10 * step, trajectory.duration - 10 * step, 300)
    ahead, behind = (trajectory.at(inside + side).pose.translation for side in (step, -step))
    own = 1e3 * np.linalg.norm(ahead - behind, axis=1) / (2 * step)
    np.testing.assert_allclose(np.interp(inside, t, speed), own, atol=0.02 * 1e3 * CAP)


def test_the_overview_of_long_programs_has_the_tools_speed(trajectory):
    overview = Overview()
    overview.add(trajectory, 0.0, 0.0)
    _, low, high = overview.column(TOOL_SPEED)
    assert high.max() <= CAP * (1 + 1e-6)
    assert high.max() > 0.9 * CAP
    assert low.min() == pytest.approx(0, abs=1e-9)


def test_without_a_machine_it_is_the_parameters():
    way = PPoly(np.array([[[1.0]], [[0.0]]]), [0.0, 1.0])
    solution = time_optimal(way, max_speed=0.5, max_acceleration=2.0)
    ax = Figure().add_subplot()
    path_speed(solution.trajectory, ax)
    assert ax.lines[0].get_ydata().max() == pytest.approx(0.5)
    assert ax.get_ylabel() == "speed along the path (1/s)"
