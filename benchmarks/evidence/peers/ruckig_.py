"""ruckig: L. Berscheid and T. Kröger, Jerk-limited Real-time Trajectory Generation, RSS 2021."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from benchmarks.evidence.peers.problems import SHARES, Motion, PathProblem
from kinematics.foundation.errors import NotInstalled


def find_trajectory(
    length: float,
    limits: Sequence[float],
    speeds: tuple[float, float] = (0.0, 0.0),
) -> Any:
    """Return ruckig's trajectory of one axis; limits: speed, acceleration and jerk."""
    try:
        from ruckig import InputParameter, Ruckig, Trajectory
    except ImportError as error:
        raise NotInstalled("the comparison", "ruckig", "peers") from error

    request = InputParameter(1)
    request.current_position, request.target_position = [0.0], [length]
    request.current_velocity, request.target_velocity = [speeds[0]], [speeds[1]]
    request.max_velocity, request.max_acceleration, request.max_jerk = ([limit] for limit in limits)
    trajectory = Trajectory(1)
    Ruckig(1).calculate(request, trajectory)
    return trajectory


def solve(problem: PathProblem) -> Callable[[], Motion]:
    """Find the fastest motion of one axis, along which its path is the axis itself."""
    trajectory = find_trajectory(problem.length, problem.bounds[:, 1, 0].tolist())
    return partial(_sample, problem, trajectory)


def _sample(problem: PathProblem, trajectory: Any) -> Motion:
    phases = trajectory.profiles[0][0]
    lengths = np.array(phases.t)
    starts = np.cumsum(lengths) - lengths
    t = (starts[:, None] + np.outer(lengths, SHARES)).ravel()
    s, v, a = np.array([trajectory.at_time(each) for each in t.tolist()])[:, :, 0].T
    return problem.motion(float(trajectory.duration), s, (v, a, np.repeat(phases.j, len(SHARES))))
