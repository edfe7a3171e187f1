"""A flexible load behind an axis: what swings on when the axis has stopped.

A mode of frequency f and damping ζ whose base the axis moves, z = load − base:

    z̈ + 2 ζ ω ż + ω² z = −q̈,   ω = 2π f

The axis is taken as straight between its samples; the motion in between is then exact. The load does not push back.
"""

from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError


@dataclass(frozen=True, slots=True)
class FlexibleLoad:
    """frequency Hz, above 0; damping ratio, from 0 to below 1. Raises MotionError for others."""

    frequency: float
    damping: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.frequency < np.inf:
            raise MotionError(f"flexible load: frequency {self.frequency} Hz must be above 0")
        if not 0 <= self.damping < 1:
            raise MotionError(f"flexible load: damping {self.damping} must be from 0 to below 1")

    def swing(self, q: Array, step: float) -> tuple[Array, Array]:
        """z (N,), and its envelope (N,), of an axis at q (N,), `step` s apart: the load rests on it at first.

        The envelope, √(z² + ((ż + ζ ω z)/(ω √(1 − ζ²)))²), is how far the load would swing were the axis to stop there.
        """
        from scipy.signal import cont2discrete, lfilter, ss2tf

        omega, fading = 2 * np.pi * self.frequency, 2 * np.pi * self.frequency * self.damping
        # with p = ż + q̇, of which no step of q̇ makes a jump: ż = p − q̇, ṗ = −2ζω (p − q̇) − ω² z
        system = np.array([[0.0, 1.0], [-(omega**2), -2 * fading]])
        drive, out = np.array([[-1.0], [2 * fading]]), np.eye(2)
        a, b, c, d, _ = cont2discrete((system, drive, out, np.zeros((2, 1))), step)
        above, below = ss2tf(a, b, c, d)
        speed = np.append(np.diff(q) / step, 0.0)
        z, p = (lfilter(row, below, speed) for row in above)
        rate = p - speed
        return z, np.hypot(z, (rate + fading * z) / (omega * np.sqrt(1 - self.damping**2)))

    def residual(self, q: Array, step: float, end: float) -> float:
        """The largest envelope from `end` (s) on: the vibration that is left of a motion over by then."""
        return float(self.swing(q, step)[1][int(np.ceil(end / step - 1e-9)) :].max())
