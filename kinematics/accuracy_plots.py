"""Figures of an error budget: each draws on `ax`, or on a figure of its own, and returns the axes."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kinematics.accuracy import Budget, Contribution
from kinematics.array import Array


def position_error(budget: Budget, ax: Axes | None = None) -> Axes:
    """√(trace Σ + |bias|²) of the position by source: along the poses, or as bars with the worst case for one pose."""
    if ax is None:
        ax = Figure(figsize=(7, 4), layout="constrained").add_subplot()
    parts = (*budget.contributions, budget.total)
    if len(budget) > 1:
        for part in parts:
            heavy = part is budget.total
            ax.plot(1e6 * _rms(part), label=part.name, color="black" if heavy else None, linewidth=2 if heavy else 1.2)
        ax.set(xlabel="pose", ylabel="RMS position error (µm)", xlim=(0, len(budget) - 1))
        ax.set_ylim(bottom=0)
        ax.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    else:
        names = [part.name for part in parts]
        ax.barh(names, [1e6 * np.linalg.norm(part.worst[0, :3]) for part in parts], color="lightgrey", label="bound")
        ax.barh(names, [1e6 * _rms(part)[0] for part in parts], height=0.4, label="RMS")
        ax.invert_yaxis()
        ax.set(xlabel="position error (µm)")
        ax.legend(frameon=False)
    ax.set_title(f"Error budget of {budget.machine}")
    return ax


def _rms(part: Contribution) -> Array:
    """(N,) root of the mean square of the position's error, m."""
    variance = np.trace(part.covariance[:, :3, :3], axis1=1, axis2=2)
    return np.asarray(np.sqrt(variance + (part.bias[:, :3] ** 2).sum(1)))
