"""How far the counts of a schedule are from its motion: along an axis, and in space.

The poses that pulses have reached at given instants: forward from what the counts make of the mechanics.
"""

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.machine.machine import Machine
from kinematics.machine.pose import from_numbers, to_numbers
from planner.pulses.motion import AxesMotion, apply_play, apply_screw
from planner.pulses.schedule import AxisPulses, PulseSchedule
from planner.trajectory import Trajectory

EVEN_INSTANTS = 20_000
"""Instants looked at beside those of the pulses."""
BLOCK = 1 << 14
FREEDOM = ("x", "y", "z", "rx", "ry", "rz")


def axis_errors(schedule: PulseSchedule, motion: AxesMotion, axis: int = 0) -> tuple[Array, Array]:
    """Instants (N,) in s and count - (q - home)/pulse (N,) of one axis there, in pulses.

    Right before and at each pulse, where they are the largest, and at 20 000 even instants.
    """
    pulses = schedule.axes[axis]
    even = np.linspace(0.0, motion.duration, EVEN_INSTANTS)
    fires = np.minimum(pulses.ticks / schedule.clock_hz, motion.duration)
    t = np.concatenate((even, fires, fires))
    counts = np.concatenate((schedule.counts(even)[:, axis], pulses.counts(pulses.ticks - 1)))
    counts = np.concatenate((counts, pulses.counts(pulses.ticks)))
    blocks = range(0, len(t), BLOCK)
    q = np.concatenate([motion.at(t[lo : lo + BLOCK]).q[:, axis] for lo in blocks])
    order = np.argsort(t, kind="stable")
    return t[order], (counts - (q - pulses.home) / pulses.pulse)[order]


def space_errors(schedule: PulseSchedule, motion: Trajectory, machine: Machine) -> tuple[Array, Array]:
    """Instants (N,) in s and how far (m, N) the platform's origin is from the motion where the counts say: |J⁻¹ δq|.

    To first order, over the freedom that the machine controls, at 20 000 even instants.
    """
    t = np.linspace(0.0, motion.duration, EVEN_INSTANTS)
    pulse = np.array([axis.pulse for axis in schedule.axes])
    home = np.array([axis.home for axis in schedule.axes])
    free = [FREEDOM.index(name) for name in machine.freedom]
    moved = np.zeros((len(t), 6))
    for lo in range(0, len(t), BLOCK):
        state = motion.at(t[lo : lo + BLOCK])
        off = schedule.counts(state.t) * pulse - (state.q - home)
        pose = state.pose
        if pose is not None:
            inverse = np.linalg.pinv(machine.jacobian(pose)[:, :, free])
            moved[lo : lo + BLOCK, free] = (inverse @ off[:, :, None])[:, :, 0]
    return t, np.linalg.norm(moved[:, :3], axis=1)


POSE_RESIDUAL = 1e-9
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
        places = pulses.home + apply_screw(
            apply_play(_counted_positions(pulses), axis, pulses.start * pulses.pulse), axis
        )
        q[:, k] = places[np.searchsorted(pulses.ticks, ticks, side="right")]
    return freeze_array(solve_poses(machine, q, t, near))


def solve_poses(machine: Machine, q: Array, t: Array, near: Array) -> Array:
    """(N, 12) pose numbers of coordinates (N, n) to which counts led at t (N,) s, looked for from near (N, 12)."""
    found = machine.forward(q, from_numbers(near), certify=False)
    lost = ~(found.residual <= POSE_RESIDUAL * max(1.0, float(abs(q).max())))
    if lost.any():
        raise MotionError(
            f"machine {machine.name}: the counts at t = {t[int(np.argmax(lost))]:.6g} s stand for no pose; the pulses "
            "are not of this motion, or it comes too near to the end of its reach"
        )
    return to_numbers(found.pose)


def _counted_positions(pulses: AxisPulses) -> Array:
    """(M + 1,) m or rad from home where the motor is counted before the first pulse and after each."""
    running = np.concatenate(([pulses.start], pulses.start + np.cumsum(pulses.direction, dtype=np.int64)))
    return np.asarray(running * pulses.pulse, float)
