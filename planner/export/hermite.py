"""What consumers make of points: one polynomial per segment that meets the rows given at both its ends.

One row (position) is a straight line, two (and velocity) the cubic of PVT, three (and acceleration) a quintic.
"""

from dataclasses import dataclass
from functools import cache
from math import factorial

import numpy as np

from kinematics.array import Array
from planner.pulses.motion import Motion


@dataclass(frozen=True, slots=True)
class Segments:
    """S segments, each from `start` to `end` (S,) s; `first` and `last` (rows, S, axes) are what its ends state."""

    start: Array
    end: Array
    first: Array
    last: Array

    @property
    def coefficients(self) -> Array:
        """(2 rows, S, axes) c of q(u) - q(0) = Σ c_i uⁱ, u in [0, 1]: of the way, whose rounding is as small as it."""
        rows = len(self.first)
        scale = (self.end - self.start)[:, None] ** np.arange(rows)[:, None, None]
        ends = np.concatenate([self.first * scale, self.last * scale])
        ends[0], ends[rows] = 0.0, self.last[0] - self.first[0]
        return np.tensordot(_from_ends(rows), ends, 1)

    def deviation(self, motion: Motion, probes: int) -> Array:
        """(S, axes) how far the segments are from a motion, in its unit.

        The largest |e| at the ends of `probes` equal parts of a segment, and what it may grow to between them: a part
        of length d adds at most d² max|ë| / 8, with ë as it is inside (at an end q̈ may be that of the next piece).
        """
        u = np.linspace(0.0, 1.0, probes + 1)
        length = self.end - self.start
        state = motion.at((self.start[:, None] + length[:, None] * u).ravel())
        shape = (len(length), len(u), -1)
        c = self.coefficients
        power = np.arange(len(c))
        way = np.einsum("pi,isa->spa", u[:, None] ** power, c)
        bend = np.einsum("pi,isa->spa", u[:, None] ** np.maximum(power - 2, 0) * power * (power - 1), c)
        error = abs(self.first[0][:, None] + way - state.q.reshape(shape)).max(1)
        bend -= state.qdd.reshape(shape) * (length**2)[:, None, None]  # ë times the square of the length
        return np.asarray(error + abs(bend[:, 1:-1]).max(1) / (8 * probes**2))

    def backward(self, motion: Motion, probes: int) -> Array:
        """(S, axes) how far a cubic runs back inside its segment where the motion runs one way only, else 0.

        q̇(u) = c1 + 2 c2 u + 3 c3 u² is against the way between its roots r1 < r2 if both lie inside: by
        |c3| (r2 - r1)³ / 2. Other segments than cubics are not looked at.
        """
        if len(self.first) != 2:
            return np.zeros(self.first.shape[1:])
        u = np.linspace(0.0, 1.0, probes + 1)
        length = self.end - self.start
        qd = motion.at((self.start[:, None] + length[:, None] * u).ravel()).qd.reshape(len(length), len(u), -1)
        way = np.sign(qd.sum(1))
        one_way = (qd * way[:, None] >= 0).all(1)
        _, c1, c2, c3 = self.coefficients * way
        with np.errstate(divide="ignore", invalid="ignore"):
            middle, apart = -c2 / (3 * c3), 2 * np.sqrt(c2**2 - 3 * c1 * c3) / (3 * c3)
            inside = one_way & (c3 > 0) & (middle > 0) & (middle < 1) & (apart > 0)
            return np.where(inside, c3 * apart**3 / 2, 0.0)


@cache
def _from_ends(rows: int) -> Array:
    """(2 rows, 2 rows) coefficients by powers of u from value and derivatives at u = 0, and at u = 1."""
    powers = range(2 * rows)
    at_start = [[factorial(i) if i == k else 0 for i in powers] for k in range(rows)]
    at_end = [[factorial(i) / factorial(i - k) if i >= k else 0 for i in powers] for k in range(rows)]
    return np.asarray(np.rint(np.linalg.inv(np.array(at_start + at_end, float)) * 2) / 2)  # they are halves
