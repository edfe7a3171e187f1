"""Following solutions of homogeneous equations F(y, t) = 0 from t = 0 to t = 1, many at a time, in complex numbers."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kinematics.array import Array

Complex = NDArray[np.complex128]
Equations = Callable[[np.ndarray, Array, Complex], tuple[Complex, Complex, Complex]]
"""(rows (M,) of the batch, t (M,), y (M, n + 1)) -> F (M, n), ∂F/∂y (M, n, n + 1), ∂F/∂t (M, n)."""

# Corrections by Newton after a prediction, and the last one's size by which they count as converged.
CORRECTIONS, CONVERGED = 3, 1e-10
# Steps of a solution at most; its first and its shortest.
STEPS, FIRST, SHORTEST = 2000, 0.02, 1e-9


def follow(equations: Equations, y: Complex, trust: float) -> tuple[Complex, Array]:
    """The solutions y (N, n + 1) of t = 0 at t = 1, and the t (N,) that each has reached.

    A solution is a point of projective space, so none can run away: it is kept at length one, and each step moves in
    the plane that touches the sphere in it. Predicted by Runge and Kutta's rule of fourth order for
    ẏ = −(∂F/∂y)⁻¹ ∂F/∂t, corrected by Newton. A step counts if the prediction was right within `trust` and Newton
    converges; each solution takes its own steps, as long as that allows. What ends in a multiple solution stays below
    t = 1, close to it.
    """
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    t, step = np.zeros(len(y)), np.full(len(y), FIRST)
    active = np.arange(len(y))
    for _ in range(STEPS):
        active = active[(t[active] < 1) & (step[active] > SHORTEST)]
        if not len(active):
            break
        now, h = y[active], np.minimum(step[active], 1 - t[active])
        ends = np.where(step[active] < 1 - t[active], t[active] + h, 1.0)
        slopes: list[Complex] = []
        for share in (0.0, 0.5, 0.5, 1.0):
            ahead = now + (share * h)[:, None] * slopes[-1] if slopes else now
            _, by_y, by_t = equations(active, t[active] + share * h, ahead)
            slopes.append(-_solve(by_y, by_t, now))
        trial = now + (h / 6)[:, None] * (slopes[0] + 2 * slopes[1] + 2 * slopes[2] + slopes[3])
        errors = []
        for _ in range(CORRECTIONS):
            value, by_y, _ = equations(active, ends, trial)
            change = _solve(by_y, value, now)
            trial = trial - change
            errors.append(np.linalg.norm(change, axis=1))
        error = np.nan_to_num(errors[0], nan=np.inf)
        kept = (error < trust) & (errors[-1] < CONVERGED)
        y[active[kept]] = trial[kept] / np.linalg.norm(trial[kept], axis=1, keepdims=True)
        t[active[kept]] = ends[kept]
        # the prediction is wrong by h⁵
        longer = 0.8 * (trust / np.maximum(error, 1e-3 * trust)) ** 0.2
        step[active] = h * np.where(kept, np.clip(longer, 0.5, 3.0), np.clip(longer, 0.1, 0.5))
    return y, t


def _solve(matrix: Complex, right: Complex, now: Complex) -> Complex:
    """Solutions (M, n + 1) of matrix (M, n, n + 1) and right (M, n) at right angles to `now` (M, n + 1)."""
    square = np.concatenate([matrix, now.conj()[:, None]], 1)
    full = np.concatenate([right, np.zeros((len(right), 1))], 1)[:, :, None]
    try:
        return np.asarray(np.linalg.solve(square, full)[:, :, 0])
    except np.linalg.LinAlgError:  # one of the batch is singular to the last bit
        return np.asarray((np.linalg.pinv(square) @ full)[:, :, 0])
