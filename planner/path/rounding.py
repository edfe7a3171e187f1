"""Rounding of a piecewise polynomial's derivatives, as far as its own coefficients leave them
open.
"""

import numpy as np

from kinematics.foundation.arrays import Array

# Units in the last place that a derivative may be off, of the quantities that it is computed from.
# Up to 250 were measured at knots of SciPy's splines.
ROUNDINGS = 256 * float(np.finfo(float).eps)
# Largest rounding, as a share of the path's largest q′, and of its largest q″ or q′ by its length.
MOST_ROUNDING = np.array([0.0, 1e-8, 1e-6])


def bound_rounding(breaks: Array, coefficients: Array) -> Array:
    """(3, P, n) of q, q′ and q″ at the ends of each piece, from coefficients (degree+1, P, n); 0 of
    q.

    Splines compute coefficients of a piece of length h from values and slopes, q″ from q/h² and
    q′/h. So an axis that is linear in the parameter has a q″ of rounding alone, and jumps of it at
    every knot.
    """
    h = np.diff(breaks)[:, None]
    sizes = [np.zeros(coefficients.shape[1:])] * 3
    for s in (np.zeros_like(h), h):
        for k, values in enumerate(_differentiate(coefficients, s)):
            sizes[k] = np.maximum(sizes[k], np.abs(values))
    q, q1, q2 = sizes
    with np.errstate(over="ignore"):
        first = ROUNDINGS * np.maximum(q1, q / h)
        second = ROUNDINGS * np.maximum(np.maximum(q2, q1 / h), q / h**2)
    # a very short piece must not hide a corner next to it
    _, slope, bend = MOST_ROUNDING
    whole = breaks[-1] - breaks[0]
    first = np.minimum(first, slope * q1.max(initial=0.0))
    second = np.minimum(second, bend * max(q2.max(initial=0.0), q1.max(initial=0.0) / whole))
    return np.stack([np.zeros_like(first), first, second])


def _differentiate(coefficients: Array, s: Array) -> tuple[Array, Array, Array]:
    """q, q′, q″ (P, n) at s (P, 1) after the start of each piece: Horner's scheme."""
    q, q1, half_q2 = (np.zeros(coefficients.shape[1:]) for _ in range(3))
    for c in coefficients:
        half_q2 = half_q2 * s + q1
        q1 = q1 * s + q
        q = q * s + c
    return q, q1, 2 * half_q2
