"""What the command `plan` computes: plan, baseline timings, quantization error, tracking errors."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

from controllers.rig import Rig
from kinematics import Machine, MotionError
from planner import Plan, Program, plan
from planner.baselines import Classical, pick_baseline
from planner.beside import NO_PROCESS, SideProcess
from planner.cross_check import CrossCheck, cross_check
from planner.limits import find_unkept_limits, usual_order
from planner.orientation.orient import orient_open
from planner.pulses import RealisedPath
from pulsepath.process.second_work import PlanReview, seen, time_baselines, time_baselines_ahead
from pulsepath.progress import detail, note, step

REALISED_SAMPLES = 25_000
"""Intervals between pulses at which the realised path is looked at: well below a second, and within 2 % in its RMS."""


class Defect(MotionError):
    """A fault of this program rather than of what it was given."""


@dataclass(frozen=True, slots=True)
class Job:
    """A plan, the baseline timing of its path, the path of its pulses, and the errors of the laws on a rig.

    classical: what the saving is told against, as `planner.baselines.pick_baseline` picks it
    others: the other baseline timings, as far as the program and the machine allow them
    seen: waits for the errors of the laws, and for some figures if the report is to have any
    rig: None: the plan is not tracked
    crossed: toppra's motion beside ours, where that was asked for
    """

    plan: Plan
    classical: Classical
    others: tuple[Classical, ...]
    realised: RealisedPath | None
    seen: Callable[[], PlanReview]
    figures: bool
    rig: Rig | None
    crossed: CrossCheck | None = None

    @property
    def saved(self) -> float:
        """s that the plan is shorter than the baseline timing; negative where that keeps fewer limits and is."""
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
) -> Job:
    """Plan, prove and compare, in the other process as well. Raises as `planner.plan`."""
    for field in find_unkept_limits(machine):
        note(f"note: {machine.name} states {field} but no masses, so no plan can respect it")
    with step(f"planning {program.name} on {machine.name}") as tell:
        program = orient_open(program, machine, usual_order(machine.axes) if order is None else order)
        timing = other.start(partial(time_baselines_ahead, program, machine))
        planned = plan(program, machine, order=order, clock_hz=clock_hz, duration=duration, rule=rule, progress=tell)
    look = partial(seen, planned, figures, rig)
    looking = other.start(look)
    detail(_describe_solution(planned))
    realised = _followed(planned)
    with step("computing baseline timings"):
        found = timing.result(partial(time_baselines, planned))
    for line in found.notes:
        detail(line)
    baseline = pick_baseline(planned, found.timings)
    others = tuple(timing for timing in found.timings if timing is not baseline)
    beside = _crossed(planned) if crossed else None
    return Job(planned, baseline, others, realised, cache(partial(looking.result, look)), figures, rig, beside)


def _crossed(planned: Plan) -> CrossCheck:
    with step("solving order 2 with toppra"):
        return cross_check(planned)


def _describe_solution(planned: Plan) -> str:
    """How the motion was found."""
    runs = ", ".join(f"{count} by {method}" for method, count in Counter(planned.methods).items())
    near = "" if planned.gap is None else f"; {100 * planned.gap:.3f} % above the estimated minimum time"
    return f"order {planned.order}, solver iterations: {planned.rounds}, runs between stops: {runs}{near}"


def _followed(planned: Plan) -> RealisedPath | None:
    """The path that the pulses make; None where the machine is singular on the way, so that counts tell no pose."""
    try:
        with step("computing quantization error"):
            return planned.realised(stride=max(1, planned.pulses.total // REALISED_SAMPLES))
    except MotionError as error:
        note(f"no quantization error: {error}")
        return None
