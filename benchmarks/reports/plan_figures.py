"""The figures of a plan's report: axes, path, limits, baseline, worth, stops, quantization,
tracking.
"""

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING

from benchmarks.reports.page import NARROW, Picture, draw_figure, style
from controllers.metrics import Metrics
from planner.baselines import Classical
from planner.bounds.limit_worth import Worth
from planner.interruption.hold import Stops
from planner.plan import Plan
from planner.pulses import RealisedPath

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from planner.figures import Quantity


def draw_axes(plan: Plan) -> dict[str, Picture]:
    """Draw the motion of the axes, and the pulse rates."""
    from planner.figures import pulse_rate

    with style():
        return {
            "axes": draw_figure(*_draw_axis_motion(plan)),
            "pulses": draw_figure(_add_legend(pulse_rate(plan))),
        }


def draw_path(plan: Plan) -> dict[str, Picture]:
    """Draw the path in space, and the limits along it."""
    from kinematics.foundation.figure import new_axes_3d
    from planner.figures import path_in_space

    with style():
        space = path_in_space(plan, new_axes_3d(None, (1.15 * NARROW, 0.75 * NARROW)))
        return {
            "path": draw_figure(space),
            "limits": draw_figure(*_draw_limit_use(plan)),
        }


def draw_baseline(plan: Plan, classical: Classical | None) -> dict[str, Picture]:
    """Draw the speed of the plan and of the baseline timing, if there is one."""
    if classical is None:
        return {}
    with style():
        return {"classical": draw_figure(_draw_classical(plan, classical))}


def draw_realised(realised: RealisedPath | None) -> dict[str, Picture]:
    """Draw the error of the path that the pulses make, if it is known."""
    from planner.figures import realised_error

    if realised is None:
        return {}
    with style():
        names = [error.name for error in realised.errors]
        shown = [name for name in names if name in ("position", "orientation")]
        axes = _stack_axes(len(shown), 2.6)
        for name, ax in zip(shown, axes, strict=True):
            realised_error(realised, name, ax)
        _add_legend(axes[0])
        return {"realised": draw_figure(*axes)}


def draw_worth(worth: Worth | None) -> dict[str, Picture]:
    """Draw the worth of the limits, if any limit saves time."""
    from planner.bounds.figures import worth_along

    if worth is None or not worth.rank():
        return {}
    with style():
        axes = _stack_axes(2, 3.2, share=False, width=NARROW)
        worth.plot(axes[0])
        worth_along(worth, axes[1])
        _add_legend(axes[1], 3)
        return {"worth": draw_figure(*axes)}


def draw_stops(stops: Stops | None) -> dict[str, Picture]:
    """Draw time and distance to rest, if they are known."""
    if stops is None:
        return {}
    with style():
        return {"stops": draw_figure(stops.plot())}


def draw_tracking(metrics: Sequence[Metrics]) -> dict[str, Picture]:
    """Draw the errors of the tracking laws, if there are any."""
    from controllers.figures import contour_error, tracking_error
    from kinematics.foundation.line_styles import PALETTE

    if not metrics:
        return {}
    with style():
        axes = _stack_axes(2, 2.6)
        for law, color in zip(metrics, cycle(PALETTE)):
            contour_error(law, axes[0], color=color)
            tracking_error(law, axes[1], color=color)
        _add_legend(axes[0])
        return {"tracking": draw_figure(*axes)}


def _draw_axis_motion(plan: Plan) -> "list[Axes]":
    from planner.figures import axis_motion

    quantities: tuple[Quantity, ...] = ("position", "speed", "acceleration", "jerk")
    kinds = sorted({axis.kind for axis in plan.machine.axes})
    # order 2 leaves the jerk without bound
    panels = [(quantity, kind) for quantity in quantities[: plan.order + 1] for kind in kinds]
    axes = _stack_axes(len(panels), 2.3)
    for ax, (quantity, kind) in zip(axes, panels, strict=True):
        axis_motion(plan, quantity, ax, kind)
    _add_legend(axes[0])
    return axes


def _draw_limit_use(plan: Plan) -> "list[Axes]":
    from planner.figures import draw_limit_uses

    axes = _stack_axes(2, 3.2, share=False)
    draw_limit_uses(plan, {"path": axes[0], "time": axes[1]})
    _add_legend(axes[0])
    return axes


def _draw_classical(plan: Plan, classical: Classical) -> "Axes":
    from kinematics.foundation.line_styles import PALETTE
    from planner.figures import path_speed

    motion = plan.trajectory
    (ax,) = _stack_axes(1, 3.0)
    label = f"this plan, {motion.duration:.4f} s"
    path_speed(motion, ax, label=label, color=PALETTE[0])
    label = f"{classical.kind}, {classical.duration:.4f} s"
    path_speed(classical.trajectory, ax, label=label, color=PALETTE[3], linewidth=1)
    ax.set(xlim=(0, max(motion.duration, classical.duration)), ylim=(0, None))
    return _add_legend(ax)


def _stack_axes(count: int, height: float, share: bool = True, width: float = 9.0) -> "list[Axes]":
    """Return the axes of one figure, one below the other; with `share`, on one time axis."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, count * height + 0.4), layout="constrained")
    return list(figure.subplots(count, 1, sharex=share, squeeze=False)[:, 0])


def _add_legend(ax: "Axes", columns: int = 6) -> "Axes":
    """Put the legend above the axes, in the middle of the figure and no wider than it."""
    from matplotlib.transforms import blended_transform_factory

    figure = ax.get_figure(root=True)
    assert figure is not None
    middle = blended_transform_factory(figure.transFigure, ax.transAxes)
    for count in range(columns, 0, -1):
        legend = ax.legend(
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            bbox_transform=middle,
            ncols=count,
            frameon=False,
        )
        if legend.get_window_extent().width <= figure.bbox.width:
            break
    return ax
