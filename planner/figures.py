"""Figures of results: each draws on `ax`, or on a figure of its own, and returns the axes."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import StepPatch
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from scipy.spatial.transform import RigidTransform

from kinematics.foundation.arrays import Array
from kinematics.foundation.figure import (
    draw_bars,
    label_space,
    literal_label,
    new_axes,
    new_axes_3d,
)
from kinematics.foundation.line_styles import PALETTE, line_style
from kinematics.foundation.result import draws
from kinematics.machine.axis import Axis, directional_bounds
from kinematics.machine.pose import from_numbers, to_numbers
from planner.active_limits import active_limits, find_segments, limit_shares
from planner.baselines.classical import Classical
from planner.bounds import figures as _worth_figures  # noqa: F401  # registers its own
from planner.bounds.duration_bound import DurationBound
from planner.certificate.certify import Certificate
from planner.certificate.feasibility import Standing
from planner.cross_check import CrossCheck
from planner.interruption.hold import Stops
from planner.interruption.section import Section
from planner.limits.styles import style_limits
from planner.path.actuation import MachinePath
from planner.plan import Plan
from planner.plan_parts import PlanStanding
from planner.pulses.realised_path import RealisedPath
from planner.pulses.schedule import RATE_WINDOWS, PulseSchedule
from planner.shaping import figures as _shaping_figures  # noqa: F401  # registers its own
from planner.shaping.shaped_motion import reached_poses
from planner.sources import figures as _source_figures  # noqa: F401  # registers its own
from planner.timing.certified_solve import Solution
from planner.trajectory import Trajectory

DRAWN_INSTANTS = 2000
"""Instants drawn, besides the knots of the trajectory. More make files larger and show no more."""
VISIBLE_SHARE = 1 / 150
"""Distance between two paths that a reader can see, as a share of their extent."""
LIMIT_LINE: Mapping[str, Any] = {"linestyle": (0, (6, 3)), "linewidth": 1}
"""Line style of limits and bounds."""


@draws(Trajectory)
def path_speed(trajectory: Trajectory, ax: Axes | None = None, **style: Any) -> Axes:
    """Draw the speed over time: of the tool on a machine, else of the path's parameter.

    The parameter of a machine's path may run faster than the tool, as in a blend; caps hold for the
    tool. `style` goes to the line, so that two timings can share the axes.
    """
    ax = new_axes(ax)
    t = pick_instants(trajectory)
    state = trajectory.at(t)
    if isinstance(trajectory.path, MachinePath):
        ax.plot(t, 1e3 * np.linalg.norm(state.tool_velocity, axis=1), **style)
        unit = "mm/s"
    else:
        ax.plot(t, state.sd, **style)
        unit = "1/s"
    ax.set(xlabel="time (s)", ylabel=f"speed along the path ({unit})")
    return ax


@draws(Classical)
@draws(Section)
@draws(Solution)
def timing_speed(
    timing: Classical | Section | Solution,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw the speed along the path over time."""
    return path_speed(timing.trajectory, ax, **style)


@draws(Stops)
def time_and_distance_to_rest(stops: Stops, ax: Axes | None = None) -> Axes:
    """Draw time and distance to rest from each instant of a plan; the distance on a second axis."""
    ax = new_axes(ax)
    ax.plot(stops.t, 1e3 * stops.time, label="time to rest", **line_style(0))
    ax.set(xlabel="time (s)", ylabel="time to rest (ms)", ylim=(0, None))
    far = ax.twinx()
    (line,) = far.plot(stops.t, 1e3 * stops.distance, label="distance to rest", **line_style(1))
    far.set(ylabel="distance to rest (mm)", ylim=(0, None))
    ax.legend(handles=[*ax.lines, line], loc="lower right", frameon=False)
    return ax


def pick_instants(trajectory: Trajectory) -> Array:
    """Return the instants (N,) at which a trajectory is drawn: evenly spaced ones, and its
    knots.
    """
    return np.union1d(np.linspace(0, trajectory.duration, DRAWN_INSTANTS), trajectory.knots)


Quantity = Literal["position", "speed", "acceleration", "jerk"]

_UNIT = {"linear": ("mm", 1e3), "rotary": ("°", 180 / np.pi)}
_DERIVATIVE = {
    "position": ("q", ""),
    "speed": ("qd", "/s"),
    "acceleration": ("qdd", "/s²"),
    "jerk": ("qddd", "/s³"),
}


