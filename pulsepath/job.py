"""The job of the command `plan`: plan, baseline timings, quantization error, tracking errors.

A second process computes the baseline timings and the tracking errors, and draws all figures, so
that this one does not load matplotlib.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import cache, partial
from math import ceil
from typing import TYPE_CHECKING

from benchmarks.reports.plan_content import PlanReport
from controllers import Metrics, find_law
from controllers.metrics.evaluate import PERIOD, evaluate_each
from controllers.rig import Rig
from controllers.rig_choice import rig_hint
from controllers.tracking import track_each
from kinematics import Machine, MotionError
from kinematics.foundation.names import count_noun
from planner import LimitChange, Plan, Program, Worth
from planner.baselines import KINDS, Classical, classical, pick_baseline
from planner.baselines.classical import Course, course
from planner.baselines.shapes import S_CURVE
from planner.bounds.duration_bound import LEAST_SHARED_CELLS, bound_duration
from planner.cross_check import CrossCheck, cross_check
from planner.interruption.hold import Stops
from planner.limits import find_unkept_limits
from planner.limits.tool import ToolSpeed
from planner.orientation.orient import orient_open
from planner.parallel import NO_PROCESS, SideProcess
from planner.path.overshoot import overshoot_warnings
from planner.plan import make_plan
from planner.pulses import PulseCheck, RealisedPath
from planner.request import PlanRequest
from planner.timing.order2.toppra_ import require
from pulsepath.inputs import read_rig
from pulsepath.options import LAWS
from pulsepath.progress import detail, note, step
from pulsepath.requests import MOST_BOUNDED, ReportRequest

if TYPE_CHECKING:
    from benchmarks.reports.page import Picture

# Intervals between pulses at which the realised path is computed: more take over a second, fewer
# change its RMS by more than 2 %.
REALISED_SAMPLES = 25_000

# Time pieces for which a bound takes one second, approximately.
BOUNDED_EACH_SECOND = 1_000

# Cost of planning in cells of a quick bound, measured: of a time piece by order, and of each run
# between stops. Cells are counted instead of timed, so that the result does not depend on the
# computer.
CELLS_PER_PIECE = {2: 0.2, 3: 0.5}
CELLS_PER_RUN = 10
# Cost of the bound of a run in addition to its cells, in cells.
CELLS_OVERHEAD = 12
# Cells of a bound that takes less time than starting the command.
CELLS_AT_ONCE = 300

# Segments up to which the first process computes baselines in less time than the second one takes
# to load the compiler and kernels for them.
FEW_SEGMENTS = 100

# Frames of the machine in a report: per second, and in all.
FRAME_RATE = 25
LEAST_FRAMES = 120
MOST_FRAMES = 1000

# Share of the program's speed from which its unit is not doubted. Ten times what the axes attain
# anywhere limits nothing.
LEAST_SPEED = 0.1

# Share by which the most valuable limit is raised, to show the saving.
RAISED = 0.2


class Defect(MotionError):
    """A fault of this program rather than of its input."""


@dataclass(frozen=True, slots=True)
class BaselineTimings:
    """Baseline timings of a path. notes: why a timing is missing."""

    timings: tuple[Classical, ...]
    notes: tuple[str, ...]


NO_BASELINES = BaselineTimings((), ())


def time_like_baseline(course: Course | Plan, order: int) -> BaselineTimings:
    """Time the baseline with a plan's own limits: an s-curve at order 3, else a trapezoid.

    If no s-curve is possible, it is the trapezoid. Raises as `planner.classical`.
    """
    jerk = any(axis.max_jerk is not None for axis in course.machine.axes)
    notes: tuple[str, ...] = ()
    if order == 3 and jerk:
        try:
            return BaselineTimings((classical(course, S_CURVE.name),), ())
        except MotionError as error:
            notes = (f"no {S_CURVE.name} timing: {error}",)
    return BaselineTimings((classical(course),), notes)


def time_baselines(course: Course | Plan) -> BaselineTimings:
    """Compute every baseline timing along a course. Raises as `planner.classical` for the first.

    Without jerk limits there is no s-curve, and no note about it.
    """
    timings = [classical(course)]
    notes: list[str] = []
    jerk = any(axis.max_jerk is not None for axis in course.machine.axes)
    for kind in KINDS[1:]:
        if kind == S_CURVE.name and not jerk:
            continue
        try:
            timings.append(classical(course, kind))
        except MotionError as error:
            notes.append(f"no {kind} timing: {error}")
    return BaselineTimings(tuple(timings), tuple(notes))


def time_baselines_ahead(
    program: Program, machine: Machine, like: int | None = None
) -> BaselineTimings:
    """Compute the baselines while the plan is made. like: only the one for a plan of this order."""
    untimed = course(program, machine, 2)
    return time_baselines(untimed) if like is None else time_like_baseline(untimed, like)


@dataclass(frozen=True, slots=True)
class PlanReview:
    """Results of the second process.

    metrics  errors of each law on a rig
    figures  figures of the plan and of the errors
    note     why there are no errors
    scene    page of the machine in motion
    """

    metrics: tuple[Metrics, ...]
    figures: "Mapping[str, Picture]"
    note: str = ""
    scene: str = ""


def review_plan(plan: Plan, figures: bool, rig: Rig | None) -> PlanReview:
    """Track the plan on a rig and draw both. A rig that cannot run the motion gives a note."""
    metrics: tuple[Metrics, ...] = ()
    note = ""
    if rig is not None:
        try:
            metrics = _track_laws(plan, rig)
        except MotionError as error:
            note = f"not tracked: {error}"
    if not figures:
        return PlanReview(metrics, {}, note)
    from benchmarks.reports.plan_figures import draw_axes, draw_path, draw_tracking

    pictures = draw_axes(plan) | draw_path(plan) | draw_tracking(metrics)
    return PlanReview(metrics, pictures, note, _record_machine(plan))


def draw_results(results: PlanReport) -> "Mapping[str, Picture]":
    """Draw the figures of the results that follow planning."""
    from benchmarks.reports import plan_figures

    return (
        plan_figures.draw_baseline(results.whole, results.classical)
        | plan_figures.draw_realised(results.realised)
        | plan_figures.draw_worth(results.worth)
        | plan_figures.draw_stops(results.stops)
    )


def _record_machine(plan: Plan) -> str:
    """Return the page of the machine in motion; "" if it cannot be drawn."""
    from benchmarks.animation.animate import document

    frames = round(FRAME_RATE * plan.trajectory.duration)
    try:
        return document(plan, min(max(frames, LEAST_FRAMES), MOST_FRAMES))
    except MotionError as error:
        detail(f"no machine in 3-D: {error}")
        return ""


def _track_laws(plan: Plan, rig: Rig) -> tuple[Metrics, ...]:
    laws = [find_law(law, rig) for law in LAWS]
    return evaluate_each(
        track_each(plan, plan.machine, laws, rig=rig, period=PERIOD), plan, plan.machine
    )


@dataclass(frozen=True, slots=True)
class Job:
    """A plan with its results, some of which the second process is still working on.

    results  content of the report so far
    review   function that waits for the review
    draw     function that waits for the figures of the results; None: no figures are requested
    """

    results: PlanReport
    review: Callable[[], PlanReview]
    draw: "Callable[[], Mapping[str, Picture]] | None"

    @property
    def plan(self) -> Plan:
        """Plan that was made."""
        return self.results.whole

    def complete(self, verdict: PulseCheck) -> PlanReport:
        """Wait for the second process, and return the content of the report."""
        results = self.results
        waiting: AbstractContextManager[object] = nullcontext()
        if results.rig is not None:
            waiting = _tracking(results.rig)
        elif self.draw is not None:
            waiting = step("drawing the figures")
        with waiting:
            review = self.review()
            figures = {} if self.draw is None else self.draw()
        if review.note:
            note(review.note)
        return replace(
            results,
            verdict=verdict,
            metrics=review.metrics,
            untracked=review.note or rig_hint(results.plan.machine),
            figures={**review.figures, **figures},
            scene=review.scene,
        )


def run(
    program: Program,
    machine: Machine,
    request: PlanRequest,
    report: ReportRequest,
    other: SideProcess = NO_PROCESS,
) -> Job:
    """Plan, prove and compare, with the second process. Raises as `planner.plan`."""
    for field in find_unkept_limits(machine):
        note(f"note: {machine.name} states {field} but no masses, so no plan can respect it")
    request = request.resolve(program, machine)  # refuses before the work
    rig = read_rig(report.rig, machine)
    if report.cross_check:
        require("--cross-check")

    order = request.resolved_order
    # Order of the only baseline timing; None: all are computed.
    like = order if report.baselines is None else None
    with step(f"planning {program.name} on {machine.name}") as tell:
        program = orient_open(program, machine, order)
        ahead = partial(time_baselines_ahead, program, machine, like)
        helper = other if len(program.segments) > FEW_SEGMENTS else NO_PROCESS
        timing = None if report.baselines is False else helper.start(ahead)
        plan = make_plan(request, program, machine, tell)
    _warn(plan)

    review = partial(review_plan, plan, report.figures, rig)
    reviewing = other.start(review)
    results = examine(plan, report)
    timed = NO_BASELINES
    if timing is not None:
        with step("computing baseline timings"):
            again = time_baselines if like is None else partial(time_like_baseline, order=like)
            timed = timing.result(partial(again, plan))
    for line in timed.notes:
        detail(line)
    baseline = pick_baseline(plan, timed.timings) if timed.timings else None
    left_out = [*results.left_out]
    if like is not None:
        left_out.append("other baseline timings (--baselines)")
    results = replace(
        results,
        rig=rig,
        classical=baseline,
        others=tuple(timing for timing in timed.timings if timing is not baseline),
        left_out=tuple(left_out),
    )
    draw = None
    if report.figures:
        draw_here = partial(draw_results, results)
        drawing = other.start(draw_here)
        draw = partial(drawing.result, draw_here)
    return Job(results, cache(partial(reviewing.result, review)), draw)


def examine(plan: Plan, report: ReportRequest) -> PlanReport:
    """Find what the report requests about a motion: bound, worth, quantization, stops,
    cross-check.
    """
    quick = report.bound_effort == "auto" and not plan.known
    unbounded = _prove_bound(plan, report.bound_effort, report.worth)
    worth: Worth | None = None
    change: LimitChange | None = None
    if plan.known and report.worth is not False:
        with step("finding what limits are worth"):
            worth = plan.worth
            change = None if quick else _replan_best(worth)
    detail(_describe_solution(plan))

    left_out = []
    if quick and plan.known and plan.fastest:
        left_out.append("a nearer lower bound (--bound full)")
    if quick and worth is not None and worth.best is not None:
        left_out.append("a plan with more of the best limit (--worth)")
    return PlanReport(
        plan,
        realised=_compute_realised_path(plan),
        crossed=_run_cross_check(plan) if report.cross_check else None,
        worth=worth,
        change=change,
        unbounded=unbounded,
        stops=_find_stops(plan, report.stops),
        left_out=tuple(left_out),
    )


def examine_loaded(plan: Plan, report: ReportRequest) -> PlanReport:
    """Find what the report requests about the motion of a plan that was made in parts."""
    results = examine(plan, report)
    rig = read_rig(report.rig, plan.machine)
    if rig is None:
        return replace(results, untracked=rig_hint(plan.machine))
    with _tracking(rig):
        review = review_plan(plan, False, rig)
    if review.note:
        note(review.note)
    return replace(results, rig=rig, metrics=review.metrics, untracked=review.note)


def _tracking(rig: Rig) -> AbstractContextManager[object]:
    return step(f"tracking under laws {' and '.join(LAWS)} on rig {rig.name}")


def _warn(plan: Plan) -> None:
    """Print warnings about a plan, and whether its gap is as requested."""
    if near := plan.conditioning.warning:
        note(f"warning: {near}")
    for warning in overshoot_warnings(plan.path.overshoots):
        note(f"warning: {warning}")
    if plan.exceeded:
        note(f"warning: {plan.exceeded}")
    attained = plan.certificate.worst.get(ToolSpeed.name, 1.0)
    if attained < LEAST_SPEED:
        share = f"{100 * attained:.2g} %"
        note(f"warning: the motion attains at most {share} of the program's speed: check its unit")
    gap = plan.request.gap
    if gap is not None and plan.bound.gap > gap:
        note(
            f"note: you asked for a motion within {100 * gap:g} % of the fastest; "
            f"{100 * plan.bound.gap:.3g} % is proved after "
            f"{count_noun(plan.request.effort, 'round')}. More rounds (--effort) may prove less"
        )


def _find_stops(plan: Plan, count: int | None) -> Stops | None:
    """Find the stops from evenly spaced instants, if requested."""
    if count is None:
        return None
    with step(f"stopping from {count_noun(count, 'instant')}"):
        return plan.stops(count)


def _prove_bound(planned: Plan, bound: str, worth: bool | None) -> str:
    """Prove the lower bound of a plan with the requested effort.

    Return why there is no bound, or an empty text.
    """
    if planned.known or bound == "none":
        return ""
    pieces = len(planned.trajectory.s)
    if pieces > MOST_BOUNDED and not worth and bound != "full":
        return describe_unbounded(pieces) if planned.fastest else ""
    most_cells = find_affordable_cells(planned) if bound == "auto" else None
    if most_cells == 0:
        runs = count_noun(_count_runs(planned), "run")
        why = f"not worked out, as {runs} between stops would take longer than planning"
        return f"{why}: give --bound full to have it all the same" if planned.fastest else ""
    with step("proving a lower bound"):
        motion = planned.trajectory
        planned.known.append(
            bound_duration(motion, planned.limits, planned.order, most_cells=most_cells)
        )
    return ""


def find_affordable_cells(planned: Plan) -> int:
    """Return the number of cells of a bound that takes as long as planning; 0: the fewest take
    longer.
    """
    pieces, runs = len(planned.trajectory.s), _count_runs(planned)
    cells = int(CELLS_PER_PIECE[planned.order] * pieces) + (CELLS_PER_RUN - CELLS_OVERHEAD) * runs
    cells = max(cells, CELLS_AT_ONCE)
    return cells if cells >= LEAST_SHARED_CELLS * runs else 0


def _count_runs(planned: Plan) -> int:
    return int(planned.path.stops(planned.order).sum()) - 1


def describe_unbounded(pieces: int) -> str:
    """Return why a motion with this number of time pieces has no bound, and how to get it."""
    takes = f"{pieces} time pieces would take some {ceil(pieces / BOUNDED_EACH_SECOND)} s"
    return f"not worked out, as {takes} (more than {MOST_BOUNDED} are left out): give --worth to have it all the same"


def _replan_best(worth: Worth | None) -> LimitChange | None:
    """Plan with the most valuable limit raised.

    None: no limit saves time, or there is no motion.
    """
    if worth is None or worth.best is None:
        return None
    try:
        return worth.replan(*worth.best, RAISED)
    except MotionError as error:
        note(f"no motion with more of the most valuable limit: {error}")
        return None


def _run_cross_check(planned: Plan) -> CrossCheck:
    with step("solving order 2 with toppra"):
        return cross_check(planned)


def _describe_solution(planned: Plan) -> str:
    """Describe how the motion was solved."""
    runs = ", ".join(f"{count} by {method}" for method, count in Counter(planned.methods).items())
    near = f"; {planned.bound.describe()}" if planned.known and planned.fastest else ""
    return (
        f"order {planned.order}, solve rounds: {planned.rounds}, runs between stops: {runs}{near}"
    )


def _compute_realised_path(planned: Plan) -> RealisedPath | None:
    """Return the path that the pulses make.

    None: the machine is singular on the way, so that counts give no pose.
    """
    try:
        with step("computing quantization error"):
            return planned.realised(stride=max(1, planned.pulses.total // REALISED_SAMPLES))
    except MotionError as error:
        note(f"no quantization error: {error}")
        return None
