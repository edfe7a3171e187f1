"""The report of a plan: one HTML page that holds everything it shows, and its figures as PNG files beside it."""

from base64 import b64encode
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from math import ceil, inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controllers.metrics import Metrics
from planner.classical import Classical
from planner.limits import Limit
from planner.plan import Plan
from planner.pulses import PulseCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 150
STYLE = {"font.size": 10, "axes.grid": True, "grid.color": "#E6E6E6", "axes.spines.top": False, "axes.spines.right": False, "axes.axisbelow": True}


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure of the report: what it shows (for those who cannot see it), what is to be seen, and the PNG."""

    alt: str
    caption: str
    png: bytes

    @property
    def base64(self) -> str:
        return b64encode(self.png).decode("ascii")


def write_report(plan: Plan, classical: Classical, metrics: Sequence[Metrics], path: Path, *, verdict: PulseCheck) -> None:
    """Write the page to `path` and its figures to `figures/*.png` beside it.

    classical  the baseline that the saving is told against;  metrics  the errors of each tracking law;  verdict  of the pulses' check
    """
    pictures = draw(plan, classical, metrics)
    path.write_text(_page(plan, classical, metrics, verdict, pictures), encoding="utf-8")
    folder = path.parent / "figures"
    folder.mkdir(exist_ok=True)
    for name, picture in pictures.items():
        (folder / f"{name}.png").write_bytes(picture.png)


def summary(plan: Plan, classical: Classical, verdict: PulseCheck) -> dict[str, str]:
    """The figures that the page begins with, as they stand there."""
    saved = classical.duration - plan.trajectory.duration
    methods = sorted(set(plan.methods))
    return {
        "Duration": f"{plan.trajectory.duration:.6f} s",
        "Classical timing": f"{classical.duration:.6f} s",
        "Time saved": f"{saved:.6f} s",
        "Segments": f"{len(plan.program.segments)}",
        "Way along the path": f"{1e3 * float(plan.path.breaks[-1]):.3f} mm (a pure turn counts its angle times {1e3 * plan.machine.characteristic_length:.3f} mm)",
        "Order": f"{plan.order} ({'speed, acceleration and jerk' if plan.order == 3 else 'speed and acceleration'})",
        "Solved by": f"{', '.join(methods)}; the proof held in round {plan.rounds}",
        "Pulses": f"{grouped(plan.pulses.total)} on a clock of {grouped(plan.pulses.clock_hz)} Hz",
        "Highest pulse rate": f"{verdict.highest_rate:.1f} 1/s",
        "Pulse check": f"{verdict.fault_count} faults; largest time error {verdict.time_error:.4f} ticks",
    }


def draw(plan: Plan, classical: Classical, metrics: Sequence[Metrics]) -> dict[str, Picture]:
    """Every figure of the page, by name."""
    from matplotlib import rc_context

    with rc_context(STYLE):
        pictures = {"path": _path(plan), "axes": _axes(plan), "limits": _limits(plan), "pulses": _pulses(plan)}
        if metrics:
            pictures["tracking"] = _tracking(metrics)
        return {**pictures, "classical": _classical(plan, classical)}


def _path(plan: Plan) -> Picture:
    from planner.plots import path_in_space

    ax = path_in_space(plan)
    return _picture(
        ax.get_figure(root=True),
        "The path of the platform's origin in three dimensions, coloured by speed",
        "The way of the platform's origin. Dark is slow, bright is fast; black dots are where the motion rests.",
    )


def _axes(plan: Plan) -> Picture:
    from planner.plots import Quantity, axis_motion

    quantities: list[Quantity] = ["position", "speed", "acceleration"]
    kinds = sorted({axis.kind for axis in plan.machine.axes})
    panels = [(quantity, kind) for quantity in [*quantities, "jerk"][: plan.order + 1] for kind in kinds]
    figure, axes = _stack(len(panels), 2.3)
    for ax, (quantity, kind) in zip(axes, panels, strict=True):
        axis_motion(plan, quantity, ax, kind)
    _only_last_time(axes)
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=6, frameon=False)
    jerk = "" if plan.order == 3 else " Order 2 leaves the jerk free: it is without bound where the acceleration steps."
    return _picture(
        figure,
        "Position, speed, acceleration and jerk of every axis over time, with their limits",
        f"Every axis over time: position from home and its derivatives. Dashed lines are the limits.{jerk}",
    )


def _limits(plan: Plan) -> Picture:
    from planner.plots import ACTIVE, limit_use

    figure, axes = _stack(2, 3.3, share=False)
    limit_use(plan, axes[0], "path")
    limit_use(plan, axes[1], "time")
    legend = axes[0].get_legend()
    if legend is not None:
        legend.remove()
    return _picture(
        figure,
        "The share of every limit that is used along the path and over time, and which limit is active",
        f"The proven share of every limit, along the path (above) and over time (below). The band on top has the colour of the limit that is used most where that "
        f"is {100 * ACTIVE:.0f} % or more, and is grey elsewhere; the numbers over it are the program's segments.",
    )


def _pulses(plan: Plan) -> Picture:
    from planner.plots import BINS, pulse_rate

    ax = pulse_rate(plan)
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=6, frameon=False)
    window = 1e3 * plan.pulses.duration / BINS
    return _picture(
        ax.get_figure(root=True),
        "Pulse rate of every axis over time",
        f"Pulses per second of every axis in either direction, averaged over windows of {window:.2g} ms.",
    )


def _tracking(metrics: Sequence[Metrics]) -> Picture:
    from controllers.plots import contour_error, tracking_error
    from planner.plots import PALETTE

    figure, axes = _stack(2, 2.6)
    for law, color in zip(metrics, PALETTE * len(metrics), strict=False):
        contour_error(law, axes[0], color=color)
        tracking_error(law, axes[1], color=color)
    _only_last_time(axes)
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, frameon=False)
    return _picture(
        figure,
        "Contour and tracking error of each law over time",
        "Above, how far the motion runs beside the path; below, how far it is from where the plan has it at that time. After the end of the plan the drives settle.",
    )


def _classical(plan: Plan, classical: Classical) -> Picture:
    from planner.plots import PALETTE, path_speed

    figure, (ax,) = _stack(1, 3.0)
    path_speed(plan.trajectory, ax, label=f"this plan, {plan.trajectory.duration:.4f} s", color=PALETTE[0])
    path_speed(classical.trajectory, ax, label=f"classical, {classical.duration:.4f} s", color=PALETTE[3], linewidth=1)
    ax.set(xlim=(0, max(plan.trajectory.duration, classical.duration)), ylim=(0, None))
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    return _picture(
        figure,
        "Speed along the path over time, of this plan and of the classical timing",
        "Speed along the path: this plan against one trapezoid per segment, both within the same limits of speed and acceleration.",
    )


def _stack(rows: int, height: float, share: bool = True) -> "tuple[Figure, list[Axes]]":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, rows * height + 0.4), layout="constrained")
    return figure, list(figure.subplots(rows, 1, sharex=share, squeeze=False)[:, 0])


def _only_last_time(axes: "list[Axes]") -> None:
    for ax in axes[:-1]:
        ax.set_xlabel("")


def _picture(figure: "Figure | None", alt: str, caption: str) -> Picture:
    buffer = BytesIO()
    if figure is not None:
        figure.savefig(buffer, format="png", dpi=DPI)
    return Picture(alt, caption, buffer.getvalue())


def _page(plan: Plan, classical: Classical, metrics: Sequence[Metrics], verdict: PulseCheck, pictures: dict[str, Picture]) -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    from planner.plots import ACTIVE

    environment = Environment(
        loader=PackageLoader("benchmarks"), autoescape=True, undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    environment.filters.update(FILTERS)
    return environment.get_template("report.html.j2").render(
        plan=plan,
        classical=classical,
        metrics=metrics,
        verdict=verdict,
        pictures=pictures,
        saved=classical.duration - plan.trajectory.duration,
        summary=summary(plan, classical, verdict).items(),
        hardest=max(plan.certificate.worst.items(), key=lambda entry: entry[1]),
        allowed={limit.name: _allowed(limit) for limit in plan.limits},
        active=list(_active_time(plan)),
        active_share=ACTIVE,
        axes=[(axis, checked, a.unit) for axis, checked, a in zip(plan.pulses.axes, verdict.axes, plan.machine.axes, strict=True)],
    )


def _allowed(limit: Limit) -> str:
    """The bounds of a limit in the units that people read; the range where its channels differ."""
    shown: dict[str, list[float]] = {}
    for bound, (unit, scale) in zip(limit.bounds.tolist(), limit.units, strict=True):
        if bound < inf:
            shown.setdefault(unit, []).append(bound * scale)
    ranges = ((min(values), max(values), unit) for unit, values in shown.items())
    return ", ".join(f"{low:.6g} {unit}" if low == high else f"{low:.6g} … {high:.6g} {unit}" for low, high, unit in ranges)


def _active_time(plan: Plan) -> Iterator[tuple[str, float]]:
    """For how many seconds each limit is the active one, and none."""
    from planner.plots import active_limits

    active, lengths = active_limits(plan.certificate), np.diff(plan.trajectory.knots)
    for n, name in enumerate(plan.certificate.use):
        yield name, float(lengths[active == n].sum())
    yield "none of them", float(lengths[active < 0].sum())


def grouped(number: int | str) -> str:
    """A whole number in groups of three digits, kept together by narrow spaces."""
    return f"{int(number):,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def up(value: float, digits: int) -> str:
    """An upper bound, rounded up: the text is a bound too."""
    return f"{ceil(value * 10**digits) / 10**digits:.{digits}f}" if value < inf else "∞"


FILTERS: dict[str, Callable[..., Any]] = {
    "fixed": lambda value, digits: f"{value:.{digits}f}",
    "general": lambda value, digits: f"{value:.{digits}g}",
    "grouped": grouped,
    "up": up,
}
