"""The numbers that the report of a plan begins with: its headline and its summary table."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from math import isfinite

from benchmarks.reports.page import group_digits, round_up
from benchmarks.reports.plan_content import PlanReport
from kinematics.analysis.residual_vibration import find_residuals
from kinematics.foundation.names import count_noun
from planner.baselines import Classical, describe_differences, missing_limits
from planner.certificate.certify import Certificate
from planner.limits.registry import geometric_limits
from planner.path.arc_length import measure_travel
from planner.path.outcome import describe_blends
from planner.path.overshoot import describe_overshoot
from planner.path.point_to_point import describe_departures
from planner.plan import Plan
from planner.plan_parts import PlanStanding
from planner.shaping.shaped_proof import ShapedProof
from planner.timing.certified_solve import BEFORE_SHAPERS

SAME_LENGTH = 5e-7
"""m by which two lengths differ at most that are shown the same."""
REACHED = 0.999
"""Proved share of a limit from which a motion is said to reach it."""


@dataclass(frozen=True, slots=True)
class Headline:
    """One number of the headline. good: None if it is neither good nor bad."""

    label: str
    value: str
    notes: tuple[str, ...] = ()
    good: bool | None = None
    wide: bool = False


def list_headline(report: PlanReport) -> Iterator[Headline]:
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
    yield Headline("Duration", f"{plan.duration:.4f} s", tuple(notes))
    if isinstance(plan, Plan):
        if plan.fastest and report.classical:
            yield _compare(plan, report.classical)
    else:
        windows = f"in {group_digits(plan.windows)} {'window' if plan.windows == 1 else 'windows'}"
        yield Headline("Segments", group_digits(plan.segment), (windows,))

    proofs: list[Certificate | ShapedProof] = [plan.certificate]
    if shaped is not None:
        proofs.append(shaped)
    holds = all(proof.holds for proof in proofs)
    worst = max(max(proof.worst.values()) for proof in proofs)
    both = ", before and after shaping" if shaped else ""
    ratios = f"every ratio ≤ {round_up(worst, 7)}{both}"
    yield Headline("Limits", "proved" if holds else "NOT PROVED", (ratios,), holds)

    checked = None if report.verdict is None else report.verdict.holds
    texts = {None: (), True: ("checked independently",), False: ("THE CHECK FAILED",)}
    yield Headline("Pulses", group_digits(count_pulses(plan)), texts[checked], checked)
    stops = plan.avoidable_stops
    if stops is not None and stops.count:
        saving = f"{stops.describe_saving()}; to pass them: {stops.remedy}"
        yield Headline("Avoidable stops", group_digits(stops.count), (saving,), wide=True)


def list_counts(plan: Plan | PlanStanding) -> list[tuple[int, int]]:
    """Return the number of pulses, and the last count minus the first, of each axis."""
    if isinstance(plan, PlanStanding):
        return [*plan.counted]
    return [(len(axis), axis.final - axis.start) for axis in plan.pulses.axes]


def count_pulses(plan: Plan | PlanStanding) -> int:
    """Return the number of pulses of all axes."""
    return sum(number for number, _ in list_counts(plan))


def _compare(plan: Plan, classical: Classical) -> Headline:
    """Return the saving against the baseline timing."""
    saved = classical.duration - plan.trajectory.duration
    share = 100 * abs(saved) / classical.duration
    sense = "shorter" if saved >= 0 else "longer"
    names = [classical.kind]
    if missing := missing_limits(plan, classical):
        names.append(f"without {', '.join(missing)}")
    baseline = f"{classical.duration:.4f} s ({', '.join(names)})"
    both = ", both before the shapers" if plan.shaped else ""
    return Headline(
        f"Compared with the baseline timing{both}",
        f"{abs(saved):.4f} s",
        (f"{share:.2f} % {sense} than {baseline}",),
    )


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the summary. brief: whether the first screen of a terminal has it too."""

    label: str
    text: str
    brief: bool = True


def summarise(report: PlanReport) -> list[Row]:
    """Return the summary of a plan, which its page begins with; the brief rows are the first
    screen.
    """
    plan = report.plan
    rows = (
        _summarise_parts(plan) if isinstance(plan, PlanStanding) else _summarise_whole(report, plan)
    )
    return [row for row in (*rows, *_describe_pulses(report)) if row.text]


