"""Shares of the axes' limits that samples of a motion use."""

from collections.abc import Sequence

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.machine.axis import directional_bounds
from kinematics.machine.machine import Machine

LIMITS = ("max_speed", "max_acceleration", "max_jerk")


def measure_rates(machine: Machine, order: int, rates: Sequence[Array]) -> float:
    """Return the largest share of a limit on the first `order` rates (N, n) of the axes."""
    most = 0.0
    for values, name in zip(rates[:order], LIMITS, strict=False):
        for axis, rate in zip(machine.axes, values.T, strict=True):
            low, high = directional_bounds(getattr(axis, name))
            most = max(most, rate.max() / high, -rate.min() / low)
    return float(most)


def measure_travel(machine: Machine, q: Array) -> float:
    """Return the largest share of a travel, from its middle, at q (N, n)."""
    low, high = np.array([axis.travel for axis in machine.axes]).T
    finite = np.isfinite(low)
    away = np.abs(2 * (q - machine.home_q) - low - high)[:, finite]
    return float((away / (high - low)[finite]).max(initial=0.0))
