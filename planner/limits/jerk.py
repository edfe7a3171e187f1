"""Jerk of every axis: −J₋ ≤ q⃛ ≤ J₊."""

from planner.actuation import Points
from planner.limits.limit import AxisLimit, Motion, Quantity, Rows, Term


class Jerk(AxisLimit):
    """q⃛ = q′ s⃛ + 3 q″ ṡ s̈ + q‴ ṡ³."""

    name, dimension = "jerk", "/s³"
    terms = frozenset({Term.SDDD, Term.SDSDD, Term.SD3})

    def value(self, motion: Motion) -> Quantity:
        return motion.qddd

    def rows(self, points: Points) -> Rows:
        _, q1, q2, q3 = points.derivatives
        return Rows({Term.SDDD: q1, Term.SDSDD: 3 * q2, Term.SD3: q3}, self.bounds, self.below)
