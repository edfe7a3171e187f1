"""Acceleration of a payload on the platform: what it bears along each axis of the base."""

import numpy as np

from kinematics.array import Array, frozen
from planner.actuation import Points
from planner.limits.limit import Limit, Motion, Quantity, Rows, Term

CAP = 0.3
"""m/s² that the payload bears."""
PLACE = (0.0, 0.0, 0.08)
"""m, where it is in the platform's frame."""


class PayloadAcceleration(Limit):
    """−cap ≤ d²(p + R c)/dt² ≤ cap, at the place c of a platform with origin p and rotation R; gravity left out.

    With x(s) the place along the path: x′ s̈ + x″ ṡ².
    """

    name = "payload acceleration"
    terms = frozenset({Term.SDD, Term.SD2})

    def __init__(self) -> None:
        self.channels = ("x", "y", "z")
        self.bounds: Array = frozen([CAP] * 3)
        self.units = (("mm/s²", 1e3),) * 3

    def value(self, motion: Motion) -> Quantity:
        return at_place(motion.pose_rate(2))

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        return np.asarray(np.maximum(-low, high) / self.bounds)

    def rows(self, points: Points) -> Rows:
        _, first, second = (at_place(numbers) for numbers in points.pose_derivatives)
        return Rows({Term.SDD: first, Term.SD2: second}, self.bounds)


def at_place(numbers: Quantity) -> Quantity:
    """p + R c (N, 3), from a pose's twelve numbers (N, 12) or from their rates: p, then R row by row."""
    place = numbers[:, :3]
    for k, along in enumerate(PLACE):
        place = place + numbers[:, [3 + k, 6 + k, 9 + k]] * along
    return place
