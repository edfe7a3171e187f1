"""Figures of actuator forces: drawn on `ax`, or on a figure of its own; the axes are returned."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kinematics.array import Array

if TYPE_CHECKING:
    from kinematics.dynamics import Forces

SHOWN = 0.3
"""Share of max_force from which the limit is drawn: below, it would flatten the curves."""


def force(forces: Forces, t: Array | None, ax: Axes | None = None) -> Axes:
    """Force of every axis over time, with the least max_force of all as two dashed lines where it is near."""
    if ax is None:
        ax = Figure(figsize=(7, 4), layout="constrained").add_subplot()
    when = np.arange(len(forces.force)) if t is None else t
    for axis, row in zip(forces.machine.axes, forces.force.T, strict=True):
        ax.plot(when, row, label=axis.name, linewidth=1.2)
    limits, use = [axis.max_force for axis in forces.machine.axes if axis.max_force is not None], forces.use.max()
    if use > SHOWN:
        for sign in (1, -1):
            ax.axhline(sign * min(limits), color="grey", linestyle="--", linewidth=0.8)
    units = {"force (N)" if axis.kind == "linear" else "torque (N m)" for axis in forces.machine.axes}
    ax.set(xlabel="instant" if t is None else "time (s)", ylabel=", ".join(sorted(units)))
    ax.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    told = f", at most {100 * use:.0f} % of what they may give" if limits else ""
    ax.set_title(f"Actuator forces of {forces.machine.name}{told}")
    return ax
