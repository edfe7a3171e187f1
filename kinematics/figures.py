"""Figures of this package's results: each draws on `ax`, or on a figure of its own, and returns the
axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import ArrayLike

from kinematics.analysis.containment import KINDS
from kinematics.analysis.dynamics import Forces
from kinematics.analysis.forward import Forward
from kinematics.analysis.margins import Margins
from kinematics.analysis.posture import Posture
from kinematics.analysis.workspace import Box, Workspace
from kinematics.calibration.measurements import POSITION, Measurements
from kinematics.calibration.result import GROUPS, Calibration, Observability, check_group
from kinematics.design.accuracy import Budget, Contribution
from kinematics.design.catalogue import Part
from kinematics.design.selection import SI, UNITS, ActuatorNeed, JointNeed, Selection
from kinematics.design.sizing import UPPER_BOUNDED, StepperSizing
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.figure import (
    draw_bars,
    invert_y_axis,
    label_space,
    literal_label,
    new_axes,
    new_axes_3d,
    scale_error_axis,
    unique_labels,
)
from kinematics.foundation.line_styles import PALETTE
from kinematics.foundation.result import draws
from kinematics.foundation.units import unit_value
from kinematics.kinds.legged import Legged
from kinematics.machine.machine import Machine

LIMIT_COLOURS = dict(zip(KINDS, ("#0072B2", "#E69F00", "#009E73", "#56B4E9"), strict=True))
"""Of the limits, told apart by colour-blind readers too [Okabe and Ito 2008]."""
BOX, SPHERE = "#D55E00", "#CC79A7"
_AXIS_UNITS = {"linear": "mm", "rotary": "°"}
MIN_SHOWN_USE = 0.3
"""Share of max_force from which the limit is drawn: below, it would flatten the curves."""


@draws(Workspace)
def reach(workspace: Workspace, ax: Axes | None = None) -> Axes:
    """Where the machine can go: what is proved, every limit's border, and the largest box and
    sphere in there.

    The end of reach, as far as the grid tells, is where no coordinates lead any further, whatever
    the limits. A plane is drawn as a map, a volume as the body of its proved cells. Raises
    MotionError for a line.
    """
    free = [k for k in range(3) if len(workspace.nodes[k]) > 1]
    if len(free) < 2:
        raise MotionError(
            f"workspace of {workspace.machine.name}: a figure needs a plane or a volume; fix one coordinate"
        )
    if len(free) == 3:
        body: Axes = _body(workspace, cast("Axes3D | None", ax))
        return body
    i, j = free
    x, y = (1e3 * workspace.nodes[k] for k in free)
    ax = new_axes(ax, (7.5, float(np.clip(5 * np.ptp(y) / np.ptp(x), 2.4, 8))))
    held = next(k for k in range(3) if k not in free)
    proved = np.squeeze(workspace.proved, held)
    ax.pcolormesh(x, y, np.where(proved, 1.0, np.nan).T, cmap="Greys", vmin=0, vmax=6)
    uses = np.squeeze(workspace.uses, held)
    nowhere = np.isinf(uses).all(-1)
    for entry, (kind, colour) in enumerate(LIMIT_COLOURS.items()):
        use = np.ma.masked_array(np.minimum(uses[..., entry], 1e3), nowhere)
        if use.min() < 1 < use.max():
            ax.contour(x, y, use.T, [1.0], colors=[colour])
            ax.plot([], [], color=colour, label=f"{kind} limit")
    if nowhere.any() and not nowhere.all():
        ax.contour(x, y, nowhere.T.astype(float), [0.5], colors=["grey"], linestyles=[":"])
        ax.plot([], [], color="grey", linestyle=":", label="end of reach")
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
    ax.voxels(
        *corners, workspace.proved, facecolor="#56B4E933", edgecolor="#56B4E933", linewidth=0.2
    )
    if workspace.proved.any():
        box, sphere = workspace.largest_box(), workspace.largest_sphere()
        for start, end in _frame(box):
            ax.plot(*(1e3 * np.stack([start, end], 1)), color=BOX, linewidth=1.6)
        ax.plot([], [], [], color=BOX, label=_size(box, [0, 1, 2]))
        turn, rise = np.meshgrid(
            np.linspace(0, 2 * np.pi, 25), np.linspace(-np.pi / 2, np.pi / 2, 13)
        )
        ball = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
        ball = 1e3 * (sphere.centre[:, None, None] + sphere.radius * ball)
        ax.plot_wireframe(
            *ball,
            color=SPHERE,
            linewidth=0.6,
            label=f"largest sphere: radius {1e3 * sphere.radius:.1f} mm",
        )
        ax.legend(loc="upper left", frameon=False, fontsize="small")
    label_space(ax)
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
    return f"Reach of {literal_label(workspace.machine.name)} at θ = ({turn})°{where}"


@draws(Budget)
def position_error(budget: Budget, ax: Axes | None = None) -> Axes:
    """√(trace Σ + |bias|²) of the position by source: along the poses, or as bars with the worst
    case for one pose.
    """
    ax = new_axes(ax, (7, 4))
    parts = (*budget.contributions, budget.total)
    if len(budget) > 1:
        for part in parts:
            heavy = part is budget.total
            ax.plot(
                1e6 * _rms(part),
                label=literal_label(part.name),
                color="black" if heavy else None,
                linewidth=2 if heavy else 1.2,
            )
        ax.set(xlabel="pose", ylabel="RMS position error (µm)", xlim=(0, len(budget) - 1))
        ax.set_ylim(bottom=0)
        ax.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    else:
        names = unique_labels(part.name for part in parts)
        ax.barh(
            names,
            [1e6 * np.linalg.norm(part.worst[0, :3]) for part in parts],
            color="lightgrey",
            label="bound",
        )
        ax.barh(names, [1e6 * _rms(part)[0] for part in parts], height=0.4, label="RMS")
        invert_y_axis(ax)
        ax.set(xlabel="position error (µm)")
        ax.legend(frameon=False)
    ax.set_title(f"Error budget of {literal_label(budget.machine)}")
    return ax


def _rms(part: Contribution) -> Array:
    """(N,) root of the mean square of the position's error, m."""
    variance = np.trace(part.covariance[:, :3, :3], axis1=1, axis2=2)
    return np.asarray(np.sqrt(variance + (part.bias[:, :3] ** 2).sum(1)))


