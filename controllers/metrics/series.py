"""An error over time, and its figures."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from kinematics.array import Array
from planner.place import Place


@dataclass(frozen=True, slots=True)
class ErrorSeries:
    """An error over time: values (N,), m or rad, signed where it has a sign; its figures are of the magnitude."""

    name: str
    unit: str
    value: Array = field(repr=False)
    where: Place
    """Where the magnitude is largest."""

    @property
    def rms(self) -> float:
        """√(mean e²)."""
        return float(np.sqrt(np.mean(self.value**2)))

    @property
    def p95(self) -> float:
        """The magnitude that 95 % of the instants stay under."""
        return float(np.percentile(np.abs(self.value), 95))

    @property
    def max(self) -> float:
        """max |e|."""
        return float(np.abs(self.value).max())
