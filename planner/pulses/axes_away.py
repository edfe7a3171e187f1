"""How far the axes can be from where they are planned while the counts keep their bound."""

from collections.abc import Sequence

import numpy as np

from kinematics.array import Array
from kinematics.axis import Axis
from planner.pulses.compensate import Compensated
from planner.pulses.mechanics import asked_of_screw, screw
from planner.pulses.motion import Motion
from planner.pulses.schedule import PulseSchedule


def axes_away(
    trajectory: Motion, driven: Sequence[Axis], schedule: PulseSchedule, behind: Compensated | None, t: Array
) -> Array:
    """(N, n) m or rad at instants t (N,): how far each axis can be from where it is planned; between two, the larger.

    The counts are δ = bound·pulse and one tick's travel about what is counted; play keeps what δ was at the last turn,
    so with play δ is the largest so far. Play and lead error are whole where they are not made up for. Where they are,
    the screw's slope is on δ, and the axis is off by what compensation says: while the play is crossed, and by the
    farthest run back that turns nothing. Schedules that count something else than `behind` may be farther away.
    """
    q, counted = trajectory.at(t).q, trajectory if behind is None else behind
    travel = abs(counted.at(t).qd) / schedule.clock_hz
    away = np.empty(q.shape)
    for k, (axis, pulses) in enumerate(zip(driven, schedule.axes, strict=True)):
        delta = pulses.bound * pulses.pulse + travel[:, k]
        if axis.backlash > 0:
            delta = np.maximum.accumulate(delta)
        slack, off = axis.backlash, np.zeros(len(t))
        if behind is not None and "backlash" in axis.compensate:
            cost, slack = behind.costs[k], 0.0
            delta, off = delta + cost.unturned, cost.off * _crossing(behind.steps[k], t)
        wanted = q[:, k] - pulses.home
        made_up_for = "lead" in axis.compensate
        middle = asked_of_screw(wanted, axis) if made_up_for else wanted
        behind_by, ahead_by = (slack, 0.0) if axis.pushed == "-" else (0.0, slack)
        below, above = screw(middle - behind_by - delta, axis), screw(middle + ahead_by + delta, axis)
        away[:, k] = np.maximum(abs(above - wanted), abs(wanted - below)) + off
        if axis.lead_error is not None and not made_up_for:  # a point of the table between two instants
            counted_at, error = np.array(axis.lead_error).T
            way = abs(np.diff(wanted))
            half = np.maximum(np.append(way, 0.0), np.append(0.0, way)) / 2
            away[:, k] += abs(np.diff(error) / np.diff(counted_at)).max() * half
    return away


def _crossing(steps: Array, t: Array) -> Array:
    """(N,) 1 at the ends of the windows t[i] .. t[i+1] in which play is crossed, else 0."""
    found = np.zeros(len(t))
    for start, time, _ in steps:
        first, last = np.searchsorted(t, (start, start + time))
        found[max(first - 1, 0) : last + 1] = 1.0
    return found
