"""The poses that pulses have reached at given instants: forward from what the counts make of the mechanics."""

import numpy as np

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.machine import Machine
from kinematics.pose import from_numbers, numbers
from planner.pulses.mechanics import carried, screw
from planner.pulses.schedule import AxisPulses, PulseSchedule

REACHED = 1e-9
"""m or rad: residual of a pose that has been found."""


def reached(machine: Machine, schedule: PulseSchedule, t: Array, near: Array) -> Array:
    """(N, 12) pose numbers at instants t (N,) s, looked for from those planned there, near (N, 12).

    The motors are where they are counted, the axes where the play and the lead error that they state leave them, as in
    `realised`. Raises MotionError where the counts stand for no pose.
    """
    # a pulse counts from its own instant on; one step up, since T / clock · clock may fall just short of the tick T
    ticks = np.floor(np.nextafter(t * schedule.clock_hz, np.inf))
    q = np.empty((len(t), len(schedule.axes)))
    for k, (pulses, axis) in enumerate(zip(schedule.axes, machine.axes, strict=True)):
        places = pulses.home + screw(carried(_counted(pulses), axis, pulses.start * pulses.pulse), axis)
        q[:, k] = places[np.searchsorted(pulses.ticks, ticks, side="right")]
    return frozen(poses(machine, q, t, near))


def poses(machine: Machine, q: Array, t: Array, near: Array) -> Array:
    """(N, 12) pose numbers of coordinates (N, n) to which counts led at t (N,) s, looked for from near (N, 12)."""
    found = machine.forward(q, from_numbers(near), certify=False)
    lost = ~(found.residual <= REACHED * max(1.0, float(abs(q).max())))
    if lost.any():
        raise MotionError(
            f"machine {machine.name}: the counts at t = {t[int(np.argmax(lost))]:.6g} s stand for no pose; the pulses "
            "are not of this motion, or it comes too near to the end of its reach"
        )
    return numbers(found.pose)


def _counted(pulses: AxisPulses) -> Array:
    """(M + 1,) m or rad from home where the motor is counted before the first pulse and after each."""
    running = np.concatenate(([pulses.start], pulses.start + np.cumsum(pulses.direction, dtype=np.int64)))
    return np.asarray(running * pulses.pulse, float)
