"""Speed of every axis, or of the motor behind a screw whose error it makes up for: −V₋ ≤ r q̇ ≤ V₊."""

from collections.abc import Sequence

import numpy as np

from kinematics.array import Array, frozen
from kinematics.axis import Axis, Magnitude
from planner.actuation import Points
from planner.limits.limit import AxisLimit, Motion, Quantity, Rows, Term


class Speed(AxisLimit):
    """q̇ = q′ ṡ, and ṡ ≥ 0: the sign of q′ says which way the axis goes.

    r = max 1/(1 + slope) of a lead error that is made up for, else 1: max_speed is the motor's.
    """

    name, dimension = "speed", "/s"
    terms = frozenset({Term.SD})

    def __init__(self, axes: Sequence[Axis], bounds: Sequence[Magnitude | None]) -> None:
        super().__init__(axes, bounds)
        self.ratio: Array = frozen([axis.motor_ratio for axis in axes])

    def value(self, motion: Motion) -> Quantity:
        return motion.qd if (self.ratio == 1.0).all() else motion.qd * self.ratio

    def rows(self, points: Points) -> Rows:
        q1 = points.derivatives[1] * self.ratio
        return Rows({Term.SD: q1}, np.where(q1 > 0, self.bounds, self.below))
