"""toppra: H. Pham and Q.-C. Pham, IEEE T-RO 34 (2018) 645–659."""

from typing import Any

import numpy as np

from kinematics.foundation.arrays import Array

PARAMETRIZERS = {"spline": "ParametrizeSpline", "pieces": "ParametrizeConstAccel"}
"""Trajectories that toppra makes from speeds at grid points: splines by default, or constant s̈."""


def installed_solvers() -> set[str]:
    """Return the names of the solvers that toppra can use."""
    import toppra

    toppra.setup_logging("CRITICAL")
    solvers = toppra.solverwrapper.available_solvers(output_msg=False)
    return {name for name, installed in solvers if installed}


def find_trajectory(
    curve: tuple[Array, Array],
    limits: tuple[Array, Array],
    duration: float,
    method: tuple[str, int],
    kind: str,
) -> Any:
    """Return toppra's trajectory along a clamped spline, None where it has none.

    curve     parameters (N,) and waypoints (N, n); limits  (n,) of speed and acceleration
    duration  s to take, 0 for the least
    method    name of a solver, and number of grid points
    kind      a key of `PARAMETRIZERS`
    """
    from toppra import SplineInterpolator, algorithm, constraint

    speed, acceleration = (np.stack([-limit, limit], 1) for limit in limits)
    scheme = constraint.DiscretizationType.Interpolation
    constraints = [
        constraint.JointVelocityConstraint(speed),
        constraint.JointAccelerationConstraint(acceleration, discretization_scheme=scheme),
    ]
    solver, points = method
    solve = algorithm.TOPPRAsd if duration > 0 else algorithm.TOPPRA
    instance = solve(
        constraints,
        SplineInterpolator(*curve, bc_type="clamped"),
        gridpoints=np.linspace(curve[0][0], curve[0][-1], points),
        solver_wrapper=solver,
        parametrizer=PARAMETRIZERS[kind],
    )
    if duration > 0:
        instance.set_desired_duration(duration)
    return instance.compute_trajectory(0, 0)
