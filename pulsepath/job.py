"""What the command `plan` computes: plan, baseline timings, quantization error, tracking errors.

Its second process does the baseline timings, the tracking errors and some figures.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from math import ceil, nan
from typing import TYPE_CHECKING

from controllers import Metrics, find_law
from controllers.metrics.evaluate import PERIOD, evaluate_each
from controllers.rig import Rig
from controllers.tracking import track_each
from kinematics import Machine, MotionError
from kinematics.foundation.names import count_noun
from planner import LimitChange, Plan, Program, Tradeoff, Worth, plan
from planner.baselines import KINDS, Classical, classical, pick_baseline
from planner.baselines.classical import Course, course
from planner.baselines.shapes import S_CURVE
from planner.cross_check import CrossCheck, cross_check
from planner.interruption.hold import Stops
from planner.limits import find_unkept_limits, usual_order
from planner.orientation.orient import orient_open
from planner.parallel import NO_PROCESS, SideProcess
from planner.path.overshoot import overshoot_warnings
from planner.pulses import RealisedPath
from planner.timing.certified_solve import EFFORT
from planner.tradeoffs.objective import read_objective
from pulsepath.options import LAWS
from pulsepath.progress import detail, note, step

if TYPE_CHECKING:
    from benchmarks.reports.page import Picture

REALISED_SAMPLES = 25_000
"""Intervals between pulses at which the realised path is looked at: well below a second, and within 2 % in its RMS."""

MOST_BOUNDED, BOUNDED_EACH_SECOND = 20_000, 1_000
"""Time pieces up to which a lower bound of the duration is proved unasked; of how many it takes a second, about."""

FRAME_RATE, LEAST_FRAMES, MOST_FRAMES = 25, 120, 1000
"""Frames of the machine in a report: 1/s, and how many."""

RAISED = 0.2
"""By how much the most valuable limit is raised, to tell what that saves."""


class Defect(MotionError):
    """A fault of this program rather than of what it was given."""


@dataclass(frozen=True, slots=True)
class BaselineTimings:
    """The baseline timings of a path that the program and the machine allow, and why there are no more."""

    timings: tuple[Classical, ...]
    notes: tuple[str, ...]


NO_BASELINES = BaselineTimings((), ())


def time_baselines(course: Course | Plan) -> BaselineTimings:
    """Every baseline timing along a course. Raises as `planner.classical`, of the first of them.

    Without a limit of jerk an s-curve is asked for by nothing, so that none needs no excuse.
    """
    found, notes = [classical(course)], []
    jerk = any(axis.max_jerk is not None for axis in course.machine.axes)
    for kind in KINDS[1:]:
        if kind == S_CURVE.name and not jerk:
            continue
        try:
            found.append(classical(course, kind))
        except MotionError as error:
            notes.append(f"no {kind} timing: {error}")
    return BaselineTimings(tuple(found), tuple(notes))


def time_baselines_ahead(program: Program, machine: Machine) -> BaselineTimings:
    """The same while the plan is being made."""
    return time_baselines(course(program, machine, 2))


@dataclass(frozen=True, slots=True)
class PlanReview:
    """Of a plan: the errors of each law on a rig, some of the figures, and the machine in motion as a page of its own;
    note: why there are no errors.
    """

    metrics: tuple[Metrics, ...]
    figures: "Mapping[str, Picture]"
    note: str = ""
    scene: str = ""


def review_plan(plan: Plan, figures: bool, rig: Rig | None) -> PlanReview:
    """No errors without a rig, nor where its card or drives cannot run the motion, which is no fault of the plan."""
    metrics: tuple[Metrics, ...] = ()
    note = ""
    if rig is not None:
        try:
            metrics = _track_laws(plan, rig)
        except MotionError as error:
            note = f"not tracked: {error}"
    if not figures:
        return PlanReview(metrics, {}, note)
    from benchmarks.reports.plan_report import draw_path, draw_tracking

    return PlanReview(metrics, draw_path(plan) | draw_tracking(metrics), note, _record_machine(plan))


def _record_machine(plan: Plan) -> str:
    """The machine in motion; nothing where it cannot be drawn."""
    from benchmarks.animation.animate import document

    frames = round(FRAME_RATE * plan.trajectory.duration)
    try:
        return document(plan, min(max(frames, LEAST_FRAMES), MOST_FRAMES))
    except MotionError as error:
        detail(f"no machine in 3-D: {error}")
        return ""


def _track_laws(plan: Plan, rig: Rig) -> tuple[Metrics, ...]:
    laws = [find_law(law, rig) for law in LAWS]
    return evaluate_each(track_each(plan, plan.machine, laws, rig=rig, period=PERIOD), plan, plan.machine)


@dataclass(frozen=True, slots=True)
class Job:
    """A plan, the baseline timing of its path, the path of its pulses, and the errors of the laws on a rig.

    classical: what the saving is told against, as `planner.baselines.pick_baseline` picks it; None: not asked for
    others: the other baseline timings, as far as the program and the machine allow them
    seen: waits for the errors of the laws, and for some figures if the report is to have any
    rig: None: the plan is not tracked
    crossed: toppra's motion beside ours, where that was asked for
    worth: what each limit is worth, where the bound is proved; change: the plan with the best of them RAISED
    tradeoff: duration against heat, where heat is part of the objective
    stops: how soon it can be stopped, where that was asked for
    unbounded: why there is neither a proved bound nor worth, and how to get them; "": there are, or nobody wants them
    """

    plan: Plan
    classical: Classical | None
    others: tuple[Classical, ...]
    realised: RealisedPath | None
    seen: Callable[[], PlanReview]
    figures: bool
    rig: Rig | None
    crossed: CrossCheck | None = None
    worth: Worth | None = None
    change: LimitChange | None = None
    tradeoff: Tradeoff | None = None
    stops: Stops | None = None
    unbounded: str = ""

    @property
    def time_saved(self) -> float:
        """s that the plan is shorter than the baseline timing; negative where that keeps fewer limits and is.

        NaN without a baseline timing.
        """
        if self.classical is None:
            return nan
        return self.classical.duration - self.plan.trajectory.duration


def run(
    program: Program,
    machine: Machine,
    order: int | None,
    clock_hz: int,
    duration: float | None = None,
    rule: str = "nearest",
    other: SideProcess = NO_PROCESS,
    figures: bool = True,
    rig: Rig | None = None,
    crossed: bool = False,
    objective: str = "time",
    gap: float | None = None,
    effort: int = EFFORT,
    stops: int | None = None,
    baselines: bool = True,
    worth: bool | None = None,
) -> Job:
    """Plan, prove and compare, in the other process as well. Raises as `planner.plan`.

    worth: whether to work out what limits are worth; None: where it takes up to MOST_BOUNDED time pieces
    """
    for field in find_unkept_limits(machine):
        note(f"note: {machine.name} states {field} but no masses, so no plan can respect it")
    aim = read_objective(objective)  # refused before the work
    with step(f"planning {program.name} on {machine.name}") as tell:
        program = orient_open(program, machine, usual_order(machine.axes, program) if order is None else order)
        timing = other.start(partial(time_baselines_ahead, program, machine)) if baselines else None
        planned = plan(
            program,
            machine,
            order=order,
            clock_hz=clock_hz,
            duration=duration,
            objective=aim,
            gap=gap,
            effort=effort,
            rule=rule,
            progress=tell,
        )
    if near := planned.conditioning.warning:
        note(f"warning: {near}")
    for warning in overshoot_warnings(planned.path.overshoots):
        note(f"warning: {warning}")
    if planned.exceeded:
        note(f"warning: {planned.exceeded}")
    if gap is not None and planned.bound.gap > gap:
        note(
            f"note: you asked for a motion within {100 * gap:g} % of the fastest; {100 * planned.bound.gap:.3g} % is "
            f"proved after {count_noun(effort, 'round')}. More rounds (--effort) may prove less"
        )
    look = partial(review_plan, planned, figures, rig)
    looking = other.start(look)
    found, change, unbounded = None, None, ""
    pieces = len(planned.trajectory.s)
    if worth is not False and (worth or planned.known or pieces <= MOST_BOUNDED):
        with step("proving a lower bound"):
            found, change = _find_worth(planned)
    elif worth is None and planned.fastest:
        unbounded = describe_unbounded(pieces)
    detail(_describe_solution(planned))
    realised = _compute_realised_path(planned)
    timed = NO_BASELINES
    if timing is not None:
        with step("computing baseline timings"):
            timed = timing.result(partial(time_baselines, planned))
    for line in timed.notes:
        detail(line)
    baseline = pick_baseline(planned, timed.timings) if timed.timings else None
    others = tuple(timing for timing in timed.timings if timing is not baseline)
    beside = _run_cross_check(planned) if crossed else None
    tradeoff = None
    if aim.heat > 0:
        with step("trading time against heat"):
            tradeoff = planned.trade()
    held = None
    if stops is not None:
        with step(f"stopping from {count_noun(stops, 'instant')}"):
            held = planned.stops(stops)
    seen = cache(partial(looking.result, look))
    outcomes = (beside, found, change, tradeoff, held, unbounded)
    return Job(planned, baseline, others, realised, seen, figures, rig, *outcomes)


def describe_unbounded(pieces: int) -> str:
    """Why no bound was proved of a motion of so many time pieces, and how to get it."""
    takes = f"{pieces} time pieces would take some {ceil(pieces / BOUNDED_EACH_SECOND)} s"
    return f"not worked out, as {takes} (more than {MOST_BOUNDED} are left out): give --worth to have it all the same"


def _find_worth(planned: Plan) -> tuple[Worth | None, LimitChange | None]:
    """What limits are worth, by the lower bound, and what more of the best of them saves."""
    _, worth = planned.bound, planned.worth
    if worth is None or worth.best is None:
        return worth, None
    try:
        return worth, worth.replan(*worth.best, RAISED)
    except MotionError as error:
        note(f"no motion with more of the most valuable limit: {error}")
        return worth, None


def _run_cross_check(planned: Plan) -> CrossCheck:
    with step("solving order 2 with toppra"):
        return cross_check(planned)


def _describe_solution(planned: Plan) -> str:
    """How the motion was found."""
    runs = ", ".join(f"{count} by {method}" for method, count in Counter(planned.methods).items())
    near = f"; {planned.bound.describe()}" if planned.known and planned.fastest else ""
    return f"order {planned.order}, solve rounds: {planned.rounds}, runs between stops: {runs}{near}"


def _compute_realised_path(planned: Plan) -> RealisedPath | None:
    """The path that the pulses make; None where the machine is singular on the way, so that counts tell no pose."""
    try:
        with step("computing quantization error"):
            return planned.realised(stride=max(1, planned.pulses.total // REALISED_SAMPLES))
    except MotionError as error:
        note(f"no quantization error: {error}")
        return None
