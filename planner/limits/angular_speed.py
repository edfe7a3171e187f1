"""Angular speed of the platform, where the program caps it: ‖ω‖ ≤ cap of the piece."""

import numpy as np

from planner.actuation import Points
from planner.limits.capped import Capped, squared
from planner.limits.limit import Motion, Quantity, Rows, Term


class AngularSpeed(Capped):
    """Ṙ = ω× R, so ‖ω‖² = ½ ‖Ṙ‖² (Frobenius), and ω = ω′ ṡ: the same of R′."""

    name, unit = "angular speed", ("deg/s", 180 / np.pi)
    terms = frozenset({Term.SD})

    def value(self, motion: Motion) -> Quantity:
        return squared(motion.pose_rate(1), range(3, 12)) * 0.5

    def rows(self, points: Points) -> Rows:
        along = np.linalg.norm(points.pose_derivatives[1][:, 3:], axis=1, keepdims=True) / np.sqrt(2)
        return Rows({Term.SD: along}, self.caps[points.piece][:, None])