@draws(Plan)
def path_in_space(plan: Plan, ax: Axes3D | None = None) -> Axes3D:
    """Draw the path of the tool (or else the platform's origin), coloured by its speed; its rests.

    Coordinates are those of the program's frame.
    """
    from_home = plan.program.frame == "home"
    frame = plan.machine.home.inv() if from_home else RigidTransform.identity()
    state = plan.trajectory.at(pick_instants(plan.trajectory))
    position = 1e3 * (frame * from_numbers(state.tool_rate(0))).translation
    speed = 1e3 * np.linalg.norm(state.tool_velocity, axis=1)
    mover = "platform's origin" if plan.path.tool is None else "tool"
    ax = draw_way(new_axes_3d(ax), position, speed, f"speed of the {mover} (mm/s)")
    visible = VISIBLE_SHARE * np.ptp(position, axis=0).max()
    if plan.shaped is not None and 1e3 * plan.shaped.contour > visible:
        motion = plan.shaped.motion
        t = np.linspace(0, plan.shaped.duration, 2 * DRAWN_INSTANTS)
        pose = frame * reached_poses(plan.trajectory, motion, t, motion.positions_at(t))
        numbers = to_numbers(pose)
        place = numbers if plan.path.tool is None else plan.path.tool(numbers)
        ax.plot(
            *(1e3 * place[:, :3].T),
            color=PALETTE[3],
            linewidth=1,
            label="behind the input shapers",
            zorder=5,
            clip_on=False,
        )
        ax.legend(loc="upper left", frameon=False)
    ax.set_title(f"Path in space, from the machine's {'home pose' if from_home else 'base frame'}")
    return ax


def draw_way(
    ax: Axes3D,
    position: Array,
    speed: Array,
    label: str = "speed along the path (mm/s)",
) -> Axes3D:
    """Draw a line through points (N, 3) mm, coloured by the speed (N,) mm/s; mark its rests."""
    strokes = list(np.stack([position[:-1], position[1:]], 1))
    # thin lines for a path that is long for its extent: neighbouring strokes would run together
    extent = np.ptp(position, axis=0)
    length = float(np.linalg.norm(np.diff(position, axis=0), axis=1).sum())
    turns = length / max(float(extent.max()), 1e-9)
    width = float(np.clip(60 / max(turns, 1.0), 0.3, 2.5))
    # fast is dark: it contrasts with the paper, and with the inverted paper of a dark page
    line = Line3DCollection(strokes, cmap="viridis_r", linewidths=width, clip_on=False)
    line.set_array((speed[:-1] + speed[1:]) / 2)
    if strokes:
        ax.add_collection3d(line)
    mark = partial(ax.scatter, edgecolor="black", depthshade=False, clip_on=False)
    rest = position[speed <= 1e-6 * speed.max(initial=0.0)]
    mark(*rest.T, facecolor="black", s=14, label="at rest")
    mark(*position[0], facecolor="none", s=80, label="start")
    middle = position.min(0) + extent / 2
    half = np.maximum(extent, extent.max() / 10) / 2
    for name, low, high in zip("xyz", middle - half, middle + half, strict=True):
        ax.set(**{f"{name}lim": (low, high)})
    label_space(ax)
    ax.legend(loc="upper left", frameon=False)
    root = ax.get_figure(root=True)
    if root is not None:
        root.colorbar(line, ax=ax, label=label, shrink=0.7, pad=0.13)
    return ax


def axis_motion(
    plan: Plan,
    quantity: Quantity,
    ax: Axes | None = None,
    kind: Literal["linear", "rotary"] | None = None,
) -> Axes:
    """Draw position (from home), speed, acceleration or jerk of each axis over time, and limits.

    kind  kind of the drawn axes, since lengths and angles share no scale; None: that of the first
    """
    alone = ax is None
    ax = new_axes(ax)
    axes = plan.machine.axes
    kind = axes[0].kind if kind is None else kind
    unit, scale = _UNIT[kind]
    attribute, per = _DERIVATIVE[quantity]
    t = pick_instants(plan.trajectory)
    values: Array = getattr(plan.trajectory.at(t), attribute)
    if quantity == "position":
        values = values - plan.machine.home_q
    for n, axis in enumerate(axes):
        if axis.kind == kind:
            ax.plot(t, scale * values[:, n], label=literal_label(axis.name), **line_style(n))
    for level, color in list_levels(axes, quantity, kind):
        ax.axhline(scale * level, color=color, **LIMIT_LINE)
    ax.set(
        xlabel="time (s)",
        ylabel=f"{quantity} ({unit}{per})",
        xlim=(0, plan.trajectory.duration),
    )
    if alone:
        ax.legend(ncols=2, fontsize="small")
    return ax


