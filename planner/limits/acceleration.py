"""Acceleration of every axis: |q̈| ≤ A."""

import numpy as np

from planner.actuation import Derivatives
from planner.limits.limit import AxisLimit, Motion, Quantity, Rows, Term


class Acceleration(AxisLimit):
    """q̈ = q′ s̈ + q″ ṡ²."""

    name, dimension = "acceleration", "/s²"
    terms = frozenset({Term.SDD, Term.SD2})

    def value(self, motion: Motion) -> Quantity:
        return motion.qdd

    def rows(self, derivatives: Derivatives, piece: np.ndarray) -> Rows:
        return Rows({Term.SDD: derivatives[1], Term.SD2: derivatives[2]}, self.bounds)
