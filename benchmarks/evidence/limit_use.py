"""Shares of limits that samples of a motion use."""

from collections.abc import Sequence

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.machine.axis import directional_bounds
from kinematics.machine.machine import Machine

LIMITS = ("max_speed", "max_acceleration", "max_jerk")


def measure_axes(machine: Machine, order: int, q: Array, rates: Sequence[Array]) -> float:
    """Return the largest share of an axis' limit on q (N, n) and its first `order` rates (N, n)."""
    most = 0.0
    for values, name in zip(rates[:order], LIMITS, strict=False):
        for axis, rate in zip(machine.axes, values.T, strict=True):
            low, high = directional_bounds(getattr(axis, name))
            most = max(most, rate.max() / high, -rate.min() / low)
    for axis, way in zip(machine.axes, (q - machine.home_q).T, strict=True):
        low, high = axis.travel
        if np.isfinite(low):
            most = max(most, np.abs(2 * way - low - high).max() / (high - low))
    return float(most)
