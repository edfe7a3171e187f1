"""All that the command `plan` finds out about a program on a machine."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from controllers import Metrics, evaluate, find_law, track
from controllers.metrics.evaluate import PERIOD
from kinematics import Machine, MotionError
from planner import Plan, Program, plan
from planner.baselines import KINDS, Classical, classical
from planner.limits import unkept
from planner.pulses import RealisedPath
from pulsepath.progress import step
from pulsepath.talk import detail, note

LAWS = ("3", "6")
"""Tracking laws that the report compares: open and closed loop."""
LOOKED = 25_000
"""Intervals between pulses at which the realised path is looked at: well below a second, and within 2 % in its RMS."""


class Defect(MotionError):
    """A fault of this program rather than of what it was given."""


@dataclass(frozen=True, slots=True)
class Job:
    """A plan, the classical timing of its path, the path of its pulses, and the errors of the laws.

    others: the other classical timings, as far as the program and the machine allow them
    """

    plan: Plan
    classical: Classical
    others: tuple[Classical, ...]
    realised: RealisedPath | None
    metrics: tuple[Metrics, ...]

    @property
    def saved(self) -> float:
        """s that the plan is shorter than the classical timing; negative where that is: it has no jerk limit."""
        return self.classical.duration - self.plan.trajectory.duration


def run(
    program: Program,
    machine: Machine,
    order: int | None,
    clock_hz: int,
    duration: float | None = None,
    rule: str = "nearest",
) -> Job:
    """Plan, prove and compare. Raises as `planner.plan`."""
    for field in unkept(machine):
        note(f"note: {machine.name} states {field} but no masses, so no plan can keep it")
    with step(f"planning {program.name} on {machine.name}") as tell:
        planned = plan(program, machine, order=order, clock_hz=clock_hz, duration=duration, rule=rule, progress=tell)
    detail(_how(planned))
    with step("timing the path classically"):
        baseline, others = classical(planned), tuple(_others(planned))
    return Job(planned, baseline, others, _followed(planned), _tracked(planned, machine))


def _how(planned: Plan) -> str:
    """How the motion was found."""
    runs = ", ".join(f"{count} by {method}" for method, count in Counter(planned.methods).items())
    near = "" if planned.gap is None else f"; {100 * planned.gap:.3f} % above an estimate of the least time"
    return f"order {planned.order}, rounds of solving: {planned.rounds}, runs between stops: {runs}{near}"


def _others(planned: Plan) -> Iterator[Classical]:
    for kind in KINDS[1:]:
        try:
            yield classical(planned, kind)
        except MotionError as error:
            note(f"no {kind} timing: {error}")


def _followed(planned: Plan) -> RealisedPath | None:
    """The path that the pulses make; None where the machine is singular on the way, so that counts tell no pose."""
    try:
        with step("following the path that the pulses make"):
            return planned.realised(stride=max(1, planned.pulses.total // LOOKED))
    except MotionError as error:
        note(f"the path of the pulses is not known: {error}")
        return None


def _tracked(planned: Plan, machine: Machine) -> tuple[Metrics, ...]:
    """Errors of each law; none where the emulated hardware cannot run the motion, which is no fault of the plan."""
    try:
        with step(f"tracking it under laws {' and '.join(LAWS)}"):
            return tuple(
                evaluate(track(planned, machine, find_law(law), period=PERIOD), planned, machine) for law in LAWS
            )
    except MotionError as error:
        note(f"not tracked: {error}")
        return ()
