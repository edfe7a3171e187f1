"""Acceleration of every axis: −A₋ ≤ q̈ ≤ A₊."""

from planner.actuation import Points
from planner.limits.limit import AxisLimit, Motion, Quantity, Rows, Term


class Acceleration(AxisLimit):
    """q̈ = q′ s̈ + q″ ṡ²."""

    name, dimension = "acceleration", "/s²"
    terms = frozenset({Term.SDD, Term.SD2})

    def value(self, motion: Motion) -> Quantity:
        return motion.qdd

    def rows(self, points: Points) -> Rows:
        return Rows({Term.SDD: points.derivatives[1], Term.SD2: points.derivatives[2]}, self.bounds, self.below)