def _summarise_whole(report: PlanReport, plan: Plan) -> Iterator[Row]:
    objective = plan.describe_objective()
    least = _describe_least(plan)
    shown = "" if plan.shaped else least
    yield Row("duration", f"{plan.duration:.6f} s{f', {objective}' if objective else ''}{shown}")
    yield from _describe_shaping(plan, least)
    if plan.fastest and report.classical:  # otherwise they cannot be compared
        yield _describe_saving(plan, report.classical)
    yield Row("stops", plan.avoidable_stops.describe())
    if plan.known and not plan.fastest:
        yield Row("lower bound", f"{plan.lower_bound:.6f} s, proved: of the fastest motion")
    lowered = {} if plan.shaped is None or plan.shaped.cost is None else plan.shaped.cost.lowered
    yield _describe_limits(plan.certificate, lowered)
    yield _describe_unchecked(plan)
    if report.worth is not None and report.worth.best is not None:
        yield Row("limits 1 % higher", report.worth.describe())
    yield Row("lower bound, worth", report.unbounded)
    yield Row("left out", ", ".join(report.left_out))
    yield from _describe_path(plan)
    yield _describe_order(plan.order)
    words = (word for method in sorted(set(plan.methods)) for word in method.split(", "))
    solvers = ", ".join(dict.fromkeys(words))
    yield Row("solved by", f"{solvers}; certified in round {plan.rounds}", brief=False)
    if plan.triggers:
        yield Row("triggers", f"{len(plan.triggers)}")


def _summarise_parts(plan: PlanStanding) -> Iterator[Row]:
    yield Row("duration", f"{plan.duration:.6f} s")
    if plan.avoidable_stops is not None:
        yield Row("stops", plan.avoidable_stops.describe())
    yield _describe_limits(plan.certificate, ())
    yield _describe_unchecked(plan)
    yield Row("segments", f"{plan.segment}", brief=False)
    yield Row("length of the path", f"{1e3 * plan.start.length:.3f} mm")
    if plan.fit is not None:
        yield Row("fit", plan.fit.describe(), brief=plan.fit.before > 0)
    if plan.blends:
        yield Row("blends", f"{plan.blends}, {plan.stops or 'none'} of them replaced by stops")
    yield _describe_order(plan.order)
    windows = count_noun(plan.windows, "window")
    rounds = f"{windows}; certified in round {plan.rounds} at most"
    yield Row("planned in", rounds)
    if plan.triggers:
        yield Row("triggers", f"{plan.triggers} in triggers.csv")


def _describe_saving(plan: Plan, classical: Classical) -> Row:
    """Describe the time saved against the baseline timing.

    The first screen compares only with a baseline that keeps the same limits.
    """
    saved = classical.duration - plan.trajectory.duration
    share = 100 * saved / classical.duration
    differences = describe_differences(plan, classical) or ("the same limits",)
    baseline = ", ".join([f"{classical.duration:.6f} s", *differences])
    sense = "less" if saved >= 0 else "more"
    amount = f"{abs(share):.2f} %: {abs(saved):.6f} s {sense}"
    text = f"{amount} than {classical.kind} ({baseline})"
    return Row("saved", text, brief=not missing_limits(plan, classical))


def _describe_limits(certificate: Certificate, lowered: Collection[str]) -> Row:
    """Describe the limits that the motion reaches: geometric ones do not count, as at home.

    lowered: limits that were lowered for input shapers.
    """
    geometric = geometric_limits()
    active = [
        f"{name} ({certificate.where[name].axis})"
        for name, share in certificate.worst.items()
        if (share > REACHED or name in lowered) and name not in geometric
    ]
    proved = f"{len(certificate.worst)} proved at every instant"
    return Row("limits", f"{proved}; reached: {', '.join(active) or 'none'}")


def _describe_unchecked(plan: Plan | PlanStanding) -> Row:
    """Describe the limits that the machine leaves out, and the collisions that no file states."""
    limits = plan.certificate.worst
    bodies = plan.machine.bodies
    others = ["tool", "workpiece", "surroundings"]
    if bodies is not None and None in (bodies.base_disc, bodies.platform_disc):
        others.insert(0, "plates without a disc")
    listed = f"{', '.join(others[:-1])} and {others[-1]}"
    unchecked = ["collisions" if "clearance" not in limits else f"collisions with {listed}"]
    if plan.machine.tilt_names and "tilt" not in limits:
        unchecked.append("tilt of the joints")
    if not {"force", "torque-speed"} & limits.keys():
        unchecked.append("forces and torques")
    unchecked += [name for name in ("speed", "acceleration", "jerk") if name not in limits]
    return Row("not checked", ", ".join(unchecked))


