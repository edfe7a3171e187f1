"""How far the counts of a schedule are from its motion: along an axis, and in space."""

import numpy as np

from kinematics.array import Array
from kinematics.machine import Machine
from planner.pulses.motion import Motion
from planner.pulses.schedule import PulseSchedule
from planner.trajectory import Trajectory

EVEN = 20_000
"""Instants looked at beside those of the pulses."""
BLOCK = 1 << 14
FREEDOM = ("x", "y", "z", "rx", "ry", "rz")


def axis_errors(schedule: PulseSchedule, motion: Motion, axis: int = 0) -> tuple[Array, Array]:
    """Instants (N,) in s and count - (q - home)/pulse (N,) of one axis there, in pulses.

    Right before and at each pulse, where they are the largest, and at 20 000 even instants.
    """
    pulses = schedule.axes[axis]
    even = np.linspace(0.0, motion.duration, EVEN)
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
    t = np.linspace(0.0, motion.duration, EVEN)
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
