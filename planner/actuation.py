"""Geometry in the actuators: q and its derivatives along a path, numerically and in guaranteed Taylor arithmetic."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Protocol

import casadi as ca
import numpy as np

from kinematics.array import Array, frozen
from kinematics.expression import Expression
from kinematics.machine import Machine
from kinematics.pose import column, symbols
from kinematics.series import Series
from planner.path.shape import Piece, Shape, pose_map

Derivatives = tuple[Array, Array, Array, Array]
"""q, q′, q″, q‴ with respect to path length, each (N, n)."""


class ActuatorPath(Protocol):
    """q(s) of n axes: P smooth pieces between `breaks` (P+1,), which tell of `s` on a break which side is meant by the piece's index."""

    @property
    def breaks(self) -> Array: ...
    @property
    def names(self) -> tuple[str, ...]: ...
    def segment(self, piece: int) -> int | None:
        """Number of the program's segment that a piece belongs to, from 1; None without a program."""

    def derivatives(self, s: Array, piece: np.ndarray) -> Derivatives: ...
    def pose_numbers(self, s: Array, piece: np.ndarray) -> Array | None:
        """(N, 12) numbers of the pose, None where there is no machine."""

    def enclose(self, s: Series, piece: np.ndarray) -> tuple[Series, Series | None]:
        """q as series (order+1, N, n) of whatever s (order+1, N) is a series of, and the pose's numbers (order+1, N, 12)."""


@lru_cache(maxsize=64)
def _along(machine: Machine, shape: Shape) -> Expression:
    """(s, parameters) -> q, q′, q″, q‴: the machine's inverse map composed with the shape, differentiated."""
    s, parameters = ca.SX.sym("s"), ca.SX.sym("parameters", shape.size)
    x = column(*shape.motion(s, parameters))
    orders = [machine.expression(*symbols(x))]
    for _ in range(3):
        orders.append(ca.jacobian(orders[-1], s))
    return Expression(f"{machine.name}_{shape.name}", ca.vertcat(s, parameters), ca.vertcat(*orders))


class MachinePath:
    """A path in space as the machine's actuators see it."""

    def __init__(self, machine: Machine, pieces: Sequence[Piece]) -> None:
        self.machine, self.pieces = machine, tuple(pieces)
        self.breaks: Array = frozen(np.concatenate([[0.0], np.cumsum([piece.length for piece in pieces])]))
        self.names = tuple(axis.name for axis in machine.axes)
        self._shapes = list({piece.shape: None for piece in pieces})
        self._shape_of = np.array([self._shapes.index(piece.shape) for piece in pieces])
        self._parameters = [
            np.array([p.parameters if p.shape is shape else np.zeros(shape.size) for p in pieces]) for shape in self._shapes
        ]

    def segment(self, piece: int) -> int:
        return self.pieces[piece].segment

    def derivatives(self, s: Array, piece: np.ndarray) -> Derivatives:
        both = self._evaluate(lambda shape: _along(self.machine, shape), s, piece)
        q, q1, q2, q3 = np.split(both, 4, axis=1)
        return q, q1, q2, q3

    def pose_numbers(self, s: Array, piece: np.ndarray) -> Array:
        return self._evaluate(pose_map, s, piece)

    def _evaluate(self, expression: Callable[[Shape], Expression], s: Array, piece: np.ndarray) -> Array:
        local = s - self.breaks[piece]
        out = np.empty((len(s), expression(self._shapes[0]).size[1]))
        for k, shape in enumerate(self._shapes):
            chosen = np.flatnonzero(self._shape_of[piece] == k)
            if not len(chosen):
                continue
            out[chosen] = expression(shape)(np.column_stack([local[chosen], self._parameters[k][piece[chosen]]]))
        return out

    def enclose(self, s: Series, piece: np.ndarray) -> tuple[Series, Series]:
        pose = Series.zeros(s.order, (len(piece), 12))
        local = s - self.breaks[piece]
        for k, shape in enumerate(self._shapes):
            chosen = np.flatnonzero(self._shape_of[piece] == k)
            if len(chosen):
                parameters = [Series.constant(values, s.order) for values in self._parameters[k][piece[chosen]].T]
                pose.put(chosen, Series.stack(pose_map(shape).enclose([local[chosen], *parameters])))
        return Series.stack(self.machine.inverse_map.enclose(pose.columns())), pose


class PolynomialPath:
    """Axis values given as a piecewise polynomial of any parameter: a path without a machine."""

    def __init__(self, breaks: Array, coefficients: Array, names: Sequence[str]) -> None:
        """coefficients (degree+1, P, n), the highest power of s − breaks[p] first, as SciPy has them."""
        self.breaks, self.names = frozen(breaks), tuple(names)
        self.coefficients: Array = frozen(coefficients)

    def segment(self, piece: int) -> None:
        return None

    def derivatives(self, s: Array, piece: np.ndarray) -> Derivatives:
        """Horner's scheme for the value and its first three derivatives at once."""
        x = (s - self.breaks[piece])[:, None]
        q = np.zeros((len(s), self.coefficients.shape[2]))
        q1, half_q2, sixth_q3 = q.copy(), q.copy(), q.copy()
        for c in self.coefficients[:, piece]:
            sixth_q3, half_q2, q1, q = sixth_q3 * x + half_q2, half_q2 * x + q1, q1 * x + q, q * x + c
        return q, q1, 2 * half_q2, 6 * sixth_q3

    def pose_numbers(self, s: Array, piece: np.ndarray) -> None:
        return None

    def enclose(self, s: Series, piece: np.ndarray) -> tuple[Series, None]:
        x = (s - self.breaks[piece])[:, None]
        q = Series.zeros(s.order, (len(piece), self.coefficients.shape[2]))
        for c in self.coefficients[:, piece]:
            q = q * x + c
        return q, None
