"""The figure of a pulse schedule."""

import numpy as np
from matplotlib.axes import Axes

from kinematics.figure import line_style, literal, new_axes
from planner.pulses.schedule import BINS, PulseSchedule


def pulse_rate(schedule: PulseSchedule, ax: Axes | None = None) -> Axes:
    """Pulses per second of every axis over time, averaged over windows of 1/600 of the duration."""
    ax = new_axes(ax)
    edges = np.linspace(0, schedule.duration, BINS + 1)
    for n, axis in enumerate(schedule.axes):
        fired, _ = np.histogram(axis.ticks / schedule.clock_hz, edges)
        ax.plot((edges[1:] + edges[:-1]) / 2, fired / np.diff(edges) / 1e3, label=literal(axis.name), **line_style(n))
    ax.set(xlabel="time (s)", ylabel="pulse rate (1000/s)", xlim=(0, schedule.duration))
    ax.set_ylim(bottom=0)
    return ax
