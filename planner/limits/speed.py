"""Speed of every axis: |q̇| ≤ V."""

import numpy as np

from planner.actuation import Derivatives
from planner.limits.limit import AxisLimit, Motion, Quantity, Rows, Term


class Speed(AxisLimit):
    """q̇ = q′ ṡ."""

    name, dimension = "speed", "/s"
    terms = frozenset({Term.SD})

    def value(self, motion: Motion) -> Quantity:
        return motion.qd

    def rows(self, derivatives: Derivatives, piece: np.ndarray) -> Rows:
        return Rows({Term.SD: derivatives[1]}, self.bounds)
