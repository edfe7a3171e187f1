"""Motions far shorter than what limits allow in a moment."""

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.evidence.random_problems import RandomProblem


def tiny_problems(order):
    """Return motions of 1e-7 to 1e-4 under limits of 100 to 10 000, which defeat toppra's solver
    Seidel.
    """
    problems = []
    for length in (1e-7, 1e-6, 1e-5, 1e-4):
        for limit in (100.0, 1000.0, 10_000.0):
            points = np.array([[0.0, 0.0], [0.6, 0.3], [1.0, 1.0]]) * length
            curve = CubicSpline([0.0, 0.5, 1.0], points)
            bound = np.full(2, limit)
            jerk = 100 * bound if order == 3 else None
            problems.append(RandomProblem(f"{length:g} under {limit:g}", curve, bound, bound, jerk))
    return problems
