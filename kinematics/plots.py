"""Figures of the workspace: drawn on `ax`, or on a figure of its own, and the axes returned."""

from __future__ import annotations

from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from kinematics.containment import KINDS
from kinematics.errors import MotionError
from kinematics.workspace import Box, Workspace

COLOURS = dict(zip(KINDS, ("#0072B2", "#E69F00", "#009E73"), strict=True))
"""Of the limits, told apart by colour-blind readers too [Okabe and Ito 2008]."""
BOX, SPHERE = "#D55E00", "#CC79A7"


def reach(workspace: Workspace, ax: Axes | None = None) -> Axes:
    """Where the machine can go: what is proved, every limit's border, and the largest box and sphere in there.

    A plane is drawn as a map, a volume as the body of its proved cells. Raises MotionError for a line.
    """
    free = [k for k in range(3) if len(workspace.nodes[k]) > 1]
    if len(free) < 2:
        raise MotionError(
            f"workspace of {workspace.machine.name}: a figure needs a plane or a volume; hold one coordinate"
        )
    if len(free) == 3:
        body: Axes = _body(workspace, cast("Axes3D | None", ax))
        return body
    i, j = free
    x, y = (1e3 * workspace.nodes[k] for k in free)
    if ax is None:
        height = float(np.clip(5 * np.ptp(y) / np.ptp(x), 2.4, 8))
        ax = Figure(figsize=(7.5, height), layout="constrained").add_subplot()
    held = next(k for k in range(3) if k not in free)
    proved = np.squeeze(workspace.proved, held)
    ax.pcolormesh(x, y, np.where(proved, 1.0, np.nan).T, cmap="Greys", vmin=0, vmax=6)
    for entry, (kind, colour) in enumerate(COLOURS.items()):
        use = np.minimum(np.squeeze(workspace.uses[..., entry], held), 1e3)
        if use.min() < 1 < use.max():
            ax.contour(x, y, use.T, [1.0], colors=[colour])
        ax.plot([], [], color=colour, label=f"{kind} limit")
    if proved.any():
        box, sphere = workspace.largest_box(), workspace.largest_sphere()
        ax.add_patch(
            Rectangle(
                (1e3 * box.low[i], 1e3 * box.low[j]),
                *(1e3 * box.size[free]),
                fill=False,
                edgecolor=BOX,
                linewidth=1.6,
                label=_size(box, free),
            )
        )
        ax.add_patch(
            Circle(
                (1e3 * sphere.centre[i], 1e3 * sphere.centre[j]),
                1e3 * sphere.radius,
                fill=False,
                edgecolor=SPHERE,
                linewidth=1.6,
                label=f"largest circle: radius {1e3 * sphere.radius:.1f} mm",
            )
        )
    ax.set(xlabel=f"{'xyz'[i]} (mm)", ylabel=f"{'xyz'[j]} (mm)", aspect="equal")
    ax.set_title(_title(workspace, f", {'xyz'[held]} = {1e3 * workspace.nodes[held][0]:.4g} mm"))
    ax.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False, fontsize="small")
    return ax


def _body(workspace: Workspace, ax: Axes3D | None) -> Axes3D:
    if ax is None:
        ax = cast(Axes3D, Figure(figsize=(7, 5.5), layout="constrained").add_subplot(projection="3d"))
    corners = np.meshgrid(*(1e3 * nodes for nodes in workspace.nodes), indexing="ij")
    ax.voxels(*corners, workspace.proved, facecolor="#56B4E933", edgecolor="#56B4E933", linewidth=0.2)
    if workspace.proved.any():
        box, sphere = workspace.largest_box(), workspace.largest_sphere()
        for start, end in _frame(box):
            ax.plot(*(1e3 * np.stack([start, end], 1)), color=BOX, linewidth=1.6)
        ax.plot([], [], [], color=BOX, label=_size(box, [0, 1, 2]))
        turn, rise = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(-np.pi / 2, np.pi / 2, 13))
        ball = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
        ball = 1e3 * (sphere.centre[:, None, None] + sphere.radius * ball)
        ax.plot_wireframe(
            *ball, color=SPHERE, linewidth=0.6, label=f"largest sphere: radius {1e3 * sphere.radius:.1f} mm"
        )
        ax.legend(loc="upper left", frameon=False, fontsize="small")
    ax.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
    ax.zaxis.set_major_locator(MaxNLocator(3))
    ax.set_aspect("equal")
    ax.set_title(_title(workspace, ""))
    return ax


def _frame(box: Box) -> list[tuple[np.ndarray, np.ndarray]]:
    """The twelve edges."""
    corners = [np.where([n & 1, n & 2, n & 4], box.high, box.low) for n in range(8)]
    return [(corners[n], corners[n | bit]) for n in range(8) for bit in (1, 2, 4) if not n & bit]


def _size(box: Box, free: list[int]) -> str:
    return "largest box: " + " × ".join(f"{1e3 * box.size[k]:.1f}" for k in free) + " mm"


def _title(workspace: Workspace, where: str) -> str:
    angles = workspace.rotation.as_euler("XYZ", degrees=True)
    turn = ", ".join(f"{angle + 0.0:.4g}" for angle in angles.round(9))
    return f"Reach of {workspace.machine.name} at θ = ({turn})°{where}"
