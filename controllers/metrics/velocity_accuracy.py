"""ISO-style accuracy, repeatability and fluctuation of the speed along a path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from kinematics.result import Result
from kinematics.table import Column, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class VelocityAccuracy(Result):
    """AV, RV, FV of n cycles at one commanded speed, in the style of ISO 9283; a simulation certifies nothing.

    commanded      v_c, m/s
    accuracy       AV = 100 (v̄ − v_c)/v_c, %, v̄ the mean over the cycles of their mean speeds v̄_j
    repeatability  RV = 100 · 3 S_v/v_c, %, S_v of the v̄_j with n − 1
    fluctuation    FV = max over the cycles of (max v − min v), m/s
    """

    cycles: int
    commanded: float
    accuracy: float
    repeatability: float
    fluctuation: float

    def figures(self) -> dict[str, float]:
        """AV and RV in %, FV in m/s."""
        return {
            "velocity_accuracy": self.accuracy,
            "velocity_repeatability": self.repeatability,
            "velocity_fluctuation": self.fluctuation,
        }

    def tables(self) -> tuple[Table, ...]:
        """Accuracy, repeatability and fluctuation."""
        columns = (
            Column("figure", ["accuracy", "repeatability", "fluctuation"]),
            Column(
                "value",
                [self.accuracy, self.repeatability, self.fluctuation],
                ["%", "%", "m/s"],
                "human",
                ".4f",
            ),
        )
        return (Table(f"ISO-style, {self.cycles} cycles at {1e3 * self.commanded:.6g} mm/s", columns),)

    def plot(self, ax: Axes | None = None) -> Axes:
        """All three as shares of the commanded speed."""
        from kinematics.bars import bars

        shares = [self.accuracy, self.repeatability, 100 * self.fluctuation / self.commanded]
        return bars(["accuracy", "repeatability", "fluctuation"], shares, "% of the commanded speed", ax)


def velocity_accuracy(speeds: Array, commanded: float) -> VelocityAccuracy:
    """From attained speeds (N, n), m/s, of n cycles where v_c > 0 is commanded.

    Raises MotionError for fewer than two cycles, and for a commanded speed that is none.
    """
    cycles = speeds.shape[1]
    if cycles < 2:
        raise MotionError(
            f"velocity repeatability: {cycles} cycle has no scatter; run at least 2 (the standard has 10)"
        )
    if not commanded > 0:
        raise MotionError(f"velocity accuracy: the commanded speed {commanded} m/s must be above 0")
    mean = speeds.mean(0)
    return VelocityAccuracy(
        cycles,
        commanded,
        float(100 * (mean.mean() - commanded) / commanded),
        float(100 * 3 * mean.std(ddof=1) / commanded),
        float(np.ptp(speeds, axis=0).max()),
    )
