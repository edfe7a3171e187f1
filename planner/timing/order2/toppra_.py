"""toppra, as a second opinion on motions under limits on speed and acceleration (the only file that imports it).

Pham and Pham, A new approach to time-optimal path parameterization based on reachability analysis, IEEE T-RO 34 (2018),
645; their interpolation scheme. It stops without an answer on some paths with a far slower cruise than their ramps.
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
    rows: list[Array], ceiling: Array, step: Array, ends: tuple[float, float] = (0.0, 0.0)
) -> Array | MotionError:
    """As planner.timing.order2.passes.largest_speeds; where toppra gives no answer, what to say. Raises NotInstalled
    where it is not there."""
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
    """Raise NotInstalled where toppra is not there; what: needs it."""
    _toppra(what)


class _Interval:
    """What toppra asks of a path when the rows come ready made: its interval."""

    path_interval = (0.0, 1.0)
    dof = 1


@lru_cache(maxsize=1)
def _toppra(what: str = "this solver") -> tuple[Any, Any]:
    try:
        import toppra.algorithm as algorithm
        from toppra.constraint.linear_constraint import LinearConstraint
    except ImportError as missing:
        raise NotInstalled(what, "toppra", instead="omit it: our own solver does not need toppra") from missing
    import logging

    logging.getLogger("toppra").setLevel(logging.ERROR)

    class Ready(LinearConstraint):  # type: ignore[misc]  # toppra has no types
        """Rows |a u + b x + c| ≤ 1 as they stand."""

        def __init__(self, rows: list[Array], ceiling: Array) -> None:
            super().__init__()
            self.rows, self.ceiling, self.identical = rows, ceiling, True

        def compute_constraint_params(self, path: object, gridpoints: Array, *rest: object) -> tuple[Any, ...]:
            xbound = np.stack([np.zeros_like(self.ceiling), self.ceiling], 1)
            if not self.rows:
                return None, None, None, None, None, None, xbound
            count = self.rows[0].shape[1]
            both = np.concatenate([np.eye(count), -np.eye(count)])
            return (*self.rows, both, np.ones(2 * count), None, xbound)

    return Ready, algorithm.TOPPRA
