"""Measured poses: what was commanded, what was measured of it, and how well."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.pose import Pose, numbers

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz", "axis u", "axis v")
"""Errors of a pose: position and turn in the measuring frame; where only the platform's z axis is known, its turn about
the measured pose's own x and y."""
POSITION, ROTATION, AXIS = slice(0, 3), slice(3, 6), slice(6, 8)


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviation of one component of a measured position (m) and rotation (rad)."""

    position: float
    rotation: float

    def __post_init__(self) -> None:
        for what, value in (("position", self.position), ("rotation", self.rotation)):
            if not 0 < value < np.inf:
                raise MotionError(f"measurements: noise of the {what} {value} must be positive and finite")


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurements:
    """N poses relative to the machine's home pose, as in programs in the frame "home": commanded, and measured.

    seen    (N, 8) bool, by COMPONENTS: what was measured; of the rest `measured` holds anything
    fit     (N,) bool: what parameters are fitted to; the other poses are checks
    noise   None: not stated, so it is estimated from the residuals
    spread  (N, 8) m and rad, largest deviation of repetitions from their mean; NaN: not stated
    """

    commanded: Pose
    measured: Pose
    seen: np.ndarray
    labels: tuple[str, ...]
    fit: np.ndarray
    spread: Array
    noise: Noise | None = None
    name: str = "measurements"

    def __post_init__(self) -> None:
        for pose, what in ((self.commanded, "commanded"), (self.measured, "measured")):
            if pose.single or len(pose) != len(self.labels) or not np.isfinite(numbers(pose)).all():
                raise MotionError(f"{self.name}: {what} must be {len(self.labels)} finite poses, one for each label")
        shapes = {"seen": (self.seen, (len(self), 8)), "fit": (self.fit, (len(self),))}
        for what, (array, shape) in {**shapes, "spread": (self.spread, (len(self), 8))}.items():
            if array.shape != shape:
                raise MotionError(f"{self.name}: {what} must have shape {shape}, not {array.shape}")

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def whole(self) -> bool:
        """Whether everything that is fitted is a whole pose."""
        return bool(self.seen[self.fit][:, :6].all())


def whole_poses(
    commanded: Pose,
    measured: Pose,
    *,
    noise: Noise | None = None,
    labels: Sequence[str] | None = None,
    name: str = "measurements",
) -> Measurements:
    """Measurements of whole poses, relative to the machine's home pose; labels count from 1 by default."""
    count = 1 if commanded.single else len(commanded)
    return Measurements(
        commanded=commanded,
        measured=measured,
        seen=frozen(np.broadcast_to(np.arange(8) < 6, (count, 8)), bool),
        labels=tuple(labels or (f"pose {k + 1}" for k in range(count))),
        fit=frozen(np.ones(count), bool),
        spread=frozen(np.full((count, 8), np.nan)),
        noise=noise,
        name=name,
    )
