"""ruckig (the only file that imports it): straight jerk-limited moves. Berscheid and Kröger, RSS 2021."""

from collections.abc import Iterator

import numpy as np

from benchmarks.evidence.peers.case import (
    SAMPLE_SHARES,
    Case,
    MotionSamples,
    PeerAnswer,
    PeerMotion,
    answer,
    failed_answer,
    is_installed,
)


def solve_by_ruckig(case: Case) -> Iterator[PeerAnswer]:
    """One axis: its path is the axis itself."""
    if is_installed("ruckig"):
        yield answer(case, 3, "ruckig", None, lambda: _solve(case))
    else:
        yield failed_answer(case, 3, "ruckig", None, "absent")


def _solve(case: Case) -> PeerMotion:
    from ruckig import InputParameter, Ruckig, Trajectory

    asked = InputParameter(1)
    asked.current_position, asked.target_position = [0.0], [case.length]
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = (bound.tolist() for bound in case.bounds)
    trajectory = Trajectory(1)
    Ruckig(1).calculate(asked, trajectory)
    profile = trajectory.profiles[0][0]
    h, j = np.array(profile.t), np.array(profile.j)
    starts = np.append(0.0, np.cumsum(h))[:-1]
    s, v, a = np.array([trajectory.at_time(t) for t in (starts[:, None] + h[:, None] * SAMPLE_SHARES).ravel()])[
        :, :, 0
    ].T
    return float(trajectory.duration), MotionSamples(s, v, a, np.repeat(j, len(SAMPLE_SHARES)), np.zeros(len(s), int))
