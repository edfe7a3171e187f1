"""The numbers that the report of a plan begins with: its headline and its summary table."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.reports.page import group_digits, round_up
from kinematics.analysis.residual_vibration import find_residuals
from kinematics.foundation.names import count_noun
from planner.baselines import Classical, describe_differences, missing_limits
from planner.certificate.certify import Certificate
from planner.path.arc_length import measure_travel
from planner.path.overshoot import describe_overshoot
from planner.plan import Plan
from planner.plan_parts import PlanStanding
from planner.pulses import PulseCheck
from planner.shaping.shaped_proof import ShapedProof
from planner.timing.certified_solve import BEFORE_SHAPERS

if TYPE_CHECKING:
    from benchmarks.reports.plan_report import PlanReport

SAME_LENGTH = 5e-7
"""m by which two lengths differ at most that are shown the same."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One number of the headline. good: None if it is neither good nor bad."""

    label: str
    value: str
    notes: tuple[str, ...] = ()
    good: bool | None = None
    wide: bool = False


def list_headline(report: "PlanReport") -> Iterator[Figure]:
    """Yield the numbers of the headline: duration, saving, proof, pulses and avoidable stops."""
    plan = report.plan
    shaped = report.shaped
    notes = []
    if isinstance(plan, Plan):
        if shaped is not None:
            notes.append(f"{plan.trajectory.duration:.4f} s before the input shapers")
        if plan.known and plan.gap is not None:
            before = " before them" if shaped else ""
            notes.append(f"at most {round_up(100 * plan.gap, 3)} % above the least{before}, proved")
    yield Figure("Duration", f"{plan.duration:.4f} s", tuple(notes))
    if isinstance(plan, Plan):
        if plan.fastest and report.classical:
            yield _compare(plan, report.classical)
    else:
        windows = f"in {group_digits(plan.windows)} {'window' if plan.windows == 1 else 'windows'}"
        yield Figure("Segments", group_digits(plan.segment), (windows,))

    proofs: list[Certificate | ShapedProof] = [plan.certificate]
    if shaped is not None:
        proofs.append(shaped)
    holds = all(proof.holds for proof in proofs)
    worst = max(max(proof.worst.values()) for proof in proofs)
    both = ", before the shapers and behind them" if shaped else ""
    ratios = f"every ratio ≤ {round_up(worst, 7)}{both}"
    yield Figure("Limits", "proved" if holds else "NOT PROVED", (ratios,), holds)

    checked = None if report.verdict is None else report.verdict.holds
    texts = {None: (), True: ("checked independently",), False: ("THE CHECK FAILED",)}
    yield Figure("Pulses", group_digits(count_pulses(plan)), texts[checked], checked)
    stops = plan.avoidable_stops
    if stops is not None and stops.count:
        cost = f"they cost {stops.describe_cost()}; to avoid them: {stops.remedy}"
        count = group_digits(stops.count)
        yield Figure("Stops that nobody asked for", count, (cost,), wide=True)


def list_counts(plan: Plan | PlanStanding) -> list[tuple[int, int]]:
    """Return the number of pulses, and the last count minus the first, of each axis."""
    if isinstance(plan, PlanStanding):
        return [*plan.counted]
    return [(len(axis), axis.final - axis.start) for axis in plan.pulses.axes]


def count_pulses(plan: Plan | PlanStanding) -> int:
    """Return the number of pulses of all axes."""
    return sum(number for number, _ in list_counts(plan))


def _compare(plan: Plan, classical: Classical) -> Figure:
    """Return the saving against the baseline timing."""
    saved = classical.duration - plan.trajectory.duration
    share = 100 * abs(saved) / classical.duration
    sense = "shorter" if saved >= 0 else "longer"
    names = [classical.kind]
    if missing := missing_limits(plan, classical):
        names.append(f"without {', '.join(missing)}")
    baseline = f"{classical.duration:.4f} s ({', '.join(names)})"
    both = ", both before the shapers" if plan.shaped else ""
    return Figure(
        f"Compared with the baseline timing{both}",
        f"{abs(saved):.4f} s",
        (f"{share:.2f} % {sense} than {baseline}",),
    )


