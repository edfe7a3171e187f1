"""Figures that compare the schedules of firing rules. Loaded only where one is drawn."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from kinematics.array import Array
from kinematics.figure import PALETTE, new_axes
from kinematics.machine import Machine
from planner.pulses.errors import axis_errors, space_errors
from planner.pulses.motion import Motion
from planner.pulses.schedule import PulseSchedule
from planner.trajectory import Trajectory

WINDOWS = 300
"""Of time, in each of which the largest error is drawn."""
WIDTHS = (3.0, 1.4, 1.4, 1.4, 1.4, 1.2)
"""The first line shows where others lie upon it."""
STYLES = ("-", (0, (4, 2)), "-", "-", (0, (1, 1)), "-.")


def axis_error(schedules: Sequence[PulseSchedule], motion: Motion, axis: int = 0, ax: Axes | None = None) -> Axes:
    """The largest |count·pulse - (q - home)| of an axis in each window of time, in pulses, for every schedule."""
    ax = new_axes(ax)
    for n, schedule in enumerate(schedules):
        _windows(ax, n, *axis_errors(schedule, motion, axis), schedule.rule, motion.duration)
    ax.set(ylabel=f"largest error of {schedules[0].axes[axis].name} (pulses)")
    return ax


def space_error(
    schedules: Sequence[PulseSchedule], motion: Trajectory, machine: Machine, ax: Axes | None = None
) -> Axes:
    """The largest error of the platform's origin in each window of time, in µm, for every schedule."""
    ax = new_axes(ax)
    for n, schedule in enumerate(schedules):
        t, error = space_errors(schedule, motion, machine)
        _windows(ax, n, t, 1e6 * error, schedule.rule, motion.duration)
    ax.set(ylabel="largest error in space (µm)")
    return ax


def close_up(
    schedules: Sequence[PulseSchedule],
    motion: Motion,
    since: float,
    until: float,
    axis: int = 0,
    ax: Axes | None = None,
) -> Axes:
    """Count - (q - home)/pulse of an axis between two instants (s), pulse by pulse, for every schedule."""
    ax = new_axes(ax)
    for n, schedule in enumerate(schedules):
        t, error = axis_errors(schedule, motion, axis)
        part = slice(*np.searchsorted(t, (since, until)))
        color, style = PALETTE[n % len(PALETTE)], STYLES[n % len(STYLES)]
        ax.plot(
            1e3 * t[part],
            error[part],
            color=color,
            linestyle=style,
            linewidth=WIDTHS[n % len(WIDTHS)],
            label=schedule.rule,
        )
    ax.set(xlabel="time (ms)", ylabel=f"count - x of {schedules[0].axes[axis].name} (pulses)")
    ax.set(xlim=(1e3 * since, 1e3 * until))
    return ax


def _windows(ax: Axes, n: int, t: Array, error: Array, label: str, duration: float) -> None:
    edges = np.linspace(0.0, duration, WINDOWS + 1)
    starts = np.minimum(np.searchsorted(t, edges[:-1]), len(t) - 1)
    largest = np.maximum.reduceat(abs(error), starts)
    color, style = PALETTE[n % len(PALETTE)], STYLES[n % len(STYLES)]
    ax.plot(
        (edges[1:] + edges[:-1]) / 2,
        largest,
        color=color,
        linestyle=style,
        linewidth=WIDTHS[n % len(WIDTHS)],
        label=label,
    )
    ax.set(xlabel="time (s)", yscale="log", xlim=(0.0, duration))
