"""Polynomials on [0, 1], many at once: where they reach heights, parts of them, and their Bernstein
coefficients.

The checker of pulses uses none of this, on purpose.
"""

from functools import cache
from math import comb

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array, freeze_array

MAX_STEPS = 256  # every fourth step halves the bracket, so 4·log2(1/eps) steps always end


def solve_heights(
    climb: Array, index: NDArray[np.intp], height: Array, tolerance: Array
) -> tuple[Array, Array]:
    """v (N,) in [0, 1] where y(v) = Σ climb[i-1, index] vⁱ, i = 1..5, rises through the height, and
    y′ (N,) near v.

    climb      (5, S) coefficients of S polynomials
    index      (N,) which polynomial each height (N,) is asked of
    tolerance  (S,) error of v that is good enough
    A height out of reach gives the nearer end. The error that a Newton step δ leaves is at most
    max|y″| δ² / y′ where
    2 max|y″| δ ≤ y′ (Kantorovich); a root is taken when that is below the tolerance, or its bracket
    is. y′ is from
    before the last step: at most twice that at the root.
    """
    tolerance = np.maximum(tolerance, 4 * np.finfo(float).eps)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        curvature = (np.array([0.0, 2, 6, 12, 20]) @ abs(climb)) / tolerance
        v = _first_guess(climb, index, height)
        excess, slope = _evaluate(climb, index, v, height)
        move = excess / slope
        root = v - move
        settled = _has_converged(move, slope, tolerance.take(index), curvature.take(index))
        settled &= (root >= 0) & (root <= 1)
        rest = np.flatnonzero(~settled)  # one step is enough for nearly all
        if len(rest):
            root[rest], slope[rest] = _solve_bracketed(
                climb, index[rest], height[rest], v[rest], tolerance, curvature
            )
    return root, slope


def _solve_bracketed(
    climb: Array,
    index: NDArray[np.intp],
    height: Array,
    v: Array,
    tolerance: Array,
    curvature: Array,
) -> tuple[Array, Array]:
    """The same from a first guess v (N,), nan for none, halving the bracket where Newton's method
    leaves it.
    """
    v = np.nan_to_num(v, nan=0.5)
    root, last = np.empty_like(v), np.empty_like(v)
    place: NDArray[np.intp] = np.arange(len(v))
    lo, hi = np.zeros_like(v), np.ones_like(v)
    for step in range(1, MAX_STEPS + 1):
        excess, slope = _evaluate(climb, index, v, height)
        below = excess < 0
        lo, hi = np.where(below, v, lo), np.where(below, hi, v)
        move = excess / slope
        v = v - move
        newton = (v >= lo) & (v <= hi)
        settled = newton & _has_converged(move, slope, tolerance.take(index), curvature.take(index))
        settled |= hi - lo <= tolerance.take(index)
        v = np.where(newton if step % 4 else settled, v, (lo + hi) / 2)
        root[place], last[place] = v, slope
        if settled.all():
            break
        rest = np.flatnonzero(~settled)
        place, index = place[rest], index[rest]
        height, v, lo, hi = height[rest], v[rest], lo[rest], hi[rest]
    return root, last


def _evaluate(
    climb: Array, index: NDArray[np.intp], v: Array, height: Array
) -> tuple[Array, Array]:
    """y - height and y′: y = v g(v), g and g′ by Horner's rule side by side."""
    g = climb[4].take(index)
    slope = g.copy()
    for k in (3, 2, 1, 0):
        g *= v
        g += climb[k].take(index)
        if k:
            slope *= v
            slope += g
    slope *= v
    slope += g
    g *= v
    g -= height
    return g, slope


def _has_converged(move: Array, slope: Array, enough: Array, curvature: Array) -> NDArray[np.bool_]:
    """Kantorovich's bounds; `enough` is left overwritten."""
    size = abs(move)
    enough *= 2
    np.maximum(size, enough, out=enough)
    enough *= size
    enough *= curvature
    return np.asarray(enough <= slope)


def _first_guess(climb: Array, index: NDArray[np.intp], height: Array) -> Array:
    """The root in [0, 1] of the parabola a v + b v² that ends where y does and has y's slope at the
    slower end.

    Exact for constant acceleration, turning points included; the nearer end where it is outside,
    nan for no parabola.
    """
    top, start, end = climb.sum(axis=0), climb[0], np.arange(1, 6) @ climb
    half = np.maximum(np.where(end < start, 2 * top - end, start), 0.0) / 2
    a = half.take(index)
    root: Array = (top - 2 * half).take(index)
    root *= height
    root += a * a
    np.maximum(root, 0.0, out=root)
    np.sqrt(root, out=root)
    root += a
    np.divide(height, root, out=root)
    np.clip(root, 0.0, 1.0, out=root)
    return root


@cache
def bernstein_matrix(degree: int) -> Array:
    """(degree + 1, degree + 1): what makes Bernstein coefficients on [0, 1] of those of powers.

    A polynomial lies within its Bernstein coefficients. It has as many roots in (0, 1) as they
    change sign, or fewer by an even number: none where they do not, exactly one where they change
    once.
    """
    powers = range(degree + 1)
    return freeze_array([[comb(j, i) / comb(degree, i) for i in powers] for j in powers])


def shift_polynomials(coefficients: Array, lo: Array, width: Array) -> Array:
    """Coefficients (6, S) of p(lo + width·v) from those of p, by Horner's shift."""
    shifted = coefficients.copy()
    for first in range(5):
        for i in range(4, first - 1, -1):
            shifted[i] += lo * shifted[i + 1]
    return shifted * width ** np.arange(6)[:, None]


def derivative(coefficients: Array) -> Array:
    """Coefficients (5, S) of p′ from those (6, S) of p."""
    return coefficients[1:] * np.arange(1, 6)[:, None]
