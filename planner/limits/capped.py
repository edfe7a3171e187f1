"""What a program caps segment by segment: the norm of a vector, ‖value‖ ≤ cap of the piece."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from kinematics.array import Array, frozen
from planner.limits.limit import Limit, Quantity


class Capped(Limit):
    """One channel. The certificate bounds the square of the norm, which is smooth where the norm is zero."""

    unit: ClassVar[tuple[str, float]]
    channels = ("tool",)

    def __init__(self, caps: Iterable[float | None]) -> None:
        self.caps = frozen([np.inf if cap is None else cap for cap in caps])
        self.bounds = frozen([self.caps.min()])
        self.units = (self.unit,)

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        return np.asarray(np.sqrt(np.maximum(high, 0.0)) / self.caps[piece][:, None])

    def told(self, value: float, channel: int) -> tuple[float, float]:
        return float(np.sqrt(max(value, 0.0))), float(self.bounds[channel])


def squared(rates: Quantity, columns: Iterable[int]) -> Quantity:
    """‖·‖² (N, 1) of the vectors that some columns of rates make."""
    parts = (rates[:, k : k + 1] for k in columns)
    return sum((part * part for part in parts), start=0.0)
