"""Linear systems of series: the balls contain every solution, and are thin where the arguments
are.
"""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics.analysis.virtual_work import solve, solve_series
from kinematics.foundation.taylor_model import Series

ORDER = 4


def systems(seed, n, width, count=3):
    random = np.random.default_rng(seed)
    matrix = random.normal(size=(ORDER + 1, count, n, n))
    matrix[0] += 4 * n * np.eye(n)  # far from singular
    right = random.normal(size=(ORDER + 1, count, n))
    return tuple(Series(mid, width * random.random(mid.shape), ORDER) for mid in (matrix, right))


def picked(series, random, corner):
    """Coefficients somewhere in the balls, or at their surface."""
    share = (
        random.choice([-1.0, 1.0], series.mid.shape)
        if corner
        else random.uniform(-1, 1, series.mid.shape)
    )
    return series.mid + share * series.rad * (1 - 1e-12)


def exact(matrix, right):
    """Coefficients (ORDER+1, n) of A(τ) f(τ) = b(τ) in rational numbers, by Gauss' elimination."""
    n = matrix.shape[-1]
    found = []
    for k in range(ORDER + 1):
        rows = [[Fraction(v) for v in row] for row in matrix[0]]
        earlier = [(j, m) for j in range(1, k + 1) for m in range(n)]
        rest = [
            Fraction(right[k, i])
            - sum(Fraction(matrix[j, i, m]) * found[k - j][m] for j, m in earlier)
            for i in range(n)
        ]
        for c in range(n):
            top = max(range(c, n), key=lambda r: abs(rows[r][c]))
            rows[c], rows[top], rest[c], rest[top] = rows[top], rows[c], rest[top], rest[c]
            for r in range(c + 1, n):
                share = rows[r][c] / rows[c][c]
                rows[r] = [a - share * b for a, b in zip(rows[r], rows[c], strict=True)]
                rest[r] -= share * rest[c]
        solution = [Fraction(0)] * n
        for c in reversed(range(n)):
            solution[c] = (rest[c] - sum(rows[c][m] * solution[m] for m in range(c + 1, n))) / rows[
                c
            ][c]
        found.append(solution)
    return found


@given(
    st.integers(0, 10_000),
    st.integers(1, 4),
    st.sampled_from([0.0, 1e-12, 1e-3, 0.05]),
    st.booleans(),
)
@settings(max_examples=40, deadline=None)
def test_the_balls_contain_every_solution(seed, n, width, corner):
    matrix, right = systems(seed, n, width)
    out = solve_series(matrix, right)
    random = np.random.default_rng(seed + 1)
    for cell in range(matrix.mid.shape[1]):
        solution = exact(
            picked(matrix, random, corner)[:, cell], picked(right, random, corner)[:, cell]
        )
        for k, values in enumerate(solution):
            for i, value in enumerate(values):
                if np.isfinite(out.rad[k, cell, i]):
                    assert abs(Fraction(out.mid[k, cell, i]) - value) <= Fraction(
                        out.rad[k, cell, i]
                    )
    assert width > 1e-3 or np.isfinite(out.rad).all()


def test_thin_arguments_give_thin_results():
    """Every order adds the condition of A₀, here about 2, in units of rounding."""
    out = solve_series(*systems(5, 6, 0.0, 50))
    assert (out.rad[0] < 1e-13).all()
    assert (out.rad < 1e-10 * np.abs(out.mid).max((0, 2))[None, :, None]).all()


def test_what_may_be_singular_bounds_nothing():
    matrix, right = systems(3, 3, 0.0)
    matrix.mid[0, 0] = 0.0  # singular
    matrix.rad[0, 1] = 100.0  # may be
    out = solve_series(matrix, right)
    assert np.isinf(out.rad[:, :2]).all()
    assert np.isfinite(out.rad[:, 2]).all()


def test_numbers_are_solved_each_by_itself():
    matrix, right = systems(2, 3, 0.0)
    found = solve(matrix.mid[0], right.mid[0][:, :, None])[:, :, 0]
    assert np.einsum("nij,nj->ni", matrix.mid[0], found) == pytest.approx(right.mid[0], rel=1e-12)
    matrix.mid[0, 1] = 0.0
    again = solve(matrix.mid[0], right.mid[0][:, :, None])[:, :, 0]
    assert np.isnan(again[1]).all()
    assert again[[0, 2]] == pytest.approx(found[[0, 2]], rel=1e-12)
