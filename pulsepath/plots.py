"""Figures of all results. Each function draws on `ax`, or on a new figure.

It returns the axes (of a gain report a list of them); `axes.figure` is the figure, which a notebook
shows.
"""

from benchmarks.reports.gain.setting_figures import gains, pareto
from controllers.figures import (
    circular_test,
    contour_error,
    following_error,
    path_accuracy,
    tracking_error,
)
from kinematics.figures import errors_by_pose, force, position_error, reach, singular_values
from planner.active_limits import active_limits
from planner.figures import (
    axis_motion,
    limit_use,
    path_in_space,
    path_speed,
    pulse_rate,
    realised_error,
)

__all__ = [
    "active_limits",
    "axis_motion",
    "circular_test",
    "contour_error",
    "errors_by_pose",
    "following_error",
    "force",
    "gains",
    "limit_use",
    "pareto",
    "path_accuracy",
    "path_in_space",
    "path_speed",
    "position_error",
    "pulse_rate",
    "reach",
    "realised_error",
    "singular_values",
    "tracking_error",
]
