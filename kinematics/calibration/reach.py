"""Which measured poses the machine can have been sent to, told before anything is fitted to them."""

from __future__ import annotations

import numpy as np

from kinematics.calibration.measurements import Measurements, taken
from kinematics.errors import Fault, FileError, OutOfReach
from kinematics.freedom import square_jacobian
from kinematics.machine import Machine
from kinematics.margins import travel_use
from kinematics.motion import singular
from kinematics.pose import Pose, numbers
from kinematics.units import describe, everyday

BEYOND = 2.0
"""Half strokes from the middle of its travel up to which an axis may be sent: half a stroke past its ends, since home
and lengths of the nominal machine are not those of the real one. More than that is another unit, sign or frame."""


def reachable(machine: Machine, measured: Measurements) -> tuple[Measurements, tuple[str, ...]]:
    """The measurements without the checks that the machine cannot be sent to, and why each of those is left out.

    Raises FileError with every fitted pose that it cannot be sent to: out of reach, of travel or of its freedom, or
    singular.
    """
    commanded = machine.home * measured.commanded
    if _obstacle(machine, commanded, "") is None:
        return measured, ()
    obstacles = {
        k: told for k, label in enumerate(measured.labels) if (told := _obstacle(machine, commanded[k], label))
    }
    remedy = "check the file's units, signs and frame (poses count from home), or leave that pose out"
    lines = measured.lines or (None,) * len(measured)
    faults = [Fault("", f"{told}; {remedy}", lines[k]) for k, told in obstacles.items() if measured.fit[k]]
    if faults:
        raise FileError(measured.name, faults)
    kept = [k for k in range(len(measured)) if k not in obstacles]
    return taken(measured, kept), tuple(obstacles.values())


def _obstacle(machine: Machine, commanded: Pose, label: str) -> str | None:
    """Why the machine cannot be sent to a pose, or to one of several; None where it can."""
    try:
        q = np.atleast_2d(machine.inverse(commanded))
    except OutOfReach as error:
        # asked for one pose, it counts from 0
        return f"{label}: {error}".replace("pose 0", "it")
    beyond = np.argwhere(travel_use(machine, q) > BEYOND)
    if len(beyond):
        pose, entry = beyond[0]
        axis, sent = machine.axes[entry], float(q[pose, entry] - machine.home_q[entry])
        unit = everyday(axis.unit)
        ends = " to ".join(describe(end, unit) for end in axis.travel)
        return f"{label}: {axis.name} would stand {describe(sent, unit)} from home; its travel is {ends}"
    if singular(machine, square_jacobian(machine, numbers(commanded), q)).any():
        return f"{label}: machine {machine.name} is singular there"
    return None
