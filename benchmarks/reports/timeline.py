"""The scrubber of a report over the time of a plan: active limit, and segments of the program."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from kinematics.foundation.arrays import Array
from planner.active_limits import active_limits, find_segments, name_segment
from planner.activity import Activity
from planner.limits.styles import style_limits
from planner.overview import Overview
from planner.plan import Plan

MOST_RUNS = 2000
"""Largest number of changes of the active limit in a band."""


def make_band(plan: Plan) -> dict[str, Any]:
    """Return the changes of the active limit (s, index or −1), and the names and colours of active
    limits.
    """
    active = active_limits(plan)
    knots = plan.trajectory.knots
    if len(active) > MOST_RUNS:  # show the active limit in the middle of each of MOST_RUNS windows
        edges = np.linspace(0.0, plan.trajectory.duration, MOST_RUNS + 1)
        middle = (edges[1:] + edges[:-1]) / 2
        active = active[np.searchsorted(knots, middle, side="right") - 1]
        knots = edges
    return _pack_band(knots, active, [limit.name for limit in plan.limits])


def make_window_band(activity: Activity) -> dict[str, Any]:
    """Return the band of a plan in parts: the limit that is active longest in each window of
    time.
    """
    return _pack_band(activity.t, activity.active, [*activity.names])


def _pack_band(t: Array, active: np.ndarray, names: Sequence[str]) -> dict[str, Any]:
    """Return the band of an active limit: its index (N,) in `names`, or −1, from each time t (s)
    on.
    """
    owners = sorted({int(owner) for owner in active if owner >= 0})
    styles = style_limits(names)
    begins = np.flatnonzero(np.diff(active, prepend=-2))
    places = {-1: -1} | {owner: k for k, owner in enumerate(owners)}
    return {
        "limits": [{"name": names[n], "color": styles[names[n]]["color"]} for n in owners],
        "runs": [(float(t[k]), places[int(active[k])]) for k in begins],
    }


def list_segments(plan: Plan) -> list[tuple[float, str]]:
    """Return the time at which each segment of the program begins, and its name
    (`name_segment`).
    """
    segments = plan.program.segments
    knots = plan.trajectory.knots
    return [(float(knots[k]), name_segment(n, segments[n - 1])) for k, n in find_segments(plan)]


def list_window_segments(overview: Overview, activity: Activity) -> list[tuple[float, str]]:
    """Return the time at which each segment begins, to one window, and its name.

    Segments that begin and end in one window are left out.
    """
    begins = np.flatnonzero(np.diff(overview.segments, prepend=0))
    numbers = [int(overview.segments[k]) for k in begins]
    segments = activity.find_segments(number - 1 for number in numbers)
    return [
        (float(overview.t[k]), name_segment(n, segments[n - 1]))
        for k, n in zip(begins, numbers, strict=True)
    ]
