"""Speed of the tool, where the program caps it: ‖ṗ‖ ≤ cap of the piece."""

from collections.abc import Sequence

import numpy as np

from kinematics.array import Array, frozen
from planner.actuation import Points
from planner.limits.limit import Limit, Motion, Quantity, Rows, Term


class ToolSpeed(Limit):
    """Path length is the way of the tool wherever a cap is given, so the solvers' row is ṡ ≤ cap.

    The certificate bounds ‖ṗ‖², which is smooth at rest, from the pose itself.
    """

    name = "tool speed"
    terms = frozenset({Term.SD})
    channels = ("tool",)
    units = (("mm/s", 1e3),)

    def __init__(self, caps: Sequence[float | None]) -> None:
        self.caps = frozen([np.inf if cap is None else cap for cap in caps])
        self.bounds = frozen([self.caps.min()])

    def value(self, motion: Motion) -> Quantity:
        x, y, z = (motion.tool_rate(1)[:, k : k + 1] for k in range(3))
        return x * x + y * y + z * z

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        return np.asarray(np.sqrt(np.maximum(high, 0.0)) / self.caps[piece][:, None])

    def rows(self, points: Points) -> Rows:
        return Rows({Term.SD: np.ones((len(points.s), 1))}, self.caps[points.piece][:, None])
