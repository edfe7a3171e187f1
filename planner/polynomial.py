"""Axis values as a piecewise polynomial: a path without a machine."""

from collections.abc import Sequence

import numpy as np

from kinematics.array import Array, frozen
from kinematics.series import Series
from planner.actuation import Derivatives
from planner.place import Place
from planner.stands import standing_ends

# A jump of a derivative at a break up to this share of its axis' largest value is rounding, or of any axis' largest.
SMOOTH, ROUNDING = 1e-9, 1e-13
# Halvings that find a parameter: to rounding.
HALVINGS = 54


class PolynomialPath:
    """Axis values given as a piecewise polynomial of any parameter: a path without a machine."""

    def __init__(
        self,
        breaks: Array,
        coefficients: Array,
        names: Sequence[str],
        end_speeds: tuple[float, float] = (0.0, 0.0),
        *,
        rests: np.ndarray | None = None,
        lines: np.ndarray | None = None,
        origin: "PolynomialPath | None" = None,
    ) -> None:
        """coefficients (degree+1, P, n), the highest power of s − breaks[p] first, as SciPy has them.

        rests   (P+1,) further places at which a motion rests: where the path stands
        lines   (P,) pieces that are straight, and drawn by their way
        origin  the path as it was given, of which such pieces are drawn
        """
        self.breaks, self.names, self.end_speeds = frozen(breaks), tuple(names), end_speeds
        self.coefficients: Array = frozen(coefficients)
        self.dwells: Array = frozen(np.zeros(len(breaks)))
        self.tool = None
        self.origin = self if origin is None else origin
        self.rests = frozen(np.zeros(len(breaks), bool) if rests is None else rests)
        self.lines = frozen(np.zeros(len(breaks) - 1, bool) if lines is None else lines)
        self.turns: Array = frozen(np.zeros(len(breaks) - 1))  # a piece of low degree bends little

    def stops(self, order: int) -> np.ndarray:
        """At corners (q′ jumps), and under jerk limits where the curvature q″ jumps."""
        inner = np.arange(1, len(self.breaks) - 1)
        left, right = self.derivatives(self.breaks[inner], inner - 1), self.derivatives(self.breaks[inner], inner)
        stops = np.ones(len(self.breaks), bool)
        stops[inner] = self.rests[inner]
        still = standing_ends(self)
        turning = (still[1, :-1] > 0) & (still[0, 1:] > 0)  # there q′ is nothing but rounding
        size = np.maximum(np.abs(left[1]), np.abs(right[1]))
        most = np.maximum(size.max(0, initial=0.0), np.finfo(float).tiny)
        # where the parameter is slow, ṡ is large: q̇ = q′ ṡ jumps by as much more, and q″ ṡ² by the square
        slow = np.where(turning[:, None], 1.0, (size / most).max(1, keepdims=True, initial=0.0))
        for k in range(1, order):
            gap, size = np.abs(left[k] - right[k]), np.maximum(np.abs(left[k]), np.abs(right[k])).max(0, initial=0.0)
            jumps = (gap > SMOOTH * size * slow**k + ROUNDING * size.max(initial=0.0)).any(1)
            stops[inner] |= jumps & ~turning if k == 1 else jumps
        return stops

    def parameter(self, s: Array, piece: np.ndarray) -> Array:
        """The parameter of the path as it was given: s itself, but on pieces that are drawn by their way."""
        found = np.array(s, float)
        drawn = np.flatnonzero(self.lines[piece])
        if not len(drawn):
            return found
        own = piece[drawn]
        way, there = self.coefficients[-2, own], self.derivatives(found[drawn], own, 0)[0]
        axis = np.abs(way).argmax(1)[:, None]
        rising, target = np.sign(np.take_along_axis(way, axis, 1)), np.take_along_axis(there, axis, 1)
        low, high = self.breaks[own], self.breaks[own + 1]
        given = self.origin
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            at = np.clip(np.searchsorted(given.breaks, middle, side="right") - 1, 0, len(given.breaks) - 2)
            value = np.take_along_axis(given.derivatives(middle, at, 0)[0], axis, 1)
            early = (rising * (value - target))[:, 0] < 0
            low, high = np.where(early, middle, low), np.where(early, high, middle)
        start, end = self.breaks[own], self.breaks[own + 1]
        near = SMOOTH * (end - start)  # of an end, where the given path may stand: rounding
        at_ends = np.where(found[drawn] - start < near, start, np.where(end - found[drawn] < near, end, high))
        found[drawn] = at_ends
        return found

    def constant(self, piece: int) -> None:
        return None

    def segment(self, piece: int) -> None:
        return None

    def place(self, s: float, piece: int, t: float | None = None, axis: str = "") -> Place:
        return Place(float(self.parameter(np.array([s]), np.array([piece]))[0]), None, t, axis)

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
