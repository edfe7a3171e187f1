"""Travel of every axis: lo ≤ q − home ≤ hi."""

from collections.abc import Sequence

import numpy as np

from kinematics.array import Array, frozen
from kinematics.axis import Axis
from planner.limits.limit import AxisLimit, Motion, Quantity


class Travel(AxisLimit):
    """Counted as |q − middle| / half range, so that 1 is an end of travel."""

    name, dimension = "travel", ""

    def __init__(self, axes: Sequence[Axis], home: Array) -> None:
        lo, hi = np.array([axis.travel for axis in axes]).T
        super().__init__(axes, list((hi - lo) / 2))
        self.travel = frozen(np.stack([lo, hi], 1))
        with np.errstate(invalid="ignore"):  # unlimited both ways: ∞ − ∞
            self.middle = frozen(np.nan_to_num(home + (lo + hi) / 2, nan=0.0))

    def value(self, motion: Motion) -> Quantity:
        return motion.q - self.middle

    def told(self, value: float, channel: int) -> tuple[float, float]:
        """The stroke from home, and the end of travel on its side."""
        lo, hi = self.travel[channel]
        middle = (lo + hi) / 2 if np.isfinite([lo, hi]).all() else 0.0
        return value + middle, float(hi if value > 0 else lo)
