"""Axis values as a piecewise polynomial: a path without a machine."""

from collections.abc import Sequence

import numpy as np

from kinematics.array import Array, frozen
from kinematics.series import Series
from planner.actuation import Derivatives
from planner.place import Place

# A jump of a derivative at a break up to this share of its axis' largest value is rounding, or of any axis' largest.
SMOOTH, ROUNDING = 1e-9, 1e-13


class PolynomialPath:
    """Axis values given as a piecewise polynomial of any parameter: a path without a machine."""

    def __init__(
        self, breaks: Array, coefficients: Array, names: Sequence[str], end_speeds: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """coefficients (degree+1, P, n), the highest power of s − breaks[p] first, as SciPy has them."""
        self.breaks, self.names, self.end_speeds = frozen(breaks), tuple(names), end_speeds
        self.coefficients: Array = frozen(coefficients)
        self.dwells: Array = frozen(np.zeros(len(breaks)))
        self.tool = None
        self.turns: Array = frozen(np.zeros(len(breaks) - 1))  # a piece of low degree bends little

    def stops(self, order: int) -> np.ndarray:
        """At corners (q′ jumps), and under jerk limits where the curvature q″ jumps."""
        inner = np.arange(1, len(self.breaks) - 1)
        left, right = self.derivatives(self.breaks[inner], inner - 1), self.derivatives(self.breaks[inner], inner)
        stops = np.ones(len(self.breaks), bool)
        stops[inner] = False
        for k in range(1, order):
            gap, size = np.abs(left[k] - right[k]), np.maximum(np.abs(left[k]), np.abs(right[k])).max(0, initial=0.0)
            stops[inner] |= (gap > SMOOTH * size + ROUNDING * size.max(initial=0.0)).any(1)
        return stops

    def constant(self, piece: int) -> None:
        return None

    def segment(self, piece: int) -> None:
        return None

    def place(self, s: float, piece: int, t: float | None = None, axis: str = "") -> Place:
        return Place(s, None, t, axis)

    def derivatives(self, s: Array, piece: np.ndarray, highest: int = 3) -> Derivatives:
        return self._horner(self.coefficients, s, piece, highest)

    def axis_derivatives(self, axis: int, s: Array, piece: np.ndarray, highest: int = 3) -> Derivatives:
        return self._horner(self.coefficients[:, :, axis : axis + 1], s, piece, highest)

    def _horner(self, coefficients: Array, s: Array, piece: np.ndarray, highest: int) -> Derivatives:
        """The value and its first three derivatives at once."""
        x = (s - self.breaks[piece])[:, None]
        q = np.zeros((len(s), coefficients.shape[2]))
        q1, half_q2, sixth_q3 = q.copy(), q.copy(), q.copy()
        for c in coefficients[:, piece]:
            sixth_q3, half_q2, q1, q = sixth_q3 * x + half_q2, half_q2 * x + q1, q1 * x + q, q * x + c
        return (q, q1, 2 * half_q2, 6 * sixth_q3)[: highest + 1]

    def pose_numbers(self, s: Array, piece: np.ndarray) -> None:
        return None

    def pose_derivatives(self, s: Array, piece: np.ndarray, highest: int = 3) -> None:
        return None

    def enclose(self, s: Series, piece: np.ndarray) -> tuple[Series, None]:
        x = (s - self.breaks[piece])[:, None]
        first, *rest = self.coefficients[:, piece]
        q = Series.constant(first, s.order)
        for c in rest:
            q = q * x + c
        return q, None
