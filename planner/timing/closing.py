"""What a solver leaves open, closed: a motion on a grid, continuous to rounding."""

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.timing.problem import Problem
from planner.timing.profile import Profile

# Newton steps: the first leaves the square of a solver's 1e-8 or so, the others its own rounding.
STEPS = 4
# Share of the largest ṡ by which it may fall below zero inside an interval: rounding.
BACK = 1e-10


def closed(problem: Problem, columns: Array) -> Profile:
    """The motion nearest to `columns` (4, N) of ṡ, s̈, s⃛, h that is continuous, on the problem's grid, between its ends.

    Each interval must end where the next one starts, in s, ṡ and s̈: 3N equations in 4N − 2 unknowns. Newton steps of
    least length, every unknown counted in its own size, solve them. They stay local: integrated from the start instead,
    an error of rounding in s̈ would grow with the square of time. Raises MotionError where no such motion is near, or
    where it backs up.
    """
    from scipy.sparse import block_array, csr_array, diags_array
    from scipy.sparse.linalg import splu

    s, columns = problem.s, columns.copy()
    columns[:2, 0] = problem.speeds[0], 0.0
    step, h = np.diff(s), columns[3]
    most = np.abs(columns).max(1)
    size = np.stack([step / h, np.minimum(step / h**2, most[1]), np.minimum(step / h**3, most[2]), h.copy()])
    scale, rows = diags_array(size.ravel()), diags_array(1 / np.concatenate([step, size[0], size[1]]))
    follows = diags_array([1.0, -1.0], offsets=[0, 1], shape=(len(h), len(h)))
    inner = diags_array((np.arange(len(h)) > 0).astype(float))  # the first ṡ and s̈ are given
    for _ in range(STEPS):
        v, a, j, h = columns
        ends = np.stack([h * (v + h * (a / 2 + h * j / 6)), v + h * (a + h * j / 2), a + h * j])
        miss = ends - np.stack([step, np.append(v[1:], problem.speeds[1]), np.append(a[1:], 0.0)])
        slopes = csr_array(
            block_array(
                [
                    [
                        diags_array(h) @ inner,
                        diags_array(h**2 / 2) @ inner,
                        diags_array(h**3 / 6),
                        diags_array(ends[1]),
                    ],
                    [follows @ inner, diags_array(h) @ inner, diags_array(h**2 / 2), diags_array(ends[2])],
                    [None, follows @ inner, diags_array(h), diags_array(j)],
                ]
            )
        )
        slopes = rows @ slopes @ scale
        try:
            least = slopes.T @ splu((slopes @ slopes.T).tocsc()).solve(-(rows @ miss.ravel()))
        except RuntimeError as failure:  # SciPy's own: a singular matrix
            raise MotionError(f"the motion that the solver found cannot be made continuous: {failure}") from failure
        columns = columns + (scale @ least).reshape(4, -1)
    if not (np.isfinite(columns).all() and (columns[3] > 0).all()):
        raise MotionError("the motion that the solver found cannot be made continuous")
    v, a, j, h = columns
    with np.errstate(divide="ignore", invalid="ignore"):
        turning = np.where((j > 0) & (a < 0) & (-a < j * h), v - a**2 / (2 * j), 0.0)
    if turning.min() < -BACK * v.max():
        raise MotionError("the motion that the solver found backs up between two grid points")
    return Profile(s[:-1], v, a, j, h, problem.piece)
