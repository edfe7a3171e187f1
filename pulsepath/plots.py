"""Every figure of every result, in one place: each function draws on `ax`, or on a figure of its own.

They return the axes (those of a gain report a list of them); `axes.figure` is the figure, which a notebook shows.
"""

from benchmarks.compare.gain_figures import gains, pareto
from controllers.plots import circular_test, contour_error, following_error, path_accuracy, tracking_error
from kinematics.calibration.plots import errors_by_pose, singular_values
from kinematics.plots import force, position_error, reach
from planner.held_back import active_limits
from planner.plots import (
    axis_motion,
    limit_use,
    path_in_space,
    pulse_rate,
    realised_error,
)
from planner.trajectory_plots import path_speed

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