def summarise(report: "PlanReport") -> dict[str, str]:
    """Return the summary table of a report, by label."""
    plan = report.plan
    derivatives = "speed and acceleration" if plan.order == 2 else "speed, acceleration and jerk"
    order = f"{plan.order} ({derivatives})"
    stops = plan.avoidable_stops
    rows = {"Duration": f"{plan.duration:.6f} s"}
    if isinstance(plan, Plan):
        if not plan.fastest:
            rows["Duration"] += f", {plan.describe_objective()}"
        rows |= _describe_shaping(plan)
        if plan.fastest and report.classical:  # otherwise they cannot be compared
            rows |= _describe_baseline(plan, report.classical)
    if stops is not None and (text := stops.describe()):
        rows["Stops"] = text
    if isinstance(plan, Plan):
        rows |= _describe_bound(plan)
        if report.left_out:
            rows["Left out"] = ", ".join(report.left_out)
        rows |= _describe_path(plan)
        solved = f"{', '.join(sorted(set(plan.methods)))}; certified in round {plan.rounds}"
        rows |= {"Order": order, "Solved by": solved}
    else:
        rows |= {
            "Segments": group_digits(plan.segment),
            "Length of the path": f"{1e3 * plan.start.length:.3f} mm",
            **({} if plan.fit is None else {"Fit": plan.fit.describe()}),
            "Order": order,
        }
        windows = f"{group_digits(plan.windows)} {'window' if plan.windows == 1 else 'windows'}"
        rows["Planned in"] = f"{windows}; certified in round {plan.rounds} at most"
    clock = group_digits(plan.pulses.clock_hz)
    rows["Pulses"] = f"{group_digits(count_pulses(plan))} on a clock of {clock} Hz"
    if report.verdict is not None:
        rows |= _describe_check(plan, report.verdict)
    return rows


def _describe_baseline(plan: Plan, classical: Classical) -> dict[str, str]:
    """Return rows about the baseline timing, and the saving."""
    saved = classical.duration - plan.trajectory.duration
    missing = missing_limits(plan, classical)
    unlike = f"; the baseline timing is without {', '.join(missing)}" if missing else ""
    differences = "; ".join([classical.kind, *describe_differences(plan, classical)])
    return {
        "Baseline timing": f"{classical.duration:.6f} s ({differences})",
        "Time saved": f"{saved:.6f} s ({100 * saved / classical.duration:.2f} %{unlike})",
    }


def _describe_shaping(plan: Plan) -> dict[str, str]:
    """Return rows about the input shapers, if there are any."""
    shaped = plan.shaped
    if shaped is None:
        return {}
    before = f"{plan.trajectory.duration:.6f} s; all that is not said to be behind them is of this motion"
    rows = {BEFORE_SHAPERS.capitalize(): before, "Behind them": shaped.describe()}
    if (cost := shaped.cost) is not None:
        if plan.fastest:
            rows["Cost of the shapers"] = cost.describe()
        if cost.lowered:
            rows["Lowered for them"] = cost.describe_lowered()
    rows["Vibration left"] = "; ".join(each.describe() for each in find_residuals(shaped.axes))
    return rows


def _describe_bound(plan: Plan) -> dict[str, str]:
    """Return a row about the lower bound, if it is known: its computation may take long."""
    if not plan.known:
        return {}
    gap = f" ({plan.bound.describe()})" if plan.fastest else ""
    return {"Lower bound, proved": f"{plan.lower_bound:.6f} s{gap}"}


def _describe_path(plan: Plan) -> dict[str, str]:
    """Return rows about the program, the length of its path, and its deviations from the program."""
    repeat = f", run {plan.program.repeat} times" if plan.program.repeat > 1 else ""
    radian = f"a pure turn counts its angle times {1e3 * plan.machine.characteristic_length:.3f} mm"
    way = measure_travel(plan.path.pieces)
    length = float(plan.path.breaks[-1])
    counted = ""
    if abs(way - length) >= SAME_LENGTH:
        counted = f"places in tables count to {1e3 * length:.3f} mm; "
    rows = {
        "Segments": f"{len(plan.program.segments)}{repeat}",
        "Length of the path": f"{1e3 * way:.3f} mm ({counted}{radian})",
    }
    if plan.path.fit is not None:
        rows["Fit"] = plan.path.fit.describe()
    if departures := plan.departures:
        worst = max(departures, key=lambda one: one.distance)
        angle = np.rad2deg(max(one.turned for one in departures))
        off = f"up to {1e3 * worst.distance:.4g} mm off the straight line, at {worst.where}"
        rows["Synchronised moves"] = f"{len(departures)}, straight in the axes: {off}; up to {angle:.4g}° in angle"
    if overshoots := plan.path.overshoots:
        rows["Splines off their polygons"] = describe_overshoot(overshoots)
    return rows


def _describe_check(plan: Plan | PlanStanding, verdict: PulseCheck) -> dict[str, str]:
    """Return rows about the check of the pulses: exact times of crossings, or the rule's bounds."""
    if verdict.time_error is not None:
        exact = f"largest time error {verdict.time_error:.4f} ticks"
    else:
        widest = max(axis.bound for axis in plan.pulses.axes)
        exact = f"within {widest:.3g} pulses, as the rule {plan.pulses.rule} states"
    return {
        "Highest pulse rate": f"{verdict.highest_rate:.1f} 1/s",
        "Pulse check": f"{count_noun(verdict.fault_count, 'error')}; {exact}",
    }
