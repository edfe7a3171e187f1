"""All that the command `plan` finds out about a program on a machine."""

import sys
from dataclasses import dataclass

from controllers import Metrics, evaluate, find_law, track
from kinematics import Machine, MotionError
from planner import Plan, Program, plan
from planner.baseline import Classical, classical
from planner.limits import unkept
from planner.pulses import PulseCheck, check
from pulsepath.progress import step

LAWS = ("3", "6")
"""Tracking laws that the report compares: open and closed loop."""


class Defect(MotionError):
    """A fault of this program rather than of what it was given."""


@dataclass(frozen=True, slots=True)
class Job:
    """A plan, the classical timing of its path, the check of its pulses, and the errors of the tracking laws."""

    plan: Plan
    classical: Classical
    verdict: PulseCheck
    metrics: tuple[Metrics, ...]

    @property
    def saved(self) -> float:
        """s that the plan is shorter than the classical timing; negative where that is: it has no jerk limit."""
        return self.classical.duration - self.plan.trajectory.duration


def run(program: Program, machine: Machine, order: int | None, clock_hz: int) -> Job:
    """Plan, prove and compare. Raises as `planner.plan`, and Defect where the pulses fail their check."""
    for field in unkept(machine):
        print(f"note: {machine.name} states {field} but no masses, so no plan can keep it", file=sys.stderr)
    with step(f"planning {program.name} on {machine.name}"):
        planned = plan(program, machine, order=order, clock_hz=clock_hz)
    with step(f"checking {planned.pulses.total} pulses"):
        verdict = check(planned.pulses, planned.trajectory, machine.axes, machine.home_q)
    if not verdict.holds:
        raise Defect(f"{verdict.fault_count} faults in the pulses, the first: {verdict.faults[0]}")
    with step("timing the path classically"):
        baseline = classical(planned)
    return Job(planned, baseline, verdict, _tracked(planned, machine))


def _tracked(planned: Plan, machine: Machine) -> tuple[Metrics, ...]:
    """Errors of each law; none where the emulated hardware cannot run the motion, which is no fault of the plan."""
    try:
        with step(f"tracking it under laws {' and '.join(LAWS)}"):
            return tuple(evaluate(track(planned, machine, find_law(law)), planned, machine) for law in LAWS)
    except MotionError as error:
        print(f"not tracked: {error}", file=sys.stderr)
        return ()
