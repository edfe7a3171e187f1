"""The figure of a motion behind input shapers; `planner.figures` loads it."""

import numpy as np
from matplotlib.axes import Axes

from kinematics.foundation.figure import literal_label, new_axes
from kinematics.foundation.line_styles import line_style
from kinematics.foundation.result import draws
from planner.shaping.shaped_proof import ShapedProof

INSTANTS = 4000


@draws(ShapedProof)
def axis_deviations(proof: ShapedProof, ax: Axes | None = None) -> Axes:
    """How far the shapers move each axis from where it was `delay` earlier, over time."""
    ax = new_axes(ax)
    motion = proof.motion
    t = np.linspace(0.0, motion.duration, INSTANTS)
    off = motion.positions_at(t) - motion.reference(t).q
    for k, axis in enumerate(proof.axes):
        ax.plot(t, 1e6 * off[:, k], label=literal_label(axis.name), **line_style(k))
    units = sorted({f"µ{axis.unit}" for axis in proof.axes})
    ax.set(
        xlabel="time (s)",
        ylabel=f"moved by the shapers ({', '.join(units)})",
        xlim=(0, motion.duration),
    )
    ax.legend(frameon=False)
    return ax
