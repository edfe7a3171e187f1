"""How far a pose is from each limit of a machine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kinematics.array import Array, frozen
from kinematics.pose import Pose, numbers

if TYPE_CHECKING:
    from kinematics.machine import Machine

# Rounding of a stroke computed from coordinates of decimetres; far below any pulse.
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Margins:
    """Use of each limit at each pose: 1 is at the limit, more is beyond.

    travel  (N, n) |q − middle| / half range, per axis
    tilt    (N, m) angle / limit, per joint
    """

    travel: Array
    tilt: Array
    travel_names: tuple[str, ...]
    tilt_names: tuple[str, ...]

    @property
    def ok(self) -> np.ndarray:
        """(N,) bool: every limit respected."""
        return np.asarray(self._all().max(1) <= 1 + ROUNDING)

    def worst(self) -> str:
        """Name and use of the limit that is used most, over all poses."""
        use = self._all()
        pose, entry = np.unravel_index(int(np.argmax(use)), use.shape)
        names = [f"{name} travel" for name in self.travel_names] + [f"{name} tilt" for name in self.tilt_names]
        at = f" at pose {pose}" if len(use) > 1 else ""
        return f"{names[entry]}: {use[pose, entry]:.1%} of its limit{at}"

    def _all(self) -> Array:
        return np.concatenate([self.travel, self.tilt], 1)


def measure(machine: Machine, pose: Pose) -> Margins:
    """Margins of N poses (N = 1 for a single one)."""
    x = numbers(pose)
    lo, hi = np.array([axis.travel for axis in machine.axes]).T
    with np.errstate(invalid="ignore"):  # unlimited travel: ∞ / ∞
        travel = np.abs(np.atleast_2d(machine.inverse(pose)) - machine.home_q - (lo + hi) / 2) / ((hi - lo) / 2)
    tilt = np.arccos(np.clip(machine.tilt_map(x), -1.0, 1.0)) / machine.max_tilt
    return Margins(
        frozen(np.nan_to_num(travel, nan=0.0)),
        frozen(tilt),
        tuple(axis.name for axis in machine.axes),
        machine.tilt_names,
    )
