"""Measurements held against the machine.

Before anything is fitted to them: which poses it can have been sent to. After: whether what was
found explains those that nothing was fitted to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.analysis.margins import travel_use
from kinematics.calibration.measurements import AXIS, Measurements, select_rows
from kinematics.calibration.result import Calibration
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import Fault, FileError, OutOfReach
from kinematics.foundation.units import describe, everyday_unit
from kinematics.machine.machine import Machine
from kinematics.machine.model import square_jacobian
from kinematics.machine.motion import is_singular
from kinematics.machine.pose import Pose, to_numbers

NOISE_SIGMAS = 3.0
"""Stated noise of a rotation, in standard deviations, that an explained error may leave."""


@dataclass(frozen=True, slots=True)
class DirectionCheck:
    """A direction of the platform's z axis (rad): as commanded, as measured, and as predicted after
    the calibration.

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
    def is_explained(self) -> bool | None:
        """Whether what remains is within what is allowed; None: nobody knows."""
        return bool(self.after <= self.allowed) if np.isfinite(self.allowed) else None


def axis_checks(calibration: Calibration) -> tuple[DirectionCheck, ...]:
    """Every direction that was measured and not fitted to, of the poses that are checks."""
    data = calibration.measurements
    return tuple(
        _check(calibration, int(k)) for k in np.flatnonzero(~data.fit & data.seen[:, AXIS].all(1))
    )


def _check(calibration: Calibration, k: int) -> DirectionCheck:
    data = calibration.measurements
    poses = data.commanded[k], data.measured[k], calibration.predicted[k]
    axes = [pose.rotation.as_matrix()[:, 2] for pose in poses]
    spread = float(np.linalg.norm(data.spread[k, AXIS]))
    noise = np.nan if data.noise is None else NOISE_SIGMAS * data.noise.rotation
    return DirectionCheck(
        data.labels[k],
        (_tilt(axes[0]), _tilt(axes[1]), _tilt(axes[2])),
        (_direction_angle(axes[0]), _direction_angle(axes[1]), _direction_angle(axes[2])),
        _angle_between(axes[0], axes[1]),
        _angle_between(axes[2], axes[1]),
        float(np.fmax(spread, noise)),
    )


def _angle_between(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _tilt(axis: Array) -> float:
    return _angle_between(axis, np.array([0.0, 0.0, 1.0]))


def _direction_angle(axis: Array) -> float:
    return float(np.arctan2(axis[1], axis[0]))


MAX_TRAVEL_USE = 2.0
"""Half strokes from the middle of its travel up to which an axis may be sent: half a stroke past
its ends, since home and lengths of the nominal machine are not those of the real one. More than
that is another unit, sign or frame.
"""


def select_reachable(
    machine: Machine, measured: Measurements
) -> tuple[Measurements, tuple[str, ...]]:
    """The measurements without the checks that the machine cannot be sent to, and why each of those
    is left out.

    Raises FileError with every fitted pose that it cannot be sent to: out of reach, of travel or of
    its freedom, or singular.
    """
    commanded = machine.home * measured.commanded
    if _obstacle(machine, commanded, "") is None:
        return measured, ()
    obstacles = {
        k: told
        for k, label in enumerate(measured.labels)
        if (told := _obstacle(machine, commanded[k], label))
    }
    remedy = (
        "check the file's units, signs and frame (poses count from home), or leave that pose out"
    )
    lines = measured.lines or (None,) * len(measured)
    faults = [
        Fault("", f"{told}; {remedy}", lines[k]) for k, told in obstacles.items() if measured.fit[k]
    ]
    if faults:
        raise FileError(measured.name, faults)
    kept = [k for k in range(len(measured)) if k not in obstacles]
    return select_rows(measured, kept), tuple(obstacles.values())


def _obstacle(machine: Machine, commanded: Pose, label: str) -> str | None:
    """Why the machine cannot be sent to a pose, or to one of several; None where it can."""
    try:
        q = np.atleast_2d(machine.inverse(commanded))
    except OutOfReach as error:
        # asked for one pose, it counts from 0
        return f"{label}: {error}".replace("pose 0", "it")
    beyond = np.argwhere(travel_use(machine, q) > MAX_TRAVEL_USE)
    if len(beyond):
        pose, entry = beyond[0]
        axis, sent = machine.axes[entry], float(q[pose, entry] - machine.home_q[entry])
        unit = everyday_unit(axis.unit)
        ends = " to ".join(describe(end, unit) for end in axis.travel)
        return f"{label}: {axis.name} would stand {describe(sent, unit)} from home; its travel is {ends}"
    if is_singular(machine, square_jacobian(machine, to_numbers(commanded), q)).any():
        return f"{label}: machine {machine.name} is singular there"
    return None
