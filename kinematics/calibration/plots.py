"""Figures of a calibration: each draws on `ax`, or on a figure of its own, and returns the axes."""

import numpy as np
from matplotlib.axes import Axes

from kinematics.array import Array
from kinematics.calibration.observability import Observability
from kinematics.calibration.result import GROUPS, Calibration, known_group
from kinematics.figure import literal, new_axes

COLORS = {"before": "#D55E00", "after": "#0072B2", "left out": "#009E73"}
"""Colours that colour-blind readers tell apart [Okabe and Ito 2008]."""
LEAST = 1e-3
"""µm or µrad: what is smaller, down to no error at all, is drawn as this on the logarithmic scale."""
_UNIT = {"position": "µm", "rotation": "µrad", "axis": "µrad"}
_NAME = {"position": "position", "rotation": "rotation", "axis": "direction of the z axis"}


def errors_by_pose(calibration: Calibration, ax: Axes | None = None, group: str = "position") -> Axes:
    """Root mean square of each pose's errors in a group: before, after, and left out of the fit."""
    known_group(group)
    ax = new_axes(ax, (9, 3.6))
    stages = {"before": calibration.before, "after": calibration.after, "left out": calibration.left_out}
    sizes = {name: np.maximum(_per_pose(errors[:, GROUPS[group]]), LEAST) for name, errors in stages.items()}
    known = np.isfinite(sizes["before"])
    labels = [label for label, there in zip(calibration.measurements.labels, known, strict=True) if there]
    at = np.arange(len(labels))
    for n, (name, size) in enumerate(sizes.items()):
        ax.bar(at + 0.27 * (n - 1), size[known], 0.25, color=COLORS[name], label=name)
    crowded = len(labels) > 12
    ax.set_xticks(
        at, [str(k + 1) if crowded else literal(label).replace(" (", "\n(") for k, label in enumerate(labels)]
    )
    ax.set(ylabel=f"RMS per component ({_UNIT[group]})", yscale="log")
    ax.set_title(f"Errors of the {_NAME[group]}", loc="left")
    ax.tick_params(axis="x", labelsize=6 if crowded else 9, rotation=90 if len(labels) > 24 else 0)
    ax.set_axisbelow(True)
    # above the axes: beside tall bars there is no room within
    ax.legend(frameon=False, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    return ax


def singular_values(observability: Observability, ax: Axes | None = None) -> Axes:
    """The singular values of the identification Jacobian: a combination of parameters each, the last seen worst."""
    ax = new_axes(ax, (9, 3.0))
    values = observability.singular
    shown = values[: observability.rank]
    ax.semilogy(np.arange(1, len(shown) + 1), shown, "o-", color=COLORS["after"], markersize=4)
    ax.set(xlabel="combination of parameters", ylabel="singular value", xlim=(0.5, len(values) + 0.5))
    return ax


def _per_pose(errors: Array) -> Array:
    """(N,) µm or µrad; NaN where nothing was measured."""
    known = np.isfinite(errors)
    total = np.nansum(errors**2, axis=1) / np.maximum(known.sum(1), 1)
    return np.asarray(1e6 * np.where(known.any(1), np.sqrt(total), np.nan))
