"""A path as a curve in space, with what a projection onto it needs."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from kinematics.array import Array
from planner.actuation import MachinePath


class Curve(Protocol):
    """A path in space r(s), smooth in each of the pieces between `breaks` (P + 1,)."""

    @property
    def breaks(self) -> Array: ...
    def at(self, s: Array, piece: np.ndarray) -> tuple[Array, Array]:
        """r and r′, each (N, 3), at s (N,) seen from inside the given pieces (N,)."""


@dataclass(frozen=True, slots=True)
class PathCurve:
    """The platform's origin along a planned path."""

    path: MachinePath

    @property
    def breaks(self) -> Array:
        return self.path.breaks

    def at(self, s: Array, piece: np.ndarray) -> tuple[Array, Array]:
        x, slope = self.path.pose_derivatives(s, piece, 1)
        return x[:, :3], slope[:, :3]
