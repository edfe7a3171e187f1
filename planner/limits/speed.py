"""Speed of every axis: −V₋ ≤ q̇ ≤ V₊."""

import numpy as np

from planner.actuation import Points
from planner.limits.limit import AxisLimit, Motion, Quantity, Rows, Term


class Speed(AxisLimit):
    """q̇ = q′ ṡ, and ṡ ≥ 0: the sign of q′ says which way the axis goes."""

    name, dimension = "speed", "/s"
    terms = frozenset({Term.SD})

    def value(self, motion: Motion) -> Quantity:
        return motion.qd

    def rows(self, points: Points) -> Rows:
        q1 = points.derivatives[1]
        return Rows({Term.SD: q1}, np.where(q1 > 0, self.bounds, self.below))
