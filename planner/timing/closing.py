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

    Each interval must end where the next one starts, in s, ṡ and s̈: 3N equations in 4N − 2 unknowns, or one equation
    less and one unknown more where an end is free. Newton steps of least length, every unknown counted in its own size,
    solve them. They stay local: integrated from the start instead, an error of rounding in s̈ would grow with the square
    of time. Raises MotionError where no such motion is near, or where it backs up.
    """
    s, columns = problem.s, columns.copy()
    columns[0, 0] = problem.speeds[0]
    if not problem.free[0]:
        columns[1, 0] = 0.0
    step, h = np.diff(s), columns[3]
    most = np.abs(columns).max(1)
    size = np.stack([step / h, np.minimum(step / h**2, most[1]), np.minimum(step / h**3, most[2]), h.copy()])
    for _ in range(STEPS):
        v, a, j, h = columns
        ends = np.stack([h * (v + h * (a / 2 + h * j / 6)), v + h * (a + h * j / 2), a + h * j])
        miss = ends - np.stack([step, np.append(v[1:], problem.speeds[1]), np.append(a[1:], 0.0)])
        if problem.free[1]:
            miss[2, -1] = 0.0
        columns = columns + size * _least(columns, ends, miss, step, size, problem.free)
    if not (np.isfinite(columns).all() and (columns[3] > 0).all()):
        raise MotionError("the motion that the solver found cannot be made continuous")
    v, a, j, h = columns
    with np.errstate(divide="ignore", invalid="ignore"):
        turning = np.where((j > 0) & (a < 0) & (-a < j * h), v - a**2 / (2 * j), 0.0)
    if turning.min() < -BACK * v.max():
        raise MotionError("the motion that the solver found backs up between two grid points")
    return Profile(s[:-1], v, a, j, h, problem.piece)


def _least(columns: Array, ends: Array, miss: Array, step: Array, size: Array, free: tuple[bool, bool]) -> Array:
    """The shortest change (4, N), counted in `size`, that takes the miss (3, N) off to first order.

    −Gᵀ (G Gᵀ)⁻¹ miss, where G holds what an interval's own columns do to its equations, and the next one's.
    """
    from scipy.linalg import LinAlgError, solve_banded

    (_, _, j, h), n, (one, none) = columns, len(step), (np.ones_like(step), np.zeros_like(step))
    rows = np.stack([step, size[0], size[1]])
    own = np.array([[h, h**2 / 2, h**3 / 6, ends[1]], [one, h, h**2 / 2, ends[2]], [none, one, h, j]])
    own = np.moveaxis(own * size / rows[:, None], 2, 0)
    own[0, :, : 1 if free[0] else 2] = 0.0  # the first ṡ is given, and s̈ where it is not free
    if free[1]:
        own[-1, 2] = 0.0  # nothing is asked of the last s̈
    following = np.zeros((n, 3, 4))  # interval i's equations by the columns of i + 1
    following[:-1, 1, 0], following[:-1, 2, 1] = -size[0, 1:] / size[0, :-1], -size[1, 1:] / size[1, :-1]
    diagonal = own @ own.mT + following @ following.mT
    if free[1]:
        diagonal[-1, 2, 2] = 1.0
    beside = following[:-1] @ own[1:].mT
    band = np.zeros((11, 3 * n))
    for p in range(3):
        for q in range(3):
            band[5 + p - q, q::3] = diagonal[:, p, q]
            band[2 + p - q, 3 + q :: 3] = beside[:, p, q]
            band[8 + q - p, p : 3 * n - 3 : 3] = beside[:, p, q]
    try:
        weights = solve_banded((5, 5), band, -(miss / rows).T.ravel(), check_finite=False).reshape(n, 3)
    except LinAlgError as failure:
        raise MotionError(f"the motion that the solver found cannot be made continuous: {failure}") from failure
    change = (own.mT @ weights[:, :, None])[:, :, 0]
    change[1:] += (following[:-1].mT @ weights[:-1, :, None])[:, :, 0]
    return np.asarray(change.T)
