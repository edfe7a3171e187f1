"""How well a motion was tracked: per axis, in space, and beside the path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from controllers.contour import contour_error
from controllers.curve import PathCurve
from controllers.simulate import Planned, Tracking, motion_of
from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.pose import from_numbers
from planner.actuation import MachinePath
from planner.place import Place
from planner.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from kinematics.machine import Machine

PERIOD = 1e-3
"""s between the instants at which errors are taken: a fifth of the time constant of a 30 Hz speed loop."""


@dataclass(frozen=True, slots=True)
class ErrorSeries:
    """An error over time: values (N,), m or rad, signed where it has a sign; its figures are of the magnitude."""

    name: str
    unit: str
    value: Array
    where: Place
    """Where the magnitude is largest."""

    @property
    def rms(self) -> float:
        """√(mean e²)."""
        return float(np.sqrt(np.mean(self.value**2)))

    @property
    def p95(self) -> float:
        """The magnitude that 95 % of the instants stay under."""
        return float(np.percentile(np.abs(self.value), 95))

    @property
    def max(self) -> float:
        """max |e|."""
        return float(np.abs(self.value).max())


@dataclass(frozen=True, slots=True)
class Metrics:
    """The errors of one tracked motion at instants t (N,), s.

    following    actual − planned of each axis, m or rad
    tracking     ‖e‖, e = y(t) − r(t), of the platform's origin, m
    orientation  ‖log(R_rᵀ R)‖, rad
    contour      ε = min over s of ‖y(t) − r(s)‖, m; never more than `tracking`
    """

    law: str
    t: Array
    following: tuple[ErrorSeries, ...]
    tracking: ErrorSeries
    orientation: ErrorSeries
    contour: ErrorSeries

    @property
    def series(self) -> tuple[ErrorSeries, ...]:
        """All of them, axes first."""
        return (*self.following, self.tracking, self.orientation, self.contour)

    def plot(self, ax: Axes | None = None) -> Axes:
        """The contour error over time; controllers.plots has the other figures."""
        from controllers.plots import contour_error

        return contour_error(self, ax)

    def __str__(self) -> str:
        width = max(len(series.name) for series in self.series)
        lines = [f"{self.law}", f"{'':{width}}  {'RMS':>9} {'P95':>9} {'max':>9}        where"]
        for series in self.series:
            figures = " ".join(f"{value * 1e6:9.3f}" for value in (series.rms, series.p95, series.max))
            lines.append(f"{series.name:{width}}  {figures}  µ{series.unit:4} {series.where}")
        return "\n".join(lines)


def evaluate(tracking: Tracking, plan: Trajectory | Planned, machine: Machine, *, period: float = PERIOD) -> Metrics:
    """The errors of a tracked plan through the machine's forward kinematics, every `period` seconds, settling included.

    Raises MotionError if the plan has no path in space, or if a tracked position is no pose of the machine.
    """
    trajectory = motion_of(plan)
    if not isinstance(trajectory, Trajectory) or not isinstance(trajectory.path, MachinePath):
        raise MotionError("metrics: errors in space need a plan made on a machine; this motion has none")
    path = trajectory.path
    every = max(1, round(period / (tracking.t[1] - tracking.t[0])))
    t, actual = tracking.t[::every], tracking.actual[::every]
    planned = trajectory.at(np.minimum(t, trajectory.duration))
    pose = from_numbers(path.pose_numbers(planned.s, planned.piece))
    # the planned pose is as near to the attained one as any: a short way to go, and to certify
    attained = machine.forward(actual, near=pose)
    lost = ~attained.certified
    if lost.any():
        first = int(np.argmax(lost))
        raise MotionError(
            f"metrics: the axis positions at t = {t[first]:.4g} s are no certain pose of machine {machine.name}; "
            "the tracking left the machine's reach: slow the motion down, or take a law that follows"
        )

    def series(name: str, unit: str, value: Array) -> ErrorSeries:
        worst = int(np.abs(value).argmax())
        where = path.place(float(planned.s[worst]), int(planned.piece[worst]), float(t[worst]))
        return ErrorSeries(name, unit, frozen(value), where)

    following = actual - tracking.reference[::every]
    position = attained.pose.translation
    away = np.linalg.norm(position - pose.translation, axis=1)
    turned = np.atleast_1d((pose.rotation.inv() * attained.pose.rotation).magnitude())
    beside = contour_error(position, planned.s, PathCurve(path)).error
    return Metrics(
        law=tracking.law,
        t=frozen(t),
        following=tuple(series(axis.name, axis.unit, following[:, i]) for i, axis in enumerate(machine.axes)),
        tracking=series("tracking", "m", away),
        orientation=series("orientation", "rad", turned),
        contour=series("contour", "m", beside),
    )
