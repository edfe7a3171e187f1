"""The scrubber of a report over the time of a plan: active limit, and segments of the program."""

from typing import Any

import numpy as np

from planner.active_limits import active_limits, find_segments, name_segment
from planner.plan import Plan

MOST_RUNS = 2000
"""Largest number of changes of the active limit in a band."""


def make_band(plan: Plan) -> dict[str, Any]:
    """Return the changes of the active limit (s, index or −1), and the names and colours of active limits."""
    from planner.figures import style_limits

    active, knots = active_limits(plan), plan.trajectory.knots
    if len(active) > MOST_RUNS:  # what is active in the middle of each of so many windows
        knots = np.linspace(0.0, plan.trajectory.duration, MOST_RUNS + 1)
        middle = np.searchsorted(plan.trajectory.knots, (knots[1:] + knots[:-1]) / 2, side="right") - 1
        active = active[middle]
    begins = np.flatnonzero(np.diff(active, prepend=-2))
    owners = sorted({int(owner) for owner in active if owner >= 0})
    styles = style_limits(limit.name for limit in plan.limits)
    limits = [{"name": plan.limits[n].name, "color": styles[plan.limits[n].name]["color"]} for n in owners]
    runs = [(float(knots[k]), owners.index(int(active[k])) if active[k] >= 0 else -1) for k in begins]
    return {"limits": limits, "runs": runs}


def list_segments(plan: Plan) -> list[tuple[float, str]]:
    """Return the time at which each segment of the program begins, and its name (`name_segment`)."""
    segments, knots = plan.program.segments, plan.trajectory.knots
    return [(float(knots[k]), name_segment(n, segments[n - 1])) for k, n in find_segments(plan)]
