"""Figures of a motion alone: each function draws on `ax`, or on a figure of its own, and returns the axes."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from kinematics.array import Array
from kinematics.figure import new_axes
from planner.actuation import MachinePath
from planner.trajectory import Trajectory

SAMPLES = 2000
"""Instants drawn, beside the knots of the trajectory."""


def path_speed(trajectory: Trajectory, ax: Axes | None = None, **style: Any) -> Axes:
    """The speed along the path over time; `style` goes to the line, so that two timings can share the axes."""
    ax = new_axes(ax)
    t = drawn(trajectory)
    unit, scale = ("mm/s", 1e3) if isinstance(trajectory.path, MachinePath) else ("1/s", 1.0)
    ax.plot(t, scale * trajectory.at(t).sd, **style)
    ax.set(xlabel="time (s)", ylabel=f"speed along the path ({unit})")
    return ax


def drawn(trajectory: Trajectory) -> Array:
    """Instants (N,) to draw a trajectory at: evenly spaced ones, and its knots."""
    return np.union1d(np.linspace(0, trajectory.duration, SAMPLES), trajectory.knots)
