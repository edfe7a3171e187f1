"""Acceleration of the tool, where the program caps it: ‖p̈‖ ≤ cap of the piece."""

import numpy as np

from kinematics.array import Array, frozen
from planner.actuation import Points
from planner.limits.capped import Capped, squared
from planner.limits.limit import Motion, Quantity, Rows, Term

# Facets over the half turn from pushing to braking; an even number, so that pushing and pure bending meet corners.
FACETS = 32


def _facets() -> tuple[Array, Array, float]:
    """Cosines and sines (FACETS,) of the facets' normals, and their distance from the centre of the unit circle."""
    angles = (np.arange(FACETS) + 0.5) * np.pi / FACETS
    return frozen(np.cos(angles)), frozen(np.sin(angles)), float(np.cos(np.pi / (2 * FACETS)))


class ToolAcceleration(Capped):
    """p̈ = p′ s̈ + p″ ṡ² of the platform's origin: in the plane of p′ and p″, a circle of radius a.

    The solvers' rows are the facets of a polygon inscribed in it: with e₁ along p′ and e₂ across, for each normal
    (cos θ, sin θ), |cos θ ‖p′‖ s̈ + (cos θ p″·e₁ + sin θ p″·e₂) ṡ²| ≤ a cos(π/2n) with n facets over the half turn.
    Nothing is lost where the tool only gains speed or only bends, elsewhere at most 1 − cos(π/64) = 0.12 % of a, so
    0.06 % of time.
    """

    name, unit = "tool acceleration", ("mm/s²", 1e3)
    terms = frozenset({Term.SDD, Term.SD2})

    def value(self, motion: Motion) -> Quantity:
        return squared(motion.tool_rate(2), range(3))

    def rows(self, points: Points) -> Rows:
        _, p1, p2 = (derivative[:, :3] for derivative in points.tool_derivatives)
        size = np.linalg.norm(p1, axis=1, keepdims=True)
        along = p1 / np.where(size > 0, size, 1.0)
        push = (p2 * along).sum(1, keepdims=True)
        bend = np.linalg.norm(p2 - push * along, axis=1, keepdims=True)
        cosine, sine, near = _facets()
        return Rows({Term.SDD: cosine * size, Term.SD2: cosine * push + sine * bend}, self._caps(points) * near)

    def _caps(self, points: Points) -> Array:
        return np.repeat(self.caps[points.piece][:, None], FACETS, 1)
