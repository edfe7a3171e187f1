"""The table that the report of a plan begins with."""

from collections.abc import Sequence

import numpy as np

from benchmarks.reports.page import group_digits
from kinematics.analysis.residual_vibration import find_residuals
from kinematics.foundation.names import count_noun
from planner.baselines import Classical, describe_differences, missing_limits
from planner.path.arc_length import measure_travel
from planner.path.overshoot import describe_overshoot
from planner.plan import Plan
from planner.pulses import PulseCheck
from planner.timing.certified_solve import BEFORE_SHAPERS

SAME_LENGTH = 5e-7
"""m by which two lengths differ at most that are shown the same."""


def summary(
    plan: Plan, classical: Classical | None, verdict: PulseCheck, left_out: Sequence[str] = ()
) -> dict[str, str]:
    """Return the first table of the page. left_out: results that were left out to save time, and their options."""
    kept = "speed and acceleration" if plan.order == 2 else "speed, acceleration and jerk"
    again = f", run {plan.program.repeat} times" if plan.program.repeat > 1 else ""
    radian = f"a pure turn counts its angle times {1e3 * plan.machine.characteristic_length:.3f} mm"
    way, length = measure_travel(plan.path.pieces), float(plan.path.breaks[-1])
    unlike = "" if abs(way - length) < SAME_LENGTH else f"places in tables count to {1e3 * length:.3f} mm; "
    return {
        "Duration": f"{plan.duration:.6f} s{'' if plan.fastest else f', {plan.describe_objective()}'}",
        **_shaping(plan),
        **(_baseline(plan, classical) if plan.fastest and classical else {}),  # else they are unlike
        **({"Stops": stops} if (stops := plan.avoidable_stops.describe()) else {}),
        **_bound(plan),
        **({"Left out": ", ".join(left_out)} if left_out else {}),
        "Segments": f"{len(plan.program.segments)}{again}",
        "Length of the path": f"{1e3 * way:.3f} mm ({unlike}{radian})",
        **({} if plan.path.fit is None else {"Fit": plan.path.fit.describe()}),
        **_departures(plan),
        **_overshoots(plan),
        "Order": f"{plan.order} ({kept})",
        "Solved by": f"{', '.join(sorted(set(plan.methods)))}; certified in round {plan.rounds}",
        "Pulses": f"{group_digits(plan.pulses.total)} on a clock of {group_digits(plan.pulses.clock_hz)} Hz",
        "Highest pulse rate": f"{verdict.highest_rate:.1f} 1/s",
        "Pulse check": f"{count_noun(verdict.fault_count, 'error')}; {_exactness(plan, verdict)}",
    }


def _baseline(plan: Plan, classical: Classical) -> dict[str, str]:
    """Return rows about the baseline timing, and the saving."""
    saved = classical.duration - plan.trajectory.duration
    missing = missing_limits(plan, classical)
    unlike = f"; the baseline timing is without {', '.join(missing)}" if missing else ""
    what = "; ".join([classical.kind, *describe_differences(plan, classical)])
    return {
        "Baseline timing": f"{classical.duration:.6f} s ({what})",
        "Time saved": f"{saved:.6f} s ({100 * saved / classical.duration:.2f} %{unlike})",
    }


def _shaping(plan: Plan) -> dict[str, str]:
    """Return rows about the input shapers, if there are any."""
    if plan.shaped is None:
        return {}
    before = f"{plan.trajectory.duration:.6f} s; all that is not said to be behind them is of this motion"
    told = {BEFORE_SHAPERS.capitalize(): before, "Behind them": plan.shaped.describe()}
    if (cost := plan.shaped.cost) is not None:
        told |= {"Cost of the shapers": cost.describe()} if plan.fastest else {}
        told |= {"Lowered for them": cost.describe_lowered()} if cost.lowered else {}
    return told | {"Vibration left": "; ".join(each.describe() for each in find_residuals(plan.shaped.axes))}


def _bound(plan: Plan) -> dict[str, str]:
    """Return a row about the lower bound, if it is known: its computation may take long."""
    if not plan.known:
        return {}
    near = f" ({plan.bound.describe()})" if plan.fastest else ""
    return {"Lower bound, proved": f"{plan.lower_bound:.6f} s{near}"}


def _departures(plan: Plan) -> dict[str, str]:
    """Return a row about the largest deviation of synchronised moves from the straight line."""
    found = plan.departures
    if not found:
        return {}
    worst = max(found, key=lambda one: one.distance)
    turned = np.rad2deg(max(one.turned for one in found))
    told = f"up to {1e3 * worst.distance:.4g} mm off the straight line, at {worst.where}; up to {turned:.4g}° in angle"
    return {"Synchronised moves": f"{len(found)}, straight in the axes: {told}"}


def _overshoots(plan: Plan) -> dict[str, str]:
    """Return a row about the largest deviation of splines from the polygon of their points."""
    overshoots = plan.path.overshoots
    return {"Splines off their polygons": describe_overshoot(overshoots)} if overshoots else {}


def _exactness(plan: Plan, verdict: PulseCheck) -> str:
    """Describe the verdict on the pulses: exact times of crossings, or the bounds that the rule states."""
    if verdict.time_error is not None:
        return f"largest time error {verdict.time_error:.4f} ticks"
    widest = max(axis.bound for axis in plan.pulses.axes)
    return f"within {widest:.3g} pulses, as the rule {plan.pulses.rule} states"
