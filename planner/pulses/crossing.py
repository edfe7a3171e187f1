"""Where rising quintics reach given heights: Newton's method held in a bracket, for millions of heights at once."""

import numpy as np
from numpy.typing import NDArray

from kinematics.array import Array

STEPS = 256  # every fourth step halves the bracket, so 4·log2(1/eps) steps always end


def solve(climb: Array, index: NDArray[np.intp], height: Array, tolerance: Array) -> Array:
    """v (N,) in [0, 1] where y(v) = Σ climb[i-1, index] vⁱ, i = 1..5, rises through the height.

    climb      (5, S) coefficients of S polynomials
    index      (N,) which polynomial each height (N,) is asked of
    tolerance  (S,) error of v that is good enough
    A height out of reach gives the nearer end. The error that a Newton step δ leaves is at most max|y″| δ² / y′ where
    2 max|y″| δ ≤ y′ (Kantorovich); a root is taken when that is below the tolerance, or its bracket is.
    """
    tolerance = np.maximum(tolerance, 4 * np.finfo(float).eps)
    curvature = (np.array([0.0, 2, 6, 12, 20]) @ abs(climb)) / tolerance
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        v = _first_guess(climb, index, height)
        root = np.empty_like(v)
        place: NDArray[np.intp] | slice = slice(None)
        lo, hi = np.zeros_like(v), np.ones_like(v)
        for step in range(1, STEPS + 1):
            c1, c2, c3, c4, c5 = (row.take(index) for row in climb)
            excess = v * (c1 + v * (c2 + v * (c3 + v * (c4 + v * c5)))) - height
            slope = c1 + v * (2 * c2 + v * (3 * c3 + v * (4 * c4 + v * (5 * c5))))
            below = excess < 0
            lo, hi = np.where(below, v, lo), np.where(below, hi, v)
            move = excess / slope
            v = v - move
            newton = (v >= lo) & (v <= hi)
            enough, size = tolerance.take(index), abs(move)
            settled = newton & (size * np.maximum(size, 2 * enough) * curvature.take(index) <= slope)
            settled |= hi - lo <= enough
            v = np.where(newton if step % 4 else settled, v, (lo + hi) / 2)
            root[place] = v
            if settled.all():
                break
            rest = np.flatnonzero(~settled)
            place = rest if isinstance(place, slice) else place[rest]
            index, height, v, lo, hi = index[rest], height[rest], v[rest], lo[rest], hi[rest]
    return root


def _first_guess(climb: Array, index: NDArray[np.intp], height: Array) -> Array:
    """The root of the parabola a v + b v² that ends where y does and has y's slope at the slower end.

    Exact for constant acceleration, turning points included.
    """
    top, start, end = climb.sum(axis=0), climb[0], np.arange(1, 6) @ climb
    a = np.maximum(np.where(end < start, 2 * top - end, start), 0.0)
    b = 4 * (top - a)
    a = a.take(index)
    guess = 2 * height / (a + np.sqrt(np.maximum(a * a + b.take(index) * height, 0.0)))
    bounded: Array = np.clip(np.nan_to_num(guess, nan=0.5), 0.0, 1.0)
    return bounded
