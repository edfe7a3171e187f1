"""The names under which the figures of a run go into tables and files, with what they are and in which unit."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of a run; smaller is better in all of them.

    unit  SI; "axis" stands for the axis' own, m or rad, and "path" for m, or rad where the motion is of turning axes
          alone and has no path in space
    per_axis  it is there for each axis too, as `<name>.<axis>`: the plain name is then the worst axis' value
    """

    name: str
    unit: str
    meaning: str
    per_axis: bool = False


FIGURES = (
    Figure("contour_rms", "path", "distance to the path, RMS over time"),
    Figure("contour_p95", "path", "distance to the path that 95 % of the time stays under"),
    Figure("contour_max", "path", "largest distance to the path"),
    Figure("contour_max_at", "s", "when it is largest"),
    Figure("tracking_rms", "path", "distance to where the plan is at that time, RMS"),
    Figure("tracking_p95", "path", "that 95 % of the time stays under"),
    Figure("tracking_max", "path", "largest"),
    Figure("lag_rms", "path", "how far ahead or behind along the path, RMS"),
    Figure("lag_max", "path", "largest"),
    Figure("orientation_rms", "rad", "angle to the planned orientation, RMS"),
    Figure("orientation_max", "rad", "largest"),
    Figure("following_rms", "axis", "actual − planned position of an axis, RMS", per_axis=True),
    Figure("following_max", "axis", "largest", per_axis=True),
    Figure(
        "settling",
        "s",
        "from the planned end until an axis stays within the band about its last position",
        per_axis=True,
    ),
    Figure("overshoot", "axis", "how far an axis goes beyond its last position after the planned end", per_axis=True),
    Figure("end_time", "s", "instant from which all axes stay within the band; inf if they never do"),
    Figure("late", "s", "end_time − planned duration; below 0 for a motion that is there early"),
    Figure("jerk_rms", "axis/s³", "jerk of the axis' shaft, RMS", per_axis=True),
    Figure(
        "vibration_power",
        "axis²",
        "mean square of the following error from the host's sample rate upwards",
        per_axis=True,
    ),
    Figure("torque_rms", "1", "torque over its limit, RMS", per_axis=True),
    Figure("torque_peak", "1", "torque over its limit, largest", per_axis=True),
    Figure("saturation", "1", "share of the time at the torque limit", per_axis=True),
    Figure("lost_steps", "full steps", "steps that a stepper has lost", per_axis=True),
)
