"""toppra, as a second opinion on motions under limits on speed and acceleration.

Pham and Pham, IEEE T-RO 34 (2018), 645. Only this file imports it. It has no answer for some paths
on which cruises are far slower than ramps.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, NotInstalled
from kinematics.foundation.names import count_noun

# toppra's own bound on x; a free axis needs some bound for its linear programmes.
_LARGEST = 1e6


def largest_speeds(
    rows: Array,
    ceiling: Array,
    step: Array,
    ends: tuple[float, float] = (0.0, 0.0),
) -> Array | MotionError:
    """Return x as `planner.timing.order2.passes.largest_speeds`, or an error without an answer.

    Raises NotInstalled without toppra.
    """
    constraint_type, algorithm = _toppra()
    points = np.concatenate([[0.0], np.cumsum(step)])
    points[-1] = 1.0
    constraint = constraint_type(rows, np.minimum(ceiling, _LARGEST))
    solver = algorithm([constraint], _Interval(), gridpoints=points, solver_wrapper="seidel")
    _, speed, _, _ = solver.compute_parameterization(*np.sqrt(ends), return_data=True)
    if speed is None or not np.isfinite(speed).all():
        return MotionError(
            f"toppra found no motion over {count_noun(len(step), 'interval')}; our own solver may: omit the solver"
        )
    return np.asarray(speed, float) ** 2


def require(what: str) -> None:
    """Raise NotInstalled unless toppra is installed; the message names the feature that needs
    it.
    """
    _toppra(what)


class _Interval:
    """Stand-in for a path: the rows are ready, and toppra only needs the interval."""

    path_interval = (0.0, 1.0)
    dof = 1


@lru_cache(maxsize=1)
def _toppra(what: str = "this solver") -> tuple[Any, Any]:
    try:
        import toppra.algorithm as algorithm
        from toppra.constraint.linear_constraint import LinearConstraint
    except ImportError as error:
        instead = "omit it: our own solver does not need toppra"
        raise NotInstalled(what, "toppra", instead=instead) from error
    import logging

    logging.getLogger("toppra").setLevel(logging.ERROR)

    class Rows(LinearConstraint):  # type: ignore[misc]  # toppra has no types
        """Rows |a u + b x + c| ≤ 1."""

        def __init__(self, rows: Array, ceiling: Array) -> None:
            super().__init__()
            self.rows = rows
            self.ceiling = ceiling
            self.identical = True

        def compute_constraint_params(
            self,
            path: object,
            gridpoints: Array,
            *rest: object,
        ) -> tuple[Any, ...]:
            xbound = np.stack([np.zeros_like(self.ceiling), self.ceiling], 1)
            count = self.rows.shape[2]
            both = np.concatenate([np.eye(count), -np.eye(count)])
            return (*self.rows, both, np.ones(2 * count), None, xbound)

    return Rows, algorithm.TOPPRA