@draws(Forces)
def draw_forces(forces: Forces, ax: Axes | None = None, t: ArrayLike | None = None) -> Axes:
    """Force of every axis over time t (N,), or over the instants' numbers."""
    return force(forces, t, ax)


def force(forces: Forces, t: ArrayLike | None, ax: Axes | None = None) -> Axes:
    """Force of every axis over time, with the least max_force of all as two dashed lines where it
    is near.
    """
    ax = new_axes(ax, (7, 4))
    when = np.arange(len(forces.force)) if t is None else np.asarray(t, float)
    for axis, row in zip(forces.machine.axes, forces.force.T, strict=True):
        ax.plot(when, row, label=literal_label(axis.name), linewidth=1.2)
    limits, use = (
        [axis.max_force for axis in forces.machine.axes if axis.max_force is not None],
        forces.use.max(),
    )
    if use > MIN_SHOWN_USE:
        for sign in (1, -1):
            ax.axhline(sign * min(limits), color="grey", linestyle="--", linewidth=0.8)
    units = {
        "force (N)" if axis.kind == "linear" else "torque (N m)" for axis in forces.machine.axes
    }
    ax.set(xlabel="instant" if t is None else "time (s)", ylabel=", ".join(sorted(units)))
    ax.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    told = f", at most {100 * use:.0f} % of their limits" if limits else ""
    ax.set_title(f"Actuator forces of {literal_label(forces.machine.name)}{told}")
    return ax


@draws(Forward)
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


