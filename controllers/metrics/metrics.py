"""What is known of how one run tracked its motion: errors over time, and the figures of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from controllers.metrics.effort import Effort
from controllers.metrics.ending import Ending
from controllers.metrics.figures import FIGURES
from controllers.metrics.series import ErrorSeries
from controllers.metrics.vibration import Vibration
from kinematics.array import Array
from kinematics.result import Result
from kinematics.table import Column, Table
from planner.place import where_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class Metrics(Result):
    """The errors of one tracked motion at instants t (N,), s, settling included, and what it cost.

    following    actual − planned of each axis, m or rad
    tracking     ‖e‖, e = y(t) − r(t), of the platform's origin, m
    lag          t̂ᵀe along the path, signed: below 0 it is behind
    orientation  ‖log(R_rᵀ R)‖, rad; None where the motion has no path in space
    contour      ε = min over s of ‖y(t) − r(s)‖, m; never more than `tracking`
    pulse        (n,) m or rad per pulse: axes are compared by pulses
    planned, attained  (N, 3) m, where the platform's origin should have been and was
    effort       None where torques are not recorded
    lost_steps   (n,) full steps; None where they are not counted

    Of a motion that has no path in space, tracking, lag and contour error are those of its axes' positions together,
    (N, n) of which are planned and attained: m, or rad on turning axes.
    """

    law: str
    t: Array = field(repr=False)
    following: tuple[ErrorSeries, ...]
    tracking: ErrorSeries
    lag: ErrorSeries
    orientation: ErrorSeries | None
    contour: ErrorSeries
    ending: Ending
    vibration: Vibration
    pulse: Array
    planned: Array = field(repr=False)
    attained: Array = field(repr=False)
    effort: Effort | None = None
    lost_steps: Array | None = None

    @property
    def series(self) -> tuple[ErrorSeries, ...]:
        """All of them, axes first."""
        space = (self.tracking, self.lag, self.orientation, self.contour)
        return (*self.following, *(series for series in space if series is not None))

    def figures(self) -> dict[str, float]:
        """Every figure by its name, see `FIGURES`: nan where it is not known, inf where the motion never came to rest.

        Of what each axis has, `<name>.<axis>` is an axis' own and `<name>` the worst one's, by pulses.
        """
        of_axes = self._of_axes()
        found = {
            "contour_rms": self.contour.rms,
            "contour_p95": self.contour.p95,
            "contour_max": self.contour.max,
            "contour_max_at": np.nan if self.contour.where.t is None else self.contour.where.t,
            "tracking_rms": self.tracking.rms,
            "tracking_p95": self.tracking.p95,
            "tracking_max": self.tracking.max,
            "lag_rms": self.lag.rms,
            "lag_max": self.lag.max,
            "orientation_rms": np.nan if self.orientation is None else self.orientation.rms,
            "orientation_max": np.nan if self.orientation is None else self.orientation.max,
            "end_time": self.ending.end_time,
            "late": self.ending.late,
            **{name: values[int(np.argmax(values * own))] for name, (values, own) in of_axes.items()},
        }
        axes = [series.name for series in self.following]
        return {figure.name: float(found[figure.name]) for figure in FIGURES} | {
            f"{name}.{axis}": float(value)
            for name, (values, _) in of_axes.items()
            for axis, value in zip(axes, values, strict=True)
        }

    def _of_axes(self) -> dict[str, tuple[Array, Array]]:
        """Figures that each axis has (n,), and the factors (n,) by which axes compare."""
        alike, unknown = np.ones(len(self.following)), np.full(len(self.following), np.nan)
        effort = self.effort or Effort(unknown, unknown, unknown)
        counted = 1 / self.pulse
        return {
            "following_rms": (np.array([series.rms for series in self.following]), counted),
            "following_max": (np.array([series.max for series in self.following]), counted),
            "settling": (self.ending.settling, alike),
            "overshoot": (self.ending.overshoot, counted),
            "jerk_rms": (self.vibration.jerk_rms, counted),
            "vibration_power": (self.vibration.power, counted**2),
            "torque_rms": (effort.torque_rms, alike),
            "torque_peak": (effort.torque_peak, alike),
            "saturation": (effort.saturation, alike),
            "lost_steps": (unknown if self.lost_steps is None else self.lost_steps, alike),
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """The contour error over time; controllers.plots has the other figures."""
        from controllers.plots import contour_error

        ax = contour_error(self, ax)
        ax.legend(frameon=False)
        return ax

    def tables(self) -> tuple[Table, ...]:
        """The errors of each axis and in space; what they cost the drives."""
        units = [series.unit for series in self.series]
        errors = Table(
            self.law,
            (
                Column("error", [series.name for series in self.series]),
                *(
                    Column(title, [getattr(series, title.lower()) for series in self.series], units, "micro", ".3f")
                    for title in ("RMS", "P95", "max")
                ),
                *where_columns([series.where for series in self.series]),
            ),
        )
        figures = self.figures()
        costs = [
            figure
            for figure in FIGURES[[figure.name for figure in FIGURES].index("settling") :]
            if np.isfinite(figures[figure.name]) or figure.name == "end_time"
        ]
        cost = Table(
            "what it cost, the largest of the axes",
            (
                Column("figure", [figure.name for figure in costs]),
                Column("value", [figures[figure.name] for figure in costs], form=".4g"),
                Column("unit", [figure.unit for figure in costs]),
                Column("meaning", [figure.meaning for figure in costs]),
            ),
        )
        return errors, cost
