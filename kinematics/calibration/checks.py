"""Whether what was found explains measurements that nothing was fitted to."""

from dataclasses import dataclass

import numpy as np

from kinematics.array import Array
from kinematics.calibration.measurements import AXIS
from kinematics.calibration.result import Calibration

SIGMAS = 3.0
"""Stated noise of a rotation, in standard deviations, that an explained error may leave."""


@dataclass(frozen=True, slots=True)
class AxisCheck:
    """A direction of the platform's z axis (rad): as commanded, as measured, and as predicted after the calibration.

    tilt      angle from z, of the three
    heading   of the tilt: azimuth about z from x, of the three
    before    angle between commanded and measured direction
    after     between predicted and measured
    allowed   what repetition or noise account for; NaN: the measurements do not say
    """

    label: str
    tilt: tuple[float, float, float]
    heading: tuple[float, float, float]
    before: float
    after: float
    allowed: float

    @property
    def explained(self) -> bool | None:
        """Whether what remains is within what is allowed; None: nobody knows."""
        return bool(self.after <= self.allowed) if np.isfinite(self.allowed) else None


def axis_checks(calibration: Calibration) -> tuple[AxisCheck, ...]:
    """Every direction that was measured and not fitted to, of the poses that are checks."""
    data = calibration.measurements
    return tuple(_check(calibration, int(k)) for k in np.flatnonzero(~data.fit & data.seen[:, AXIS].all(1)))


def _check(calibration: Calibration, k: int) -> AxisCheck:
    data = calibration.measurements
    poses = data.commanded[k], data.measured[k], calibration.predicted[k]
    axes = [pose.rotation.as_matrix()[:, 2] for pose in poses]
    spread = float(np.linalg.norm(data.spread[k, AXIS]))
    noise = np.nan if data.noise is None else SIGMAS * data.noise.rotation
    return AxisCheck(
        data.labels[k],
        (_tilt(axes[0]), _tilt(axes[1]), _tilt(axes[2])),
        (_heading(axes[0]), _heading(axes[1]), _heading(axes[2])),
        _between(axes[0], axes[1]),
        _between(axes[2], axes[1]),
        float(np.fmax(spread, noise)),
    )


def _between(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _tilt(axis: Array) -> float:
    return _between(axis, np.array([0.0, 0.0, 1.0]))


def _heading(axis: Array) -> float:
    return float(np.arctan2(axis[1], axis[0]))
