"""Bounds of the distances between bodies over cells, from the pose at both ends and bounds of its
change.
"""

from collections.abc import Sequence

import numpy as np

from kinematics.analysis.clearance import Bodies
from kinematics.foundation.arrays import Array
from kinematics.foundation.taylor_model import EPS


def bound_distances(bodies: Bodies, ends: Array, error: Array, rates: Sequence[Array]) -> tuple[Array, Array]:
    """Return bounds low and high (N, k) of distances d over cells τ ∈ [−1, 1].

    With the largest change V over a cell and the largest bend K (see `Bodies`):

        (d₀ + d₁)/2 − V ≤ d ≤ (d₀ + d₁)/2 + V,   d ≥ min(d₀, d₁) − K/2.

    ends   (2, N, 12) numbers of the pose at τ = −1 and 1; error (N, 12) of them
    rates  bounds (N, 12) of their first and second derivatives by τ
    """
    start, end = np.split(bodies.distances(ends.reshape(-1, 12)), 2)
    speed, swing = _norms(rates[0])
    shift, twist = _norms(error)
    spin = swing / np.sqrt(2)
    farthest = 2 * speed + shift, 2 * spin + twist
    # a rounded rotation matrix is not quite a rotation: twice the change allows for that
    rounding = bodies.change(ends[0], 2 * shift, 2 * twist) + 64 * EPS * (1 + np.abs(ends[0]).max(1))[:, None]
    change = bodies.change(ends[0], *farthest) / 2
    middle = (start + end) / 2
    bend = bodies.bend(ends[0], *farthest, middle - change - rounding, (speed, spin), _norms(rates[1]))
    low = np.maximum(middle - change, np.minimum(start, end) - bend / 2)
    return low - rounding, middle + change + rounding


def _norms(numbers: Array) -> tuple[Array, Array]:
    """Return upper bounds (N,) of the norm of the origin and the Frobenius norm of the rotation of
    (N, 12) numbers.
    """
    origin, rotation = (np.linalg.norm(part, axis=1) * (1 + 16 * EPS) for part in (numbers[:, :3], numbers[:, 3:]))
    return origin, rotation