@draws(Machine)
def draw_home_pose(machine: Machine, ax: Axes | None = None) -> Axes:
    """A machine on legs in its home pose; of others the travel of each axis, from home."""
    if isinstance(machine, Legged):
        return _legs(machine, cast("Axes3D | None", ax))
    ax = new_axes(ax, (7, max(2.2, 0.4 * len(machine.axes) + 1)))
    scales = [1e3 if axis.kind == "linear" else 180 / np.pi for axis in machine.axes]
    for row, (axis, scale) in enumerate(zip(machine.axes, scales, strict=True)):
        low, high = axis.travel
        endless = not np.isfinite(high)
        ax.barh(
            row,
            2 if endless else scale * (high - low),
            left=-1 if endless else scale * low,
            color=PALETTE[row],
        )
    named = [
        f"{literal_label(axis.name)} ({_AXIS_UNITS[axis.kind]}{'' if np.isfinite(axis.travel[1]) else ', unlimited'})"
        for axis in machine.axes
    ]
    ax.set_yticks(range(len(named)), named)
    invert_y_axis(ax)
    ax.axvline(0.0, color="black", linewidth=0.8)
    ax.set(xlabel="travel from home", title=literal_label(machine.name))
    return ax


def _legs(machine: Legged, ax: Axes3D | None) -> Axes:
    ax = new_axes_3d(ax, (7, 5.5))
    base, platform = 1e3 * machine.base, 1e3 * machine.home.apply(machine.platform)
    for n, (axis, low, high) in enumerate(zip(machine.axes, base, platform, strict=True)):
        ax.plot(
            *np.stack([low, high], 1),
            color=PALETTE[n % len(PALETTE)],
            linewidth=2.5,
            label=literal_label(axis.name),
        )
    for joints in (base, platform):
        round_ = np.argsort(np.arctan2(*(joints - joints.mean(0))[:, 1::-1].T))
        ax.plot(*joints[[*round_, round_[0]]].T, color="black", linewidth=1)
    label_space(ax)
    ax.set_title(f"{literal_label(machine.name)} at home")
    ax.legend(loc="upper left", frameon=False, fontsize="small")
    return cast(Axes, ax)


STAGE_COLOURS = {"before": "#D55E00", "after": "#0072B2", "leave-one-out": "#009E73"}
"""Colours that colour-blind readers tell apart [Okabe and Ito 2008]."""
STAGE_MARKS = "osD"
MIN_SHOWN_ERROR = 1e-3
"""µm or µrad: what is smaller, down to no error at all, is drawn as this on the logarithmic
scale.
"""
_ERROR_UNIT = {"position": "µm", "rotation": "µrad", "axis": "µrad"}
_NAME = {"position": "position", "rotation": "rotation", "axis": "direction of the z axis"}


MAX_NAMED_POSES, MAX_NUMBERED_POSES = 12, 32
"""Up to so many poses have their names below the axis; of more, so many at most have their
numbers.
"""


@draws(Calibration)
def errors_by_pose(
    calibration: Calibration, ax: Axes | None = None, group: str = "position"
) -> Axes:
    """Root mean square of each pose's errors in a group: before, after, and leave-one-out."""
    check_group(group)
    ax = new_axes(ax, (9, 3.6))
    sizes = {
        name: np.maximum(_per_pose(errors[:, GROUPS[group]]), MIN_SHOWN_ERROR)
        for name, errors in calibration.stages.items()
    }
    known = np.isfinite(sizes["before"])
    labels = [
        label for label, there in zip(calibration.measurements.labels, known, strict=True) if there
    ]
    at = np.arange(len(labels))
    for n, (name, size) in enumerate(sizes.items()):
        # dots, not bars: a bar on a logarithmic axis begins at no value of its own
        if np.isfinite(size[known]).any():
            ax.plot(
                at + 0.2 * (n - 1),
                size[known],
                STAGE_MARKS[n],
                color=STAGE_COLOURS[name],
                label=name,
            )
    if len(labels) > MAX_NAMED_POSES:
        numbered = at[:: ceil(len(at) / MAX_NUMBERED_POSES)]
        ax.set_xticks(numbered, [str(k + 1) for k in numbered])
        ax.set_xlabel("pose")
    else:
        _name_poses(ax, labels)
    ax.set(ylabel=f"RMS per component ({_ERROR_UNIT[group]})")
    scale_error_axis(ax)
    ax.set_title(f"Errors of the {_NAME[group]}", loc="left", pad=22)
    ax.tick_params(axis="x", labelsize=9)
    ax.set_axisbelow(True)
    # above the axes: among the dots there may be no room
    ax.legend(
        frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2
    )
    return ax


