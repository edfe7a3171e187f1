"""All that the command `plan` finds out about a program on a machine."""

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

from controllers import Metrics, evaluate, find_law, track
from controllers.metrics.evaluate import PERIOD
from kinematics import Machine, MotionError
from planner import Plan, Program, plan
from planner.baselines import KINDS, Classical, classical
from planner.beside import Beside
from planner.limits import unkept
from planner.pulses import RealisedPath
from pulsepath.progress import step

LAWS = ("3", "6")
"""Tracking laws that the report compares: open and closed loop."""
LOOKED = 25_000
"""Intervals between pulses at which the realised path is looked at: well below a second, and within 2 % in its RMS."""


class Defect(MotionError):
    """A fault of this program rather than of what it was given."""


@dataclass(frozen=True, slots=True)
class Job:
    """A plan, the classical timing of its path, the path of its pulses, and what another core finds out meanwhile.

    others: the other classical timings, as far as the program and the machine allow them
    aside: waits for what the other core does
    figures: whether the report has any
    """

    plan: Plan
    classical: Classical
    others: tuple[Classical, ...]
    realised: RealisedPath | None
    aside: Callable[[], "Aside"]
    figures: bool

    @property
    def saved(self) -> float:
        """s that the plan is shorter than the classical timing; negative where that is: it has no jerk limit."""
        return self.classical.duration - self.plan.trajectory.duration


@dataclass(frozen=True, slots=True)
class Aside:
    """What needs nothing but the plan, and is left to another core: the errors of the laws, and most figures.

    note: why there are no errors, where there are none
    """

    metrics: tuple[Metrics, ...]
    figures: Mapping[str, bytes]
    note: str = ""


def run(
    program: Program,
    machine: Machine,
    order: int | None,
    clock_hz: int,
    duration: float | None = None,
    rule: str = "nearest",
    other: Beside | None = None,
    figures: bool = True,
) -> Job:
    """Plan, prove and compare, on the other core as well. Raises as `planner.plan`."""
    for field in unkept(machine):
        print(f"note: {machine.name} states {field} but no masses, so no plan can keep it", file=sys.stderr)
    with step(f"planning {program.name} on {machine.name}") as tell:
        planned = plan(program, machine, order=order, clock_hz=clock_hz, duration=duration, rule=rule, progress=tell)
    aside = (Beside(None) if other is None else other).start(partial(_aside, planned, figures))
    with step("timing the path classically"):
        baseline, others = classical(planned), tuple(_others(planned))
    return Job(planned, baseline, others, _followed(planned), aside, figures)


def _others(planned: Plan) -> Iterator[Classical]:
    for kind in KINDS[1:]:
        try:
            yield classical(planned, kind)
        except MotionError as error:
            print(f"no {kind} timing: {error}", file=sys.stderr)


def _followed(planned: Plan) -> RealisedPath | None:
    """The path that the pulses make; None where the machine is singular on the way, so that counts tell no pose."""
    try:
        with step("following the path that the pulses make"):
            return planned.realised(stride=max(1, planned.pulses.total // LOOKED))
    except MotionError as error:
        print(f"the path of the pulses is not known: {error}", file=sys.stderr)
        return None


def _aside(planned: Plan, figures: bool) -> Aside:
    """In another process: the figures only if they are asked for."""
    try:
        metrics, note = _tracked(planned), ""
    except MotionError as error:
        metrics, note = (), f"not tracked: {error}"
    if not figures:
        return Aside(metrics, {}, note)
    from benchmarks.report import draw_plan, draw_tracking

    return Aside(metrics, draw_plan(planned) | draw_tracking(metrics), note)


def _tracked(planned: Plan) -> tuple[Metrics, ...]:
    machine = planned.machine
    return tuple(evaluate(track(planned, machine, find_law(law), period=PERIOD), planned, machine) for law in LAWS)
