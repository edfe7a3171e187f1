"""A run whose answer has to be slowed as a whole is the fastest of all that was found for it."""

import numpy as np
from scipy.interpolate import CubicSpline

from planner import time_optimal
from planner.timing import attempts


def test_what_a_solver_started_from_is_taken_where_its_answer_has_to_be_slowed_more(monkeypatch):
    """1 mm at 10⁻³ mm/s on the hexapod took 1117 s so, 1005 as the averaged start."""
    s = np.linspace(0, 3, 6)
    path = CubicSpline(s, np.stack([np.sin(s), np.cos(s)], 1))
    limits = {"max_speed": 1.0, "max_acceleration": 4.0, "max_jerk": 40.0}
    best, solve = time_optimal(path, **limits), attempts.solve_jerk_limited

    def slowed(*args, **kwargs):
        return solve(*args, **kwargs).slowed(1.5)

    monkeypatch.setattr(attempts, "solve_jerk_limited", slowed)
    found = time_optimal(path, **limits)
    assert found.certificate.holds
    assert found.methods[0].startswith("averaged")
    assert found.trajectory.duration < 1.2 * best.trajectory.duration