LETTER = 0.085
"""Inches: the width of a letter of a pose's name, about."""


def _name_poses(ax: Axes, labels: Sequence[str]) -> None:
    """Names below the axis: on two lines where there is room for them, else leaning."""
    figure = ax.get_figure(root=True)
    room = (9.0 if figure is None else figure.get_figwidth()) / (len(labels) + 1)
    split = [literal_label(label).replace(" (", "\n(") for label in labels]
    if max(len(part) for label in split for part in label.split("\n")) * LETTER < room:
        ax.set_xticks(range(len(labels)), split)
    else:
        ax.set_xticks(
            range(len(labels)),
            [*map(literal_label, labels)],
            rotation=40,
            ha="right",
            rotation_mode="anchor",
        )


@draws(Observability)
def singular_values(observability: Observability, ax: Axes | None = None) -> Axes:
    """The singular values of the identification Jacobian: a combination of parameters each, the
    last seen worst.
    """
    ax = new_axes(ax, (9, 3.0))
    values = observability.singular
    shown = values[: observability.rank]
    ax.plot(np.arange(1, len(shown) + 1), shown, "o-", color=STAGE_COLOURS["after"], markersize=4)
    scale_error_axis(ax)
    ax.set(
        xlabel="combination of parameters", ylabel="singular value", xlim=(0.5, len(values) + 0.5)
    )
    return ax


def _per_pose(errors: Array) -> Array:
    """(N,) µm or µrad; NaN where nothing was measured."""
    known = np.isfinite(errors)
    total = np.nansum(errors**2, axis=1) / np.maximum(known.sum(1), 1)
    return np.asarray(1e6 * np.where(known.any(1), np.sqrt(total), np.nan))


@draws(Margins)
def limit_uses(margins: Margins, ax: Axes | None = None) -> Axes:
    """The largest use of each limit over the poses."""
    return draw_bars(
        margins.names,
        margins.uses.max(0, initial=0.0).tolist(),
        "largest use of the limit",
        ax,
        1.0,
    )


@draws(Posture)
def posture_uses(posture: Posture, ax: Axes | None = None) -> Axes:
    """The use of every limit."""
    return limit_uses(posture.margins, ax)


@draws(Measurements)
def measured_offsets(measurements: Measurements, ax: Axes | None = None) -> Axes:
    """How far the measured position of each pose is from the commanded one."""
    off = np.linalg.norm(
        measurements.measured.translation - measurements.commanded.translation, axis=1
    )
    known = np.asarray(measurements.seen[:, POSITION].all(1))
    names = [
        label for label, there in zip(measurements.labels, known.tolist(), strict=True) if there
    ]
    return draw_bars(names, (1e6 * off[known]).tolist(), "measured − commanded position (µm)", ax)


@draws(ActuatorNeed)
@draws(JointNeed)
def needs(need: ActuatorNeed | JointNeed, ax: Axes | None = None) -> Axes:
    """What is asked for, in the units of `UNITS`."""
    wanted = need.demands()
    shown = [value / unit_value(UNITS[name], SI[name]) for name, value in wanted.items()]
    return draw_bars([f"{name} ({UNITS[name]})" for name in wanted], shown, "needed", ax)


@draws(Selection)
def reserves(selection: Selection[Part], ax: Axes | None = None) -> Axes:
    """The reserve of each part that does."""
    feasible = selection.feasible
    shown = [each.reserve for each in feasible]
    return draw_bars(
        [each.part.name for each in feasible], shown, "smallest offered / needed", ax, 1.0
    )


@draws(StepperSizing)
def sizing_shares(sizing: StepperSizing, ax: Axes | None = None) -> Axes:
    """How much of what is offered, or allowed, each rule takes."""
    # of what must not be more than allowed the offer is the use
    shares = {
        check.name: check.offered / check.needed
        if check.name in UPPER_BOUNDED
        else check.needed / check.offered
        for check in sizing.checks
        if check.offered and check.needed
    }
    return draw_bars([*shares], [*shares.values()], "share of what is allowed or offered", ax, 1.0)
