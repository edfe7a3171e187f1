"""Figures of programs and lists of positions, as their files state them; `planner.figures` loads
it.
"""

from itertools import pairwise
from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from kinematics.foundation.arrays import Array
from kinematics.foundation.figure import label_space, literal_label, new_axes, new_axes_3d
from kinematics.foundation.names import count_noun
from kinematics.foundation.result import draws
from planner.program.model import Program
from planner.sources.arm_simulation import ArmSimulation
from planner.sources.outline import Outline, outline
from planner.sources.position_list import PositionList
from planner.sources.source import Imported

FLATNESS_SHARE = 1e-2
"""Share of the largest extent up to which a program is drawn as if it were flat."""
MAX_MARKED_SEGMENTS = 60
"""Segments up to which their ends are marked."""


def program_path(outline: Outline, ax: Axes | None = None, title: str = "") -> Axes:
    """The tool's way in the program's coordinates, coloured from its start to its end."""
    extent = outline.high - outline.low
    thin = [k for k in range(3) if extent[k] <= FLATNESS_SHARE * extent.max()]
    shown = [k for k in range(3) if k != thin[-1]] if thin else [0, 1, 2]
    ax = new_axes(ax, (7.5, 5.4)) if thin else new_axes_3d(cast("Axes3D | None", ax), (7.5, 5.4))
    strokes = [1e3 * stroke[:, shown] for stroke in outline.strokes]
    order = np.arange(len(strokes), dtype=float) + 1
    drawn = (LineCollection if thin else Line3DCollection)(strokes, cmap="viridis", linewidths=1.5)
    drawn.set_array(order)
    if thin:
        ax.add_collection(drawn)
    else:
        cast(Axes3D, ax).add_collection3d(drawn)
    if strokes:
        start = strokes[0][0]
        ax.plot(
            *start[:, None], "o", markersize=9, markerfacecolor="none", color="black", label="start"
        )
        if len(strokes) <= MAX_MARKED_SEGMENTS:
            ends = np.array([stroke[-1] for stroke in strokes])
            ax.plot(*ends.T, ".", color="black", markersize=4, label="ends of segments")
        ax.legend(loc="upper right", frameon=False)
    for place, k in enumerate(shown):
        half = max(extent[k], extent.max() / 10, 1e-6) * 0.55e3
        middle = 0.5e3 * (outline.low[k] + outline.high[k])
        ax.set(
            **{
                f"{'xyz'[place]}lim": (middle - half, middle + half),
                f"{'xyz'[place]}label": f"{'xyz'[k]} (mm)",
            }
        )
    if thin:
        ax.set_aspect("equal")
    else:
        label_space(cast(Axes3D, ax))
    ax.set_title(
        literal_label(title)
        or f"{count_noun(len(strokes), 'segment')}, {1e3 * outline.length:.6g} mm"
    )
    root = ax.get_figure(root=True)
    if root is not None and len(strokes) > 1:
        root.colorbar(drawn, ax=ax, label="segment", shrink=0.7, pad=0.1 if not thin else 0.02)
    return ax


def listed_positions(points: Array, ax: Axes | None = None, title: str = "") -> Axes:
    """Positions (N, 3) in m, joined in their order by straight lines."""
    strokes = tuple(np.stack([a, b]) for a, b in pairwise(points))
    low, high = (
        of(points, axis=0, initial=0.0) if not len(points) else of(points, axis=0)
        for of in (np.min, np.max)
    )
    length = sum(float(np.linalg.norm(b - a)) for a, b in strokes)
    return program_path(Outline(strokes, low, high, length), ax, title)


def arm_lengths(
    lengths: Array, turned: np.ndarray, ax: Axes | None = None, title: str = ""
) -> Axes:
    """Lengths (N, 3) in m of three arms from pose to pose; those of turned poses marked."""
    ax = new_axes(ax, (7.5, 4.5))
    pose = np.arange(1, len(lengths) + 1)
    for k, length in enumerate(1e3 * lengths.T):
        ax.plot(pose, length, ".-", label=f"arm{k + 1}")
        ax.plot(
            pose[turned],
            length[turned],
            "o",
            markerfacecolor="none",
            color=ax.lines[-1].get_color(),
        )
    if turned.any():
        ax.plot([], [], "o", markerfacecolor="none", color="black", label="rotated: simulated only")
    ax.set(xlabel="pose", ylabel="length (mm)")
    ax.legend(frameon=False)
    ax.set_title(literal_label(title))
    return ax


@draws(Imported)
def imported_way(found: Imported, ax: Axes | None = None) -> Axes:
    """The tool's way in the program's coordinates."""
    return program_way(found.program, ax)


@draws(Program)
def program_way(program: Program, ax: Axes | None = None) -> Axes:
    """The tool's way in the program's coordinates."""
    return program_path(outline(program), ax, program.name)


@draws(PositionList)
def list_of_positions(listed: PositionList, ax: Axes | None = None) -> Axes:
    """The positions in their order, joined by straight lines."""
    return listed_positions(listed.poses[:, :3], ax, f"{len(listed)} poses from {listed.frame}")


@draws(ArmSimulation)
def simulated_arms(simulation: ArmSimulation, ax: Axes | None = None) -> Axes:
    """The arms' lengths from pose to pose; turned ones shaded."""
    return arm_lengths(
        simulation.lengths, simulation.turned, ax, f"arm lengths of {simulation.machine}"
    )
