"""Bars: one figure for each of a few names."""

from collections.abc import Sequence

from matplotlib.axes import Axes

from kinematics.figure import PALETTE, distinct, new_axes, top_down


def bars(
    names: Sequence[str], values: Sequence[float], label: str, ax: Axes | None = None, limit: float | None = None
) -> Axes:
    """Lying bars, the first on top; a dashed line at the limit."""
    ax = new_axes(ax, (7, max(2.2, 0.3 * len(names) + 1)))
    ax.barh(distinct(names), list(values), color=PALETTE[0])
    top_down(ax)
    if limit is not None:
        ax.axvline(limit, color="black", linestyle=(0, (6, 3)), linewidth=1)
    ax.set(xlabel=label)
    return ax