def list_levels(axes: Sequence[Axis], quantity: Quantity, kind: str) -> list[tuple[float, str]]:
    """List the limits of the axes of a kind, in SI units, each once, with their colours.

    The colour is that of the axis, or black for a limit that all axes share.
    """
    ranges: dict[int, tuple[float, float]] = {}
    for n, axis in enumerate(axes):
        if axis.kind != kind:
            continue
        if quantity == "position":
            ranges[n] = axis.travel
        else:
            below, above = directional_bounds(getattr(axis, f"max_{quantity}"))
            ranges[n] = -below, above
    levels = []
    for level in sorted({bound for pair in ranges.values() for bound in pair}):
        owners = [n for n, pair in ranges.items() if level in pair]
        shared = len(owners) == len(ranges)
        if np.isfinite(level):
            levels.append((level, "#000000" if shared else line_style(owners[0])["color"]))
    return levels


def limit_use(plan: Plan, ax: Axes | None = None, over: Literal["path", "time"] = "path") -> Axes:
    """Draw the use of each limit, along the path or over time, and a band of the active limits.

    A figure of its own gets a legend. On axes of the caller, the caller adds one.
    """
    alone = ax is None
    ax = new_axes(ax)
    draw_limit_uses(plan, {over: ax})
    if alone:
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=5, frameon=False)
    return ax


def draw_limit_uses(plan: Plan, axes: Mapping[Literal["path", "time"], Axes]) -> None:
    """Draw `limit_use` on several axes.

    The limits are sampled once, which takes as long as drawing.
    """
    trajectory = plan.trajectory
    s = np.append(trajectory.s, trajectory.at(trajectory.duration).s)
    shares = limit_shares(plan)
    active = active_limits(plan)
    for over, ax in axes.items():
        edges = trajectory.knots if over == "time" else 1e3 * s
        _draw_limit_use(plan, ax, edges, shares, active)
        ax.set_xlabel("time (s)" if over == "time" else "distance along the path (mm)")


def _draw_limit_use(
    plan: Plan,
    ax: Axes,
    edges: Array,
    shares: Mapping[str, Array],
    active: np.ndarray,
) -> None:
    """Draw the shares of the limits between the edges (M + 1,) of time pieces, and the active limit
    of each.
    """
    styles = style_limits(limit.name for limit in plan.limits)
    for name, drawn in styles.items():
        _draw_stairs(ax, shares[name], edges, label=literal_label(name), **drawn)
    ax.set_axisbelow(True)
    first = np.flatnonzero(np.diff(active, prepend=-2))
    last = np.append(first[1:], len(active))
    for owner in np.unique(active):
        color = "#E8E8E8" if owner < 0 else styles[plan.limits[owner].name]["color"]
        runs = active[first] == owner
        low = edges[first[runs]]
        width = edges[last[runs]] - low
        spans = list(zip(low.tolist(), width.tolist(), strict=True))
        ax.broken_barh(spans, (1.06, 0.12), facecolor=color, linewidth=0)
    for k, number in find_segments(plan):
        ax.axvline(edges[k], color="#B0B0B0", linewidth=0.8, zorder=0)
        ax.annotate(
            f"{number}",
            (edges[k], 1.2),
            xytext=(2, 0),
            textcoords="offset points",
            fontsize="small",
            color="#606060",
        )
    ax.axhline(1.0, color="black", **LIMIT_LINE)
    ax.set(
        ylabel="share of the limit",
        xlim=(edges[0], edges[-1]),
        ylim=(0, 1.3),
        yticks=np.linspace(0, 1, 5),
    )


