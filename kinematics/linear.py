"""Linear systems A f = b, numerically in batches and in Taylor series with guaranteed error."""

from __future__ import annotations

import numpy as np

from kinematics.array import Array
from kinematics.array_ball import EPS, Ball
from kinematics.series import Series


def solve(matrix: Array, right: Array) -> Array:
    """f (N, n) of A (N, n, n) and b (N, n); nan where A is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:
        return np.asarray((_inverse(matrix) @ right[:, :, None])[:, :, 0])


def solve_series(matrix: Series, right: Series) -> Series:
    """The same of series: A₀ f_k = b_k − Σ_{j>0} A_j f_{k−j}.

    With C ≈ A₀⁻¹ and E = 1 − C A₀, f = C b + E f, so that |f − C b| ≤ |E| 1 · ‖C b‖/(1 − ‖E‖), the norms largest row
    sums (Rump, Acta Numerica 19 (2010), section 10); no bound where ‖E‖ ≥ 1.
    """
    order = min(matrix.order, right.order)
    matrix, right = matrix.cut(order), right.cut(order).padded(order)
    guess = _inverse(matrix.mid[0])
    size, terms = np.abs(guess), matrix.mid.shape[-1] + 2
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        off = np.abs(np.eye(terms - 2) - guess @ matrix.mid[0]) + size @ matrix.rad[0]
        off += terms * EPS * (size @ np.abs(matrix.mid[0]) + 1)
        rows = off.sum(-1) * (1 + terms * EPS)
        norm = rows.max(-1, keepdims=True)
        spread = np.where(norm < 1, rows / (1 - norm), np.inf) * (1 + 4 * EPS)
        out = Series.zeros(order, right.mid.shape[1:])
        for k in range(order + 1):
            mid, rad = right.mid[k], right.rad[k]
            for j in range(1, min(k, matrix.degree) + 1):
                part = _times((matrix.mid[j], matrix.rad[j]), (out.mid[k - j], out.rad[k - j]))
                mid, rad = mid - part[0], (rad + part[1]) * (1 + EPS) + EPS * np.abs(mid - part[0])
            mid, rad = _times((guess, np.zeros_like(guess)), (mid, rad))
            most = (np.abs(mid) + rad).max(-1, keepdims=True)
            out.mid[k], out.rad[k] = mid, (rad + spread * most) * (1 + 4 * EPS)
        out.rad[:] = np.where(np.isnan(out.rad) | np.isnan(out.mid), np.inf, out.rad)
        out.mid[:] = np.nan_to_num(out.mid)
    return out


def _times(matrix: Ball, vector: Ball) -> Ball:
    (am, ar), (vm, vr) = matrix, vector
    mid = (am @ vm[..., None])[..., 0]
    size, terms = np.abs(am), am.shape[-1]
    rad = size @ vr[..., None] + ar @ (np.abs(vm) + vr)[..., None] + terms * EPS * (size @ np.abs(vm)[..., None])
    return mid, rad[..., 0] * (1 + (terms + 3) * EPS)


def _inverse(matrix: Array) -> Array:
    """A⁻¹ (N, n, n); nan where there is none."""
    finite: np.ndarray = np.asarray(np.isfinite(matrix).all((1, 2)))
    safe = np.where(finite[:, None, None], matrix, np.eye(matrix.shape[-1]))
    try:
        found = np.linalg.inv(safe)
    except np.linalg.LinAlgError:  # one singular matrix fails the whole batch
        regular = np.linalg.matrix_rank(safe) >= matrix.shape[-1]
        found = np.full(safe.shape, np.nan)
        found[regular] = np.linalg.inv(safe[regular])
    return np.asarray(np.where(finite[:, None, None], found, np.nan))
