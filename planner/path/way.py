"""The way along a curve: its length by quadrature, and the place at which a length is reached."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kinematics.array import Array, frozen

# Points of a panel (exact to degree 31), panels at first and at most, and how well twice as many must agree with them.
POINTS, PANELS, MOST, AGREED = 16, 4, 2**12, 1e-14
# Steps after which nothing of a bracket is left to floats: each at least halves it.
STEPS = 64


@dataclass(frozen=True, slots=True)
class Way:
    """The length ∫ speed ds from the first of some edges (K+1,) on; lengths (K+1,) there.

    speed  |dp/ds| (N,) at s (N,), positive
    """

    speed: Callable[[Array], Array]
    edges: Array
    lengths: Array

    @property
    def length(self) -> float:
        return float(self.lengths[-1])

    def place(self, lengths: Array) -> Array:
        """s (N,) at which lengths (N,) are reached, to rounding: Newton's steps inside a bracket that closes."""
        k = np.clip(np.searchsorted(self.lengths, lengths, side="right") - 1, 0, len(self.edges) - 2)
        low, high, start = self.edges[k], self.edges[k + 1], self.edges[k]
        s = low + (high - low) * (lengths - self.lengths[k]) / (self.lengths[k + 1] - self.lengths[k])
        for _ in range(STEPS):
            missing = lengths - self.lengths[k] - _integrals(self.speed, start, s)
            low, high = np.where(missing > 0, s, low), np.where(missing > 0, high, s)
            step = s + missing / self.speed(s)
            before, s = s, np.where((low <= step) & (step <= high), step, (low + high) / 2)
            if (np.abs(s - before) <= 2 * np.spacing(np.abs(s))).all():
                break
        return s


def way(speed: Callable[[Array], Array], low: float, high: float) -> Way:
    """The way from s = low to high: panels of Gauss and Legendre, as many as agree with half of them."""
    panels, before = PANELS, np.inf
    while True:
        edges = np.linspace(low, high, panels + 1)
        lengths = np.concatenate([[0.0], np.cumsum(_integrals(speed, edges[:-1], edges[1:]))])
        if abs(lengths[-1] - before) <= AGREED * lengths[-1] or panels >= MOST:
            return Way(speed, frozen(edges), frozen(lengths))
        panels, before = 2 * panels, lengths[-1]


def _integrals(speed: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """∫ speed from low (N,) to high (N,)."""
    x, weight = np.polynomial.legendre.leggauss(POINTS)
    s = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * x
    return np.asarray((speed(s.ravel()).reshape(s.shape) * weight).sum(1) * (high - low) / 2)
