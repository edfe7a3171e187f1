"""A motion of one axis in pulses, as the check samples it."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.array import Array

HALF_TICK = 0.501  # what rounding to a whole tick may take, and a thousandth for the arithmetic of both sides
ROUNDING = 64 * np.finfo(float).eps


@dataclass(frozen=True, slots=True)
class Samples:
    """x and its three derivatives (pulses, s) at instants t (N,); the count from t on, and the way of the last pulse.

    way  +1 or -1, 0 before the first pulse
    """

    t: Array
    x: Array
    v: Array
    a: Array
    j: Array
    count: Array
    way: Array

    def __getitem__(self, which: slice | NDArray[Any]) -> "Samples":
        return Samples(*(getattr(self, part.name)[which] for part in fields(self)))

    def followed_by(self, other: "Samples") -> "Samples":
        return Samples(*(np.concatenate((getattr(self, p.name), getattr(other, p.name))) for p in fields(self)))

    def travel(self, time: float) -> Array:
        """(N,) pulses that x runs in so long (s)."""
        return np.asarray(abs(self.v) * time + abs(self.a) * time**2 / 2)
