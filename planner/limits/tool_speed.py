"""Speed of the tool, where the program caps it: ‖ṗ‖ ≤ cap of the piece."""

import numpy as np

from planner.actuation import Points
from planner.limits.capped import Capped, squared
from planner.limits.limit import Motion, Quantity, Rows, Term


class ToolSpeed(Capped):
    """ṗ = p′ ṡ of the tool."""

    name, unit = "tool speed", ("mm/s", 1e3)
    terms = frozenset({Term.SD})

    def value(self, motion: Motion) -> Quantity:
        return squared(motion.tool_rate(1), range(3))

    def rows(self, points: Points) -> Rows:
        along = np.linalg.norm(points.tool_derivatives[1][:, :3], axis=1, keepdims=True)
        return Rows({Term.SD: along}, self.caps[points.piece][:, None])
