"""Limits of the tool, where the program caps it: ‖ṗ‖, ‖p̈‖ or ‖ω‖ ≤ cap of the piece.

All are the norm of a vector that a program caps segment by segment: the tool's speed, its acceleration, and the
platform's angular speed.
"""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from planner.limits.limit import Limit, LimitState, Quantity, Rows, Term
from planner.path.actuation import Points


class ToolLimit(Limit):
    """One channel. The certificate bounds the square of the norm, which is smooth where the norm is zero."""

    unit: ClassVar[tuple[str, float]]
    channels = ("tool",)

    def __init__(self, caps: Iterable[float | None]) -> None:
        self.caps = freeze_array([np.inf if cap is None else cap for cap in caps])
        self.bounds = freeze_array([self.caps.min()])
        self.units = (self.unit,)

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        return np.asarray(np.sqrt(np.maximum(high, 0.0)) / self.caps[piece][:, None])

    def report_value(self, value: float, channel: int, piece: int) -> tuple[float, float]:
        return float(np.sqrt(max(value, 0.0))), float(self.caps[piece])

    def _scale(self, factors: Array) -> None:
        self.caps, self.bounds = freeze_array(self.caps * factors[0]), freeze_array(self.bounds * factors)


def squared_norm(rates: Quantity, columns: Iterable[int]) -> Quantity:
    """‖·‖² (N, 1) of the vectors that some columns of rates make."""
    parts = (rates[:, k : k + 1] for k in columns)
    return sum((part * part for part in parts), start=0.0)


class ToolSpeed(ToolLimit):
    """ṗ = p′ ṡ of the tool."""

    name, unit = "tool speed", ("mm/s", 1e3)
    terms = frozenset({Term.SD})

    def value(self, motion: LimitState) -> Quantity:
        return squared_norm(motion.tool_rate(1), range(3))

    def rows(self, points: Points) -> Rows:
        along = np.linalg.norm(points.tool_derivatives[1][:, :3], axis=1, keepdims=True)
        return Rows({Term.SD: along}, self.caps[points.piece][:, None])


# Facets over the half turn from pushing to braking; an even number, so that pushing and pure bending meet corners.
FACETS = 32


def _facet_normals() -> tuple[Array, Array, float]:
    """Cosines and sines (FACETS,) of the facets' normals, and their distance from the centre of the unit circle."""
    angles = (np.arange(FACETS) + 0.5) * np.pi / FACETS
    return freeze_array(np.cos(angles)), freeze_array(np.sin(angles)), float(np.cos(np.pi / (2 * FACETS)))


class ToolAcceleration(ToolLimit):
    """p̈ = p′ s̈ + p″ ṡ² of the platform's origin: in the plane of p′ and p″, a circle of radius a.

    The solvers' rows are the facets of a polygon inscribed in it: with e₁ along p′ and e₂ across, for each normal
    (cos θ, sin θ), |cos θ ‖p′‖ s̈ + (cos θ p″·e₁ + sin θ p″·e₂) ṡ²| ≤ a cos(π/2n) with n facets over the half turn.
    Nothing is lost where the tool only gains speed or only bends, elsewhere at most 1 − cos(π/64) = 0.12 % of a, so
    0.06 % of time.
    """

    name, unit = "tool acceleration", ("mm/s²", 1e3)
    terms = frozenset({Term.SDD, Term.SD2})

    def value(self, motion: LimitState) -> Quantity:
        return squared_norm(motion.tool_rate(2), range(3))

    def rows(self, points: Points) -> Rows:
        _, p1, p2 = (derivative[:, :3] for derivative in points.tool_derivatives)
        size = np.linalg.norm(p1, axis=1, keepdims=True)
        along = p1 / np.where(size > 0, size, 1.0)
        push = (p2 * along).sum(1, keepdims=True)
        bend = np.linalg.norm(p2 - push * along, axis=1, keepdims=True)
        cosine, sine, near = _facet_normals()
        return Rows({Term.SDD: cosine * size, Term.SD2: cosine * push + sine * bend}, self._caps(points) * near)

    def _caps(self, points: Points) -> Array:
        return np.repeat(self.caps[points.piece][:, None], FACETS, 1)


class AngularSpeed(ToolLimit):
    """Ṙ = ω× R, so ‖ω‖² = ½ ‖Ṙ‖² (Frobenius), and ω = ω′ ṡ: the same of R′."""

    name, unit = "angular speed", ("deg/s", 180 / np.pi)
    terms = frozenset({Term.SD})

    def value(self, motion: LimitState) -> Quantity:
        return squared_norm(motion.pose_rate(1), range(3, 12)) * 0.5

    def rows(self, points: Points) -> Rows:
        along = np.linalg.norm(points.pose_derivatives[1][:, 3:], axis=1, keepdims=True) / np.sqrt(2)
        return Rows({Term.SD: along}, self.caps[points.piece][:, None])