def _describe_least(plan: Plan) -> str:
    """Describe how near the duration is to the least, as the end of a sentence; "" if unknown."""
    if not (plan.known and plan.fastest):
        return ""
    if plan.gap is None or not isfinite(plan.gap):
        return f"; {plan.bound.describe()}"
    left_out = ", ".join(plan.bound.left_out)
    least = f"{plan.lower_bound:.6f} s{f' (without {left_out})' if left_out else ''}"
    return f", at most {round_up(100 * plan.gap, 3)} % above the proved least of {least}"


def _describe_shaping(plan: Plan, least: str) -> Iterator[Row]:
    """Describe the input shapers, their cost, and the vibration that is left."""
    shaped = plan.shaped
    if shaped is None:
        return
    before = f"{plan.trajectory.duration:.6f} s{least}; the saving refers to this, too"
    yield Row(BEFORE_SHAPERS, before)
    yield Row("input shapers", shaped.describe())
    if (cost := shaped.cost) is not None:
        yield Row("cost of the shapers", cost.describe() if plan.fastest else "")
        yield Row("lowered for them", cost.describe_lowered() if cost.lowered else "")
    left = "; ".join(each.describe() for each in find_residuals(shaped.axes))
    yield Row("vibration left", left)


def _describe_path(plan: Plan) -> Iterator[Row]:
    """Describe the program, the length of its path, and its deviations from the program."""
    path = plan.path
    repeat = f", run {plan.program.repeat} times" if plan.program.repeat > 1 else ""
    yield Row("segments", f"{len(plan.program.segments)}{repeat}", brief=False)
    way = measure_travel(path.pieces)
    length = float(path.breaks[-1])
    counted = ""
    if abs(way - length) >= SAME_LENGTH:
        counted = f"places in tables count to {1e3 * length:.3f} mm; "
    turn = 1e3 * plan.machine.characteristic_length
    note = f"{counted}a pure turn counts its angle times {turn:.3f} mm"
    yield Row("length of the path", f"{1e3 * way:.3f} mm ({note})", brief=False)
    if path.fit is not None:
        yield Row("fit", path.fit.describe(), brief=path.fit.before > 0)
    yield Row("synchronised moves", describe_departures(plan.departures))
    yield Row("splines off their polygons", describe_overshoot(path.overshoots))
    yield Row("blends", describe_blends(path.blends))
    tolerances = [blend.tolerance for blend in path.blends]
    if path.fit is not None:
        tolerances.append(path.fit.tolerance)
    widest = max(tolerances, default=0.0)
    if widest > length:
        whole = f"more than the whole path of {1e3 * length:.6g} mm"
        yield Row("tolerance", f"{1e3 * widest:.6g} mm, {whole}: is the unit as meant?")


def _describe_order(order: int) -> Row:
    derivatives = "speed and acceleration" if order == 2 else "speed, acceleration and jerk"
    return Row("order", f"{order} ({derivatives})", brief=False)


def _describe_pulses(report: PlanReport) -> Iterator[Row]:
    """Describe the pulses and their check: exact times of crossings, or the bounds of the rule."""
    pulses = report.plan.pulses
    bound = max(axis.bound for axis in pulses.axes)
    clock = f"a clock of {pulses.clock_hz / 1e6:g} MHz"
    error = f"count error at most {bound:.3f} (firing rule {pulses.rule})"
    yield Row("pulses", f"{count_pulses(report.plan)} on {clock}, {error}")
    verdict = report.verdict
    if verdict is None:
        return
    exact = ""
    if verdict.time_error is not None:
        exact = f"; largest time error {verdict.time_error:.4f} ticks"
    yield Row("highest pulse rate", f"{verdict.highest_rate:.1f} 1/s", brief=False)
    yield Row("pulse check", f"{count_noun(verdict.fault_count, 'error')}{exact}", brief=False)
