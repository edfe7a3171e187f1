"""Time-optimal motion under limits on speed and acceleration, by toppra (the only file that imports it).

Pham and Pham, A new approach to time-optimal path parameterization based on reachability analysis, IEEE T-RO 34 (2018),
645.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.limits.limit import Term
from planner.timing.problem import Block, Problem
from planner.timing.profile import Profile

TERMS = frozenset({Term.ONE, Term.SD, Term.SD2, Term.SDD})


def second_order(problem: Problem) -> Profile:
    """The fastest rest-to-rest motion with s̈ constant on each interval, every row kept at both ends of every interval.

    With x = ṡ² and u = s̈, x grows by 2 u Δs over an interval, so a row a u + b x + c at its end is (a + 2 Δs b) u + b
    x + c at its start: that is the interpolation scheme, with the derivatives of the interval's own side at both ends.
    toppra solves stage problems in x and u; lengths and times are scaled so that both are about one.
    """
    length = problem.s[-1] - problem.s[0]
    time = _time_scale(problem, length)
    step = np.diff(problem.s) / length
    rows, ceiling = _rows(problem, step, length, time)
    x = _solve(problem, rows, ceiling, step)
    v = np.sqrt(x) * length / time
    h = 2 * np.diff(problem.s) / (v[1:] + v[:-1])
    return Profile(problem.s[:-1], v[:-1], np.diff(v) / h, np.zeros(len(h)), h, problem.piece)


def _time_scale(problem: Problem, length: float) -> float:
    """A time in which the run could roughly be done."""
    slowest = [1e-9]
    for block in problem.blocks:
        for term, values in block.start.items():
            size = np.abs(values).max(1).mean()
            if term is Term.SD:
                slowest.append(size * length)
            elif term in (Term.SDD, Term.SD2):
                slowest.append(float(np.sqrt(size * length * (length if term is Term.SD2 else 1.0))))
    return max(slowest)


def _rows(problem: Problem, step: Array, length: float, time: float) -> tuple[list[Array], Array]:
    """([a, b, c] each (N+1, rows) with |a u + b x + c| ≤ 1, and the largest x (N+1,) that speed rows allow)."""
    ceiling = np.full(len(step) + 1, np.inf)
    parts: list[list[Array]] = [[], [], []]
    for block in problem.blocks:
        if set(block.start) == {Term.SD}:
            _cap(ceiling, block, length / time)
            continue
        for side, at_end in ((block.start, False), (block.end, True)):
            zero = np.zeros_like(next(iter(side.values())))
            share = block.room[:, None]
            b = side.get(Term.SD2, zero) * (length / time) ** 2 / share
            a = side.get(Term.SDD, zero) * length / time**2 / share + (2 * step[:, None] * b if at_end else 0.0)
            for part, values in zip(parts, (a, b, side.get(Term.ONE, zero) / share), strict=True):
                part.append(np.concatenate([values, values[-1:]]))
    return [np.concatenate(part, 1) for part in parts] if parts[0] else [], ceiling


def _cap(ceiling: Array, block: Block, unit: float) -> None:
    for side, points in ((block.start, slice(None, -1)), (block.end, slice(1, None))):
        slope = np.abs(side[Term.SD]).max(1) * unit
        with np.errstate(divide="ignore"):
            np.minimum(ceiling[points], (block.room / slope) ** 2, out=ceiling[points])


def _solve(problem: Problem, rows: list[Array], ceiling: Array, step: Array) -> Array:
    """x (N+1,) from rest to rest."""
    constraint_type, algorithm = _toppra()
    points = np.concatenate([[0.0], np.cumsum(step)])
    points[-1] = 1.0
    constraint = constraint_type(rows, np.minimum(ceiling, _LARGEST))
    solver = algorithm([constraint], _Interval(), gridpoints=points, solver_wrapper="seidel")
    _, speed, _, _ = solver.compute_parameterization(0.0, 0.0, return_data=True)
    if speed is None or not np.isfinite(speed).all() or (speed[1:] + speed[:-1] <= 0).any():
        raise MotionError(
            f"the second-order solver found no motion over {problem.s[-1] - problem.s[0]:.6g} of path "
            f"with {problem.intervals} intervals; "
            "check for a limit that leaves no room, or a path that stands still"
        )
    return np.asarray(speed, float) ** 2


# toppra's own bound on x; a free axis needs some bound for its linear programmes.
_LARGEST = 1e6


class _Interval:
    """What toppra asks of a path when the rows come ready made: its interval."""

    path_interval = (0.0, 1.0)
    dof = 1


@lru_cache(maxsize=1)
def _toppra() -> tuple[Any, Any]:
    try:
        import toppra.algorithm as algorithm
        from toppra.constraint.linear_constraint import LinearConstraint
    except ImportError as missing:
        raise MotionError(
            "order 2 needs toppra, which has no wheel for this platform; plan with order 3 instead"
        ) from missing
    import logging

    logging.getLogger("toppra").setLevel(logging.ERROR)

    class Ready(LinearConstraint):  # type: ignore[misc]
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
