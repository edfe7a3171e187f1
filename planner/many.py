"""Hundreds of programs planned at once, on a cluster."""

from collections.abc import Iterable

from kinematics.errors import MotionError
from kinematics.machine import Machine
from planner.cluster import Lost, on_cluster
from planner.parallel import Progress
from planner.plan import Plan, plan
from planner.program import Program


def plan_many(
    programs: Iterable[Program],
    machine: Machine,
    *,
    order: int | None = None,
    clock_hz: int = 10_000_000,
    address: str | None = None,
    progress: Progress | None = None,
) -> list[Plan | MotionError]:
    """The plan of every program, or the MotionError that it met with, in the programs' order.

    order and clock_hz as of `plan`. address as of `on_cluster`: of a Dask scheduler; None: this computer's cores.
    progress is told how many programs are done, and of how many. Raises MotionError where Dask is not installed or
    nothing answers.
    """
    asked = list(programs)
    found: dict[int, Plan | MotionError] = {}
    if not asked:
        return []
    for n, one in on_cluster(_planned, asked, (machine, order, clock_hz), address):
        found[n] = MotionError(f"program {asked[n].name}: {one}") if isinstance(one, Lost) else one
        if progress is not None:
            progress(len(found), len(asked))
    return [found[n] for n in range(len(asked))]


def _planned(program: Program, how: tuple[Machine, int | None, int]) -> Plan | MotionError:
    """On a worker."""
    machine, order, clock_hz = how
    try:
        return plan(program, machine, order=order, clock_hz=clock_hz)
    except MotionError as error:
        return error.with_traceback(None)
