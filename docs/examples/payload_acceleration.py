"""Acceleration of a payload on the platform: what it bears along each axis of the base."""

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from planner.limits.limit import Limit, LimitState, Quantity, Rows, Term
from planner.path.actuation import Points

CAP = 0.3
"""m/s² that the payload bears."""
PLACE = (0.0, 0.0, 0.08)
"""m, where it is in the platform's frame."""


class PayloadAcceleration(Limit):
    """−cap ≤ d²x/dt² ≤ cap of the place x = p + R c; gravity is left out.

    p, R are the platform's origin and rotation, c is fixed on it. Along the path x(s): x′ s̈ + x″ ṡ².
    """

    name = "payload acceleration"
    terms = frozenset({Term.SDD, Term.SD2})

    def __init__(self) -> None:
        self.channels = ("x", "y", "z")
        self.bounds: Array = freeze_array([CAP] * 3)
        self.units = (("mm/s²", 1e3),) * 3

    def value(self, motion: LimitState) -> Quantity:
        return at_place(motion.pose_rate(2))

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        return np.asarray(np.maximum(-low, high) / self.bounds)

    def rows(self, points: Points) -> Rows:
        _, first, second = (at_place(numbers) for numbers in points.pose_derivatives)
        return Rows({Term.SDD: first, Term.SD2: second}, self.bounds)


def at_place(numbers: Quantity) -> Quantity:
    """p + R c (N, 3) of a pose's twelve numbers (N, 12), p and R row by row, or of their rates."""
    place = numbers[:, :3]
    for k, along in enumerate(PLACE):
        place = place + numbers[:, [3 + k, 6 + k, 9 + k]] * along
    return place
