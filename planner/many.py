"""Hundreds of programs planned at once, on a cluster: Dask's, on this computer or on any number of others."""

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from kinematics.errors import MotionError
from kinematics.machine import Machine
from planner.parallel import Progress, cores, main_hidden
from planner.plan import Plan, plan
from planner.program import Program

# s to wait for a cluster that is said to be there.
PATIENCE = 10.0


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

    order and clock_hz as of `plan`. address: of a Dask scheduler whose workers have this package, such as
    "tcp://10.0.0.1:8786"; None: one worker for each core of this computer, for as long as this takes. progress is told
    how many programs are done, and of how many. Raises MotionError where Dask is not installed or nothing answers.
    """
    asked = list(programs)
    if not asked:
        return []
    with _client(address, len(asked)) as (client, as_completed, killed):
        shared = client.scatter(machine, broadcast=True)
        tasks = [client.submit(_planned, program, shared, order, clock_hz, pure=False) for program in asked]
        for done, _ in enumerate(as_completed(tasks), 1):
            if progress is not None:
                progress(done, len(asked))
        return [_result(task, program, killed) for task, program in zip(tasks, asked, strict=True)]


def _planned(program: Program, machine: Machine, order: int | None, clock_hz: int) -> Plan | MotionError:
    """On a worker."""
    try:
        return plan(program, machine, order=order, clock_hz=clock_hz)
    except MotionError as error:
        return error.with_traceback(None)


def _result(task: Any, program: Program, killed: type[Exception]) -> Plan | MotionError:
    try:
        found: Plan | MotionError = task.result()
    except killed as lost:
        return MotionError(f"program {program.name}: every worker that planned it died, as for want of memory: {lost}")
    return found


@contextmanager
def _client(address: str | None, programs: int) -> Iterator[tuple[Any, Any, type[Exception]]]:
    """A client of the cluster, what waits for its tasks, and what a task raises that keeps killing its worker."""
    try:
        from distributed import Client, KilledWorker, LocalCluster, as_completed
    except ImportError as missing:
        raise MotionError(
            'plan_many needs Dask, which is not installed: install this package with its extra "cluster", '
            'as pip install "pulsepath[cluster]"'
        ) from missing
    with ExitStack() as stack:
        if address is None:
            with main_hidden():
                local = LocalCluster(
                    n_workers=min(cores(), programs), threads_per_worker=1, processes=True, dashboard_address=None
                )
                cluster = stack.enter_context(local)
        try:
            client = stack.enter_context(Client(cluster if address is None else address, timeout=PATIENCE))
        except (OSError, ValueError) as silent:
            raise MotionError(f"no Dask scheduler answers at {address}: {silent}; check the address") from silent
        yield client, as_completed, KilledWorker
