"""Quadratic programs by OSQP: min ½ wᵀP w + qᵀw over l ≤ A w ≤ u, whose P and A stay while the vectors change."""

from __future__ import annotations

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError

_INITIAL_RHO = 1.0
"""OSQP's rho at the start of every solve."""
_SETTINGS = {
    "verbose": False,
    "eps_abs": 1e-6,
    "eps_rel": 1e-9,
    "max_iter": 20_000,
    # by iterations, not by time: the same vectors give the same result on any day
    "adaptive_rho": 1,
    "adaptive_rho_interval": 25,
    # it would print a line of its own for every solve without active limits
    "polishing": False,
}


class QuadraticProgram:
    """A program set up once: P (N, N) positive definite and A (M, N), dense or sparse, are factorized here."""

    def __init__(self, what: str, P: Array, A: Array) -> None:
        import osqp
        from scipy.sparse import csc_matrix, triu

        self._what = what
        rows, columns = A.shape
        self._solver = osqp.OSQP()
        self._solver.setup(
            csc_matrix(triu(csc_matrix(P))),
            np.zeros(columns),
            csc_matrix(A),
            np.full(rows, -np.inf),
            np.full(rows, np.inf),
            **_SETTINGS,
        )
        self._still = np.zeros(rows)

    def solve(self, q: Array, low: Array, high: Array, guess: Array) -> Array:
        """The minimum w (N,), started from `guess`. Raises MotionError where OSQP finds none within the limits."""
        # the result is a function of the vectors alone, not of what was solved before
        self._solver.update_settings(rho=_INITIAL_RHO)
        self._solver.update(q=q, l=low, u=high)
        self._solver.warm_start(x=guess, y=self._still)
        result = self._solver.solve(raise_error=False)
        if result.info.status != "solved":
            raise MotionError(
                f"{self._what}: OSQP ends with {result.info.status!r} after {result.info.iter} iterations; "
                "loosen the speed or acceleration limits, or slow the motion down"
            )
        return np.asarray(result.x)
