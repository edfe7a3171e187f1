"""Work of the command `plan` in its second process: baseline timings, tracking errors, some figures."""

from collections.abc import Mapping
from dataclasses import dataclass

from controllers import Metrics, find_law
from controllers.metrics.evaluate import PERIOD, evaluate_each
from controllers.rig import Rig
from controllers.tracking import track_each
from kinematics import Machine, MotionError
from planner import Plan, Program
from planner.baselines import KINDS, Classical, classical
from planner.baselines.classical import Course, course
from planner.baselines.shapes import S_CURVE
from pulsepath.options import LAWS


@dataclass(frozen=True, slots=True)
class BaselineTimings:
    """The baseline timings of a path that the program and the machine allow, and why there are no more."""

    timings: tuple[Classical, ...]
    notes: tuple[str, ...]


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
    """Of a plan: the errors of each law on a rig, and some of the figures; note: why there are no errors."""

    metrics: tuple[Metrics, ...]
    figures: Mapping[str, bytes]
    note: str = ""


def seen(plan: Plan, figures: bool, rig: Rig | None) -> PlanReview:
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

    return PlanReview(metrics, draw_path(plan) | draw_tracking(metrics), note)


def _track_laws(plan: Plan, rig: Rig) -> tuple[Metrics, ...]:
    laws = [find_law(law, rig) for law in LAWS]
    return evaluate_each(track_each(plan, plan.machine, laws, rig=rig, period=PERIOD), plan, plan.machine)