def realised_error(
    result: RealisedPath,
    name: str = "position",
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw one error of a realised path over time, the largest in each window, and its bound.

    `style` goes to the error's line, so that the paths of several firing rules can share the axes.
    """
    ax = new_axes(ax)
    error = result[name]
    style = {"label": "error", **line_style(0), **style}
    _draw_stairs(ax, 1e6 * error.series, result.edges, **style)
    _draw_stairs(ax, 1e6 * error.bounds, result.edges, label="bound", color="black", **LIMIT_LINE)
    ax.set_axisbelow(True)
    ax.set(
        xlabel="time (s)",
        ylabel=f"{name} error (µ{error.unit})",
        xlim=(0, result.edges[-1]),
    )
    ax.set_ylim(bottom=0)
    return ax


def _draw_stairs(ax: Axes, values: Array, edges: Array, **style: Any) -> None:
    """Draw stairs faster than `Axes.stairs`, which spends most time on the ends of the steps."""
    baseline: Any = None  # matplotlib's types admit a float only
    ax.add_artist(StepPatch(values, edges, baseline=baseline, fill=False, **style))
    ax.update_datalim([(edges[0], values.min()), (edges[-1], values.max())])
    ax.autoscale_view()


@draws(CrossCheck)
def cross_checked_speeds(check: CrossCheck, ax: Axes | None = None) -> Axes:
    """Draw the speeds of both motions along the path over time."""
    ax = path_speed(check.ours.trajectory, ax, label="pulsepath")
    if check.theirs is not None:
        path_speed(check.theirs.trajectory, ax, label="toppra")
    ax.legend()
    return ax


@draws(PlanStanding)
def window_uses(standing: PlanStanding, ax: Axes | None = None) -> Axes:
    """Draw the largest proved share of each limit in each window of planning."""
    ax = new_axes(ax)
    styles = style_limits(standing.certificate.use)
    for name, use in standing.certificate.use.items():
        edges = np.linspace(0.5, standing.windows + 0.5, len(use) + 1)
        _draw_stairs(ax, use, edges, label=literal_label(name), **styles[name])
    # below the lines: many limits are used in full
    ax.axhline(1.0, color="#9AA4AE", linewidth=4, alpha=0.5, zorder=0)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    ax.set_xlim(0.5, standing.windows + 0.5)
    ax.set(xlabel="window", ylabel="largest share of the limit, proved", ylim=(0, 1.1))
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
    return ax


@draws(Certificate)
def proven_uses(certificate: Certificate, ax: Axes | None = None) -> Axes:
    """Draw the worst proven use of each limit; `limit_use` shows that of a plan over time."""
    worst = certificate.worst
    return draw_bars([*worst], [*worst.values()], "bound of value/limit", ax, 1.0)


@draws(Standing)
def geometric_uses(standing: Standing, ax: Axes | None = None) -> Axes:
    """Draw the largest use of each limit."""
    uses = [use for use, _ in standing.largest.values()]
    return draw_bars([*standing.largest], uses, "bound of value/limit along the path", ax, 1.0)


@draws(DurationBound)
def bound_losses(bound: DurationBound, ax: Axes | None = None) -> Axes:
    """Draw the sum of the open gap to the least duration over all cells up to a place."""
    ax = new_axes(ax)
    s = np.append(bound.s, bound.s[-1:])
    open_time = np.append(0.0, np.cumsum(bound.loss))
    ax.step(s, 1e3 * open_time, where="post")
    ax.set(xlabel="path length", ylabel="left open so far (ms)")
    return ax


@draws(RealisedPath)
def realised_in_space(realised: RealisedPath, ax: Axes | None = None) -> Axes:
    """Draw the error in space over time and its bound; `realised_error` has the other errors."""
    ax = realised_error(realised, ax=ax)
    ax.legend(frameon=False, loc="lower center")
    return ax


@draws(PulseSchedule)
def pulse_rate(result: Plan | PulseSchedule, ax: Axes | None = None) -> Axes:
    """Draw pulses per second of each axis over time, averaged over 1/600 of the duration.

    The figure of a plan has the limits too, and that of a schedule a legend.
    """
    ax = new_axes(ax)
    schedule = result.pulses if isinstance(result, Plan) else result
    edges = np.linspace(0, schedule.duration, RATE_WINDOWS + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    for n, axis in enumerate(schedule.axes):
        fired, _ = np.histogram(axis.ticks / schedule.clock_hz, edges)
        rate = fired / np.diff(edges) / 1e3
        ax.plot(middle, rate, label=literal_label(axis.name), **line_style(n))
    ax.set(xlabel="time (s)", ylabel="pulse rate (1000/s)", xlim=(0, schedule.duration))
    ax.set_ylim(bottom=0)
    if isinstance(result, PulseSchedule):
        ax.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
        return ax
    for limit in {axis.max_pulse_rate for axis in result.machine.axes}:
        if limit is not None:
            ax.axhline(limit / 1e3, color="black", **LIMIT_LINE)
    return ax
