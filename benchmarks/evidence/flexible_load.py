"""A flexible load on an axis: the vibration that remains when the axis has stopped.

A mode of frequency f and damping ratio ζ, whose base is the axis at q; z = load − base:

    z̈ + 2 ζ ω ż + ω² z = −q̈,   ω = 2π f

The axis moves in straight lines between its samples, for which the motion of the load is exact. The
load does not act back on the axis.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import cont2discrete, lfilter, ss2tf

from kinematics.foundation.arrays import Array


@dataclass(frozen=True, slots=True)
class FlexibleLoad:
    """frequency  Hz, above 0
    damping    ratio, from 0 to below 1
    """

    frequency: float
    damping: float = 0.0

    def swing(self, q: Array, step: float) -> tuple[Array, Array]:
        """Return z (N,) and its envelope (N,) for an axis at q (N,), sampled every `step` s. The
        load begins at rest.

        The envelope √(z² + ((ż + ζ ω z)/(ω √(1 − ζ²)))²) is the amplitude of z if the axis stopped
        at that sample.
        """
        omega = 2 * np.pi * self.frequency
        fading = self.damping * omega

        # state (z, p) with p = ż + q̇, which stays continuous where q̇ jumps: ż = p − q̇, ṗ = −2ζω
        # (p − q̇) − ω² z
        system = np.array([[0.0, 1.0], [-(omega**2), -2 * fading]])
        drive = np.array([[-1.0], [2 * fading]])
        a, b, c, d, _ = cont2discrete((system, drive, np.eye(2), np.zeros((2, 1))), step)
        numerators, denominator = ss2tf(a, b, c, d)

        speed = np.append(np.diff(q) / step, 0.0)
        z, p = (lfilter(numerator, denominator, speed) for numerator in numerators)
        rate = p - speed
        return z, np.hypot(z, (rate + fading * z) / (omega * np.sqrt(1 - self.damping**2)))

    def residual(self, q: Array, step: float, end: float) -> float:
        """Return the largest envelope from `end` (s) on: the residual vibration of a motion that
        ends by then.
        """
        _, envelope = self.swing(q, step)
        first = int(np.ceil(end / step - 1e-9))
        return float(envelope[first:].max())
