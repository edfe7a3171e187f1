"""Many programs planned in parallel, on this computer's cores or on a cluster of computers."""

from collections.abc import Iterable, Sequence

from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_arguments
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import MachineSource, load_machine
from planner.cluster import LostTask, run_on_cluster
from planner.limits import OwnLimit
from planner.parallel import Progress, ignore_progress
from planner.plan import Plan, make_plan
from planner.program.model import Program
from planner.program.program_file import ProgramSource, load_program
from planner.request import PlanRequest


@check_arguments("machine")
def plan_many(
    programs: Iterable[ProgramSource],
    machine: MachineSource,
    *,
    order: int | None = None,
    clock_hz: int = 10_000_000,
    limits: Sequence[OwnLimit] = (),
    address: str | None = None,
    progress: Progress = ignore_progress,
) -> list[Plan | MotionError]:
    """Plan many programs in parallel.

    Parameters
    ----------
    programs
        Each as it is, by name, or by the path of a file.
    machine, order, clock_hz, limits
        As of `plan`.
    address
        Of a Dask scheduler (`run_on_cluster`). None: this computer's cores.
    progress
        Called with how many programs are done, and of how many.

    Returns
    -------
    list
        The Plan of each program, or the MotionError that it was refused with, in order.

    Raises
    ------
    MotionError
        Dask is not installed, or nothing answers at the address.
    """
    asked, machine = [load_program(program) for program in programs], load_machine(machine)
    found: dict[int, Plan | MotionError] = {}
    how = machine, PlanRequest(order=order, clock_hz=clock_hz, limits=limits)
    for n, one in run_on_cluster(_plan_one, asked, how, address) if asked else ():
        found[n] = MotionError(f"program {asked[n].name}: {one}") if isinstance(one, LostTask) else one
        progress(len(found), len(asked))
    return [found[n] for n in range(len(asked))]


def _plan_one(program: Program, how: tuple[Machine, PlanRequest]) -> Plan | MotionError:
    machine, request = how
    try:
        return make_plan(request, program, machine)
    except MotionError as error:
        return error.with_traceback(None)
