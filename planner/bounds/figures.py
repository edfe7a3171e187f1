"""Figures of the worth of limits; `planner.figures` loads them."""

import numpy as np
from matplotlib.axes import Axes

from kinematics.foundation.figure import draw_bars, literal_label, new_axes
from kinematics.foundation.line_styles import PALETTE
from kinematics.foundation.result import draws
from planner.bounds.limit_worth import ALL, LimitChange, Worth

# Greatest number of bars, and of bands along the path.
MOST_BARS = 16
MOST_BANDS = 5
# Least bar, as a share of the largest.
LEAST_BAR = 2e-3
# Number of intervals along the path.
INTERVALS = 150


@draws(Worth)
def limit_worths(worth: Worth, ax: Axes | None = None) -> Axes:
    """Draw the time that one per cent more of each limit saves, the most valuable first."""
    rows = [k for k in worth.rank() if worth.saved[k] >= LEAST_BAR * worth.saved.max()][:MOST_BARS]
    names = [_name(worth, k) for k in rows]
    savings = [1e3 * float(worth.saved[k]) for k in rows]
    ax = draw_bars(names, savings, "ms saved by raising the limit by 1 %", ax)
    ax.set_axisbelow(True)
    return ax


def worth_along(worth: Worth, ax: Axes | None = None) -> Axes:
    """Draw where along the path all active limits, raised by one per cent, save time."""
    ax = new_axes(ax)
    edges = np.linspace(worth.ends[0], worth.ends[-1], INTERVALS + 1)
    sums = np.pad(np.cumsum(worth.along, axis=1), [(0, 0), (1, 0)])
    width = 1e3 * (edges[1] - edges[0])
    density = np.array(
        [1e6 * np.diff(np.interp(edges, worth.ends, row)) / width for row in sums],
    )
    rows = [k for k in worth.rank() if worth.axes[k] != ALL]
    rows.sort(key=lambda k: -worth.together[k])
    bands = [(_name(worth, k), density[k]) for k in rows[:MOST_BANDS]]
    if rows[MOST_BANDS:]:
        bands.append(("others", density[rows[MOST_BANDS:]].sum(0)))
    low = np.zeros(INTERVALS)
    for n, (name, height) in enumerate(bands):
        color = "#C8C8C8" if name == "others" else PALETTE[n % len(PALETTE)]
        ax.stairs(
            low + height,
            1e3 * edges,
            baseline=low,
            fill=True,
            label=literal_label(name),
            color=color,
        )
        low = low + height
    ax.set(
        xlabel="distance along the path (mm)",
        ylabel="µs saved per mm by one per cent",
        xlim=1e3 * edges[[0, -1]],
    )
    ax.set_ylim(bottom=0)
    ax.set_axisbelow(True)
    return ax


@draws(LimitChange)
def changed_duration(change: LimitChange, ax: Axes | None = None) -> Axes:
    """Draw both durations."""
    after = change.solution.trajectory.duration
    names = ["before", f"{change.limit} {100 * change.by:+g} %"]
    return draw_bars(names, [after + change.saved, after], "time (s)", ax)


def _name(worth: Worth, row: int) -> str:
    axis = worth.axes[row]
    limit = worth.limits[row]
    if axis == "tool":
        return limit
    return f"{limit}, {'all axes' if axis == ALL else axis}"
