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
        As for `plan`.
    address
        Address of a Dask scheduler (`run_on_cluster`). None: this computer's cores.
    progress
        Callback with how many programs are done, and of how many.

    Returns
    -------
    list
        The Plan of each program, or the MotionError that refuses it, in order.

    Raises
    ------
    MotionError
        Dask is not installed, or no scheduler answers at the address.
    """
    loaded = [load_program(program) for program in programs]
    shared = (load_machine(machine), PlanRequest(order=order, clock_hz=clock_hz, limits=limits))
    results: dict[int, Plan | MotionError] = {}
    for n, result in run_on_cluster(_plan_one, loaded, shared, address) if loaded else ():
        if isinstance(result, LostTask):
            results[n] = MotionError(f"program {loaded[n].name}: {result}")
        else:
            results[n] = result
        progress(len(results), len(loaded))
    return [results[n] for n in range(len(loaded))]


def _plan_one(program: Program, shared: tuple[Machine, PlanRequest]) -> Plan | MotionError:
    machine, request = shared
    try:
        return make_plan(request, program, machine)
    except MotionError as error:
        return error.with_traceback(None)
