"""Speed of every axis: |q̇| ≤ V."""

from planner.actuation import Points
from planner.limits.limit import AxisLimit, Motion, Quantity, Rows, Term


class Speed(AxisLimit):
    """q̇ = q′ ṡ."""

    name, dimension = "speed", "/s"
    terms = frozenset({Term.SD})

    def value(self, motion: Motion) -> Quantity:
        return motion.qd

    def rows(self, points: Points) -> Rows:
        return Rows({Term.SD: points.derivatives[1]}, self.bounds)
