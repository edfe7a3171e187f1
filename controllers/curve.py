"""A path as a curve in space, with the derivatives that a projection onto it needs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Protocol

import casadi as ca
import numpy as np

from kinematics.array import Array
from kinematics.expression import Expression
from planner.actuation import MachinePath
from planner.path.shape import Shape


class Curve(Protocol):
    """A path in space r(s), smooth in each of the pieces between `breaks` (P + 1,)."""

    @property
    def breaks(self) -> Array: ...
    def at(self, s: Array, piece: np.ndarray) -> tuple[Array, Array, Array]:
        """r, r′, r″, each (N, 3), at s (N,) seen from inside the given pieces (N,)."""


@cache
def _derivatives(shape: Shape) -> Expression:
    """(s, parameters) -> r, r′, r″ of a shape."""
    s, parameters = ca.SX.sym("s"), ca.SX.sym("parameters", shape.size)
    position, _ = shape.motion(s, parameters)
    slope = ca.jacobian(position, s)
    return Expression(f"{shape.name}_slope", ca.vertcat(s, parameters), ca.vertcat(position, slope, ca.jacobian(slope, s)))


@dataclass(frozen=True, slots=True)
class PathCurve:
    """The positions of a planned path as a Curve."""

    path: MachinePath

    @property
    def breaks(self) -> Array:
        return self.path.breaks

    def at(self, s: Array, piece: np.ndarray) -> tuple[Array, Array, Array]:
        out = np.empty((len(s), 9))
        for p in np.unique(piece):
            rows = np.flatnonzero(piece == p)
            chosen = self.path.pieces[p]
            local = np.minimum(s[rows] - self.path.breaks[p], chosen.length)
            inputs = np.broadcast_to(chosen.parameters, (len(rows), chosen.shape.size))
            out[rows] = _derivatives(chosen.shape)(np.column_stack([local, inputs]))
        return out[:, :3], out[:, 3:6], out[:, 6:]
