"""Figures of this package's results: each draws on `ax`, or on a figure of its own, and returns the axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from kinematics.accuracy import Budget, Contribution
from kinematics.array import Array
from kinematics.containment import KINDS
from kinematics.errors import MotionError
from kinematics.figure import PALETTE, new_axes, new_axes_3d
from kinematics.legs import Legged
from kinematics.workspace import Box, Workspace

if TYPE_CHECKING:
    from kinematics.dynamics import Forces
    from kinematics.forward import Forward
    from kinematics.machine import Machine

COLOURS = dict(zip(KINDS, ("#0072B2", "#E69F00", "#009E73"), strict=True))
"""Of the limits, told apart by colour-blind readers too [Okabe and Ito 2008]."""
BOX, SPHERE = "#D55E00", "#CC79A7"
SHOWN = 0.3
"""Share of max_force from which the limit is drawn: below, it would flatten the curves."""


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
        ax = new_axes(ax, (7.5, height))
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
    ax = new_axes_3d(ax, (7, 5.5))
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


def position_error(budget: Budget, ax: Axes | None = None) -> Axes:
    """√(trace Σ + |bias|²) of the position by source: along the poses, or as bars with the worst case for one pose."""
    ax = new_axes(ax, (7, 4))
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


def force(forces: Forces, t: Array | None, ax: Axes | None = None) -> Axes:
    """Force of every axis over time, with the least max_force of all as two dashed lines where it is near."""
    ax = new_axes(ax, (7, 4))
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


def poses(found: Forward, ax: Axes | None = None) -> Axes:
    """Positions in space; hollow where they are not certified."""
    space = new_axes_3d(cast("Axes3D | None", ax), (7, 5.5))
    points, sure = 1e3 * np.atleast_2d(found.pose.translation), np.atleast_1d(found.certified)
    for chosen, face, label in ((sure, PALETTE[0], "certified"), (~sure, "none", "not certified")):
        if chosen.any():
            space.scatter(*points[chosen].T, facecolor=face, edgecolor=PALETTE[0], label=label)
    space.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
    space.legend(loc="upper left", frameon=False, fontsize="small")
    return cast(Axes, space)


def at_home(machine: Machine, ax: Axes | None = None) -> Axes:
    """A machine on legs in its home pose; of others the travel of each axis, from home."""
    if isinstance(machine, Legged):
        return _legs(machine, cast("Axes3D | None", ax))
    ax = new_axes(ax, (7, max(2.2, 0.4 * len(machine.axes) + 1)))
    scales = [1e3 if axis.kind == "linear" else 180 / np.pi for axis in machine.axes]
    for row, (axis, scale) in enumerate(zip(machine.axes, scales, strict=True)):
        low, high = axis.travel
        endless = not np.isfinite(high)
        ax.barh(row, 2 if endless else scale * (high - low), left=-1 if endless else scale * low, color=PALETTE[row])
    named = [
        f"{axis.name} ({'mm' if axis.kind == 'linear' else '°'}{'' if np.isfinite(axis.travel[1]) else ', unlimited'})"
        for axis in machine.axes
    ]
    ax.set_yticks(range(len(named)), named)
    ax.invert_yaxis()
    ax.axvline(0.0, color="black", linewidth=0.8)
    ax.set(xlabel="travel from home", title=machine.name)
    return ax


def _legs(machine: Legged, ax: Axes3D | None) -> Axes:
    ax = new_axes_3d(ax, (7, 5.5))
    base, platform = 1e3 * machine.base, 1e3 * machine.home.apply(machine.platform)
    for n, (axis, low, high) in enumerate(zip(machine.axes, base, platform, strict=True)):
        ax.plot(*np.stack([low, high], 1), color=PALETTE[n % len(PALETTE)], linewidth=2.5, label=axis.name)
    for joints in (base, platform):
        round_ = np.argsort(np.arctan2(*(joints - joints.mean(0))[:, 1::-1].T))
        ax.plot(*joints[[*round_, round_[0]]].T, color="black", linewidth=1)
    ax.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)", title=f"{machine.name} at home")
    ax.set_aspect("equal")
    ax.legend(loc="upper left", frameon=False, fontsize="small")
    return cast(Axes, ax)
